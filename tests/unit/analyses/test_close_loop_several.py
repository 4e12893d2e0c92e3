"""Effects that hide one another in the few means of an axis: found together, or not at all."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import binom

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.needless import needless
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.several import _best_pair, _Lone, _of_parts, several
from mtu_cli.close_loop_sealed.analyses.loop.state import State
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.stats.remainder import COMMON_SHAPE

NOISE = 1.3e-3
SCALE, ANGLE = 20e-6, 58e-6
X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)


@cache
def ready() -> Prepared:
    """What days of `found` have in common: all but the errors."""
    own = table(12, 12, places=PLACES, covariates={})
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    own = replace(own, errors=np.random.default_rng(0).normal(0.0, NOISE, own.errors.shape))
    return prepare(own, candidates(own, LIBRARY), own.pass_dof)


def found(seed: int, scale: float, angle: float, axis: int = 0) -> tuple[Prepared, Search]:
    """Twelve parts of twelve holes, an axis longer by `scale` and leaning by `angle`."""
    rng, own = np.random.default_rng(seed), ready().table
    errors = rng.normal(0.0, NOISE, own.errors.shape) + rng.normal(0.0, NOISE, (12, 1, 2))
    errors[..., axis] += scale * PLACES[:, axis] + angle * PLACES[:, 1 - axis]
    prepared = ready().with_table(replace(own, errors=errors))
    gate = calibrated(prepared.scan, 499, 1)
    return prepared, search(prepared, gate, alpha=0.05, most=4)


def names(prepared: Prepared, seen: Search) -> set[str]:
    return {prepared.candidates[s.index].name for s in seen.steps if s.member >= 0}


@pytest.mark.parametrize("factor", [1.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_scale_and_a_squareness_of_one_axis_are_found_at_any_size(
    seed: int, factor: float
) -> None:
    prepared, seen = found(seed, factor * SCALE, factor * ANGLE)
    # Neither passes by itself.
    index = [prepared.scan.names.index(name) for name in ("scale-x", "squareness-xy")]
    assert (seen.p[index] > 0.05).any()
    assert names(prepared, seen) >= {"scale-x", "squareness-xy"}
    steps = [step for step in seen.steps if step.member >= 0]
    effects = added(prepared, seen)
    assert effects.fit is not None
    sizes = {"scale-x": factor * SCALE, "squareness-xy": factor * ANGLE}
    for place, step in enumerate(steps):
        true = sizes.get(prepared.candidates[step.index].name)
        if true is not None:
            at = effects.coefficients(place)[0]
            u = float(np.sqrt(effects.fit.covariance[at, at]))
            assert abs(abs(float(effects.fit.beta[at])) - true) < 4.5 * u
            assert u < 0.1 * true
    assert not seen.fired(0.05)


def test_one_effect_alone_brings_no_other_with_it() -> None:
    others = 0
    for seed in range(20):
        prepared, seen = found(seed, 0.0, ANGLE)
        assert names(prepared, seen) >= {"squareness-xy"} or seen.fired(0.05)
        others += "scale-x" in names(prepared, seen)
    assert others <= binom.ppf(1 - 1e-3, 20, 0.05)


def test_what_hides_in_directions_of_no_effect_is_told_by_the_check_alone() -> None:
    """With the squareness and what may stand for it left out of the search."""
    prepared, _ = found(1, SCALE, ANGLE)
    gate = calibrated(prepared.scan, 499, 1)
    shapes = {"scale-x", "squareness-xy", "rotation-z", "radial"}
    unsure = frozenset(i for i, name in enumerate(prepared.scan.names) if name in shapes)
    seen = search(prepared, gate, alpha=0.05, most=4, unsure=unsure)
    assert names(prepared, seen).isdisjoint(shapes)
    assert COMMON_SHAPE in seen.fired(0.05)


def test_nothing_is_found_as_often_as_stated() -> None:
    hits = sum(bool(found(seed, 0.0, 0.0)[1].steps) for seed in range(100, 160))
    assert hits <= binom.ppf(1 - 1e-3, 60, 0.05)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_axis_is_that_of_the_errors(axis: int) -> None:
    """Along the other one nothing is."""
    for seed in range(3):
        prepared, seen = found(seed, SCALE, ANGLE, axis)
        axes: set[int] = set()
        for step in seen.steps:
            if step.member >= 0:
                columns: list[dict[int, Floats]] = list(prepared.members[step.member].columns)
                axes |= {own for column in columns for own in column}
        assert axes == {axis}


def test_three_effects_of_one_axis_are_found_together() -> None:
    """A scale, and a squareness to y and to z, of holes at two heights."""
    places = np.concatenate([PLACES, PLACES + np.array([7.0, 5.0, 80.0])])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        own = table(12, 24, places=places, covariates={})
        own = replace(own, operations=("",), operation=np.zeros(24, np.int64))
        errors = rng.normal(0.0, NOISE, own.errors.shape) + rng.normal(0.0, NOISE, (12, 1, 2))
        errors[..., 0] += places @ [3 * SCALE, 3 * ANGLE, 600e-6]
        own = replace(own, errors=errors)
        prepared = prepare(own, candidates(own, LIBRARY), own.pass_dof)
        gate = calibrated(prepared.scan, 499, 1)
        seen = search(prepared, gate, alpha=0.05, most=4)
        first = {prepared.candidates[i].name for s in seen.steps for i in s.credible}
        assert names(prepared, seen) >= {"scale-x", "squareness-xy"}
        assert first & {"squareness-xz", "abbe-x"}
        assert not seen.fired(0.05)


def test_the_axis_that_shows_most_is_looked_at_first() -> None:
    """Both axes hide a pair: the first step is of the larger."""
    for more, less in ((0, 1), (1, 0)):
        rng = np.random.default_rng(5)
        own = table(12, 12, places=PLACES, covariates={})
        own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
        errors = rng.normal(0.0, NOISE, own.errors.shape) + rng.normal(0.0, NOISE, (12, 1, 2))
        for axis, factor in ((more, 3.0), (less, 1.0)):
            shape = SCALE * PLACES[:, axis] + ANGLE * PLACES[:, 1 - axis]
            errors[..., axis] += factor * shape
        prepared = prepare(replace(own, errors=errors), candidates(own, LIBRARY), own.pass_dof)
        state = State(prepared, calibrated(prepared.scan, 299, 1))
        state.look()
        chosen = several(state, 0.05, frozenset())
        axes = {a for s in chosen for c in prepared.members[s.member].columns for a in c}
        assert axes == {more}


LATE = 8
"""Parts before the step."""


def warm_shift(
    seed: int, jump: float, drift: float, axis: int = 0, unsure: tuple[str, ...] = ()
) -> tuple[Prepared, Search]:
    """Eighteen parts at 24 to 28 degC; from part `LATE` + 1 on an axis jumps, and it drifts."""
    rng = np.random.default_rng(seed)
    T = rng.permutation(np.linspace(24.0, 28.0, 18))[:, None]
    known = {"T_room_degC": T, "sequence": np.arange(1.0, 19.0)[:, None]}
    own = table(18, 12, places=PLACES, covariates=known)
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = rng.normal(0.0, NOISE, own.errors.shape) + rng.normal(0.0, 0.6e-3, (18, 1, 2))
    errors[..., axis] += drift * (T - 26.0) + jump * (np.arange(18) >= LATE)[:, None]
    prepared = prepare(replace(own, errors=errors), candidates(own, LIBRARY), own.pass_dof)
    gate = calibrated(prepared.scan, 499, 1)
    out = frozenset(i for i, name in enumerate(prepared.scan.names) if name in unsure)
    return prepared, search(prepared, gate, alpha=0.05, most=4, unsure=out)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_a_step_and_a_drift_of_the_parts_are_found_together(seed: int, axis: int) -> None:
    letter = "xy"[axis]
    pair = {f"step-{letter}", f"thermal-drift-{letter}"}
    prepared, seen = warm_shift(seed, 6e-3, 2e-3, axis)
    assert names(prepared, seen) == pair
    effects = added(prepared, seen)
    assert effects.fit is not None
    for place, step in enumerate(step for step in seen.steps if step.member >= 0):
        true = 6e-3 if prepared.candidates[step.index].family == "step" else 2e-3
        at = effects.coefficients(place)[0]
        u = float(np.sqrt(effects.fit.covariance[at, at]))
        assert abs(float(effects.fit.beta[at]) - true) < 4.5 * u
    assert not seen.fired(0.05)


def test_some_such_pairs_hide_one_another() -> None:
    prepared, _ = warm_shift(0, 6e-3, 2e-3)
    both = [prepared.scan.names.index(name) for name in ("step-x", "thermal-drift-x")]
    alone = [warm_shift(seed, 6e-3, 2e-3)[1].p[both] for seed in range(8)]
    assert sum(bool((p > 0.05).all()) for p in alone) >= 2


def test_what_later_effects_leave_nothing_of_is_taken_back() -> None:
    """A trend, or a step a part too early, passes first; beside drift and step it is nothing."""
    for seed in (1, 2):
        prepared, seen = warm_shift(seed, 6e-3, 2e-3, axis=1)
        steps = [step for step in seen.steps if step.member >= 0]
        assert needless(prepared, steps, 0.05) is None
        index = prepared.scan.names.index("trend-y")
        first = sum(len(columns) for columns in prepared.scan.columns[:index])
        trend = replace(steps[0], index=index, member=first)
        assert needless(prepared, [*steps, trend], 0.05) is trend
        assert needless(prepared, [trend], 0.05) is None


def test_what_is_not_looked_for_is_no_half_of_a_pair() -> None:
    alike = ("step-x", "trend-x", "warm-up-x", "offset-x")
    for seed in range(4):
        prepared, seen = warm_shift(seed, 6e-3, 2e-3, unsure=alike)
        assert names(prepared, seen).isdisjoint(alike)


def test_the_pair_that_leaves_least_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    y = rng.standard_normal(17)
    columns = rng.standard_normal((12, 17))
    columns[5] = columns[2]
    known = [_Lone(i // 2, i, column) for i, column in enumerate(columns)]
    pair = _best_pair(y, known)
    assert pair is not None
    left = {}
    for i, one in enumerate(known):
        for other in known[i + 1 :]:
            if one.index != other.index and {one.member, other.member} != {2, 5}:
                X = np.stack([one.column, other.column], axis=1)
                rest = y - X @ np.linalg.lstsq(X, y)[0]
                left[one.member, other.member] = float(rest @ rest / (y @ y))
    best = min(left, key=lambda own: left[own])
    assert tuple(own.member for own in pair[1]) == best
    assert pair[0] == pytest.approx(1 - left[best])
    assert _best_pair(y, known[:2]) is None
    assert _best_pair(0 * y, known) is None


def test_pairs_are_found_by_chance_as_rarely_as_stated() -> None:
    """In the means of parts, of which nothing else is asked."""
    runs, hits = 150, 0
    for seed in range(runs):
        prepared, _ = warm_shift(0, 0.0, 0.0)
        rng = np.random.default_rng(1000 + seed)
        y = rng.standard_normal(prepared.y.shape)
        state = State(replace(prepared, y=y), None)
        state.look()
        hits += bool(_of_parts(state, 1.0, frozenset()))
    assert hits <= binom.ppf(1 - 1e-3, runs, 0.2)
