"""An offset that is only the constant of a drift, and effects that were found twice over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import shop_covariates
from effect_tables import table as points_table
from separation_examples import LIBRARY, index, members_of

from mtu_cli.analyses.close_loop import own_constant
from mtu_cli.analyses.close_loop.added import Added, added, contribution
from mtu_cli.analyses.close_loop.describe import Described, found_effects
from mtu_cli.analyses.close_loop.own_constant import with_own_constants
from mtu_cli.analyses.close_loop.prepare import Prepared, prepare
from mtu_cli.analyses.close_loop.rivals import all_instead
from mtu_cli.analyses.close_loop.search import Search
from mtu_cli.analyses.close_loop.searched import Searched
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.analyses.close_loop.twofold import twofold
from mtu_cli.model.effect_library import candidates
from mtu_cli.model.residual_table import ResidualTable

T = "T_spindle_degC"
PARTS, FEATURES = 12, 16
GROWTH, FIXED = 20e-6, 400.0
KNOWN = (
    *("thermal-growth-x", "thermal-drift-x", "trend-x", "offset-x"),
    *("wear-approach-x", "step-x", "squareness-xy"),
)


@cache
def empty() -> tuple[ResidualTable, Prepared]:
    """A day that warms up from 20 to 26 degC, from part to part."""
    warm = 20.0 + 6.0 * np.arange(PARTS)[:, None] / (PARTS - 1)
    table = points_table(PARTS, FEATURES, covariates=shop_covariates(PARTS, FEATURES) | {T: warm})
    table = replace(table, errors=1e-3 * np.random.default_rng(2).normal(size=table.errors.shape))
    known = [c for c in candidates(table, LIBRARY) if c.name in KNOWN]
    return table, prepare(table, known)


def with_x(errors: Floats) -> Prepared:
    """The day with errors along x beside its scatter, mm."""
    table, prepared = empty()
    whole = table.errors.copy()
    whole[:, :, 0] += errors
    return prepared.with_table(replace(table, errors=whole))


def growing(offset: float = 0.0) -> Prepared:
    """X grows from x = 400 mm and 20 degC."""
    table, _ = empty()
    warmer = table.covariates[T] - 20.0
    return with_x(GROWTH * (table.places[..., 0] - FIXED) * warmer + offset)


def step(prepared: Prepared, name: str, of: int = 0, rivals: Sequence[str] = ()) -> Step:
    """A step of member `of` of a candidate, which these rivals may be as well."""
    own = index(prepared, name)
    return Step(
        index=own,
        member=members_of(prepared, name)[of] if own < len(prepared.scan.columns) else -1,
        p=0.01,
        log_bayes=0.0,
        posterior=1.0,
        credible=(own, *(index(prepared, rival) for rival in rivals)),
    )


def of_covariate(prepared: Prepared, name: str, covariate: str | None) -> list[int]:
    """Which members of a candidate are of a covariate."""
    own = [prepared.members[m] for m in members_of(prepared, name)]
    return [i for i, member in enumerate(own) if member.covariate == covariate]


def found(prepared: Prepared, *steps: Step) -> Search:
    none = np.zeros(len(prepared.candidates))
    return Search(
        steps=steps, p=none, log_bayes=none, posterior=none, checks=(), without_name=False
    )


def joined(prepared: Prepared, *steps: Step, most: int = 9) -> tuple[Prepared, Search]:
    first = Searched(
        gross=(), prepared=prepared, gate=cast(Any, None), found=found(prepared, *steps)
    )
    own = with_own_constants(first, alpha=0.05, most=most)
    return own.prepared, own.found


def three(prepared: Prepared, growth: int = 0, rivals: Sequence[str] = ()) -> tuple[Step, ...]:
    return (
        step(prepared, "offset-x"),
        step(prepared, "thermal-growth-x", growth),
        step(prepared, "thermal-drift-x", rivals=rivals),
    )


def says(prepared: Prepared, own: Search) -> tuple[Added, Floats]:
    effects = added(prepared, own)
    members = tuple(prepared.members[m] for m in effects.members)
    return effects, contribution(effects, prepared.table, members)


@pytest.mark.parametrize("growth", [0, 1], ids=["from-20", "from-the-mean"])
def test_an_offset_that_the_growth_explains_belongs_to_its_drift(growth: int) -> None:
    """g (x_0 - c) (T - 20) has the mean g (x_0 - c) (T_0 - 20): -19.5 um, here."""
    prepared = growing()
    steps = three(prepared, of_covariate(prepared, "thermal-growth-x", T)[growth])
    other, own = joined(prepared, *steps)
    assert own.steps == steps[1:]
    (drift,) = [e for e in found_effects(described(other, own), [None] * 2) if "drift" in e.name]
    assert drift.equations == {"Ex": f"drift*({T} - 20)"}
    effects, after = says(other, own)
    assert effects.levels == ()
    _, before = says(prepared, found(prepared, *steps))
    # Both readings, to the uncertainty of an offset of 12 parts and 16 features.
    assert abs(before - after).max() < 4e-3 / np.sqrt(PARTS)
    warmer = prepared.table.covariates[T] - 20.0
    true = GROWTH * (prepared.table.places[..., 0] - FIXED) * warmer
    # Where the growth is written from the mean, its scale there is no effect of it.
    scale = GROWTH * 65.0 * 3.0 if growth else 0.0
    assert abs(after[:, :, 0] - true).max() < 1.5e-3 + scale


def described(prepared: Prepared, own: Search) -> Described:
    return Described(prepared=prepared, found=own, effects=added(prepared, own), chosen=())


def test_an_offset_of_its_own_stays_and_so_does_one_without_a_growth() -> None:
    prepared = growing(offset=6e-3)
    steps = three(prepared)
    other, own = joined(prepared, *steps)
    assert other is prepared
    assert own.steps == steps
    prepared = growing()
    without = (step(prepared, "offset-x"), step(prepared, "thermal-drift-x"))
    assert joined(prepared, *without)[1].steps == without
    # Nor with a growth by another sensor.
    steps = three(prepared, of_covariate(prepared, "thermal-growth-x", "T_part_degC")[0])
    assert joined(prepared, *steps)[1].steps == steps


def test_a_search_that_stopped_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = growing()
    steps = three(prepared)
    asked = []

    def again(*_: object, most: int, **__: object) -> Search:
        asked.append(most)
        return found(prepared, *steps, step(prepared, "step-x", 4))

    monkeypatch.setattr(own_constant, "search", again)
    _, own = joined(prepared, *steps, most=3)
    assert asked == [4]
    assert [s.index for s in own.steps] == [s.index for s in (*steps[1:], step(prepared, "step-x"))]
    assert joined(prepared, *steps, most=4)[1].steps == steps[1:]
    assert asked == [4]


def test_a_rival_of_the_drift_keeps_the_offset() -> None:
    prepared = growing()
    other, own = joined(prepared, *three(prepared, rivals=("trend-x",)))
    told = described(other, own)
    ((rival,),) = [[i.rival] for i in all_instead(told, found_effects(told, [None] * 2), LIBRARY)]
    assert rival.equations["Ex"].endswith(" + level")
    (level,) = [p for p in rival.parameters if p[0] == "level"]
    assert level[2] == pytest.approx(float(prepared.table.errors[:, :, 0].mean()), abs=1e-6)


def lost(prepared: Prepared) -> Floats:
    table, _ = empty()
    return 4e-3 * np.broadcast_to(table.covariates["dir_x"], prepared.table.there.shape)


def after(first: int, last: int) -> Floats:
    """5 um from one part to another."""
    own = np.zeros((PARTS, 1))
    own[first:last] = 5e-3
    return np.broadcast_to(own, (PARTS, FEATURES)).copy()


def two_steps(first: int, last: int) -> tuple[Prepared, tuple[Step, ...]]:
    """A jump and the way back, by the steps that are nearest to them."""
    prepared = with_x(after(first, last))
    at = [prepared.members[m].searched["at"] for m in members_of(prepared, "step-x")]
    near = [int(np.argmin(np.abs(np.array(at) - (part + 0.5)))) for part in (first, last)]
    return prepared, tuple(step(prepared, "step-x", of) for of in near)


def twice(prepared: Prepared, steps: Sequence[Step]) -> tuple[str, ...]:
    return twofold(described(prepared, found(prepared, *steps)))


def test_two_ways_to_write_one_cause_are_a_shape_without_a_name() -> None:
    """Lost motion by wear from the middle of the day and, less, from its beginning."""
    prepared = with_x(lost(empty()[1]))
    of_sequence = of_covariate(prepared, "wear-approach-x", "sequence")
    ways = [step(prepared, "wear-approach-x", of) for of in of_sequence]
    assert twice(prepared, ways) == ("wear-approach-x",)
    assert twice(prepared, ways[:1]) == ()
    # Of other tools they are causes of their own; and one of a class says so itself.
    of_tool = of_covariate(prepared, "wear-approach-x", "tool_parts")[0]
    assert twice(prepared, [ways[0], step(prepared, "wear-approach-x", of_tool)]) == ()
    unsure = step(prepared, "wear-approach-x", of_sequence[1], ("trend-x",))
    assert twice(prepared, [ways[0], unsure]) == ()


@pytest.mark.parametrize(("first", "last", "names"), [(4, 8, ()), (6, 7, ("step-x",))])
def test_two_steps_are_two_causes_but_where_they_all_but_cancel(
    first: int, last: int, names: tuple[str, ...]
) -> None:
    assert twice(*two_steps(first, last)) == names
