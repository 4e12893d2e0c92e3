"""An offset that is only the constant of a drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from crossed_tables import Floats
from separation_examples import LIBRARY
from warm_day import T, described, empty, found, of_covariate, step, with_x

from mtu_cli.close_loop_sealed.analyses.loop import one_table
from mtu_cli.close_loop_sealed.analyses.loop.added import Added, contribution
from mtu_cli.close_loop_sealed.analyses.loop.describe import found_effects
from mtu_cli.close_loop_sealed.analyses.loop.own_constant import with_own_constants
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.rivals import all_instead
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.searched import Searched
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit

GROWTH, FIXED = 20e-6, 400.0


def growing(offset: float = 0.0) -> Prepared:
    """X grows from x = 400 mm and 20 degC."""
    table, _ = empty()
    warmer = table.covariates[T] - 20.0
    return with_x(GROWTH * (table.places[..., 0] - FIXED) * warmer + offset)


def joined(prepared: Prepared, *steps: Step) -> tuple[Prepared, Search]:
    first = Searched(
        gross=(), prepared=prepared, gate=cast(Any, None), found=found(prepared, *steps)
    )
    own = with_own_constants(first)
    return own.prepared, own.found


def three(prepared: Prepared, growth: int = 0, rivals: Sequence[str] = ()) -> tuple[Step, ...]:
    return (
        step(prepared, "offset-x"),
        step(prepared, "thermal-growth-x", growth),
        step(prepared, "thermal-drift-x", rivals=rivals),
    )


def says(prepared: Prepared, own: Search) -> tuple[Added, Floats]:
    effects = described(prepared, own).effects
    members = tuple(prepared.members[m] for m in effects.members)
    return effects, contribution(effects, prepared.table, members)


@pytest.mark.parametrize(
    ("growth", "offset"),
    [(0, 0.0), (1, 0.0), (0, 0.2e-3)],
    ids=["from-20", "from-the-mean", "beside-a-small-offset"],
)
def test_an_offset_that_the_growth_explains_is_a_level_of_its_drift(
    growth: int, offset: float
) -> None:
    """g (x_0 - c) (T - 20) has the mean g (x_0 - c) (T_0 - 20): -19.5 um, here."""
    prepared = growing(offset)
    steps = three(prepared, of_covariate(prepared, "thermal-growth-x", T)[growth])
    other, own = joined(prepared, *steps)
    assert own.steps == steps[1:]
    (drift,) = [e for e in found_effects(described(other, own), [None] * 2) if "drift" in e.name]
    assert drift.equations == {"Ex": f"drift*({T} - 20) + level"}
    effects, after = says(other, own)
    before, beside = says(prepared, found(prepared, *steps))
    assert abs(beside - after).max() < 1e-12
    # About 23 degC, the mean, nothing is told anew: the level alone begins elsewhere.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 3.0, 1.0]])
    was, now = cast(StratifiedFit, before.fit), cast(StratifiedFit, effects.fit)
    np.testing.assert_allclose(turn @ now.beta, was.beta, rtol=1e-9)
    np.testing.assert_allclose(turn @ now.covariance @ turn.T, was.covariance, atol=1e-18)
    assert abs(now.beta[2] - offset) < 3 * np.sqrt(now.covariance[2, 2])
    true = GROWTH * (prepared.table.places[..., 0] - FIXED) * (prepared.table.covariates[T] - 20.0)
    # Where the growth is written from the mean, its scale there is no effect of it.
    scale = GROWTH * 65.0 * 3.0 if growth else 0.0
    assert abs(after[:, :, 0] - true - offset).max() < 1.5e-3 + scale


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


def test_an_offset_too_small_to_be_found_is_a_level_all_the_same() -> None:
    """The drift is the same beside it as without it, and starts where the growth does."""
    prepared = growing()
    offset, growth, drift = three(prepared)
    other, own = joined(prepared, growth, drift)
    assert own.steps == (growth, drift)
    assert says(other, own)[0].levels == says(*joined(prepared, offset, growth, drift))[0].levels
    # One that does not agree is no level of a drift: it was not found, and is told nowhere.
    assert joined(growing(offset=6e-3), growth, drift)[0].members == prepared.members


def test_a_rival_of_the_drift_keeps_the_offset() -> None:
    prepared = growing()
    other, own = joined(prepared, *three(prepared, rivals=("trend-x",)))
    told = described(other, own)
    ((rival,),) = [[i.rival] for i in all_instead(told, found_effects(told, [None] * 2), LIBRARY)]
    assert rival.equations["Ex"].endswith(" + level")
    (level,) = [p for p in rival.parameters if p[0] == "level"]
    assert level[2] == pytest.approx(float(prepared.table.errors[:, :, 0].mean()), abs=1e-6)


def test_a_rival_along_another_axis_has_no_level_of_the_drift() -> None:
    prepared = growing()
    told = described(*joined(prepared, *three(prepared, rivals=("step-y",))))
    ((rival,),) = [[i.rival] for i in all_instead(told, found_effects(told, [None] * 2), LIBRARY)]
    assert set(rival.equations) == {"Ey"}
    assert [name for name, *_ in rival.parameters] == ["jump"]


def test_beside_a_rival_of_the_growth_the_drift_keeps_its_level() -> None:
    prepared = growing()
    offset, growth, drift = three(prepared)
    unsure = step(prepared, "thermal-growth-x", rivals=("squareness-xy",))
    assert unsure.member == growth.member
    told = described(*joined(prepared, offset, unsure, drift))
    others = all_instead(told, found_effects(told, [None] * 2), LIBRARY)
    (beside,) = [i.effects[1] for i in others if i.rival.name == "squareness-xy"]
    assert beside.equations == {"Ex": f"drift*({T} - 20) + level"}


def test_the_loop_takes_out_what_it_would_beside_the_offset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nothing held out, and a gate of few tables: neither is what this is about."""
    monkeypatch.setattr(one_table, "splits_of", lambda _: ())
    monkeypatch.setattr(one_table, "SAMPLES", 99)
    prepared = growing()
    known = [c for c in prepared.source if c.name in ("thermal-growth-x", "thermal-drift-x")]
    known += [c for c in prepared.source if c.name == "offset-x"]
    found = one_table.loop_on(prepared.table, known, LIBRARY, alpha=0.05, most=4, seed=1).result
    assert found.verdict == "named"
    assert {e.name for e in found.effects} == {"thermal-growth-x", "thermal-drift-x"}
    (drift,) = [e for e in found.effects if e.name == "thermal-drift-x"]
    assert drift.equations == {"Ex": f"drift*({T} - 20) + level"}
    # The scatter was made with 1 um: its rms of 384 values is known to 1/sqrt(2*384), of which 4.
    assert found.in_sample_after.rms == pytest.approx(1e-3, rel=4 / np.sqrt(2 * 384))
    (point,) = found.fixed_points
    assert point.at == pytest.approx(FIXED, abs=4 * point.u)


def test_a_growth_that_waves_along_its_axis_has_no_zero() -> None:
    """Its equation is a straight line through x = 0, 500 and 1000 mm all the same."""
    prepared = growing()
    steps = three(prepared)
    at = steps[1].member
    waves = {"Ex": f"growth*(x - 75 + 40*sin(pi*x/500))*({T} - 20)"}
    members = list(prepared.members)
    members[at] = replace(members[at], equations=waves)
    assert joined(replace(prepared, members=tuple(members)), *steps)[1].steps == steps
