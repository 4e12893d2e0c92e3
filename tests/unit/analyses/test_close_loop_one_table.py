"""The loop from a table of residuals to its verdict: what hangs together, and the same bytes."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats
from loop_bench.days import UM, shop_table
from shop_day import SIGMA, ShopDay, Truth, effect, measure

from mtu_cli.close_loop_sealed.analyses.loop import CloseLoopResult, close_loop
from mtu_cli.close_loop_sealed.model.effect_library import effect_library
from mtu_cli.findings import InputError

PARTS, SEED = 10, 7
SLOW = ("cyclic", "warm-up", "curvature", "straightness", "wear-approach", "thermal-growth")
"""Families with many members, which nothing here is about."""


@cache
def day() -> ShopDay:
    return ShopDay("B", SEED, parts=PARTS)


@cache
def backlash() -> Truth:
    return effect(day(), "backlash-x", np.random.default_rng(1), 2.0)


def errors(truths: Sequence[Truth] = ()) -> Floats:
    return measure(day(), np.random.default_rng(2), truths)


def closed(values: Floats) -> CloseLoopResult:
    library = effect_library()
    table = shop_table(day(), values)
    return close_loop([table], library, alpha=0.05, max_effects=3, exclude=SLOW, seed=1)


@cache
def found() -> CloseLoopResult:
    return closed(errors([backlash()]))


def test_lost_motion_is_named_with_its_value() -> None:
    (one,) = found().effects
    assert found().verdict == "named"
    assert one.name == "backlash-x"
    assert one.class_names == ("backlash-x",)
    # Half the reversal value: the rms of a column of +-1.
    (_, unit, value, u), *_ = one.parameters
    wanted = float(np.sqrt(np.mean(backlash().errors[..., 0] ** 2))) * UM
    assert unit == "um"
    assert abs(value) == pytest.approx(wanted, abs=4 * u)
    # Known from 240 entries, at best sigma / sqrt(240).
    assert u > 0.9 * SIGMA * UM / np.sqrt(24 * PARTS)


def test_scores_are_those_of_the_errors_less_what_is_explained() -> None:
    (table,) = found().tables
    left = table.table.errors - table.explained
    assert table.in_sample_before.rms == pytest.approx(np.sqrt(np.mean(table.table.errors**2)))
    assert table.in_sample_after.rms == pytest.approx(np.sqrt(np.mean(left**2)))
    assert table.in_sample_after.rms < table.after.rms < table.before.rms
    assert table.before.rms == pytest.approx(table.in_sample_before.rms)
    assert table.held_out_by == "parts"
    (one,) = found().effects
    assert one.of_folds == table.folds == one.folds
    assert table.unexplained_rms is None


def test_a_machine_that_gets_no_equation_keeps_its_errors() -> None:
    quiet = closed(errors())
    (table,) = quiet.tables
    assert quiet.verdict == "none"
    assert table.after.rms == table.before.rms
    assert table.after.largest == table.before.largest


def test_the_explained_is_the_effect() -> None:
    (table,) = found().tables
    (one,) = found().effects
    wanted = backlash().errors * UM
    direction = table.explained[..., 0] - table.explained[..., 0].mean()
    true = wanted[..., 0] - wanted[..., 0].mean()
    assert np.corrcoef(direction.ravel(), true.ravel())[0, 1] == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_array_equal(table.explained[..., 1], 0)
    assert found().covariance.shape == (len(one.parameters),) * 2
    np.testing.assert_allclose(found().covariance, one.covariance)


def test_the_floor_is_the_repeatability_of_an_entry() -> None:
    (table,) = found().tables
    assert table.floor is not None
    # Two axes of some 9 x 21 degrees of freedom.
    assert table.floor == pytest.approx(SIGMA * UM, rel=5 / np.sqrt(2 * 2 * 9 * 21))
    assert 0.7 < (table.in_sample_after.chi2_per_dof or 0.0) < 1.3


def test_every_candidate_of_the_library_is_judged() -> None:
    (table,) = found().tables
    judged = {item.name: item for item in table.candidates}
    own = judged["backlash-x"]
    assert own.p_familywise is not None
    assert own.p_familywise < 0.05
    tested = [item for item in table.candidates if item.posterior is not None]
    assert sum(item.posterior or 0.0 for item in tested) == pytest.approx(1.0)
    assert max(tested, key=lambda item: item.posterior or 0.0).name == "backlash-x"
    assert all(item.unavailable for item in table.candidates if item.posterior is None)
    assert own.minimum_detectable is not None
    assert 0 < own.minimum_detectable < float(np.sqrt(np.mean(backlash().errors ** 2))) * 2 * UM


def test_the_same_bytes_again() -> None:
    again = closed(errors([backlash()]))
    arrays = [
        (r.covariance, r.tables[0].explained, r.tables[0].table.errors) for r in (found(), again)
    ]
    assert [a.tobytes() for a in arrays[0]] == [a.tobytes() for a in arrays[1]]
    told = [
        (r.verdict, r.tables[0].candidates, r.tables[0].checks, r.tables[0].before, r.warnings)
        for r in (found(), again)
    ]
    assert pickle.dumps(told[0]) == pickle.dumps(told[1])


def test_a_gross_entry_is_set_aside_and_changes_nothing_else() -> None:
    spoilt = errors([backlash()])
    spoilt[3, 5] += 90.0
    result = closed(spoilt)
    (table,) = result.tables
    assert [(g.part, g.feature) for g in table.gross] == [(day().parts[3], day().features[5])]
    assert [e.name for e in result.effects] == ["backlash-x"]
    value, u = result.effects[0].parameters[0][2:]
    assert value == pytest.approx(found().effects[0].parameters[0][2], abs=u)
    assert "outliers-set-aside" in [w.code for w in result.warnings]
    assert np.isnan(table.table.errors[3, 5]).all()
    assert np.isfinite(table.explained).all()
    # Held out, the figures are of what was not set aside; with it they stand beside them.
    assert table.held_out_with_gross is not None
    before, after = (own.rms for own in table.held_out_with_gross)
    (sound,) = found().tables
    assert sound.held_out_with_gross is None
    cells, gross = table.table.there.size, np.square(spoilt[3, 5] * UM).sum() / 2
    for kept, whole in ((table.before, before), (table.after, after)):
        # One entry was left out, of `cells`: it holds nearly all of the squares.
        assert whole**2 * cells == pytest.approx(kept.rms**2 * (cells - 1) + gross, rel=0.1)
        assert kept.largest * 5 < np.sqrt(2 * gross)
    # Held out, what was there before is what was measured: to the digit.
    assert table.before.rms == pytest.approx(np.sqrt(np.nanmean(table.table.errors**2)), rel=1e-12)
    measured = shop_table(day(), spoilt).errors
    assert before == pytest.approx(np.sqrt(np.mean(measured**2)), rel=1e-12)
    assert table.before.rms == pytest.approx(sound.before.rms, rel=0.05)
    assert table.after.rms == pytest.approx(sound.after.rms, rel=0.05)


def test_too_little_to_judge_by_is_said() -> None:
    table = shop_table(day(), errors())
    small = replace(
        table,
        parts=table.parts[:3],
        features=table.features[:3],
        errors=table.errors[:3, :3],
        repeats=table.repeats[:3, :3],
    )
    with pytest.raises(InputError):
        close_loop([small], effect_library(), alpha=0.05, max_effects=3, seed=1)
