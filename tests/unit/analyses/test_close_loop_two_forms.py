"""Wear that begins at the new tool, beside lost motion that is there all the time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import shop_covariates
from effect_tables import table as points_table
from separation_examples import LIBRARY, index, members_of
from warm_day import described, found, step

from mtu_cli.close_loop_sealed.analyses.loop.describe import found_effects
from mtu_cli.close_loop_sealed.analyses.loop.otherwise import with_otherwise
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.ranking import ranked
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.two_forms import difference, hidden_in, in_two_names
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

PARTS, FEATURES = 12, 16
WAYS = np.where((np.arange(PARTS)[:, None] + np.arange(FEATURES)) % 2, -1.0, 1.0)
SEQUENCE: Floats = np.arange(1.0, PARTS + 1)[:, None]
TOOL: Floats = np.asarray(np.arange(PARTS) % 5 + 1, np.float64)[:, None]
SIGMA, WEAR, LOST = 1.5e-3, -0.3e-3, -2e-3
"""mm, mm a part, and mm while the tool was new; half of the reversal value."""


@cache
def ready() -> tuple[Prepared, Gate]:
    own: dict[str, Floats] = {"dir_x": WAYS, "sequence": SEQUENCE, "tool_parts": TOOL}
    covariates = {**shop_covariates(PARTS, FEATURES), **own}
    table = points_table(PARTS, FEATURES, covariates=covariates)
    table = replace(table, errors=scatter(1, table.errors.shape))
    known = [
        c
        for c in candidates(table, LIBRARY)
        if c.name in ("backlash-x", "wear-approach-x", "trend-x", "scale-x", "offset-x", "step-x")
    ]
    prepared = prepare(table, known)
    return prepared, calibrated(prepared.scan, 999, 3)


def scatter(seed: int, shape: tuple[int, ...]) -> Floats:
    found: Floats = SIGMA * np.random.default_rng(seed).normal(size=shape)
    return found


def with_x(seed: int, errors: Floats) -> Prepared:
    prepared, _ = ready()
    whole = scatter(seed, prepared.table.errors.shape)
    whole[..., 0] += errors
    return prepared.with_table(replace(prepared.table, errors=whole))


def worn(seed: int, lost: float) -> Prepared:
    return with_x(seed, (lost + WEAR * (SEQUENCE - 1)) * WAYS)


def of(prepared: Prepared, covariate: str, zero: float) -> int:
    """Which member of the wear is counted from `zero` of a covariate."""
    own = members_of(prepared, "wear-approach-x")
    for place, m in enumerate(own):
        member = prepared.members[m]
        if member.covariate == covariate and f"- {zero:g})" in member.equations["Ex"]:
            return place
    raise AssertionError([prepared.members[m].equations for m in own])


def names(own: Prepared, told: Search) -> list[str]:
    return [own.candidates[s.index].name for s in told.steps]


def test_two_forms_differ_by_lost_motion() -> None:
    own, _ = ready()
    lost = index(own, "backlash-x"), members_of(own, "backlash-x")[0]
    new, middle = (step(own, "wear-approach-x", of(own, "sequence", z)) for z in (1, 6.5))
    assert difference(own, new.member, middle.member) == lost
    assert hidden_in(own, new) == hidden_in(own, middle) == lost
    # Of two columns of the data both are causes of their own.
    tool = step(own, "wear-approach-x", of(own, "tool_parts", 1))
    assert difference(own, new.member, tool.member) is None
    assert hidden_in(own, step(own, "trend-x")) is None
    assert hidden_in(own, step(own, "step-x")) is None
    assert hidden_in(own, step(own, "offset-x")) is None


def test_a_copy_of_one_form_is_no_difference() -> None:
    """Of a count of two values wear from the lower one on is lost motion from one part on."""
    ways = np.where(np.arange(FEATURES) % 3, 1.0, -1.0)[None]
    tool = np.repeat([1.0, 2.0], PARTS // 2)[:, None]
    own: dict[str, Floats] = {"dir_x": ways, "sequence": SEQUENCE, "tool_parts": tool}
    table = points_table(PARTS, FEATURES, covariates={**shop_covariates(PARTS, FEATURES), **own})
    names = ("backlash-x", "wear-approach-x", "backlash-step-x")
    prepared = prepare(
        replace(table, errors=scatter(1, table.errors.shape)),
        [c for c in candidates(table, LIBRARY) if c.name in names],
    )
    new = step(prepared, "wear-approach-x", of(prepared, "tool_parts", 1))
    middle = step(prepared, "wear-approach-x", of(prepared, "tool_parts", 1.5))
    assert difference(prepared, new.member, middle.member) is None
    assert hidden_in(prepared, new) is None
    assert in_two_names(prepared, [new, middle])[1] is middle


def test_the_second_form_takes_the_name_of_what_they_differ_by() -> None:
    own, _ = ready()
    new, middle = (step(own, "wear-approach-x", of(own, "sequence", z)) for z in (1, 6.5))
    told = in_two_names(own, [new, middle])
    lost = index(own, "backlash-x")
    assert told[0] is new
    assert (told[1].index, told[1].credible) == (lost, (lost,))
    assert told[1].member == members_of(own, "backlash-x")[0]
    # Not where it was found as well, or is none that may be found.
    assert in_two_names(own, [new, step(own, "backlash-x"), middle])[2] is middle
    assert in_two_names(own, [new, middle], {lost})[1] is middle
    tool = step(own, "wear-approach-x", of(own, "tool_parts", 1))
    assert in_two_names(own, [new, tool, step(own, "trend-x")])[1] is tool


@pytest.mark.parametrize("seed", range(4))
def test_wear_beside_lost_motion_is_found_as_both(seed: int) -> None:
    own = worn(seed, LOST)
    told = search(own, ready()[1], alpha=0.05, most=4)
    assert sorted(names(own, told)) == ["backlash-x", "wear-approach-x"]
    assert all(len(s.credible) == 1 and s.posterior > 0.9 for s in told.steps)
    effects = found_effects(described(own, told), [None] * 2)
    wear = next(e for e in effects if e.name == "wear-approach-x")
    ((_, _, value, u),) = wear.parameters
    assert abs(value - WEAR) < 4 * u
    # As wide as least squares of both has it, to the degrees of freedom of its variance.
    X = np.column_stack([np.ones(WAYS.size), WAYS.ravel(), ((SEQUENCE - 6.5) * WAYS).ravel()])
    plain = SIGMA * float(np.sqrt(np.linalg.inv(X.T @ X)[2, 2]))
    assert u == pytest.approx(plain, rel=0.25)


def test_wear_alone_is_told_with_what_it_is_beside_lost_motion() -> None:
    """Exactly as least squares with both has it."""
    own = worn(7, 0.0)
    new = step(own, "wear-approach-x", of(own, "sequence", 1))
    told = described(own, found(own, new))
    (effect,) = with_otherwise(told, found_effects(told, [None]))
    (other,) = effect.otherwise
    assert other.name == "backlash-x"
    both = described(own, found(own, new, step(own, "backlash-x")))
    wear, lost = found_effects(both, [None] * 2)
    assert other.parameter[2:] == pytest.approx(wear.parameters[0][2:], rel=0.02)
    assert other.constant[2:] == pytest.approx(lost.parameters[0][2:], rel=0.05)
    assert other.parameter[3] > 1.5 * effect.parameters[0][3]
    # With it nothing is left to be told.
    assert all(not e.otherwise for e in with_otherwise(both, (wear, lost)))


def test_two_effects_of_one_candidate_are_judged_beside_each_other() -> None:
    """A drift by the tool and one from part to part: each is there, whatever has its name, too."""
    own = with_x(3, 2e-3 * TOOL + 0.8e-3 * SEQUENCE + np.zeros(WAYS.shape))
    told = search(own, ready()[1], alpha=0.05, most=4)
    trends = [s for s in told.steps if own.candidates[s.index].name == "trend-x"]
    assert {own.members[s.member].covariate for s in trends} == {"sequence", "tool_parts"}
    for s in trends:
        assert s.posterior > 0.5
        assert s.credible[0] == s.index


def test_a_mean_error_has_no_rivals() -> None:
    """What has a mean is judged without it: either may be there without the other."""
    own = with_x(5, np.full(WAYS.shape, 0.55e-3))
    told = search(own, ready()[1], alpha=0.05, most=4)
    assert names(own, told) == ["offset-x"]
    (offset,) = told.steps
    assert offset.credible == (offset.index,)
    assert offset.posterior == 1.0
    # Were all alike an effect would still have all effects of its axis for rivals, but no offset.
    scan = own.scan
    alike, unnamed = np.zeros(scan.tested + len(scan.scatters)), np.zeros(4)
    assert ranked(scan, offset, alike, unnamed).credible == (offset.index,)
    # Of the passes of one run what drifts has a mean, too.
    run = ranked(replace(scan, readings=True), offset, alike, unnamed)
    assert len(run.credible) > 4
    trend = ranked(scan, step(own, "trend-x"), alike, unnamed)
    assert len(trend.credible) > 4
    assert offset.index not in trend.credible
