"""The search: what passes, in which order, what it is ranked with, and when it ends."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import grid_places
from effect_tables import table as points_table
from loop_tables import candidate, crossed, offset, prepared_with, residuals, whole_column
from scipy.special import logsumexp
from scipy.stats import binom
from separation_examples import LIBRARY as SHOP

from mtu_cli.close_loop_sealed.analyses.loop.classes import class_of
from mtu_cli.close_loop_sealed.analyses.loop.describe import candidate_name
from mtu_cli.close_loop_sealed.analyses.loop.detectable import minimum_detectable
from mtu_cli.close_loop_sealed.analyses.loop.estimate import raw_design
from mtu_cli.close_loop_sealed.analyses.loop.evidence import _scatters_apart
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.ranking import posterior_of
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.model.effect_candidate import Column
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.close_loop_sealed.stats.scatter_tests import two_scatters_p

SHAPE = (12, 10, 2)
RNG = np.random.default_rng(1)


def centred(values: Floats) -> Floats:
    return np.asarray(values - values.mean())


COLUMNS: dict[str, Column] = {
    "trend": {0: centred(np.arange(12.0)[:, None])},
    "late": {0: centred(np.exp(np.arange(12.0) / 6)[:, None])},
    "shape": {0: centred(RNG.normal(size=(1, 10)))},
    "twin": {0: centred(RNG.normal(size=(1, 10)))},
    "cells": {1: centred(RNG.normal(size=(12, 10)))},
    "both": {0: centred(RNG.normal(size=(12, 10))), 1: centred(RNG.normal(size=(12, 10)))},
    "step": {1: np.asarray(np.arange(12) >= 5, float)[:, None]},
}
COLUMNS["twin"] = {0: COLUMNS["shape"][0] + 0.25 * COLUMNS["twin"][0]}
LIBRARY = (*(candidate(name, (c,)) for name, c in COLUMNS.items()), offset("x"), offset("y"))


def quiet(rng: np.random.Generator) -> Floats:
    return crossed(rng, SHAPE, part=0.7, column=0.5)


@cache
def ready() -> tuple[Prepared, Gate]:
    own = prepared_with(residuals(quiet(np.random.default_rng(2))), *LIBRARY)
    return own, calibrated(own.scan, 1999, 3)


def searched(errors: Floats, alpha: float = 0.05, most: int = 4) -> Search:
    own, gate = ready()
    moved = own.with_table(replace(own.table, errors=errors))
    return search(moved, gate, alpha=alpha, most=most)


def names(found: Search) -> list[str]:
    return [ready()[0].candidates[step.index].name for step in found.steps]


def with_effects(seed: int, **strength: float) -> Floats:
    """Strengths in root mean squares along the axis of the column."""
    errors = quiet(np.random.default_rng(seed))
    for name, value in strength.items():
        whole = whole_column(COLUMNS[name], SHAPE)
        errors += value * whole / np.sqrt(np.mean(whole[..., list(COLUMNS[name])] ** 2))
    return errors


@pytest.mark.parametrize("name", ["trend", "cells", "both", "step"])
def test_a_strong_effect_is_the_only_one_and_has_its_name(name: str) -> None:
    found = [searched(with_effects(seed, **{name: 2.0})) for seed in range(20)]
    right = sum(names(item)[:1] == [name] for item in found)
    more = sum(len(item.steps) > 1 for item in found)
    assert right >= binom.ppf(1e-3, 20, 0.95)
    assert more <= binom.ppf(1 - 1e-3, 20, 0.07)


def test_several_effects_are_found_each_once_and_no_more_than_asked() -> None:
    errors = with_effects(30, trend=3.0, cells=2.0, both=1.5)
    assert sorted(names(searched(errors))) == ["both", "cells", "trend"]
    assert len(searched(errors, most=2).steps) == 2
    assert searched(errors, most=0).steps == ()


def test_at_the_cap_the_levels_of_what_was_found_are_still_looked_at() -> None:
    errors = with_effects(7, trend=3.0)
    errors[..., 0] += 3.0
    found = searched(errors, most=1)
    assert set(names(found)) == {"trend", "offset-x"}
    assert not found.stopped
    other = errors + with_effects(8, cells=3.0)
    other[..., 1] += 3.0
    found = searched(other, most=1)
    assert len(set(names(found)) & {"trend", "cells"}) == 1
    assert found.stopped
    # Levels of what was not found are causes of their own.
    axis = "x" if "trend" in names(found) else "y"
    assert {name for name in names(found) if name.startswith("offset")} <= {f"offset-{axis}"}
    whole = searched(other)
    assert set(names(whole)) == {"trend", "cells", "offset-x", "offset-y"}
    assert not whole.stopped


def test_a_level_has_no_rivals_at_the_cap_and_below_it() -> None:
    """What passes beside it, or does not, is another cause."""
    errors = with_effects(9, trend=6.0)
    errors[..., 0] += 0.9
    whole = searched(errors)
    assert names(whole) == ["trend", "offset-x"]
    assert whole.steps[1].credible == (whole.steps[1].index,)
    # Another cause, along y, changes nothing of x but that it passes too.
    beside = errors + with_effects(9, cells=0.6) - with_effects(9)
    capped = searched(beside, most=1)
    assert (names(capped), capped.stopped) == (["trend", "offset-x"], True)
    assert capped.steps[1].credible == whole.steps[1].credible


def test_what_is_minor_of_an_effect_is_taken_off_with_it_where_cells_are_missing() -> None:
    """A growth is seldom read at one temperature within a part: a thousandth of it is in cells.

    In a complete table it is one effect; that a cell is missing must not make it two.
    """
    rng = np.random.default_rng(3)
    small = centred(rng.normal(size=(12, 10)))
    large = COLUMNS["shape"][0] + 0.2 * centred(np.arange(12.0)[:, None]) + 0.04 * small
    own = (candidate("growth", ({0: large},)), candidate("cells", ({0: small},)))
    errors = quiet(rng)
    errors[..., 0] += 20.0 * large
    for missing in (0, 1):
        there = np.ones((12, 10), bool)
        there[4, 7] = not missing
        prepared = prepared_with(residuals(errors, there=there), *own)
        found = search(prepared, calibrated(prepared.scan, 499, 3), alpha=0.05, most=4)
        assert [prepared.candidates[step.index].name for step in found.steps] == ["growth"]
        (whole,) = prepared.whole(found.members)
        taken = raw_design(prepared.scan, [whole])[:, 0]
        table = whole_column({0: large}, SHAPE) * there[..., None]
        np.testing.assert_allclose(taken, prepared.scan.frame.coordinates(table)[0], atol=1e-9)


def test_a_class_is_the_same_where_a_cell_is_missing() -> None:
    """Of two effects beside a growth, that which is there; not what a rest of the growth is."""
    rng = np.random.default_rng(3)
    small = centred(rng.normal(size=(12, 10)))
    wander = centred(np.random.default_rng(8).normal(size=(12, 1))) * np.ones((1, 10))
    growth = COLUMNS["shape"][0] + 0.2 * centred(np.arange(12.0)[:, None]) + 0.04 * small
    effects = {"growth": growth, "wander": wander, "mix": wander + 0.6 * small}
    own = [candidate(name, ({0: column},)) for name, column in effects.items()]
    errors = quiet(rng)
    errors[..., 0] += 20.0 * growth + 3.0 * wander
    for missing in (0, 1):
        there = np.ones((12, 10), bool)
        there[4, 7] = not missing
        prepared = prepared_with(residuals(errors, there=there), *own)
        found = search(prepared, calibrated(prepared.scan, 499, 3), alpha=0.05, most=4)
        (step,) = [s for s in found.steps if prepared.candidates[s.index].name == "wander"]
        posterior = class_of(prepared, found, replace(step, credible=(1, 2))).posterior
        assert posterior[1] > 0.95


def test_parts_that_scatter_in_scale_are_no_growth_where_cells_are_missing() -> None:
    """What a part's own line foretells of a missing cell is no scatter of single cells."""
    rng = np.random.default_rng(0)
    errors, x = quiet(rng), centred(grid_places(10, jitter=3.0)[:, 0])[None]
    trend = COLUMNS["trend"][0]
    errors[..., 0] += 20.0 * rng.normal(size=(12, 1)) * x / x.std()
    there = np.ones((12, 10), bool)
    there.flat[[4, 37, 62, 95]] = False
    own = candidate("growth", ({0: trend * x},))
    prepared = prepared_with(residuals(errors, there=there), own)
    assert search(prepared, calibrated(prepared.scan, 499, 3), alpha=0.05, most=4).steps == ()


def test_the_first_look_is_the_same_however_many_are_asked_for() -> None:
    errors = with_effects(31, trend=3.0, cells=2.0)
    one, more = searched(errors, most=1), searched(errors, most=4)
    for what in ("p", "log_bayes", "posterior"):
        np.testing.assert_array_equal(getattr(one, what), getattr(more, what))
    assert one.posterior.sum() == pytest.approx(1.0)


def test_nothing_passes_at_a_rate_of_zero() -> None:
    assert searched(with_effects(32, trend=9.0), alpha=0.0).steps == ()


def test_what_cannot_be_told_apart_is_in_the_class() -> None:
    count, held, alone = 30, 0, 0
    for seed in range(40, 40 + count):
        found = searched(with_effects(seed, shape=1.5))
        if not found.steps:
            continue
        step = found.steps[0]
        own = {ready()[0].scan.names[i] for i in step.credible if i < len(LIBRARY)}
        held += "shape" in own
        alone += own == {"shape"}
        assert 0 < step.posterior <= 1
        assert step.index in step.credible
    assert held >= binom.ppf(1e-3, count, 0.95)
    # The twin is within a few degrees of it: hardly ever told by itself.
    assert alone < count / 2


def test_posteriors_are_bayes_rule() -> None:
    scores = np.array([-1e6, 3.0, 700.0, 701.5, -np.inf])
    expected = np.exp(scores - logsumexp(scores))
    np.testing.assert_allclose(posterior_of(scores), expected, rtol=1e-12)
    assert posterior_of(np.zeros(0)).shape == (0,)


def test_a_mean_error_is_an_offset_and_a_step_has_its_own() -> None:
    errors = quiet(np.random.default_rng(50)) + np.array([2.5, 0.0])
    assert names(searched(errors)) == ["offset-x"]
    # A step of 4 um at part 5 of 12 has a mean of 2.3 um: no offset besides.
    errors = quiet(np.random.default_rng(51)) + 4.0 * whole_column(COLUMNS["step"], SHAPE)
    assert names(searched(errors)) == ["step"]


def test_a_mean_error_is_no_rival_of_a_shape_that_acts_beside_it() -> None:
    """Either shows without the other: both are found, none of them in the class of the other."""
    scan = ready()[0].scan
    offsets = set(range(len(scan.columns), scan.tested))
    seen = 0
    for seed in range(60, 66):
        found = searched(with_effects(seed, shape=2.5) + np.array([2.5, 0.0]))
        for step in found.steps:
            if step.member >= 0:
                assert not offsets & set(step.credible)
        seen += len(found.steps) > 1
    assert seen > 0


def test_parts_that_wander_get_no_lone_name() -> None:
    rng, count = np.random.default_rng(52), 20
    named = 0
    for _ in range(count):
        walk = np.cumsum(rng.normal(size=(12, 1)), axis=0)
        errors = quiet(rng)
        errors[:, :, 0] += 2 * centred(walk)
        found = searched(errors)
        lone = len(found.steps) == 1 and len(found.steps[0].credible) == 1
        named += lone and not found.without_name and not found.fired(0.05)
    assert named <= binom.ppf(1 - 1e-3, count, 0.1)


def test_what_has_no_name_is_in_the_class_until_it_is_out_at_one_in_a_hundred() -> None:
    """A name held 95 % of the posterior and was alone with a drift left at 2 %: walks got names."""
    own = ready()[0]
    inside = outside = 0
    for seed in range(70, 130):
        found = searched(with_effects(seed, step=0.5 + (seed - 70) / 60))
        for step in found.steps:
            nameless = [i for i in step.credible if i >= len(own.candidates)]
            # A step along one axis has one rival without a name: the drift along that axis.
            assert bool(nameless) == (step.unnamed >= 0.01)
            others = [i for i in step.credible if i not in nameless]
            lone = others == [step.index]
            inside += lone and 0.01 <= step.unnamed < 0.05
            outside += lone and not nameless
    assert inside > 0
    assert outside > 0


def test_an_empty_library_is_searched_without_a_fault() -> None:
    own = prepare(residuals(quiet(np.random.default_rng(53))), ())
    found = search(own, calibrated(own.scan, 199, 1), alpha=0.05, most=4)
    assert found.steps == ()
    assert [name for name, _ in found.checks][-1] == "part-variance"


def test_the_same_search_gives_the_same_bytes() -> None:
    errors = with_effects(54, trend=3.0, cells=2.0)
    a, b = searched(errors), searched(errors)
    assert a.steps == b.steps
    assert a.checks == b.checks
    assert a.p.tobytes() == b.p.tobytes()


@pytest.mark.parametrize("name", ["trend", "shape", "cells", "both"])
def test_the_smallest_detectable_effect_is_found_four_times_in_five(name: str) -> None:
    own, gate = ready()
    rng, count, passed = np.random.default_rng(55), 100, 0
    whole = whole_column(COLUMNS[name], SHAPE)
    size = np.sqrt(np.mean(whole[..., list(COLUMNS[name])] ** 2))
    index = own.scan.names.index(name)
    for _ in range(count):
        errors = quiet(rng)
        first = own.with_table(replace(own.table, errors=errors))
        nothing = search(first, gate, alpha=0.05, most=0)
        smallest = minimum_detectable(first, gate, nothing, 0.05)[name]
        found = searched(errors + smallest / size * whole, most=0)
        passed += bool(found.p[index] < 0.05)
    # 80 %, and ten more or less for the approximation of Student's noncentral distribution.
    assert binom.ppf(1e-3, count, 0.7) <= passed <= binom.ppf(1 - 1e-3, count, 0.9)


def test_what_was_found_is_no_noise_of_what_could_have_been() -> None:
    """The smallest detectable effect is that of the data without the effect, within what the
    estimate takes along: one coordinate of some hundred.
    """
    own, gate = ready()
    errors = quiet(np.random.default_rng(56))
    name, size = "cells", 0.0
    limits = []
    for size in (0.0, 20.0):
        column = whole_column(COLUMNS[name], SHAPE)
        table = replace(own.table, errors=errors + size * column)
        first = own.with_table(table)
        found = search(first, gate, alpha=0.05, most=1)
        assert len(found.members) == (size > 0)
        limits.append(minimum_detectable(first, gate, found, 0.05)["trend"])
    assert limits[1] == pytest.approx(limits[0], rel=0.02)


def test_what_wanders_has_no_name_and_its_axis() -> None:
    """Beside candidates of scatter, which stand between those of the mean and what has no name."""
    table = points_table(18, 16, places=grid_places(16, jitter=2.0))
    known = [
        c
        for c in candidates(table, SHOP)
        if c.name in ("trend-x", "trend-y", "rotation-scatter", "scale-scatter")
    ]
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(0.0, 3e-3, (18, 1, 2)), axis=0)
    errors = 1e-3 * rng.normal(size=table.errors.shape) + walk
    own = prepare(replace(table, errors=errors), known)
    found = search(own, calibrated(own.scan, 499, 3), alpha=0.05, most=4)
    assert found.steps
    assert found.without_name
    told = [candidate_name(own, i) for i in found.nameless]
    assert all(name.startswith("unnamed-") for name in told)
    assert any(name.startswith("unnamed-drift-") for name in told)


@pytest.mark.parametrize("axes", [(0,), (0, 1)])
def test_an_operation_that_scatters_along_one_axis_is_seen(axes: tuple[int, ...]) -> None:
    """Of all axes together it would be lost among the others."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 300, 3))
    clean = _scatters_apart(a, b, 0.8)
    assert clean > 0.05
    a[:, list(axes)] *= 1.35
    assert _scatters_apart(a, b, 0.8) < 1e-3
    assert two_scatters_p(a[:, :1], b[:, :1], 0.8)[0] <= _scatters_apart(a[:, :1], b[:, :1], 0.8)


def test_what_scatters_along_one_axis_is_not_lost_among_the_others() -> None:
    """1.3 times of 300 entries: 4 standard errors along that axis, not 3 along all of them."""
    told, together = [], []
    for seed in range(40):
        a, b = np.random.default_rng(seed).normal(size=(2, 300, 3))
        a[:, 0] *= 1.3
        told.append(_scatters_apart(a, b, 0.8))
        together.append(two_scatters_p(a, b, 0.8)[0])
    assert np.median(told) < 0.3 * np.median(together)


def test_scatters_apart_are_as_rare_as_their_p() -> None:
    rng = np.random.default_rng(6)
    p = []
    for _ in range(1000):
        a, b = rng.normal(size=(2, 200, 2))
        p.append(_scatters_apart(a, b, 1.0))
    assert binom.sf(sum(own < 0.05 for own in p), len(p), 0.05) > 1e-3
