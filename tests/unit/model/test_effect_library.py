"""The library of effects: columns, equations and candidates, against formulas written out."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from effect_tables import FloatArray, grid_places, readings_table, shop_covariates, table

from mtu_cli.close_loop_sealed.model.effect_library import (
    BUILT_IN,
    Candidate,
    EffectLibrary,
    Member,
    candidates,
    effect_library,
)
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.covariates import own_columns
from mtu_cli.files.machine import load_machine
from mtu_cli.findings import InputError
from mtu_cli.language import check_dimension, evaluate, linear_form, names, parse
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import build_model, design
from mtu_cli.units import LENGTH, PARAMETER_UNITS, internal

OF_READINGS = {"scale-trend"}
"""Passes follow each other while a machine warms up."""
FAMILIES = {
    "offset",
    "scale",
    "curvature",
    "straightness",
    "squareness",
    "rotation",
    "backlash",
    "cyclic",
    "abbe",
    "thermal-drift",
    "thermal-growth",
    "thermal-squareness",
    "warm-up",
    "trend",
    "wear-approach",
    "step",
    "backlash-step",
    "operation",
    "radial",
    "covariate",
    "feature-outlier",
    "part-outlier",
    "rotation-scatter",
    "scale-scatter",
    "operation-scatter",
}
WITHOUT_EQUATION = {"operation", "feature-outlier", "part-outlier"}
PLANE = table()
SPACE = table(axes=("x", "y", "z"), places=grid_places(12, jitter=2.0, z=None))


@pytest.fixture(scope="module")
def library() -> EffectLibrary:
    return effect_library()


def by_name(found: tuple[Candidate, ...]) -> dict[str, Candidate]:
    assert len({candidate.name for candidate in found}) == len(found)
    return {candidate.name: candidate for candidate in found}


def values_of(own: ResidualTable) -> dict[str, FloatArray]:
    """Every name of the equations over the cells, (P, H)."""
    shape = own.repeats.shape
    values = {axis: own.places[..., i] for i, axis in enumerate("xyz")}
    return values | {n: np.broadcast_to(v, shape) for n, v in own.covariates.items()}


def column(member: Member, k: int, axis: int, own: ResidualTable) -> FloatArray:
    zero = np.zeros((1, 1))
    found: FloatArray = np.broadcast_to(member.columns[k].get(axis, zero), own.repeats.shape)
    return found


# ---- what is there


def test_every_family_has_its_candidates(library: EffectLibrary) -> None:
    assert {family.family.family for family in library.families} == FAMILIES | OF_READINGS
    found = by_name(candidates(PLANE, library))
    assert {candidate.family for candidate in found.values()} == FAMILIES
    pairs = {"squareness-xy", "rotation-z", "thermal-squareness-xy"}
    plain = {"thermal-growth", "radial", *(name for name in FAMILIES if name.endswith("er"))}
    per_axis = {
        f"{family}-{axis}"
        for axis in "xy"
        for family in FAMILIES - {"squareness", "rotation", "thermal-squareness", "radial"}
        if not family.endswith(("outlier", "scatter"))
    }
    assert set(found) == pairs | plain | per_axis
    for candidate in found.values():
        assert candidate.says
        assert "{" not in candidate.says + (candidate.separates or "") + candidate.name


def test_what_tells_effects_of_readings_apart_can_be_done_with_an_instrument(
    library: EffectLibrary,
) -> None:
    """There is no part, tool or fixture in a run of a laser."""
    axis = readings_table()
    warm = {"T_bed_degC": 20.0 + np.array([0.1, 1.3, 2.0, 2.6, 3.3, 3.5])[:, None]}
    own = replace(axis, covariates={**axis.covariates, **warm, "load": warm["T_bed_degC"] ** 2})
    found = by_name(candidates(own, library))
    assert {"trend-x", "step-x", "feature-outlier", "part-outlier", "warm-up-x"} <= set(found)
    can_be = [own for own in found.values() if own.members and own.kind != "scatter"]
    for candidate in can_be:
        words = set(re.findall(r"[a-z]+", candidate.separates or "until then"))
        of_parts = {"part", "parts", "tool", "fixture", "program", "feature", "features", "spindle"}
        assert not words & of_parts, (candidate.name, candidate.separates)


def test_a_position_may_stand_out_in_both_directions(library: EffectLibrary) -> None:
    """Beside each column by itself; of two positions each is off by what the other is not."""
    axis = readings_table()
    names = tuple(f"{50 * (i // 2)} {'+-'[i % 2]}" for i in range(len(axis.features)))
    axis = replace(axis, features=names)
    found = by_name(candidates(axis, library))["feature-outlier"]
    both = {m.chosen: m for m in found.members if m.chosen not in axis.features}
    assert list(both) == ["0", "50", "100", "150", "200", "250", "300"]
    lever = column(both["100"], 0, 0, axis)
    wanted = np.isin(axis.features, ["100 +", "100 -"]).astype(float)
    np.testing.assert_array_equal(np.broadcast_to(lever, axis.there.shape), [wanted] * 6)
    few = [i for i, name in enumerate(axis.features) if name.split()[0] in ("0", "50")]
    two = replace(
        axis, features=tuple(axis.features[i] for i in few), errors=axis.errors[:, few],
        repeats=axis.repeats[:, few], places=axis.places[:, few], operation=axis.operation[few],
        covariates={n: v[:, few] if v.shape[1] > 1 else v for n, v in axis.covariates.items()},
        common=axis.common[:, few], of_part=axis.of_part[:, few],
    )  # fmt: skip
    found = by_name(candidates(two, library))["feature-outlier"]
    assert {m.chosen for m in found.members} <= set(two.features)
    plain = by_name(candidates(PLANE, library))["feature-outlier"]
    assert {m.chosen for m in plain.members} == set(PLANE.features)


def test_a_growth_from_the_zero_of_an_axis_is_for_readings_alone(library: EffectLibrary) -> None:
    def from_zero(own: ResidualTable) -> list[bool]:
        grows = by_name(candidates(own, library))["thermal-growth-x"]
        forms = [parse(next(iter(member.equations.values()))) for member in grows.members]
        at = {"growth": 1.0, "x": 0.0}
        return [evaluate(form, dict.fromkeys(names(form), 27.0) | at) == 0.0 for form in forms]

    assert not any(from_zero(PLANE))
    axis = readings_table()
    warm = {"T_bed_degC": 20.0 + np.array([0.1, 1.3, 2.0, 2.6, 3.3, 3.5])[:, None]}
    own = replace(axis, covariates={**axis.covariates, **warm})
    found = from_zero(own)
    assert any(found)
    # Cell by cell x (T - 20), and the same from the day's mean.
    T, x = warm["T_bed_degC"], own.places[..., 0]
    grows = by_name(candidates(own, library))["thermal-growth-x"]
    told = [column(m, 0, 0, own) for m, zero in zip(grows.members, found, strict=True) if zero]
    for T0 in (20.0, T.mean()):
        plain = (T - T0) * x
        assert any(np.allclose(item, plain, rtol=1e-9, atol=1e-9) for item in told)
    assert not all(found)


def test_with_z_all_of_them_for_z_too(library: EffectLibrary) -> None:
    found = by_name(candidates(SPACE, library))
    for name in ("scale-z", "straightness-z", "squareness-xz", "squareness-yz", "rotation-x"):
        assert found[name].members, name
    assert found["rotation-x"].members[0].equations.keys() == {"Ey", "Ez"}
    assert found["rotation-y"].members[0].equations.keys() == {"Ez", "Ex"}
    assert len(found["straightness-z"].members) == 6
    assert "abbe-z" not in found
    assert found["backlash-z"].unavailable == "no column dir_z"
    assert found["thermal-growth"].members[0].equations.keys() == {"Ex", "Ey", "Ez"}


def test_places_at_several_heights_without_errors_in_z(library: EffectLibrary) -> None:
    places = grid_places(12, jitter=2.0)
    places[:, 2] = 10.0 * (np.arange(12) % 5)
    found = by_name(candidates(table(places=places), library))
    assert found["abbe-x"].members
    # A tilt along z of the error in x is no angle between measured axes.
    assert not {"scale-z", "rotation-x", "rotation-y", "squareness-xz"} & set(found)
    # The error in x bends along y or along z.
    assert len(found["straightness-x"].members) == 6
    along = {text for m in found["straightness-x"].members for text in m.equations.values()}
    assert sum("y -" in text for text in along) == sum("z -" in text for text in along) == 3


@pytest.mark.parametrize(
    ("name", "kind", "members", "k"),
    [
        ("offset-x", "offset", 1, 1),
        ("curvature-x", "mean", 3, 2),
        ("straightness-y", "mean", 3, 2),
        ("squareness-xy", "mean", 3, 1),
        ("thermal-drift-x", "mean", 2, 1),
        ("thermal-squareness-xy", "mean", 6, 1),
        ("trend-x", "mean", 2, 1),
        ("wear-approach-x", "mean", 4, 1),
        ("step-y", "mean", 6, 1),
        ("backlash-step-y", "mean", 6, 1),
        ("warm-up-x", "mean", 12, 1),
        ("operation-x", "mean", 3, 1),
        ("covariate-x", "mean", 1, 1),
        ("feature-outlier", "outlier", 12, 2),
        ("part-outlier", "outlier", 9, 2),
        ("rotation-scatter", "scatter", 0, None),
    ],
)
def test_members(library: EffectLibrary, name: str, kind: str, members: int, k: int | None) -> None:
    found = by_name(candidates(PLANE, library))[name]
    assert (found.kind, len(found.members)) == (kind, members)
    assert found.unavailable is None
    assert found.members == () or len(found.members[-1].columns) == k


# ---- columns against formulas written out, cell by cell

Cell = Mapping[str, float]
Formula = Callable[[Cell], dict[str, float]]


def _step(at: int) -> Formula:
    return lambda c: {"x": float(c["sequence"] > at)}


def _play_from(at: int) -> Formula:
    return lambda c: {"x": c["dir_x"] if c["sequence"] > at else 0.0}


def _on(code: int) -> Formula:
    return lambda c: {"x": float(c["operation"] == code)}


def oracle(own: ResidualTable) -> dict[str, list[Formula]]:
    """Candidate -> some of its members: errors in mm by axis for a parameter of 1."""
    x0, y0 = own.places[..., 0].mean(), own.places[..., 1].mean()
    d = own.places[..., 0] - x0
    third = (d**4).sum() / (d**2).sum()
    T0 = np.broadcast_to(own.covariates["T_spindle_degC"], d.shape).mean()
    tools0 = own.covariates["tool_parts"].mean()

    def outward(c: Cell) -> float:
        return math.hypot(c["x"] - x0, c["y"] - y0)

    return {
        "offset-y": [lambda c: {"y": 1.0}],
        "scale-x": [lambda c: {"x": c["x"] - x0}],
        "curvature-x": [
            lambda c: {"x": (c["x"] - x0) ** 2},
            lambda c: {"x": (c["x"] - x0) ** 3 - third * (c["x"] - x0)},
        ],
        "straightness-x": [lambda c: {"x": (c["y"] - y0) ** 2}],
        "squareness-xy": [
            lambda c: {"x": y0 - c["y"]},
            lambda c: {"y": x0 - c["x"]},
            lambda c: {"x": (y0 - c["y"]) / 2, "y": (x0 - c["x"]) / 2},
        ],
        "rotation-z": [lambda c: {"x": y0 - c["y"], "y": c["x"] - x0}],
        "backlash-y": [lambda c: {"y": c["dir_y"]}],
        "thermal-drift-x": [lambda c: {"x": c["T_spindle_degC"] - T0}],
        "thermal-growth-y": [
            lambda c: {"y": (c["y"] - y0) * (c["T_spindle_degC"] - 20.0)},
            lambda c: {"y": (c["y"] - y0) * (c["T_spindle_degC"] - T0)},
        ],
        "thermal-growth": [
            lambda c: {
                "x": (c["x"] - x0) * (c["T_spindle_degC"] - T0),
                "y": (c["y"] - y0) * (c["T_spindle_degC"] - T0),
            }
        ],
        "thermal-squareness-xy": [
            lambda c: {"x": (y0 - c["y"]) * (c["T_spindle_degC"] - T0)},
            lambda c: {"y": (x0 - c["x"]) * (c["T_spindle_degC"] - T0)},
            lambda c: {
                "x": (y0 - c["y"]) / 2 * (c["T_spindle_degC"] - T0),
                "y": (x0 - c["x"]) / 2 * (c["T_spindle_degC"] - T0),
            },
        ],
        "trend-x": [
            lambda c: {"x": c["sequence"] - 5.0},
            lambda c: {"x": c["tool_parts"] - tools0},
        ],
        "wear-approach-y": [
            lambda c: {"y": (c["sequence"] - 5.0) * c["dir_y"]},
            lambda c: {"y": (c["tool_parts"] - tools0) * c["dir_y"]},
            lambda c: {"y": (c["sequence"] - 1.0) * c["dir_y"]},
            lambda c: {"y": (c["tool_parts"] - 1.0) * c["dir_y"]},
        ],
        "step-x": [_step(at) for at in range(2, 8)],
        "backlash-step-x": [_play_from(at) for at in range(2, 8)],
        "radial": [
            lambda c: {"x": (c["x"] - x0) / outward(c), "y": (c["y"] - y0) / outward(c)},
        ],
        "operation-x": [_on(code) for code in range(3)],
    }


@pytest.mark.parametrize("name", sorted(oracle(PLANE)))
def test_columns_are_the_formulas(library: EffectLibrary, name: str) -> None:
    found = by_name(candidates(PLANE, library))[name]
    values = values_of(PLANE) | {"operation": np.broadcast_to(PLANE.operation, (9, 12))}
    own = [
        np.stack([column(member, 0, axis, PLANE) for axis in (0, 1)], axis=-1)
        for member in found.members
        if len(member.columns) == 1
    ]
    for formula in oracle(PLANE)[name]:
        plain = np.zeros((9, 12, 2))
        for i in range(9):
            for j in range(12):
                errors = formula({key: float(value[i, j]) for key, value in values.items()})
                plain[i, j] = [errors.get("x", 0.0), errors.get("y", 0.0)]
        scale = np.abs(plain).max()
        same = [np.abs(columns - plain).max() <= 1e-9 * scale for columns in own]
        assert sum(same) == 1, (name, [m.equations for m in found.members])


def test_outliers_move_one_column_or_one_part(library: EffectLibrary) -> None:
    found = by_name(candidates(PLANE, library))
    for name, what, index in (
        ("feature-outlier", "H4", (slice(None), 3)),
        ("part-outlier", "P4", 3),
    ):
        member = next(m for m in found[name].members if m.chosen == what)
        assert member.parameters == (("shift_x", "um"), ("shift_y", "um"))
        for axis in (0, 1):
            expected = np.zeros((9, 12))
            expected[index] = 1.0
            assert (column(member, axis, axis, PLANE) == expected).all()
            assert 1 - axis not in member.columns[axis]


def test_the_third_order_is_orthogonal_to_the_first(library: EffectLibrary) -> None:
    found = by_name(candidates(SPACE, library))
    for axis, name in enumerate(("curvature-x", "curvature-y", "curvature-z")):
        if axis == 2:
            # Two heights: nothing bends.
            assert found[name].unavailable is not None
            continue
        cubic = column(found[name].members[1], 0, axis, SPACE)
        place = SPACE.places[..., axis]
        linear = place - place.mean()
        assert abs((cubic * linear).sum()) < 1e-9 * np.linalg.norm(cubic) * np.linalg.norm(linear)


# ---- equations give the columns back


def equations_of(own: ResidualTable, library: EffectLibrary) -> list[tuple[Candidate, Member]]:
    return [
        (candidate, member)
        for candidate in candidates(own, library)
        for member in candidate.members
        if candidate.family not in WITHOUT_EQUATION
    ]


@pytest.mark.parametrize("own", [PLANE, SPACE, readings_table(), readings_table(unit="arcsec")])
def test_equations_evaluate_to_the_columns(library: EffectLibrary, own: ResidualTable) -> None:
    values = values_of(own)
    pairs = equations_of(own, library)
    assert {c.family for c, _ in pairs} >= {"scale", "backlash", "cyclic", "step", "warm-up"}
    for candidate, member in pairs:
        names = [name for name, _ in member.parameters]
        assert member.equations.keys() == {
            f"E{own.axes[axis]}" for column in member.columns for axis in column
        }, candidate.name
        for key, text in member.equations.items():
            axis = own.axes.index(key[1:])
            form = linear_form(parse(text), names)
            assert form.remainder is None
            for k, name in enumerate(names):
                if name in form.coefficients:
                    back = evaluate(form.coefficients[name], values)
                    expected = column(member, k, axis, own)
                    # sin, cos and exp may differ by one bit between long and short arrays.
                    transcendental = "sin" in text or "exp" in text
                    tolerance = 4e-16 * max(1.0, np.abs(expected).max()) if transcendental else 0.0
                    assert np.abs(back - expected).max() <= tolerance, (candidate.name, text)


def entry(name: str, candidate: Candidate, member: Member) -> dict[str, Any]:
    return {
        "name": name,
        "family": candidate.family,
        "axis": candidate.axis,
        "covariate": member.covariate,
        "says": candidate.says,
        "parameters": {n: {"value": 1.0, "u": 0.1, "unit": u} for n, u in member.parameters},
        "equations": member.equations,
    }


@pytest.mark.parametrize("own", [PLANE, SPACE])
def test_a_machine_file_takes_every_member_and_predicts_its_columns(
    library: EffectLibrary, own: ResidualTable, tmp_path: Path
) -> None:
    pairs = [(f"{i}", c, m) for i, (c, m) in enumerate(equations_of(own, library))]
    machine = {
        "schema": "mtu/machine/1",
        "name": "m",
        "covariates": ["tool_parts", "load"],
        "components": {"a0": {"unit": "um", "coefficients": [0.0]}},
        "equations": {f"E{axis}": "a0" for axis in own.axes},
        "effects": [entry(*pair) for pair in pairs],
    }
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(machine), encoding="utf-8")
    loaded = load_machine(tmp_path / "m.yaml")
    model = build_model(loaded, estimates_from_fit(loaded, None))
    shape = own.repeats.shape
    values = {n: np.broadcast_to(v, shape).ravel() for n, v in own.covariates.items()}
    J = design(model, own.places.reshape(-1, 3), values).J.reshape(*shape, len(own.axes), -1)
    place = {term.estimate.name: i for i, term in enumerate(model.terms)}
    for name, candidate, member in pairs:
        for k, (parameter, _) in enumerate(member.parameters):
            for axis in range(len(own.axes)):
                back = J[:, :, axis, place[f"{name}.{parameter}"]]
                expected = column(member, k, axis, own)
                scale = max(1.0, np.abs(expected).max())
                assert np.abs(back - expected).max() <= 4e-16 * scale, (candidate.name, k)


# ---- searched parameters


def test_a_pitch_is_searched_in_even_frequencies(library: EffectLibrary) -> None:
    own = table(places=grid_places(12, jitter=3.0))
    found = by_name(candidates(own, library))["cyclic-x"]
    pitches = np.array([member.searched["pitch_mm"] for member in found.members])
    span = float(np.ptp(own.places[..., 0]))
    # Of a longer one less than two periods are there.
    assert pitches[0] == pytest.approx(span / 2.0)
    assert 2.0 <= pitches[-1] < 10.0
    steps = np.diff(1.0 / pitches)
    assert np.ptp(steps) < 1e-12
    family = next(f for f in library.families if f.family.family == "cyclic")
    most = family.family.search["pitch_mm"].count
    # A quarter of 1/span, unless that were too many.
    assert steps[0] <= 0.25 / span * (1.0 + 1e-12) or len(pitches) == most
    sine = np.sin(2.0 * np.pi * own.places[..., 0] / pitches[5])
    assert column(found.members[5], 0, 0, own) == pytest.approx(sine, abs=1e-12)


@pytest.mark.parametrize(("longest", "missed"), [(1000.0, False), (20_000.0, True)])
def test_pitches_that_lie_between_those_searched_are_told(
    library: EffectLibrary, longest: float, missed: bool
) -> None:
    """No more than 2000 are searched, of the 40 000 that places over 20 m ask for."""
    places = grid_places(12, jitter=3.0)
    places[:, 0] = np.concatenate([10.0 + 3.3 * np.arange(11), [longest]])
    found = by_name(candidates(table(places=places), library))["cyclic-x"]
    told = [note for note in found.notes if "may be missed" in note]
    assert bool(told) == missed
    if missed:
        assert told[0].startswith("2000 values of pitch_mm were searched, 5 periods apart over")


def test_of_many_large_columns_some_parts_are_told_to_stand_for_others(
    library: EffectLibrary,
) -> None:
    """496 places of a jump, each with 50 000 numbers: no more than 2e6 are kept."""
    found = by_name(candidates(table(500, 100, places=grid_places(100, jitter=2.0)), library))
    thinned, whole = found["backlash-step-y"], found["step-x"]
    at = [m.searched["at"] for m in thinned.members]
    assert np.diff(at) == pytest.approx(13.0)
    said = f"{len(at)} values of at were searched, one in 13 of those of the data"
    assert [note for note in thinned.notes if note.startswith(said)]
    assert len(whole.members) == 497
    assert not [note for note in whole.notes if "were searched" in note]


def test_pitches_that_a_regular_grid_cannot_tell_apart_are_told_once(
    library: EffectLibrary,
) -> None:
    found = by_name(candidates(PLANE, library))["cyclic-x"]
    # Four places a row, 130/3 mm apart: sin and cos of at most one frequency below half of
    # 1/spacing, besides the offset.
    assert any("look like others" in note for note in found.notes)
    # What was left out is told by the member that is the same: beside an offset sine and cosine
    # of either span the same space (dense projectors).
    x = PLANE.places[0, :, 0]

    def projector(pitch: float) -> FloatArray:
        phase = 2.0 * np.pi * x / pitch
        Q, _ = np.linalg.qr(np.column_stack([np.ones_like(x), np.sin(phase), np.cos(phase)]))
        return np.asarray(Q @ Q.T)

    told = [(m.searched["pitch_mm"], other) for m in found.members for other in m.alike]
    assert told
    for pitch, other in told:
        assert pitch > other
        np.testing.assert_allclose(projector(pitch), projector(other), atol=0.05)
    X = [
        np.stack([column(m, k, 0, PLANE)[0] for k in range(len(m.columns))], axis=1)
        for m in found.members
    ]
    for i, first in enumerate(X):
        for second in X[:i]:
            # A sine alone may be one of the sines that two columns make.
            assert first.shape != second.shape or shared(first, second) < 1.0 - 1e-7


def shared(first: FloatArray, second: FloatArray) -> float:
    """Mean squared canonical correlation of two pairs of columns beside an offset."""
    Q = [np.linalg.qr(X - X.mean(axis=0))[0] for X in (first, second)]
    return float(np.mean(np.linalg.svd(Q[0].T @ Q[1], compute_uv=False) ** 2))


@pytest.mark.parametrize(
    ("x", "pitch", "equation"),
    [
        (50.0 * np.arange(1, 6), 100.0, "cosine*cos(2*pi*x/100)"),
        (25.0 + 50.0 * np.arange(5), 100.0, "sine*sin(2*pi*x/100)"),
        (10.0 + 30.0 * np.arange(5), 60.0, "sine*sin(2*pi*x/60)"),
    ],
    ids=["no-sine", "no-cosine", "in-step"],
)
def test_of_a_wave_that_has_one_column_at_these_places_that_one_stays(
    library: EffectLibrary, x: FloatArray, pitch: float, equation: str
) -> None:
    """Twice the steps: sine and cosine alternate, or are 0 up to rounding."""
    places = np.stack([np.repeat(x, 2), np.tile([0.0, 60.0], 5), np.full(10, 127.0)], axis=1)
    own = table(H=10, places=places)
    members = by_name(candidates(own, library))["cyclic-x"].members
    (found,) = [m for m in members if m.searched["pitch_mm"] == pytest.approx(pitch)]
    assert list(found.equations) == ["Ex"]
    shown = re.sub(r"/[0-9.]+", f"/{pitch:g}", found.equations["Ex"])
    assert shown == equation
    assert (len(found.columns), len(found.tangent), len(found.parameters)) == (1, 1, 1)
    for member in members:
        for k in range(len(member.columns)):
            assert np.std(column(member, k, 0, own)) > 1e-4


def test_tangents_are_derivatives_by_the_logarithm(library: EffectLibrary) -> None:
    found = by_name(candidates(PLANE, library))
    x, time = PLANE.places[0, :, 0], PLANE.covariates["time_min"]
    for member in found["cyclic-x"].members:
        phase = 2.0 * np.pi * x / member.searched["pitch_mm"]
        wanted = {"sine": -phase * np.cos(phase), "cosine": phase * np.sin(phase)}
        assert len(member.tangent) == len(member.parameters)
        for (name, _), tangent in zip(member.parameters, member.tangent, strict=True):
            assert tangent[0][0] == pytest.approx(wanted[name], rel=1e-6, abs=1e-6)
    for member in found["warm-up-y"].members:
        ratio = time / member.searched["tau_min"]
        assert member.tangent[0][1] == pytest.approx(-ratio * np.exp(-ratio), rel=1e-6, abs=1e-7)
    assert all(member.tangent == () for member in found["step-x"].members)
    assert all(member.tangent == () for member in found["scale-x"].members)


def test_time_constants_and_steps(library: EffectLibrary) -> None:
    found = by_name(candidates(PLANE, library))
    span = float(np.ptp(PLANE.covariates["time_min"]))
    tau = [member.searched["tau_min"] for member in found["warm-up-x"].members]
    assert tau == pytest.approx(np.geomspace(span / 50.0, 2.0 * span, 12))
    # Nine parts, two on either side at least: half-way from 2.5 to 7.5.
    assert [m.searched["at"] for m in found["step-x"].members] == [2.5, 3.5, 4.5, 5.5, 6.5, 7.5]


# ---- numbers of the data, kinds of columns


def test_centres_are_those_of_the_measured_cells(library: EffectLibrary) -> None:
    repeats = np.full((9, 12), 2)
    repeats[4:, 5:] = 0
    repeats[0, 0] = 7
    own = table(repeats=repeats)
    found = by_name(candidates(own, library))
    there = repeats > 0
    x = own.places[..., 0][there]
    sequence = np.broadcast_to(own.covariates["sequence"], (9, 12))[there]
    member = found["scale-x"].members[0]
    assert member.columns[0][0].shape == (1, 12)
    assert own.places[0, :, 0] - member.columns[0][0][0] == pytest.approx(np.full(12, x.mean()))
    trend = found["trend-x"].members[0].columns[0][0][:, 0]
    assert np.arange(1.0, 10.0) - trend == pytest.approx(np.full(9, sequence.mean()))


@pytest.mark.parametrize(
    ("values", "counts"),
    [
        ([1, 2, 3, 1, 2, 3, 1, 2, 3], True),
        ([5, 6, 7, 8, 9, 10, 11, 12, 13], True),
        ([1, 1, 1, 2, 2, 2, 3, 3, 3], True),
        ([0, 10, 20, 30, 0, 10, 20, 30, 40], True),
        ([1, 2, 1, 2, 1, 2, 1, 2, 1], False),
        ([4, 9, 2, 7, 1, 8, 3, 6, 5], False),
        ([9, 8, 7, 6, 5, 4, 3, 2, 1], False),
        ([1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5], False),
        ([1, 2, 3, 4, 9, 8, 9, 10, 11], False),
    ],
)
def test_which_columns_count_parts(
    library: EffectLibrary, values: list[float], counts: bool
) -> None:
    covariates = shop_covariates(9, 12) | {"n": np.array(values, float)[:, None]}
    found = by_name(candidates(table(covariates=covariates), library))
    assert ("n" in {m.covariate for m in found["trend-x"].members}) == counts or (
        # A count that runs as the sequence does is dropped as its copy.
        counts and any("n" in note for note in found["trend-x"].notes)
    )
    assert ("n" in {m.covariate for m in found["covariate-x"].members}) == (not counts)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_the_unit_of_a_column_makes_it_no_other(library: EffectLibrary, size: float) -> None:
    """Its square is no number then."""
    covariates = shop_covariates(9, 12)
    covariates["press"] = size * covariates["T_part_degC"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = by_name(candidates(table(covariates=covariates), library))
    notes = found["thermal-drift-x"].notes + found["covariate-x"].notes
    assert any("press is a copy of T_part_degC" in note for note in notes)


def test_copies_are_named_and_tested_once(library: EffectLibrary) -> None:
    covariates = shop_covariates(9, 12)
    covariates["T_twin_degC"] = 1.8 * covariates["T_spindle_degC"] + 32.0
    covariates["dir_z"] = -covariates["dir_x"]
    found = by_name(candidates(table(covariates=covariates), library))
    assert {m.covariate for m in found["thermal-drift-x"].members} == {
        "T_spindle_degC",
        "T_part_degC",
    }
    note = "T_twin_degC is a copy of T_spindle_degC here: the two cannot be told apart"
    assert note in found["thermal-drift-x"].notes
    assert any("is the same as" in note for note in found["thermal-drift-x"].notes)
    assert any("dir_z is a copy of dir_x" in note for note in found["backlash-x"].notes)


# ---- what cannot be tested


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("backlash-x", {"dir_x": np.ones((1, 1))}, "dir_x does not change"),
        ("backlash-x", {"dir_x": None}, "no column dir_x"),
        ("backlash-x", {"dir_x": np.full((9, 1), np.nan)}, "dir_x has gaps"),
        ("warm-up-y", {"time_min": None}, "no column time_min"),
        ("covariate-x", {"load": None}, "no other numeric column"),
        ("trend-y", {"sequence": None, "tool_parts": None}, "no column counts parts"),
        ("step-y", {"sequence": np.array([[1.0], [2], [3]] * 3)}, "too few values of sequence"),
        (
            "thermal-drift-x",
            {"T_spindle_degC": None, "T_part_degC": None},
            "no column T_..._degC without gaps",
        ),
        (
            "thermal-growth",
            {"T_spindle_degC": None, "T_part_degC": np.full((1, 1), 20.0)},
            "T_part_degC does not change",
        ),
    ],
)
def test_the_reason_is_told(
    library: EffectLibrary, name: str, changes: dict[str, FloatArray | None], reason: str
) -> None:
    covariates = {
        key: value for key, value in (shop_covariates(9, 12) | changes).items() if value is not None
    }
    own = by_name(candidates(table(covariates=covariates), library))[name]
    assert own.members == ()
    assert own.unavailable is not None
    assert reason in own.unavailable


def test_a_member_that_cannot_be_tested_is_a_note_beside_the_others(
    library: EffectLibrary,
) -> None:
    covariates = shop_covariates(9, 12) | {
        "T_cmm_degC": np.full((1, 1), 20.0),
        "my load": np.ones((9, 1)),
    }
    found = by_name(candidates(table(covariates=covariates), library))
    assert found["thermal-drift-x"].members
    assert "T_cmm_degC does not change" in found["thermal-drift-x"].notes
    assert "equations cannot use the column 'my load'" in found["covariate-x"].notes


def test_one_row_of_holes_one_part_one_operation(library: EffectLibrary) -> None:
    places = grid_places(4)
    places[:, 1] = 50.0
    own = table(1, 4, places=places, covariates={}, operations=("drilled",))
    found = by_name(candidates(own, library))
    # Three or four places in a line along x.
    for name in ("scale-y", "curvature-y", "radial", "trend-x", "step-x", "part-outlier"):
        assert found.get(name) is None or not found[name].members, name
    assert found["operation-x"].unavailable == "there is one operation only"
    assert found["part-outlier"].unavailable == "there is one part only"
    assert found["operation-scatter"].unavailable == "there is one operation only"
    assert found["scale-x"].members


def test_two_places_bend_nothing(library: EffectLibrary) -> None:
    found = by_name(candidates(table(5, 4), library))
    reason = "too few distinct values to tell it from an offset"
    assert found["curvature-x"].unavailable == reason
    assert found["straightness-x"].unavailable == reason
    assert found["scale-x"].members


def test_three_even_places_have_a_second_but_no_third_order(library: EffectLibrary) -> None:
    found = by_name(candidates(table(5, 9), library))
    assert [len(m.columns) for m in found["curvature-x"].members] == [1]
    assert found["curvature-x"].members[0].parameters == (("bend", "um/m^2"),)


def test_unknown_places_and_nothing_measured(library: EffectLibrary) -> None:
    own = table(places=np.full((12, 3), np.nan), repeats=np.zeros((9, 12), np.int64))
    found = by_name(candidates(own, library))
    assert found["scale-x"].unavailable == "the position along x is not known"
    assert found["offset-x"].members
    assert found["backlash-x"].members


def test_a_place_at_the_centre_has_no_outward_direction(library: EffectLibrary) -> None:
    found = by_name(candidates(table(5, 9), library))["radial"]
    assert found.members[0].columns[0][0][0, 4] == pytest.approx(0.0, abs=1e-3)
    assert np.isfinite(found.members[0].columns[0][0]).all()


# ---- readings of a component


def test_readings_have_the_families_of_one_axis(library: EffectLibrary) -> None:
    found = by_name(candidates(readings_table(), library))
    assert {name for name, c in found.items() if c.members} == {
        "offset-x",
        "scale-x",
        "curvature-x",
        "backlash-x",
        "cyclic-x",
        "warm-up-x",
        "trend-x",
        "scale-trend-x",
        "wear-approach-x",
        "step-x",
        "backlash-step-x",
        "feature-outlier",
        "part-outlier",
    }
    assert {m.covariate for m in found["trend-x"].members} == {"sequence", "time_min"}
    units = {m.covariate: m.parameters for m in found["trend-x"].members}
    assert units == {"sequence": (("slope", "um"),), "time_min": (("slope", "um/min"),)}
    units = {m.covariate: m.parameters for m in found["scale-trend-x"].members}
    assert units == {"sequence": (("rate", "um/m"),), "time_min": (("rate", "um/m/min"),)}
    assert not any(name.startswith(("squareness", "rotation", "radial")) for name in found)


def test_passes_grow_by_the_rate_a_length_and_a_pass(library: EffectLibrary) -> None:
    """Whatever both are counted from, each form has the product of their differences."""
    found = by_name(candidates(readings_table(), library))["scale-trend-x"]
    assert len(found.members) == 4
    for member in found.members:
        (form,) = (parse(text) for text in member.equations.values())
        corners = [
            evaluate(form, {"rate": 1.0, "x": x, "sequence": c, "time_min": c})
            for x, c in ((40.0, 2.0), (40.0, 7.0), (290.0, 2.0), (290.0, 7.0))
        ]
        grown = corners[3] - corners[2] - corners[1] + corners[0]
        assert grown == pytest.approx(250.0 * 5.0, rel=1e-9)


def test_readings_of_an_angle_are_in_arcsec(library: EffectLibrary) -> None:
    found = by_name(candidates(readings_table(unit="arcsec"), library))
    units = {unit for c in found.values() for m in c.members for _, unit in m.parameters}
    assert units == {
        "arcsec", "arcsec/m", "arcsec/m^2", "arcsec/m^3", "arcsec/min", "arcsec/m/min"
    }  # fmt: skip
    assert units <= set(PARAMETER_UNITS)


def test_members_of_readings_have_units_that_a_machine_file_takes(library: EffectLibrary) -> None:
    for member in (m for c in candidates(readings_table(), library) for m in c.members[:2]):
        units = {name: PARAMETER_UNITS[unit] for name, unit in member.parameters}
        for text in member.equations.values():
            tree = parse(text)
            columns = own_columns(names(tree), units)
            check_dimension(tree, internal(LENGTH), {}, parameters=units, columns=columns)


TIMED = """
- family: creep
  says: s
  parameters: {k: UNIT}
  equations:
    E{a}: "EQUATION"
"""


SEARCHED = "  search: {tau: {from: 5, to: 50, count: 3}}\n"


@pytest.mark.parametrize(
    ("unit", "equation", "told"),
    [
        ("um/m", "k*{a}*({c} - {c0})", "um/m/min"),
        ("um", "k*({c} - {c0})/10", "um"),
        ("um", "k*({c} - {c0})**2", "um"),
        ("um/m^2", "k*{a}**2*({c} - {c0})", "urad/m/min"),
        ("um/m^3", "k*{a}**3*({c} - {c0})", None),
        ("um", "k*{c}/tau", "um"),
        ("um", "k*{c}*exp(-{c}/tau)", "um/min"),
        ("um", "k*({c} + sequence)", None),
        ("um", "k*({c} + dir_{a})", None),
    ],
)
def test_a_unit_beside_the_time(tmp_path: Path, unit: str, equation: str, told: str | None) -> None:
    text = TIMED.replace("UNIT", unit).replace("EQUATION", equation)
    text += SEARCHED if "tau" in equation else ""
    (tmp_path / "own.yaml").write_text(text, encoding="utf-8")
    found = by_name(candidates(readings_table(), effect_library([tmp_path / "own.yaml"])))
    units = {m.covariate: m.parameters[0][1] for m in found["creep-x"].members}
    assert units == {"sequence": unit} | ({} if told is None else {"time_min": told})
    why = "time_min in place of {c}: what is added is an angle or ratio (rad), not a time (min)"
    why = why if "+" in equation else "um/m^3 of k has no unit per minute"
    assert (why in " ".join(found["creep-x"].notes)) == (told is None)


def test_readings_of_a_component_without_an_axis(library: EffectLibrary) -> None:
    own = readings_table(name="axy", component="axy", unit="arcsec")
    found = by_name(candidates(own, library))
    assert found["offset-axy"].members[0].equations == {"Eaxy": "shift"}
    assert found["trend-axy"].members
    units = {m.covariate: m.parameters for m in found["trend-axy"].members}
    assert units["time_min"] == (("slope", "arcsec/min"),)
    assert "scale-axy" not in found
    assert "cyclic-axy" not in found


@pytest.mark.parametrize(("degree", "gone"), [(0, {"offset-x"}), (1, {"offset-x", "scale-x"})])
def test_what_the_fitted_polynomial_holds_is_no_candidate(
    library: EffectLibrary, degree: int, gone: set[str]
) -> None:
    found = by_name(candidates(readings_table(fitted_degree=degree), library))
    reason = "the polynomial that was fitted to these readings holds it"
    assert {name for name, c in found.items() if c.unavailable == reason} == gone
    cubic = readings_table(fitted_degree=2)
    orders = by_name(candidates(cubic, library))["curvature-x"].members
    assert [m.parameters[0][0] for m in orders] == ["cubic"]


# ---- choice, users' own families, size


def test_excluded_by_candidate_and_by_family(library: EffectLibrary) -> None:
    everything = {candidate.name for candidate in candidates(PLANE, library)}
    left = {c.name for c in candidates(PLANE, library, ["backlash-x", "cyclic", "rotation-x"])}
    assert everything - left == {"backlash-x", "cyclic-x", "cyclic-y"}


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("baclash-x", "did you mean 'backlash-x'?"),
        ("BACKLASH-Z", "did you mean 'backlash-z'?"),
        ("drift", "did you mean 'thermal-drift'?"),
        (
            "Thermal",
            "did you mean 'thermal-drift' or 'thermal-growth' or 'thermal-squareness'?",
        ),
        ("", "operation-scatter) or one of its effects, such as backlash-x;"),
        ("nonsense", "operation-scatter) or one of its effects, such as backlash-x;"),
    ],
)
def test_a_name_that_no_effect_has(library: EffectLibrary, name: str, meant: str) -> None:
    """Near names, or every family there is."""
    with pytest.raises(InputError) as caught:
        candidates(PLANE, library, [name])
    assert meant in str(caught.value)
    if "scatter)" in meant:
        assert all(family in str(caught.value) for family in FAMILIES)


OWN = """
- family: chatter
  says: chatter of {a}
  needs:
    - load
  parameters: {gain: um}
  equations:
    E{a}: gain*load*sin(2*pi*x/30)
- family: coolant
  says: bends with the coolant
  parameters: {bow: um/K}
  search: {decay_mm: {of: x, from: 10, to: [2*span, 400], log: true, count: 5}}
  equations: {Ey: "bow*exp(-abs(x - {x_low})/decay_mm)*(T_coolant_degC - {T_coolant_degC0})"}
"""


def test_families_of_the_user(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(OWN, encoding="utf-8")
    library = effect_library([tmp_path / "own.yaml"])
    assert [source.shown for source in library.sources] == ["own.yaml"]
    coolant = np.linspace(18.0, 22.0, 9)[:, None]
    own = table(covariates=shop_covariates(9, 12) | {"T_coolant_degC": coolant})
    found = by_name(candidates(own, library))
    member = found["chatter-y"].members[0]
    assert (member.covariate, member.equations) == (
        "load",
        {"Ey": "gain*load*sin(2*pi*x/30)"},
    )
    decays = [m.searched["decay_mm"] for m in found["coolant"].members]
    assert decays == pytest.approx(np.geomspace(10.0, 260.0, 5))
    x, load = own.places[..., 0], own.covariates["load"]
    assert column(member, 0, 1, own) == pytest.approx(load * np.sin(2.0 * np.pi * x / 30.0))
    expected = np.exp(-(x - 10.0) / decays[2]) * (coolant - 20.0)
    assert column(found["coolant"].members[2], 0, 1, own) == pytest.approx(expected)


def test_a_parameter_has_a_name_that_no_column_of_its_equations_has(
    library: EffectLibrary,
) -> None:
    """Whoever has a column called slope, or wear, has it in the equation, too."""
    counts = np.asarray(np.arange(9) % 5 + 1, np.float64)[:, None]
    load = np.random.default_rng(2).normal(size=(9, 1))
    own = table(covariates={**shop_covariates(9, 12), "wear": counts, "slope": load})
    found = by_name(candidates(own, library))
    (along,) = (m for m in found["covariate-x"].members if m.covariate == "slope")
    assert along.parameters == (("own_slope", "um"),)
    assert along.equations["Ex"].startswith("own_slope*(slope - ")
    for member in (m for m in found["wear-approach-y"].members if m.covariate == "wear"):
        assert member.parameters == (("own_wear", "um"),)
        form = linear_form(parse(member.equations["Ey"]), ["own_wear"])
        lever = evaluate(form.coefficients["own_wear"], values_of(own))
        np.testing.assert_allclose(np.broadcast_to(lever, (9, 12)), column(member, 0, 1, own))
    others = (m for m in found["trend-x"].members if m.covariate == "wear")
    assert all(m.parameters == (("slope", "um"),) for m in others)


def test_columns_stay_small() -> None:
    own = table(500, 100, places=grid_places(100, jitter=2.0))
    found = candidates(own, effect_library())
    arrays = {
        id(a if a.base is None else a.base): (a if a.base is None else a.base).nbytes
        for c in found
        for m in c.members
        for column in (*m.columns, *m.tangent)
        for a in column.values()
    }
    # One column of all cells is 0.4 MB.
    assert sum(arrays.values()) < 40e6


def test_the_built_in_file_is_part_of_the_package() -> None:
    pyproject = (BUILT_IN.parents[3] / "pyproject.toml").read_text("utf-8")
    import tomllib

    patterns = tomllib.loads(pyproject)["tool"]["setuptools"]["package-data"]["mtu_cli"]
    assert any(BUILT_IN.relative_to(BUILT_IN.parents[2]).match(pattern) for pattern in patterns)


@pytest.mark.parametrize("off", [0, 1])
@pytest.mark.parametrize("first", [0, 1])
def test_of_two_operations_the_one_that_errs_is_shifted(
    library: EffectLibrary, off: int, first: int
) -> None:
    """Whichever stands first in the file."""
    own = table(operations=("drilled", "milled"))
    codes = (np.arange(12) + first) % 2
    errors = np.zeros((9, 12, 2))
    errors[:, codes == off, 0] = 4e-3
    # One entry far off, as before it is set aside, does not change it.
    errors[3, np.flatnonzero(codes != off)[0], 0] = -2.0
    found = by_name(candidates(replace(own, operation=codes, errors=errors), library))
    (member,) = found["operation-x"].members
    assert member.chosen == ("drilled", "milled")[off]
    # Along y nothing errs: the first one stands for both.
    (member,) = found["operation-y"].members
    assert member.chosen == "drilled"
