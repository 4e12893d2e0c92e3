"""Intervals of a shape and its size from few parts, and of shapes that have no end."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table as points_table
from loop_bench.folds import LIBRARY
from warm_day import found as found_as
from warm_day import step

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described, found_effects
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import with_shapes
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.reports.close_loop_searched import (
    open_end,
    searched_text,
    size_interval,
)

FEATURES, STEP, SD = 9, 15.0, 1e-3


@cache
def prepared_of(parts: int) -> Prepared:
    times = {"time_min": STEP * np.arange(float(parts))[:, None]}
    own = points_table(parts, FEATURES, covariates=times)
    own = replace(own, errors=drawn(parts, 20e-3, 30.0, 0))
    return prepare(own, [c for c in candidates(own, LIBRARY) if c.name == "warm-up-x"])


def drawn(parts: int, rise: float, tau: float, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    errors: Floats = SD * rng.normal(size=(parts, FEATURES, 2))
    errors += SD * rng.normal(size=(parts, 1, 2))
    errors[..., 0] += (rise * (1 - np.exp(-STEP * np.arange(parts) / tau)))[:, None]
    return errors


def told(parts: int, rise: float, tau: float, seed: int) -> FoundEffect:
    prepared = prepared_of(parts)
    moved = prepared.with_table(replace(prepared.table, errors=drawn(parts, rise, tau, seed)))
    known = np.log([m.searched["tau_min"] for m in moved.members])
    found = found_as(moved, step(moved, "warm-up-x", int(np.argmin(np.abs(known - np.log(tau))))))
    effects = added(moved, found, values=searched_members(moved, found, LIBRARY))
    own = Described(prepared=moved, found=found, effects=effects, chosen=())
    own = with_refined(own, LIBRARY, None, {})
    (effect,) = with_shapes(own, found_effects(own, [None]), LIBRARY)
    return effect


@pytest.mark.parametrize(("parts", "tau", "rise"), [(5, 30.0, 12e-3), (6, 30.0, 20e-3)])
def test_of_few_parts_they_hold_what_was_drawn(parts: int, tau: float, rise: float) -> None:
    """95 % to three standard errors at least: the shape costs a degree of freedom of few."""
    tables, sizes, times = 60, 0, 0
    for seed in range(1, tables + 1):
        effect = told(parts, rise, tau, seed)
        low, high, _ = effect.intervals[0]
        sizes += low <= rise <= high
        ((_, first, last),) = effect.searched.values()
        times += first <= tau <= last
    least = tables * (0.95 - 3 * np.sqrt(0.95 * 0.05 / tables))
    assert min(sizes, times) > least


def test_what_is_slower_than_any_run_has_no_upper_end() -> None:
    effect = told(24, 200e-3, 4000.0, 3)
    low, high, _ = effect.intervals[0]
    assert (low > 0, high) == (True, np.inf)
    ((_, first, last),) = effect.searched.values()
    assert (first > 100.0, last) == (True, np.inf)


def test_what_is_faster_than_the_first_part_has_no_lower_end() -> None:
    effect = told(24, 6e-3, 2.0, 3)
    ((_, first, last),) = effect.searched.values()
    assert (first, last < 100.0) == (0.0, True)
    low, high, _ = effect.intervals[0]
    assert low < 6e-3 < high < 20e-3


@pytest.mark.parametrize(
    ("found", "text"),
    [
        ((26.0, 0.0, np.inf), ("26.0", "(not told)")),
        ((690.0, 130.0, np.inf), ("at least 130", "")),
        ((300.0, 130.0, np.inf), ("at least 130", "")),
        ((15.0, 0.0, 38.4), ("at most 38", "")),
        ((50.8, 40.4, 65.3), ("50.8", "[40.4, 65.3]")),
    ],
)
def test_ends_are_told_where_there_are_any(
    found: tuple[float, float, float], text: tuple[str, str]
) -> None:
    assert searched_text(found) == text


def test_a_size_without_an_end_is_told_by_the_other() -> None:
    assert size_interval(3.35, np.inf, 38.0) == "> 3.4"
    assert size_interval(-np.inf, -0.21, 38.0) == "< -0.21"
    assert size_interval(-np.inf, np.inf, 38.0) == "any"
    assert size_interval(1.2, 3.4, 0.5) == "[1.20, 3.40]"
    assert open_end(3.35, np.inf) == " (95 %: > 3.4)"
    assert open_end(-np.inf, np.inf) == " (95 %: any)"
    assert open_end(1.2, 3.4) == ""
