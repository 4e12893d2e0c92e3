"""Held out: what is scored takes no part in the search, in blocks of parts or every n-th column."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from crossed_tables import Floats, Mask, holes
from loop_bench.folds import LIBRARY as BUILT_IN
from loop_bench.folds import folds_of, held_out
from loop_tables import candidate, crossed, residuals, whole_column

from mtu_cli.close_loop_sealed.analyses.loop.folds import cut_candidates, only_columns, only_parts
from mtu_cli.close_loop_sealed.analyses.loop.held_out import (
    Fold,
    HeldOut,
    joined,
    of_fold,
    scores,
)
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.loop_null import entry_variance

SHAPE = (8, 12, 2)
RNG = np.random.default_rng(1)


def centred(values: Floats) -> Floats:
    return np.asarray(values - values.mean())


PLACE: Column = {0: centred(RNG.normal(size=(1, 12)))}
CELLS: Column = {1: centred(RNG.normal(size=(8, 12)))}
STEP: Column = {0: np.asarray(np.arange(8) >= 6, float)[:, None]}
LIBRARY = (
    candidate("place", (PLACE,)),
    candidate("cells", (CELLS,)),
    candidate("step", (STEP,)),
)
COUNT = 4


def measured(seed: int, shape: tuple[int, int, int] = SHAPE) -> Floats:
    errors = crossed(np.random.default_rng(seed), shape, part=0.5, column=0.3)
    if shape == SHAPE:
        errors += 3.0 * whole_column(PLACE, SHAPE) + 2.0 * whole_column(CELLS, SHAPE)
    return errors


def judged(table: ResidualTable, library: tuple[Candidate, ...] = LIBRARY) -> HeldOut:
    found = held_out(table, folded(table, library), alpha=0.05, most=3)
    assert found is not None
    return found


def folded(table: ResidualTable, library: tuple[Candidate, ...]) -> tuple[Fold, ...]:
    return folds_of(table, library, 1, count=COUNT)


@cache
def first() -> HeldOut:
    return judged(residuals(measured(2)))


def bytes_of(found: HeldOut) -> list[bytes]:
    return [v.tobytes() for v in (found.before, found.after, found.variance)]


def test_blocks_of_consecutive_parts_and_all_of_them_once() -> None:
    folds = folded(residuals(measured(2)), LIBRARY)
    out = np.array([~fold.split.kept for fold in folds])
    np.testing.assert_array_equal(out.sum(axis=0), 1)
    for own in out:
        assert (np.diff(np.flatnonzero(own)) == 1).all()
    assert len(first().chosen) == COUNT
    assert first().by == "parts"


def test_effects_are_found_and_taken_out_without_the_held_out_cells() -> None:
    found = first()
    assert all({"place", "cells"} <= names for names in found.chosen)
    table = residuals(measured(2))
    np.testing.assert_array_equal(found.before, table.errors)
    explained = found.before - found.after
    wanted = 3.0 * whole_column(PLACE, SHAPE) + 2.0 * whole_column(CELLS, SHAPE)
    left = np.mean((explained - wanted) ** 2)
    # Two coefficients a fold of about 0.1 standard error on columns of size one.
    assert left < 0.1
    gain = np.mean(found.before**2) - np.mean(found.after**2)
    assert gain > 0.8 * np.mean(wanted**2)


def test_a_correction_for_each_column_is_the_mean_of_what_the_other_folds_leave() -> None:
    """Cell by cell; one that is missing counts nowhere."""
    there = np.ones(SHAPE[:2], bool)
    there[1, 4] = there[6, 0] = False
    table = residuals(measured(2), there=there)
    folds = folded(table, LIBRARY)
    found = [of_fold(table, fold, BUILT_IN, alpha=0.05, most=3) for fold in folds]
    together = joined(table, [fold.split for fold in folds], found)
    assert together is not None
    assert together.by_column is not None
    for fold, own in zip(folds, found, strict=True):
        left = table.errors - own.foretold
        for part, column in np.ndindex(there.shape):
            if fold.split.kept[part]:
                continue
            others = [left[p, column] for p in range(len(there))
                      if fold.split.kept[p] and there[p, column]]  # fmt: skip
            wanted = left[part, column] - sum(others) / len(others)
            np.testing.assert_allclose(together.by_column[part, column], wanted, rtol=1e-9)


def test_a_gross_entry_is_in_no_correction_for_a_column() -> None:
    errors = measured(2)
    errors[1, 4, 0] += 500.0
    off, clean = judged(residuals(errors)).by_column, first().by_column
    assert off is not None
    assert clean is not None
    others = np.arange(len(errors)) != 1
    np.testing.assert_allclose(off[others], clean[others], atol=0.5)
    assert off[1, 4, 0] > 490.0


def test_the_errors_of_held_out_cells_change_their_own_scores_alone() -> None:
    errors = measured(2)
    rng = np.random.default_rng(3)
    folds = folded(residuals(errors), LIBRARY)
    for i in (0, 2):
        out = ~folds[i].split.kept
        other = errors.copy()
        other[out] = 30.0 * rng.normal(size=other[out].shape)
        one = [folds[i]]
        a, b = (held_out(residuals(e), one, alpha=0.05, most=3) for e in (errors, other))
        assert a is not None
        assert b is not None
        assert a.chosen == b.chosen
        np.testing.assert_array_equal(a.variance, b.variance)
        # What is predicted of them is the same number; only what it is taken from differs.
        np.testing.assert_allclose(a.before - a.after, b.before - b.after, rtol=0, atol=1e-12 * 100)
        np.testing.assert_array_equal(b.before[out], other[out])
        # The fold prepared from the other table is the same, its gate too.
        again = folded(residuals(other), LIBRARY)[i]
        np.testing.assert_array_equal(again.gate.largest, folds[i].gate.largest)
        np.testing.assert_array_equal(again.prepared.y, folds[i].prepared.y)


def test_the_same_bytes_again() -> None:
    assert bytes_of(judged(residuals(measured(2)))) == bytes_of(first())


def test_members_that_a_fold_hardly_shows_are_not_foretold() -> None:
    # A step at the last two parts: without them nothing is known of it.
    folds = folded(residuals(measured(2)), LIBRARY)
    names = [fold.prepared.scan.names for fold in folds]
    assert "step" not in names[-1]
    assert all("step" in own for own in names[:-1])


def test_few_parts_leave_out_columns() -> None:
    errors = measured(4, (3, 12, 2))
    library = (candidate("place", (PLACE,)),)
    folds = folds_of(residuals(errors), library, 1, count=COUNT)
    assert [fold.split.dimension for fold in folds] == [1] * COUNT
    np.testing.assert_array_equal(np.sum([~fold.split.kept for fold in folds], axis=0), 1)
    found = held_out(residuals(errors), folds, alpha=0.05, most=3)
    assert found is not None
    assert found.by == "columns"
    assert found.by_column is None
    np.testing.assert_array_equal(found.before, errors)


def test_too_few_of_both_hold_nothing_out() -> None:
    table = residuals(measured(5, (3, 9, 2)))
    assert folds_of(table, (), 1) == ()
    assert held_out(table, (), alpha=0.05, most=3) is None


def test_a_fold_without_which_a_column_was_never_measured_is_left_out() -> None:
    there: Mask = np.ones((8, 12), bool)
    there[2:, 0] = False
    there[0, 0] = there[1, 0] = True
    table = residuals(measured(2), there=there)
    assert len(folds_of(table, (), 1, count=COUNT)) == COUNT - 1
    found = held_out(table, folds_of(table, (), 1, count=COUNT), alpha=0.05, most=3)
    assert found is not None
    assert np.isnan(found.before[:2]).all()
    own = scores(found.before, ("x", "y"), found.variance)
    assert own.rms == pytest.approx(float(np.sqrt(np.nanmean(table.errors[2:] ** 2))), rel=1e-12)


def test_scores_by_hand() -> None:
    errors = np.array([[[3.0, 4.0], [0.0, 1.0]], [[np.nan, 2.0], [6.0, 8.0]]])
    own = scores(errors, ("x", "y"), np.array([1.0, 4.0]))
    assert own.rms == pytest.approx(np.sqrt((9 + 16 + 0 + 1 + 36 + 64) / 6))
    assert own.rms_by_axis == pytest.approx({"x": np.sqrt(15.0), "y": np.sqrt(27.0)})
    assert own.largest == 10.0
    assert own.p95 == pytest.approx(np.quantile([5.0, 1.0, 10.0], 0.95))
    assert own.chi2_per_dof == pytest.approx((9 + 4 + 0 + 0.25 + 36 + 16) / 6)
    assert scores(errors, ("x", "y")).chi2_per_dof is None
    assert scores(errors, ("x", "y"), np.zeros(2)).chi2_per_dof is None


def test_the_variance_of_an_entry_is_that_of_drawn_tables() -> None:
    folds = folded(residuals(measured(2)), ())
    scan = folds[0].prepared.scan
    H = scan.frame.strata.shape[1]
    null = replace(
        scan.null,
        interaction=np.array([1.0, 2.0]),
        column=np.array([0.5, 0.0]),
        part=np.diag([H * 4.0, 0.0, 0.0, H * 1.0, 0.0, 0.0]),
    )
    np.testing.assert_allclose(entry_variance(null, scan.frame.strata), [5.5, 3.0])
    # Lines add their own mean over the columns.
    null = replace(null, part=null.part + np.diag([0, 3.0, 3.0, 0, 0, 0]))
    np.testing.assert_allclose(entry_variance(null, scan.frame.strata), [5.5 + 6 / H, 3.0])


def test_cut_tables_and_candidates_keep_their_cells() -> None:
    there = holes(8, 12, 0.2, 6)
    common = np.random.default_rng(7).normal(size=(8, 12, 2, 1))
    covariates = {"T": np.arange(8.0)[:, None], "dir": np.arange(12.0)[None], "all": np.eye(8, 12)}
    table = replace(
        residuals(measured(2), there=there, common=common, of_part=common[:1]),
        covariates=covariates,
    )
    parts, columns = np.arange(8) % 3 > 0, np.arange(12) % 4 > 0
    own = only_columns(only_parts(table, parts), columns)
    np.testing.assert_array_equal(own.errors, table.errors[parts][:, columns])
    np.testing.assert_array_equal(own.there, there[parts][:, columns])
    np.testing.assert_array_equal(own.common, common[parts][:, columns])
    np.testing.assert_array_equal(own.of_part, common[:1][:, columns])
    np.testing.assert_array_equal(own.covariates["T"], covariates["T"][parts])
    np.testing.assert_array_equal(own.covariates["dir"], covariates["dir"][:, columns])
    np.testing.assert_array_equal(own.covariates["all"], np.eye(8, 12)[parts][:, columns])
    assert own.parts == tuple(np.array(table.parts)[parts])
    assert own.features == tuple(np.array(table.features)[columns])
    place, cells, step = cut_candidates(LIBRARY, parts, 0).candidates
    np.testing.assert_array_equal(cells.members[0].columns[0][1], CELLS[1][parts])
    np.testing.assert_array_equal(place.members[0].columns[0][0], PLACE[0])
    # Of a step at the last two parts one is left: how little that says, its uncertainty tells.
    np.testing.assert_array_equal(step.members[0].columns[0][0], STEP[0][parts])
    place, cells, step = cut_candidates(LIBRARY, columns, 1).candidates
    np.testing.assert_array_equal(place.members[0].columns[0][0], PLACE[0][:, columns])
    np.testing.assert_array_equal(step.members[0].columns[0][0], STEP[0])
