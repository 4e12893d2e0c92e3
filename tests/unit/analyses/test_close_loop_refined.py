"""The pitch of a wave between the values that are searched, against non-linear least squares."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table as points_table
from loop_bench.folds import LIBRARY
from scipy.optimize import least_squares
from scipy.stats import binom
from separation_examples import found_as, members_of, prepared_of

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.estimate import raw_design, searched_spread
from mtu_cli.close_loop_sealed.analyses.loop.held_out import fold_of, of_fold, splits_of
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import with_other_pitches
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.rivals import all_instead
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.column_groups import whitened

AMPLITUDE, NOISE, PITCH = 2e-3, 7e-4, 20.0
PLACES = np.cumsum([0.0, *np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 5)])


def passes(
    seed: int, pitch: float = PITCH, amplitude: float = AMPLITUDE, places: Floats = PLACES
) -> ResidualTable:
    """Six passes over uneven places, each with a level of its own."""
    rng = np.random.default_rng(seed)
    at = np.stack([places, np.full_like(places, np.nan), np.full_like(places, np.nan)], 1)
    found = points_table(6, len(places), axes=("x",), places=at, component="dx_x")
    errors = rng.normal(0.0, NOISE, found.errors.shape) + rng.normal(0.0, 1e-3, (6, 1, 1))
    errors[:, :, 0] += amplitude * np.sin(2 * np.pi * places / pitch + 0.4)
    return replace(found, errors=errors)


@cache
def ready() -> Prepared:
    """What the passes at `PLACES` have in common: all but the errors."""
    return prepared_of(passes(0))


def refined(table: ResidualTable, known: Prepared | None = None) -> Described:
    prepared = prepared_of(table) if known is None else known.with_table(table)
    effects, found = found_as(prepared, ["cyclic-x"])
    told = Described(prepared=prepared, found=found, effects=effects, chosen=())
    return with_refined(told, LIBRARY, 1, {})


def fitted(errors: Floats, start: float) -> tuple[float, float]:
    """Pitch and amplitude that leave the least of the columns' means, beside their mean."""
    mean = errors[:, :, 0].mean(axis=0)

    def left(p: Floats) -> Floats:
        angle = 2 * np.pi * PLACES / p[0]
        own: Floats = mean - p[1] * np.sin(angle) - p[2] * np.cos(angle) - p[3]
        return own / NOISE

    x = least_squares(left, [start, AMPLITUDE, 0.0, 0.0], xtol=1e-14, ftol=1e-14).x
    return float(x[0]), float(np.hypot(x[1], x[2]))


@pytest.mark.parametrize("pitch", [20.0, 19.83, 11.3])
def test_the_pitch_is_that_of_least_squares(pitch: float) -> None:
    table = passes(3, pitch)
    told = refined(table)
    (effect,) = with_other_pitches(told, found_effects(told, [None]), LIBRARY)
    ((value, low, high),) = effect.searched.values()
    wanted, amplitude = fitted(table.errors, pitch)
    # The grid is a quarter of a period over the span apart: no value of it is that near.
    assert value == pytest.approx(wanted, rel=1e-6)
    sine, cosine = (p[2] for p in effect.parameters)
    assert np.hypot(sine, cosine) == pytest.approx(amplitude, rel=1e-5)
    assert low < value < high
    assert high - low < 0.5 * value**2 / (4 * np.ptp(PLACES))
    assert f"/{value:.7g}".rstrip("0") in effect.equations["Ex"]


def test_the_intervals_hold_pitch_sine_and_cosine_as_often_as_stated() -> None:
    """Also the cosine, which a pitch a little off turns into the sine half the span away from 0."""
    runs, held = 200, np.zeros(3, int)
    wave = AMPLITUDE * np.array([np.cos(0.4), np.sin(0.4)])
    for seed in range(runs):
        told = refined(passes(seed), ready())
        (effect,) = with_other_pitches(told, found_effects(told, [None]), LIBRARY)
        ((_, low, high),) = effect.searched.values()
        ends = [(low, high), *((own[0], own[1]) for own in effect.intervals[:2])]
        held += [a <= true <= b for (a, b), true in zip(ends, (PITCH, *wave), strict=True)]
    for count in held.tolist():
        assert binom.ppf(1e-3, runs, 0.95) <= count <= binom.ppf(1 - 1e-3, runs, 0.95)


def test_what_the_pitch_adds_to_sine_and_cosine_is_that_of_non_linear_least_squares() -> None:
    """Covariance by the Jacobian with a free pitch over that with the pitch as found."""
    told = refined(passes(4))
    fixed = added(told.prepared, told.found, 1)
    assert fixed.fit is not None
    assert told.effects.fit is not None
    sine, cosine = fixed.fit.beta[:2].tolist()
    (pitch,) = told.prepared.members[told.found.steps[0].member].searched.values()
    angle = 2 * np.pi * PLACES / pitch
    slope = angle * (cosine * np.sin(angle) - sine * np.cos(angle))
    X = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle), slope], axis=1)
    free, known = (np.linalg.inv(own.T @ own)[:2, :2] for own in (X, X[:, :3]))
    # The weights of the strata are not quite those of the columns' means.
    for i in (0, 1):
        ratio = told.effects.fit.covariance[i, i] / fixed.fit.covariance[i, i]
        assert ratio == pytest.approx(free[i, i] / known[i, i], rel=0.01)
    assert free[1, 1] > 2 * known[1, 1]


def test_a_pitch_is_no_less_certain_than_the_search_leaves_it() -> None:
    """By how much a change by `most` shows beside the columns: what shows nothing is chosen."""
    prepared = prepared_of(passes(4))
    _, alone = found_as(prepared, ["cyclic-x"])
    columns, weights = prepared.whole(alone.members), np.ones(len(prepared.scan.dof))
    design = raw_design(prepared.scan, columns)
    beside = design[:, 0] ** 2 + np.arange(len(design)) % 3
    free = searched_spread(prepared.scan, columns, weights, beside[:, None], np.array([1e9]))
    sized = beside * free[2, 0]
    of_sized = -free[:2, 0]
    most, own = 0.02, np.array([0.3, -0.2])
    for held, factor in ((0.0, 0.0), (0.01, 0.0), (0.2, 1.0), (5.0, 1 / 5)):
        slope = design @ own + held / most * sized
        found = searched_spread(prepared.scan, columns, weights, slope[:, None], np.array([most]))
        c = own + held / most * of_sized
        expected = factor * most * np.array([*-c, 1.0])
        assert found @ found.T == pytest.approx(np.outer(expected, expected), rel=1e-6)


def test_a_pitch_is_an_estimate_of_the_level_too() -> None:
    """All that it adds to sine, cosine and level against least squares with the pitch free."""
    places = np.sort(np.random.default_rng(0).uniform(0.0, 150.0, 12))
    told = refined(passes(4, amplitude=2 * AMPLITUDE, places=places))
    values = searched_members(told.prepared, told.found, LIBRARY)
    without, free = (
        added(told.prepared, told.found, 1, owners={0: 0}, values=own) for own in ({}, values)
    )
    known, with_pitch = without.fit, free.fit
    assert known is not None
    assert with_pitch is not None
    sine, cosine = known.beta[:2].tolist()
    ((pitch, *_),) = [[*told.prepared.members[m].searched.values()] for m in values]
    angle = 2 * np.pi * places / pitch
    slope = angle * (cosine * np.sin(angle) - sine * np.cos(angle))
    X = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle), slope], axis=1)
    expected = np.linalg.inv(X.T @ X)[:3, :3] - np.linalg.inv(X[:, :3].T @ X[:, :3])
    scale = known.covariance[0, 0] / np.linalg.inv(X[:, :3].T @ X[:, :3])[0, 0]
    found = (with_pitch.covariance - known.covariance)[:3, :3] / scale
    size = np.sqrt(np.diag(expected))
    # The weights of the strata are not quite those of the columns' means.
    assert found / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=0.06)
    # With them: the inverse with the pitch beside sine and cosine less that without it, and the
    # level less what the mean of each of them takes of it.
    scan = free.prepared.scan
    ways = np.stack([np.sin(angle), np.cos(angle), slope], axis=1)
    y, mean = scan.frame.coordinates(np.broadcast_to(ways.T[:, None, :, None], (3, 6, 12, 1)))
    sizes = [stratum.size for stratum in scan.frame.strata.all]
    root = np.sqrt(np.repeat(with_pitch.weights, sizes))
    W = root[:, None] * whitened(scan.frame.strata, scan.whitening, y.T)
    more = np.linalg.inv(W.T @ W)
    more[:2, :2] -= np.linalg.inv(W[:, :2].T @ W[:, :2])
    G = np.concatenate([np.eye(3)[:2], -mean.T])
    exactly = G @ more @ G.T / scale
    assert found / np.outer(size, size) == pytest.approx(exactly / np.outer(size, size), abs=1e-6)


def test_a_pitch_lies_between_those_beside_it() -> None:
    prepared = prepared_of(passes(4))
    _, found = found_as(prepared, ["cyclic-x"])
    (step,) = found.steps
    known = sorted(
        1.0 / value
        for m in prepared.candidates[step.index].members
        for value in m.searched.values()
    )
    (pitch,) = prepared.members[step.member].searched.values()
    (share,) = searched_members(prepared, found, LIBRARY).values()
    at = int(np.argmin(np.abs(np.array(known) - 1 / pitch)))
    apart = max(known[at] - known[at - 1], known[at + 1] - known[at])
    assert share == pytest.approx(apart * pitch / np.sqrt(3), rel=1e-9)


@pytest.mark.parametrize(
    ("places", "columns"),
    [
        # Whatever pitch there is fits three places alike.
        (np.array([0.0, 13.0, 30.3]), 2),
        # Of one phase: cosine alone is seen, and a pitch beside it would be seen to have a sine.
        (10.0 * np.arange(12), 1),
    ],
)
def test_a_pitch_that_none_beside_it_betters_stays(places: Floats, columns: int) -> None:
    prepared = prepared_of(passes(2, 20.0, places=places, amplitude=20 * NOISE))
    _, found = found_as(prepared, ["cyclic-x"])
    (step,) = found.steps
    own = [
        m
        for m in members_of(prepared, "cyclic-x")
        if len(prepared.members[m].columns) == columns
        and (columns == 2 or prepared.members[m] is prepared.members[step.member])
    ]
    assert own
    for m in own[:: max(1, len(own) // 10)]:
        one = replace(found, steps=(replace(step, member=m),))
        effects = added(prepared, one)
        told = Described(prepared=prepared, found=one, effects=effects, chosen=())
        after = with_refined(told, LIBRARY, 1, {})
        assert after.prepared.members[m] is prepared.members[m]


def test_held_out_passes_are_foretold_by_the_pitch_of_the_others() -> None:
    """Half a grid step off, a wave of this size leaves a fifth of it at the ends."""
    table = passes(1)
    grid = candidates(table, LIBRARY)
    (split, *_) = splits_of(table)
    own = of_fold(table, fold_of(table, grid, split, 1), LIBRARY, alpha=0.05, most=3)
    said = own.foretold[~split.kept][0, :, 0]
    wave = AMPLITUDE * np.sin(2 * np.pi * PLACES / PITCH + 0.4)
    off = (said - said.mean()) - (wave - wave.mean())
    # Two coefficients and a pitch from five passes at 26 places.
    assert np.sqrt(np.mean(off**2)) < 3 * NOISE * np.sqrt(3 / (5 * len(PLACES)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_strong_wave_leaves_no_other_one_beside_it(seed: int) -> None:
    """Twenty times the noise: what two values of the grid leave of one half way between them is
    beyond chance where it is taken for a straight line.
    """
    places = np.cumsum([0.0, *np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 8)])
    step = 1 / (4 * np.ptp(places))
    frequencies = 2 / np.ptp(places) + step * np.arange(200)
    table = passes(seed, 1 / (frequencies[np.argmin(np.abs(frequencies - 0.046))] + step / 2),
                   20 * NOISE, places)  # fmt: skip
    prepared = prepare(table, [c for c in candidates(table, LIBRARY) if c.family == "cyclic"])
    found = search(prepared, calibrated(prepared.scan, 999, 1), alpha=0.05, most=4)
    assert [prepared.candidates[step.index].name for step in found.steps] == ["cyclic-x"]


def test_many_uneven_places_find_a_pitch_shorter_than_their_steps() -> None:
    """5 mm at places 14 mm apart, by name; at few places it would be no wave of the library."""
    places = np.cumsum([0.0, *np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 8)])
    table = passes(2, 5.0, places=places)
    prepared = prepare(table, candidates(table, LIBRARY))
    found = search(prepared, calibrated(prepared.scan, 999, 1), alpha=0.05, most=4)
    (step,) = found.steps
    ((value,),) = [[*prepared.members[step.member].searched.values()]]
    assert prepared.candidates[step.index].name == "cyclic-x"
    assert value == pytest.approx(5.0, abs=5.0**2 / (4 * np.ptp(places)))


def test_a_wave_in_the_place_of_another_effect_has_its_pitch_in_its_uncertainty() -> None:
    prepared = prepared_of(passes(4))
    effects, found = found_as(prepared, ["curvature-x", "cyclic-x"])
    told = Described(prepared=prepared, found=found, effects=effects, chosen=())
    (other,) = all_instead(told, found_effects(told, [None]), LIBRARY)
    assert other.rival.name == "cyclic-x"
    effects, alone = found_as(prepared, ["cyclic-x"])
    told = Described(prepared=prepared, found=alone, effects=effects, chosen=())
    refined = with_refined(told, LIBRARY, None, {}).prepared
    known, free = (
        added(refined, alone, values=values).fit
        for values in ({}, searched_members(prepared, alone, LIBRARY))
    )
    assert known is not None
    assert free is not None
    u = [own[3] for own in other.rival.parameters[:2]]
    assert u == pytest.approx(np.sqrt(np.diag(free.covariance)[:2]).tolist(), rel=1e-9)
    assert u[1] > 1.4 * np.sqrt(known.covariance[1, 1])
