"""Where correct takes covariates from, and what it says of those that it cannot have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    DIAMETER,
    ROUNDING_MM,
    codes,
    error_at,
    machine,
    ring_part,
    ring_points,
    rings,
)
from model_examples import part_of, stated
from numpy.typing import NDArray

from mtu_cli.analyses.correct import correct, unused_warmth
from mtu_cli.findings import InputError
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import only_rows

SETTINGS = Settings()


def refused(model: MachineModel, part: object, points: object, **at: float) -> list[str]:
    with pytest.raises(InputError) as caught:
        correct(model, part, points, SETTINGS, at)  # type: ignore[arg-type]  # as given
    return [str(problem) for problem in caught.value.findings]


def test_covariates_come_from_the_rows_else_from_the_call(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    model, part = machine(tmp_path), ring_part(tmp_path)
    bare = ring_points(measured, ["a"])
    (message,) = refused(model, part, bare)
    assert "cmm.csv, column 'T_scale_degC': a value of T_scale_degC for the machine 'm'" in message
    assert "--at T_scale_degC=VALUE" in message
    given = correct(model, part, bare, SETTINGS, {"T_scale_degC": 20.0})
    assert given.error[:, :2] == pytest.approx(error_at(measured, np.full(11, 20.0))[:, :2])
    own = ring_points(measured, ["a"], None, {"T_scale_degC": temperature})
    both = correct(model, part, own, SETTINGS, {"T_scale_degC": 35.0})
    assert both.error[:, :2] == pytest.approx(error_at(measured, temperature)[:, :2])
    assert codes(both) == ["not-used"]


def test_cells_without_a_number_are_told_with_their_rows(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    model, part = machine(tmp_path), ring_part(tmp_path)
    holes = temperature.copy()
    holes[[3, 7]] = np.nan
    found = refused(model, part, ring_points(measured, ["a"], None, {"T_scale_degC": holes}))
    assert [text.split(":")[0] for text in found] == [
        "cmm.csv, row 5, column 'T_scale_degC'",
        "cmm.csv, row 9, column 'T_scale_degC'",
    ]
    texts = np.array([*(f"{value:.2f}" for value in temperature[:10]), "warm"], object)
    (message,) = refused(model, part, ring_points(measured, ["a"], None, {"T_scale_degC": texts}))
    assert "row 12, column 'T_scale_degC': not a number: 'warm'" in message


def test_what_was_not_measured_or_calibrated_is_said(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    own: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {"T_scale_degC": temperature}
    points = ring_points(measured, ["a"], None, own)
    model = machine(tmp_path)
    bare = correct(model, ring_part(tmp_path, calibrated_mm=""), points, SETTINGS)
    assert codes(bare) == ["not-estimable"]
    assert np.isnan(bare.sizes[0].error).all()
    assert bare.sizes[0].size[1] == pytest.approx(DIAMETER, abs=ROUNDING_MM)
    kept = np.arange(11) != 4
    found = correct(model, ring_part(tmp_path), only_rows(points, kept), SETTINGS)
    assert codes(found) == ["not-measured", "no-scatter-known"]
    assert found.sizes == ()
    other = part_of(tmp_path, "features: {q: {x_mm: 0, y_mm: 0}, w: {x_mm: 9, y_mm: 0}}\n"
                    "lengths: [{from: q, to: w}]\n")  # fmt: skip
    assert codes(correct(model, other, points, SETTINGS)) == ["not-measured", "no-scatter-known"]


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"T_a_degC": 20.9, "T_b_degC": 19.1, "load": 90.0}, None),
        ({"T_a_degC": 20.9, "T_b_degC": 26.0}, "(T_b_degC reads 26 degC)"),
        ({"T_a_degC": 17.5, "T_b_degC": 22.0, "T_c_degC": np.nan}, "reads 17.5 degC; 1 more se"),
    ],
)
def test_temperatures_that_nothing_in_the_model_goes_by_are_told(
    tmp_path: Path, columns: dict[str, float], told: str | None
) -> None:
    cold = stated(tmp_path, "components: {px: {unit: um, coefficients: [2], u_future: 1}}\n"
                            "equations: {Ex: px}\n")  # fmt: skip
    measured = rings(1)[1]
    own = {name: np.append(np.full(10, 20.0), value) for name, value in columns.items()}
    points = ring_points(measured, ["a"], None, dict(own))
    found = unused_warmth(cold, points, 20.0)
    assert [item.code for item in found] == ([] if told is None else ["no-thermal-component"])
    assert told is None or told in found[0].message
    assert unused_warmth(machine(tmp_path), points, 20.0) == []
