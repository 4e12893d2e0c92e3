"""Declared effects beyond what they were found on, and those too large to be true."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_tables import table
from model_examples import FloatArray, loaded, part_of, stated

from mtu_cli.analyses.lengths import predict_lengths
from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.analyses.predict_points import predict_points
from mtu_cli.model.effect_ranges import _not_given, effect_warnings_at
from mtu_cli.model.fit import effects_on_readings
from mtu_cli.model.prediction import predict
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
TWO = ONE.replace("one", "two").replace("Ex", "Ey")
PLACE = """
  - name: bend
    parameters: {p: {value: 2.0, u: 0.3, unit: um/m^2}}
    equations: {Ex: p*(y - 20)**2*dir_x}
    seen: {y: [10, 30], dir_x: [1, 1]}
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
        (1e6, "1e+06"),
        (np.array([50.0, 150.0, -70.0]), "-70"),
    ],
)
def test_a_tenth_of_the_range_is_no_matter(
    tmp_path: Path, time: FloatArray | float, at: str | None
) -> None:
    found = told(tmp_path, ONE, {"time_min": time}, POINTS)
    one = f"machine.yaml: effects[0] (one) time_min from 0 to 100 extrapolated to {at}"
    assert found == ([] if at is None else [one])


def test_effects_that_left_the_same_range_are_told_together(tmp_path: Path) -> None:
    (found,) = told(tmp_path, ONE + TWO, {"time_min": 300.0}, POINTS)
    both = "machine.yaml: effects[0] (one), effects[1] (two)"
    assert found == f"{both} time_min from 0 to 100 extrapolated to 300"


def test_positions_and_columns_that_did_not_change(tmp_path: Path) -> None:
    assert told(tmp_path, PLACE, {"dir_x": 1.0}, POINTS) == []
    found = told(tmp_path, PLACE, {"dir_x": np.array([1.0, 1, -1])}, POINTS + np.array([0, 5, 0]))
    assert found == [
        "machine.yaml: effects[0] (bend) y from 10 to 30 mm extrapolated to 33 mm",
        "machine.yaml: effects[0] (bend) dir_x at 1 extrapolated to -1",
    ]
    # A coordinate that the machine fixes is no matter.
    text = PLACE.replace("(y - 20)**2", "z**2").replace("y: [10", "z: [10")
    assert told(tmp_path, text, {"dir_x": 1.0}, POINTS) == []


def test_ranges_may_be_left_out_and_change_no_prediction(tmp_path: Path) -> None:
    far, bare = {"time_min": 1e3}, ONE.replace("    seen: {time_min: [0, 100]}\n", "")
    assert told(tmp_path, bare, far, POINTS) == []
    one, other = (
        predict(stated(tmp_path, MACHINE + text), ["1", "2", "3"], POINTS, far)
        for text in (ONE, bare)
    )
    assert (one.mean == other.mean).all()
    assert (one.covariance == other.covariance).all()


@pytest.mark.parametrize(
    ("value", "unit", "equation", "length", "degC", "large"),
    [
        (900, "um", "Ey: p*dir_x", 70, 20, None),
        (-3, "mm", "Ey: p*dir_x", 70, 20, -3.0),
        (1100, "um", "Ey: p*dir_x", 70, 20, 1.1),
        # 11 um/m/K by 10 K over 24 m; with a temperature in kelvin 3 mm over one metre.
        (11, "um/m/K", "Ex: p*x*(T_a_degC - 20)", 23640, 30, None),
        (11, "um/m/K", "Ex: p*x*(T_a_degC - 20)", 1000, 293.15, 3.00465),
    ],
)
def test_an_effect_of_more_than_a_millimetre(
    tmp_path: Path,
    value: float,
    unit: str,
    equation: str,
    length: float,
    degC: float,
    large: float | None,
) -> None:
    text = f"  - name: e\n    parameters: {{p: {{value: {value}, u: 1, unit: {unit}}}}}\n"
    text = f"{MACHINE}{text}    equations: {{{equation}}}\n".replace("[1.0, 0.1]", "[1.0, 0.0]")
    points = np.array([[0.0, 20, 0], [length, 12, 0]])
    found = effect_warnings_at(stated(tmp_path, text), points, {"dir_x": 1.0, "T_a_degC": degC})
    assert [item.code for item in found] == ([] if large is None else ["effect-too-large"])
    assert [item.facts["value_mm"] for item in found] == (
        [] if large is None else [pytest.approx(large)]
    )


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


def test_readings_of_a_component_warn(tmp_path: Path) -> None:
    text = ONE + "    found: {component: a}\n"
    machine = loaded(tmp_path, MACHINE + text)
    places = np.column_stack([POINTS[:, 0], np.full((3, 2), np.nan)])
    for time, count in ((50.0, 0), (200.0, 1)):
        _, found = effects_on_readings(machine, "a", places, {"time_min": np.full(3, time)})
        assert [item.code for item in found] == ["outside-effect-range"] * count


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


@pytest.mark.parametrize(
    ("low", "high", "value", "words"),
    [
        (1234567, 1234587, 1234567.0, None),
        (1234567, 1234587, 1234597.0, "from 1234567 to 1234587 extrapolated to 1234597"),
        (1763770000, 1763770000, 1763773600.0, "at 1763770000 extrapolated to 1763773600"),
    ],
)
def test_large_numbers_are_told_apart(
    tmp_path: Path, low: int, high: int, value: float, words: str | None
) -> None:
    text = ONE.replace("time_min: [0, 100]", f"time_min: [{low}, {high}]")
    found = told(tmp_path, text, {"time_min": value}, POINTS)
    assert [words in item for item in found if words is not None] == ([True] if words else [])
    assert len(found) == (words is not None)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (None, "no value is given (--at T_room_degC)"),
        (np.full(4, np.nan), "no value is given (--at T_room_degC)"),
        (np.array([26.0, np.nan, 26.0, np.nan]), "2 of 4 points have no value"),
        (np.full(4, 26.0), None),
        (26.0, None),
    ],
)
def test_what_an_effect_holds_within_is_asked_of_all_points(given: Any, told: str | None) -> None:
    own = SimpleNamespace(
        file="m.yaml", index=0, name="scale-x", within=("T_room_degC",),
        seen={"T_room_degC": (26.0, 26.0)},
    )  # fmt: skip
    values = {} if given is None else {"T_room_degC": given}
    found = _not_given([own], values)  # type: ignore[list-item]  # all that it looks at
    assert [warned.code for warned in found] == ["outside-effect-range"] * (told is not None)
    assert told is None or told in found[0].message
