"""The report and picture of thermal-fit: names and units, nulls, the whole model, legibility."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import CONFIGS

from mtu_cli.analyses.thermal_fit import ThermalFit
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import fitted_drift
from mtu_cli.cli.options import Options
from mtu_cli.files.machine import load_machine
from mtu_cli.files.reports_read import ThermalReport, read_report
from mtu_cli.model.fit import thermal_from_report
from mtu_cli.reports.tables import plain_text
from mtu_cli.reports.thermal_fit import document, figure

STUDY = CONFIGS / "valdes-ring"
CONTRACT = {
    "model", "positions_mm", "sensors", "groups", "coefficients", "r2_fit", "rms_before_um",
    "rms_after_um", "held_out", "collinearity", "residuals", "of", "unit", "degree",
    "reference_temperature_degC", "time_constants_min", "covariance", "coefficient_dof",
    "leftover_covariance", "leftover_dof", "sensor_u_degC", "temperature_range_degC",
    "position_range_mm", "gradients", "inseparable",
}  # fmt: skip


@pytest.fixture(scope="module")
def fit() -> ThermalFit:
    """Of the shipped drift test: a length by degree 3 through four positions, two of degree 0."""
    inputs = Inputs(Options("thermal-fit", {"study": STUDY}))
    return fitted_drift(inputs, "ridge")


def written(fit: ThermalFit) -> dict[str, Any]:
    """The components of the report as a reader of the file finds them."""
    found: dict[str, Any] = json.loads(json.dumps(document(fit).record(), allow_nan=False))
    return dict(found["components"])


def test_names_and_units(fit: ThermalFit) -> None:
    found = written(fit)
    for name, unit, other, size in (
        ("pos_y", "um", "arcsec", 1e-3),
        ("yaw_y", "arcsec", "um", np.pi / 648000),
    ):
        entry, known = found[name], fit.components[name]
        assert set(entry) >= {key.replace("_um", f"_{unit}") for key in CONTRACT}
        assert f"_{other}" not in json.dumps(entry)
        held, expected, at = entry["held_out"], known.held_out, known.gradients[0]
        assert expected is not None
        assert (held["by"], entry["gradients"][0]["sensors"]) == ("cycle", list(at.sensors))
        pairs = {
            entry[f"rms_after_{unit}"]: known.rms_after,
            held[f"rms_before_{unit}"]: expected.before,
            held[f"rms_after_{unit}"]: expected.after,
            held[f"ordinary_{unit}"]: expected.ordinary,
            entry["gradients"][0][f"gradient_{unit}_per_degC"]: at.value,
        }
        assert list(pairs) == pytest.approx([value / size for value in pairs.values()])


def test_report_holds_the_whole_model(fit: ThermalFit, tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    path.write_text(json.dumps({"schema": "mtu/thermal-fit/1", "results": document(fit).record()}))
    report = read_report(path)
    assert isinstance(report, ThermalReport)
    back = thermal_from_report(load_machine(STUDY / "machine.yaml"), report)
    place = np.array([0.0, 40.0, 310.0])
    for name, item in fit.components.items():
        again, known = back[name], item.estimate
        T = {
            each: 20 + np.array([1.0, -2.0, 6.0]) * (s + 1) for s, each in enumerate(known.sensors)
        }
        np.testing.assert_allclose(again.drift(place, T), known.drift(place, T), rtol=1e-9)
        for key in ("covariance", "leftover", "time_constants", "sensor_u", "temperature_range"):
            np.testing.assert_allclose(getattr(again, key), getattr(known, key), rtol=1e-12)
        for key in ("coefficient_dof", "leftover_dof", "of", "reference"):
            assert getattr(again, key) == getattr(known, key)


def test_curves_lie_side_by_side_and_show_the_readings(fit: ThermalFit) -> None:
    found = fit.components["pos_y"]
    panel = figure(replace(fit, components={"pos_y": found})).axes[0]
    lines = [line for line in panel.lines if len(np.asarray(line.get_xdata())) > 2]
    curves = sorted(found.curves, key=lambda curve: found.cycles.index(curve.cycle))
    for curve, measured, modelled in zip(curves, lines[::2], lines[1::2], strict=True):
        np.testing.assert_allclose(np.asarray(measured.get_ydata()), curve.measured * 1e3)
        np.testing.assert_allclose(np.asarray(modelled.get_ydata()), curve.modelled * 1e3)
        assert measured.get_color() == modelled.get_color()
    starts = [np.asarray(line.get_xdata())[0] for line in lines]
    assert starts == sorted(starts)
    assert (len(lines), len({*starts})) == (32, 4)
    assert lines[0].get_color() != lines[2].get_color()


def test_details_have_the_gradient_of_every_sensor_at_every_position(fit: ThermalFit) -> None:
    (table,) = (each for each in document(fit).tables if "Gradients" in each.title)
    known = [each for item in fit.components.values() for each in item.gradients]
    sheet = table.sheet(2, detail=True)
    assert len(sheet.rows) == len(known) > 100
    heads = [column.title for column in sheet.columns]
    values = [row[heads.index("gradient\nper degC")] for row in sheet.rows]
    assert all("±" in value for value in values)
    assert "Gradients" not in plain_text(document(fit).blocks())
