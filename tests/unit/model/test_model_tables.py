"""Tables of smooth profiles: intervals that cover, a report that predicts the same, their files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import read_components
from table_trials import SIGMA, TARGETS, axis_machine, axis_readings, bend, table_coverage

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.reports.fit_components import document
from mtu_cli.units import UM

X = np.linspace(0.0, 400.0, TARGETS)
AT = np.array([0.0, 20.0, 40.0, 333.0, 420.0])
POINTS = np.column_stack([AT, np.zeros((len(AT), 2))])
IDS = [f"{x:g}" for x in AT]


@pytest.mark.parametrize("own", [0.0, 1.0])
def test_future_readings_between_the_targets(own: float, tmp_path: Path) -> None:
    """The short version of tests/bench/test_bench_table.py."""
    found = table_coverage(axis_machine(tmp_path), 60, 6.0, seed=2, own=own)
    assert found.inside > 0.93
    assert found.width < (1.3 if own else 1.25)
    assert found.outside > 0.9


def test_readings_and_their_report_predict_the_same(tmp_path: Path) -> None:
    known, rng = axis_machine(tmp_path), np.random.default_rng(7)
    readings = axis_readings(X, bend(400.0, 4 * UM, rng), rng, own=2 * SIGMA)
    fit = fit_machine(known, readings)
    estimates = estimates_from_fit(known, fit)
    results = document(fit_result("m", fit, estimates)).record()
    item = results["components"]["dx_x"]
    assert item["shape"] == "table"
    assert item["degree"] is None
    assert item["at_mm"] == pytest.approx(X)
    assert item["between_um2"] == 0.0
    assert min(item["roughness_um2_per_mm3"], item["own_um2_per_mm3"]) > 0
    path = tmp_path / "components.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    again = estimates_from_report(known, read_components(path))

    def predicted(given: object) -> Prediction:
        return predict(build_model(known, given), IDS, POINTS)  # type: ignore[arg-type]

    first, second = predicted(estimates), predicted(again)
    assert second.mean == pytest.approx(first.mean, abs=1e-12)
    assert second.covariance == pytest.approx(first.covariance, rel=1e-9, abs=1e-18)
    assert second.variance().dof == pytest.approx(first.variance().dof, rel=1e-6)
    # What the interpolation leaves open: nothing at the targets, more beyond them.
    left = first.variance().by_block[1] / UM**2
    assert left[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert 0 < left[1] < left[4]
    assert [each[0] for each in first.outside] == ["420"]


@pytest.mark.parametrize(("amplitude", "degrees"), [(0.0, {0, 1}), (40.0, {None})])
def test_held_out_runs_choose_the_shape(
    amplitude: float, degrees: set[int | None], tmp_path: Path
) -> None:
    known, chosen = axis_machine(tmp_path, "degree: auto"), []
    for seed in range(6):
        rng = np.random.default_rng(seed)

        def wavy(x: np.ndarray) -> np.ndarray:
            return np.asarray(amplitude * SIGMA * np.sin(x / 25.0))

        readings = axis_readings(X, wavy, rng)
        chosen.append(fit_machine(known, readings).components["dx_x"].estimate.degree)
    assert sum(each in degrees for each in chosen) >= 5, chosen
