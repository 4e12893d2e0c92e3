"""Declared effects beyond what they were found on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from effect_tables import table
from model_examples import (
    FloatArray,
    part_of,
    stated,
)

from mtu_cli.analyses.lengths import predict_lengths
from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.analyses.predict_points import predict_points
from mtu_cli.model.effect_ranges import (
    effect_warnings_at,
)
from mtu_cli.model.settings import Settings

MACHINE = """
constants: {z: 127}
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
equations: {Ex: a, Ey: 0.5*a}
effects:
"""
ONE = """
  - name: one
    parameters: {p: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: p*exp(-time_min/30)}
    seen: {time_min: [0, 100]}
"""
POINTS = np.array([[10.0, 20, 0], [70.0, 12, 0], [40.0, 28, 0]])


def told(
    folder: Path, effects: str, covariates: Mapping[str, FloatArray | float], points: FloatArray
) -> list[str]:
    found = effect_warnings_at(stated(folder, MACHINE + effects), points, covariates)
    assert all(item.code == "outside-effect-range" for item in found)
    return [f"{item.file}: " + " ".join(map(str, item.facts.values())) for item in found]


@pytest.mark.parametrize(
    ("time", "at"),
    [
        (0.0, None),
        (110.0, None),
        (-10.0, None),
        (110.1, "110.1"),
        (-50.0, "-50"),
        (1e6, "1000000"),
        (np.array([50.0, 150.0, -70.0]), "-70"),
    ],
)
def test_a_tenth_of_the_range_is_no_matter(
    tmp_path: Path, time: FloatArray | float, at: str | None
) -> None:
    found = told(tmp_path, ONE, {"time_min": time}, POINTS)
    one = f"machine.yaml: effects[0] (one) time_min from 0 to 100 extrapolated to {at}"
    assert found == ([] if at is None else [one])


def test_every_prediction_warns(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE + ONE)
    part = part_of(
        tmp_path,
        """
        features: {A: {x_mm: 0, y_mm: 0}, B: {x_mm: 90, y_mm: 0}, C: {x_mm: 90, y_mm: 90}}
        lengths: [{from: A, to: B}]
        orthogonality: [{id: xy, row: [A, B], column: [B, C]}]
        """,
    )
    settings, far = Settings(trials=1000), {"time_min": 500.0}
    for predicted in (predict_points, predict_lengths, predict_orthogonality):
        found = predicted(model, part, settings, far).warnings
        assert [w.code for w in found].count("outside-effect-range") == 1


def ranges_of(**covariates: FloatArray) -> dict[str, list[float]]:
    """The ranges of three parts with two features, one of which was not measured."""
    repeats = np.array([[1, 1], [1, 1], [1, 0]])
    places = np.array([[10.0, 5.0, np.nan], [1000 / 3, 5.0, np.nan]])
    own = table(3, 2, axes=("x",), places=places, covariates=covariates, repeats=repeats)
    return own.ranges(["x", "z", "load", "time_min"])


def test_ranges_are_those_of_the_measured_cells() -> None:
    """A column in its smallest shape, positions, and what the equations do not use."""
    time = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 99.0]])
    found = ranges_of(time_min=time, load=np.array([[7.0]]), sequence=np.arange(3.0)[:, None])
    assert found == {"x": [10.0, 333.3334], "load": [7.0, 7.0], "time_min": [0.0, 4.0]}


@pytest.mark.parametrize(
    "values",
    [
        [1234567.0, 1234571.0, 1234587.0],
        [1763770000.0, 1763771234.567, 1763773600.0],
        [19.8, 22.0, 26.1],
        [-1 / 3, 0.0, 2 / 3],
        [1e15, 1e15 + 1, 1e15 + 2],
        [1e-9 / 3, 0.0, 2e-9],
        [7.0, 7.0, 7.0],
        # A range, or a millionth of it, that is no number: its ends are as they are.
        [0.0, 5e-321, 1e-320],
        [-1e308, 0.0, 1e308],
    ],
)
def test_what_was_seen_lies_within_its_range(values: list[float]) -> None:
    """Rounded outward, and by the range: counters and seconds since 1970 have few digits of it."""
    low, high = ranges_of(load=np.array(values)[:, None])["load"]
    slack = 2e-6 * (max(values) - min(values))
    assert min(values) - slack <= low <= min(values)
    assert max(values) <= high <= max(values) + slack
