"""Lost motion of a few passes whose levels and slopes scatter: its u and interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import Segment, loaded, permuted, readings
from reading_examples import only
from scipy.special import stdtrit
from scipy.stats import binom
from separation_examples import LIBRARY, found_as

from mtu_cli.close_loop_sealed.analyses.loop.added import Added
from mtu_cli.close_loop_sealed.analyses.loop.fitted import beside_polynomial
from mtu_cli.close_loop_sealed.analyses.loop.prepare import prepare
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.close_loop_sealed.stats.estimated_scatter import inflation
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import estimates_from_fit, fit_machine

UM = 1e-3
TARGETS = np.linspace(0.0, 400.0, 9)
LOST = 8 * UM
BACKLASH = replace(
    LIBRARY,
    families=tuple(item for item in LIBRARY.families if item.family.family == "backlash"),
)
"""What else the library has is not looked at, and most of the work."""


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> LoadedMachine:
    text = "components:\n  px: {of: x, unit: um}\nequations: {Ex: px}\n"
    return loaded(tmp_path_factory.mktemp("axis"), text)


def run(passes: int, scatter: float, seed: int) -> Readings:
    """Of 1 um noise, each pass and direction with a level and slope of its own."""
    rng = np.random.default_rng(seed)
    direction = np.tile(np.repeat([1, -1], len(TARGETS)), passes)
    position = np.tile(np.concatenate([TARGETS, TARGETS[::-1]]), passes)
    number = np.repeat(np.arange(passes) + 1, 2 * len(TARGETS))
    level, slope = scatter * UM * rng.normal(size=(2, 2 * passes))
    own = 2 * (number - 1) + (direction > 0)
    error = level[own] + slope[own] * (position - 200) / 200 + LOST * direction
    error += UM * rng.normal(size=len(error))
    return readings(
        [Segment(name="px", position=position, error=error, passes=number, direction=direction)]
    )


def lost_motion(axis: LoadedMachine, found: Readings) -> Added:
    table = only(reading_tables(axis, None, found))
    own = beside_polynomial(table, candidates(table, BACKLASH))
    prepared = prepare(table, [item for item in own if item.name == "backlash-x"])
    return found_as(prepared, ["backlash-x"])[0]


def figures(found: Added) -> tuple[float, float, float]:
    fit = found.fit
    assert fit is not None
    return float(fit.beta[0]), float(np.sqrt(fit.covariance[0, 0])), float(fit.dof[0])


@pytest.mark.parametrize(("passes", "scatter"), [(5, 3.0), (8, 1.0)])
def test_intervals_cover(axis: LoadedMachine, passes: int, scatter: float) -> None:
    count, hits, freedom = 150, 0, []
    for seed in range(count):
        beta, u, dof = figures(lost_motion(axis, run(passes, scatter, seed)))
        freedom.append(dof)
        hits += bool(abs(beta - LOST) <= stdtrit(dof, 0.975) * u)
    assert hits >= binom.ppf(1e-3, count, 0.94)
    # Two directions are reversed: level and slope.
    assert np.median(freedom) < passes - 1


def test_where_passes_do_not_scatter_nothing_is_added(axis: LoadedMachine) -> None:
    found = lost_motion(axis, run(8, 0.0, 3))
    _, u, dof = figures(found)
    assert u == pytest.approx(UM / np.sqrt(8 * 2 * len(TARGETS)), rel=0.4)
    # Those of what targets have of their own.
    assert dof > inflation(7.0, 2)[1]


@pytest.mark.parametrize("passes", [3, 4, 6])
def test_a_missing_reading_does_not_change_what_is_known(axis: LoadedMachine, passes: int) -> None:
    whole = run(passes, 1.0, 11)
    gap = permuted(whole, np.flatnonzero(np.arange(len(whole)) != 13))
    one, other = figures(lost_motion(axis, whole)), figures(lost_motion(axis, gap))
    assert other[0] == pytest.approx(one[0], abs=0.5 * one[1])
    # Of an incomplete table it is drawn, here from 200 tables: 5 %.
    assert other[1] == pytest.approx(one[1], rel=0.3)


def test_a_scatter_that_was_known_is_known(axis: LoadedMachine) -> None:
    before = estimates_from_fit(axis, fit_machine(axis, run(5, 1.0, 1)))
    assert only(reading_tables(axis, before, run(5, 1.0, 2))).scatter_known
    assert not only(reading_tables(axis, None, run(5, 1.0, 2))).scatter_known
