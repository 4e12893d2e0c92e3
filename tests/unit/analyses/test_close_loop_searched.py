"""What a searched time constant adds to u of a size, against non-linear least squares."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table as points_table
from loop_bench.folds import LIBRARY
from scipy.optimize import least_squares
from separation_examples import index
from warm_day import found as found_as
from warm_day import step

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.one_table import loop_on
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import with_shapes
from mtu_cli.close_loop_sealed.model.effect_library import candidates

PARTS, FEATURES, TABLES = 24, 9, 60
RISE, TAU, PART, NOISE = 12e-3, 200.0, 1e-3, 1e-3
TIME: Floats = 15.0 * np.arange(PARTS, dtype=np.float64)
PASSED: dict[str, Floats] = {
    "time_min": TIME[:, None],
    "sequence": np.arange(1.0, PARTS + 1.0)[:, None],
}


@cache
def empty() -> Prepared:
    table = points_table(PARTS, FEATURES, covariates=PASSED)
    table = replace(table, errors=drawn(0))
    known = [c for c in candidates(table, LIBRARY) if c.name in ("warm-up-x", "step-x", "offset-x")]
    return prepare(table, known)


def rise_of(tau: float) -> float:
    """With the same change over the run, whatever the time constant."""
    return RISE * float((1 - np.exp(-TIME[-1] / TAU)) / (1 - np.exp(-TIME[-1] / tau)))


def drawn(seed: int, tau: float = TAU) -> Floats:
    """Errors that warm up, beside parts that shift and entries that scatter."""
    rng = np.random.default_rng(seed)
    errors = NOISE * rng.normal(size=(PARTS, FEATURES, 2))
    errors += PART * rng.normal(size=(PARTS, 1, 2))
    errors[..., 0] += (rise_of(tau) * (1 - np.exp(-TIME / tau)))[:, None]
    return errors


def nearest(prepared: Prepared, name: str) -> int:
    """Which member has the time constant that fits the most, by its profile."""
    own = prepared.members
    of = [i for i, m in enumerate(own) if "tau_min" in m.searched]
    y = prepared.table.errors[..., 0].mean(axis=1)

    def left(tau: float) -> float:
        X = np.stack([1 - np.exp(-TIME / tau), np.ones(PARTS)], axis=1)
        return float(np.linalg.lstsq(X, y, rcond=None)[1][0])

    assert {prepared.candidates[index(prepared, name)].family} == {"warm-up"}
    return int(np.argmin([left(own[i].searched["tau_min"]) for i in of]))


def estimated(seed: int) -> tuple[Added, Added, float, Floats]:
    """With tau as it was searched, and as if it were known; it, and the parts' means."""
    moved = empty().with_table(replace(empty().table, errors=drawn(seed)))
    own = step(moved, "warm-up-x", nearest(moved, "warm-up-x"))
    found = found_as(moved, own)
    values = searched_members(moved, found, LIBRARY)
    assert set(values) == {own.member}
    (tau,) = moved.members[own.member].searched.values()
    free, known = (added(moved, found, 1, owners={0: 0}, values=given) for given in (values, {}))
    return free, known, tau, moved.table.errors[..., 0].mean(axis=1)


def test_it_is_that_of_non_linear_least_squares() -> None:
    free, known, tau, mean = estimated(3)
    assert free.fit is not None
    assert known.fit is not None

    def left(p: Floats) -> Floats:
        found: Floats = mean - p[0] * (1 - np.exp(-TIME / p[1])) - p[2]
        return found

    x = least_squares(left, [RISE, tau, 0.0], x_scale=[RISE, tau, RISE], xtol=1e-14).x
    gone = np.exp(-TIME / tau)
    full = np.stack([1 - gone, -free.fit.beta[0] * gone * TIME / tau, np.ones(PARTS)], axis=1)
    inverse = np.linalg.inv(full.T @ full)
    alone = np.linalg.inv(full[:, ::2].T @ full[:, ::2])
    # The grid holds one value in each 1.5 times: its least squares are near those of the free one.
    assert free.fit.beta[0] == pytest.approx(x[0], rel=0.1)
    wanted = np.sqrt(np.diag(inverse)[::2] / np.diag(alone))
    told = np.sqrt(np.diag(free.fit.covariance) / np.diag(known.fit.covariance))
    assert told == pytest.approx(wanted, rel=0.03)
    assert (wanted > 1.3).all()


def told_of(seed: int, tau: float, found: str = "warm-up-x") -> FoundEffect:
    """The effect of a table whose only effect is known by its name, as it is told."""
    moved = empty().with_table(replace(empty().table, errors=drawn(seed, tau)))
    own = step(moved, found, nearest(moved, found))
    search = found_as(moved, own)
    values = searched_members(moved, search, LIBRARY)
    effects = added(moved, search, owners={0: 0}, values=values)
    told = Described(prepared=moved, found=search, effects=effects, chosen=())
    told = with_refined(told, LIBRARY, None, {0: 0})
    (effect,) = with_shapes(told, found_effects(told, [None]), LIBRARY)
    return effect


# Values searched are 1.52 times apart: 160 and 245 lie between two of them, 35 by one.
@pytest.mark.parametrize(
    ("tau", "scale"),
    [
        *((35.0, 4.0), (160.0, 0.1), (245.0, 1.0), (560.0, 0.1), (700.0, 4.0)),
    ],
)
def test_intervals_hold_what_was_drawn(
    tau: float, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """95 %, to three standard errors: of time constants at the values searched, between them and
    as far as twice the run, in little scatter and in as much as there is of the effect.
    """
    monkeypatch.setattr("test_close_loop_searched.NOISE", scale * NOISE)
    monkeypatch.setattr("test_close_loop_searched.PART", scale * PART)
    sizes, times = [], []
    for seed in range(TABLES):
        effect = told_of(seed, tau)
        low, high, _ = effect.intervals[0]
        sizes.append(low < rise_of(tau) < high)
        ((_, first, last),) = effect.searched.values()
        times.append(first <= tau <= last)
    for held in (sizes, times):
        assert np.mean(held) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / TABLES)


def test_what_jumps_from_a_part_on_has_no_slope() -> None:
    moved = empty()
    own = step(moved, "step-x", 3)
    found = found_as(moved, own)
    assert searched_members(moved, found, LIBRARY) == {}


def test_what_is_told_has_it() -> None:
    """The whole loop, whose u is that of `added` with the searched value an estimate."""
    table = replace(empty().table, errors=drawn(3))
    known = [c for c in candidates(table, LIBRARY) if c.name in ("warm-up-x", "offset-x")]
    told = loop_on(table, known, LIBRARY, alpha=0.05, most=1, seed=1)
    (effect,) = told.result.effects
    assert not effect.is_hint
    by_name = told_of(3, TAU)
    assert effect.parameters[0][2:] == pytest.approx(by_name.parameters[0][2:], rel=0.05)
    assert effect.intervals[0] == pytest.approx(by_name.intervals[0], rel=0.05)


def test_a_poor_shape_is_known_no_better_than_its_grid() -> None:
    """Of a time far beyond the run: the logarithm of a value between the first and the last."""
    moved = empty()
    own = step(moved, "warm-up-x", 11)
    found = found_as(moved, own)
    (share,) = searched_members(moved, found, LIBRARY).values()
    known = [m.searched["tau_min"] for m in moved.members if "tau_min" in m.searched]
    assert share == pytest.approx(np.log(max(known) / min(known)) / np.sqrt(12), rel=1e-12)


def test_a_place_beyond_0_has_no_relative_uncertainty() -> None:
    moved = empty()
    own = step(moved, "warm-up-x", 5)
    (candidate,) = [c for c in moved.candidates if c.name == "warm-up-x"]
    shifted = tuple(
        replace(m, searched={"tau_min": m.searched["tau_min"] - 20.0}) for m in candidate.members
    )
    other = replace(candidate, members=shifted)
    whole = tuple(other if c is candidate else c for c in moved.candidates)
    assert searched_members(replace(moved, candidates=whole), found_as(moved, own), LIBRARY) == {}
