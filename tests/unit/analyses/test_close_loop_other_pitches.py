"""Other pitches that fit the measured places as well: by dense least squares, and what is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import readings_table
from effect_tables import table as points_table
from separation_examples import (
    LIBRARY,
    dense_d2,
    found_as,
    parts_basis,
    prepared_of,
    with_variances,
)

from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.one_table import verdict_of
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import (
    periodic,
    pitches_as_good,
    squares_left,
    with_other_pitches,
)
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shown import pitch_is_open
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

PITCH, NOISE = 10.0, 1e-3
EVEN = np.linspace(10.0, 140.0, 5)
UNEVEN = np.array([10.0, 33.0, 61.0, 90.0, 113.0, 140.0])
MANY = np.array(
    [10.0, 14.1, 19.7, 27.0, 31.3, 40.9, 52.2, 58.4, 70.3, 81.6, 99.5, 112.4, 127.8, 140.0]
)


def grid(x: Floats, amplitude: float = 5e-3, seed: int = 1) -> ResidualTable:
    """Six parts, three rows of features at the places `x`, a sine of 10 mm in x."""
    at = np.stack(
        [np.repeat(x, 3), np.tile([10.0, 60.0, 140.0], len(x)), np.full(3 * len(x), 127.0)], 1
    )
    found = points_table(6, len(at), places=at)
    errors = NOISE * np.random.default_rng(seed).normal(size=found.errors.shape)
    errors[:, :, 0] += amplitude * np.sin(2 * np.pi * at[:, 0] / PITCH + 0.4)
    return replace(found, errors=errors)


def told(table: ResidualTable, name: str = "cyclic-x") -> Described:
    prepared = prepared_of(table)
    effects, found = found_as(prepared, [name])
    return Described(prepared=prepared, found=found, effects=effects, chosen=())


def described(own: Described) -> FoundEffect:
    (effect,) = with_other_pitches(own, found_effects(own, [None]), LIBRARY)
    return effect


def test_what_a_pitch_leaves_is_that_of_dense_least_squares() -> None:
    own = told(grid(UNEVEN))
    table = own.prepared.table
    variances = (np.array([3e-6, 2e-6]), np.array([1e-6, 4e-6]), np.full((2, 3), 5e-6))
    left = with_variances(own.effects.prepared, *variances)
    own = replace(own, effects=replace(own.effects, prepared=left))
    seen = periodic(own, own.found.steps[0], LIBRARY)
    assert seen is not None
    pitches = np.array([seen.found, 40.0, 23.0, 10.0, 7.3, 4.1, 2.2])
    squares = squares_left(own, seen, 0, pitches)
    assert squares is not None
    x = np.broadcast_to(table.places[0, :, 0], table.errors.shape[:2])
    basis = parts_basis(table.places[0, :, :2])
    data = {0: table.errors[:, :, 0]}
    dense = [
        dense_d2(data, [[{0: f(2 * np.pi * x / p)} for f in (np.sin, np.cos)]], basis, variances)
        for p in pitches
    ]
    # Dense: of all cells; here of what places differ by. Pitches differ alike in both.
    np.testing.assert_allclose(
        squares - squares[0], np.array(dense) - dense[0], rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("x", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_at_few_places_the_true_pitch_is_one_of_those_told(x: Floats) -> None:
    """Shorter than the places can follow, so that it is not in the grid that was searched."""
    effect = described(told(grid(x)))
    ((value, low, high),) = effect.searched.values()
    assert abs(value / PITCH - 1) > 0.1
    # Within an eighth of what the places resolve: a phase that is off by 22 degrees at the ends.
    assert min(abs(1 / a - 1 / PITCH) for a in effect.alike) <= 1 / (8 * np.ptp(x))
    assert low <= min(effect.alike) <= max(*effect.alike, value) <= high
    assert pitch_is_open(effect)
    assert effect.class_names == ("cyclic-x",)
    search = told(grid(x)).found
    assert verdict_of(search, [effect], ()) == "class"
    assert verdict_of(search, [replace(effect, alike=())], ()) == "named"


def test_pitches_that_are_the_same_on_even_places_are_all_told() -> None:
    """f and n/s - f, n/s + f are one on places s apart: as many as are longer than 2 mm."""
    effect = described(told(grid(EVEN)))
    ((value, _, _),) = effect.searched.values()
    step = 1 / float(EVEN[1] - EVEN[0])
    same = [abs(n * step + sign / value) for n in range(40) for sign in (-1, 1)]
    for frequency in sorted(set(same)):
        if 2 / 130 <= frequency <= 1 / 2 and abs(frequency - 1 / value) > 1e-6:
            # Two nearer than the places resolve, one over their span, count as one.
            known = [1 / value, *(1 / a for a in effect.alike)]
            assert min(abs(f - frequency) for f in known) <= 1 / 130


def images(value: float, step: float, low: float, high: float) -> list[float]:
    """Pitches from `low` to `high` whose frequencies differ from, or add up with that of `value`
    to, whole multiples of 1/step.
    """
    found = {
        round(abs(n / step + sign / value), 12)
        for n in range(int(step / low) + 2)
        for sign in (-1, 1)
    }
    return sorted(1 / f for f in found if 1 / high <= f <= 1 / low and abs(f * value - 1) > 1e-6)


@pytest.mark.parametrize(
    ("x", "step"),
    [
        (10.0 + 22.5 * np.arange(5), 22.5),
        (10.0 + 22.5 * np.arange(8), 22.5),
        (12.5 * np.array([0.0, 1.0, 3.0, 7.0, 12.0]), 12.5),
        (3.0 + 6.4 * np.array([0.0, 3.0, 4.0, 11.0, 13.0, 20.0, 26.0]), 6.4),
    ],
    ids=["five", "eight", "steps", "short-steps"],
)
@pytest.mark.parametrize("pitch", [34.809, 10.0, 8.0])
def test_no_pitch_that_is_the_same_is_missing(x: Floats, step: float, pitch: float) -> None:
    """On multiples of a step, all in their order or not: exactly those of sampling at it."""
    table = grid(x, 0.0)
    wave = 5e-3 * np.sin(2 * np.pi * table.places[:, :, 0] / pitch + 0.4)
    errors = table.errors + wave[:, :, None] * [1.0, 0.0]
    effect = described(told(replace(table, errors=errors)))
    ((value, low, high),) = effect.searched.values()
    same = images(value, step, 2.0, float(np.ptp(x)) / 2)
    assert same
    alike = np.array(effect.alike)
    for other in same:
        assert np.abs(alike / other - 1).min() < 1e-6, other
        assert low * (1 - 1e-6) <= other <= high * (1 + 1e-6)


def test_the_interval_holds_the_images_of_all_that_the_data_support() -> None:
    """Those of its own interval's ends, not of the pitch that is told alone."""
    own = told(grid(np.linspace(10.0, 115.0, 6), 2e-3, seed=4))
    effect = described(own)
    seen = periodic(own, own.found.steps[0], LIBRARY)
    assert seen is not None
    ((value, low, high),) = effect.searched.values()
    pitches = 1 / np.arange(2 / 105, 1 / 2, 1e-4)
    left = squares_left(own, seen, 0, np.append(pitches, value))
    assert left is not None
    supported = pitches[left[:-1] <= left.min() + 3.84]
    assert len(supported) > len(effect.alike)
    assert low <= supported.min() * 1.001
    assert high >= supported.max() / 1.001


@pytest.mark.parametrize(
    "x",
    [
        10.0 + 30.0 * np.array([0.0, 1.0, np.sqrt(2.0), np.e, np.pi, 4.1, 4.7]),
        10.0 + 22.5 * np.arange(7) + 0.3 * np.array([0, 1, -1, 1, 1, -1, 0]),
    ],
    ids=["no-divisor", "nearly-even"],
)
def test_places_without_a_step_have_no_images(x: Floats) -> None:
    """What is nearly the same is left to the data."""
    own = told(grid(x))
    seen = periodic(own, own.found.steps[0], LIBRARY)
    assert seen is not None
    assert pitches_as_good(own, seen, 0).same == ()


def test_of_a_pitch_of_one_column_the_others_are_told_too() -> None:
    """At twice the steps sine and cosine are one: its size is that of the errors, not 1e13."""
    table = grid(np.linspace(10.0, 130.0, 5), 0.0)
    wave = 5e-3 * np.cos(2 * np.pi * (table.places[:, :, 0] - 10.0) / 60.0)
    errors = table.errors + wave[:, :, None] * [1.0, 0.0]
    effect = described(told(replace(table, errors=errors)))
    ((_, _, value, u),) = effect.parameters
    ((pitch, low, high),) = effect.searched.values()
    assert pitch == pytest.approx(60.0)
    # The sine of 60 mm is sqrt(3)/2 at most there.
    assert abs(value) == pytest.approx(5e-3 / np.sqrt(0.75), abs=3 * u)
    same = [30.0 / n for n in (1.5, 2.5, 3.5)]
    assert all(min(abs(1 / a - 1 / p) for a in effect.alike) <= 1 / 120 for p in same)
    assert low <= min(same) <= 60.0 <= high


def test_at_many_uneven_places_a_pitch_is_told() -> None:
    effect = described(told(grid(MANY)))
    assert effect.alike == ()
    assert not pitch_is_open(effect)
    low, high = effect.searched["pitch_mm"][1:]
    assert low <= PITCH <= high


def test_on_as_many_places_as_figures_the_name_is_one_of_several_too() -> None:
    effect = described(told(grid(np.array([10.0, 50.0, 95.0, 140.0]))))
    assert effect.class_names == ("cyclic-x", "unnamed-field-x")


def test_without_scatter_nothing_else_fits_but_what_is_the_same() -> None:
    own = told(grid(UNEVEN))
    null = replace(
        own.effects.prepared.scan.null, interaction=np.zeros(2), column=np.zeros(2),
        part=np.zeros_like(own.effects.prepared.scan.null.part),
    )  # fmt: skip
    scan = replace(own.effects.prepared.scan, null=null)
    own = replace(
        own, effects=replace(own.effects, prepared=replace(own.effects.prepared, scan=scan))
    )
    assert described(own).alike == ()


def test_what_is_no_pitch_stays_as_it_is() -> None:
    own = told(grid(UNEVEN), "warm-up-x")
    effects = found_effects(own, [None])
    assert with_other_pitches(own, effects, LIBRARY) == effects
    readings = readings_table(fitted_degree=1)
    rng = np.random.default_rng(3)
    readings = replace(readings, errors=NOISE * rng.normal(size=readings.errors.shape))
    own = told(readings, "cyclic-x")
    assert described(own).name == "cyclic-x"
