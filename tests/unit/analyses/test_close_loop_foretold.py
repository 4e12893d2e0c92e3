"""What is foretold of cells that were not seen: the mean over all explanations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import grid_places
from loop_bench.folds import LIBRARY as BUILT_IN
from loop_bench.folds import folds_of, held_out
from loop_tables import candidate, crossed, offset, residuals, whole_column

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.folds import (
    CutCandidates,
    cut_candidates,
    identity,
    only_parts,
)
from mtu_cli.close_loop_sealed.analyses.loop.foretold import LEAST, foretold
from mtu_cli.close_loop_sealed.analyses.loop.held_out import of_fold
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column
from mtu_cli.close_loop_sealed.stats.size_prior import sized

SHAPE = (12, 10, 2)
KEPT = np.arange(12) % 4 != 3
RNG = np.random.default_rng(1)
CELLS: Column = {0: RNG.normal(size=(12, 10))}
LIKE: Column = {0: CELLS[0] + 0.3 * RNG.normal(size=(12, 10))}
OTHER: Column = {1: RNG.normal(size=(12, 10))}
LIBRARY = (candidate("cells", (CELLS,)), candidate("like", (LIKE,)), candidate("other", (OTHER,)))


def seen(
    errors: Floats, library: tuple[Candidate, ...] = LIBRARY
) -> tuple[Prepared, Search, CutCandidates]:
    own = cut_candidates(library, KEPT, 0)
    prepared = prepare(only_parts(residuals(errors), KEPT), own.candidates)
    gate = calibrated(prepared.scan, 399, 1)
    return prepared, search(prepared, gate, alpha=0.05, most=3), own


def told(errors: Floats) -> Floats:
    prepared, found, own = seen(errors)
    return foretold(prepared, found, residuals(errors), own.whole, own.weights)


def noise(seed: int) -> Floats:
    return crossed(np.random.default_rng(seed), SHAPE, part=0.5, column=0.3)


def test_what_leaves_no_doubt_is_foretold_as_a_single_machine_would() -> None:
    errors = noise(2) + 4.0 * whole_column(CELLS, SHAPE)
    _, found, _ = seen(errors)
    assert len(found.steps) == 1
    # One coefficient of 90 entries with scatter 1: within four standard errors.
    slope = told(errors)[..., 0] / CELLS[0]
    assert np.ptp(slope) < 1e-9
    assert slope.mean() == pytest.approx(4.0, abs=4 / np.sqrt(90))
    np.testing.assert_array_equal(told(errors)[..., 1], 0)


def test_little_evidence_foretells_little_by_bayes_rule_over_the_candidates() -> None:
    # 0.2 of a column beside scatter 1: nothing passes the gate, but something speaks for it.
    errors = noise(6) + 0.2 * whole_column(CELLS, SHAPE)
    prepared, found, _ = seen(errors)
    assert not found.steps
    variance = prepared.scan.null.interaction
    columns = (CELLS, LIKE, OTHER)
    tau = np.array([np.sqrt(variance[a]) / c[a].std() for c in columns for a in c])
    members = sized(State(prepared, None).look().members, np.ones(3), tau)
    # Nothing is as likely before as all three together.
    weights = np.exp([*members.log_bayes, np.log(3.0)])
    posterior = weights[:3] / weights.sum()
    # Each alone by least squares of a table without part and column means, apart from weights
    # of the strata: interaction holds nearly all of a column.
    wanted = np.zeros(SHAPE)
    for p, share, column in zip(posterior, members.believed, columns, strict=True):
        (axis,) = column
        X, y = column[axis][KEPT], errors[KEPT][..., axis]
        X, y = (v - v.mean(0) - v.mean(1, keepdims=True) + v.mean() for v in (X, y))
        wanted[..., axis] += p * share * (X * y).sum() / (X * X).sum() * column[axis]
    assert 0.02 < posterior.sum() < 0.98
    size = float(np.sqrt(np.mean(wanted**2)))
    # The strata of parts and columns hold a fifth of a column's entries, with more scatter.
    assert np.sqrt(np.mean((told(errors) - wanted) ** 2)) < 0.5 * size


def step_of(member: int, index: int) -> Step:
    return Step(index=index, member=member, p=0.0, log_bayes=0.0, posterior=1.0, credible=())


AGAIN = np.random.default_rng(3)
MORE: list[Column] = [{0: AGAIN.normal(size=(12, 10))} for _ in range(4)]
UNEQUAL = (candidate("cells", (CELLS,), *((c,) for c in MORE)), candidate("other", (OTHER,)))


@pytest.mark.parametrize("library", [LIBRARY, UNEQUAL])
@pytest.mark.parametrize("passed", [False, True])
def test_shares_are_bayes_rule_to_the_last_digit(
    library: tuple[Candidate, ...], passed: bool
) -> None:
    """Candidates are equally likely before, and in each of them its members; nothing is as
    likely as one of them where an effect passed the gate, and as all together where none did.
    """
    errors = noise(6) + 0.2 * whole_column(CELLS, SHAPE)
    prepared, found, own = seen(errors, library)
    found = replace(found, steps=(step_of(0, 0),) if passed else ())
    flat = [(f, m.columns[0]) for f, c in enumerate(library) for m in c.members]
    variance = prepared.scan.null.interaction
    tau = np.array([np.sqrt(variance[a]) / c[a].std() for _, c in flat for a in c])
    members = sized(State(prepared, None).look().members, np.ones(len(flat)), tau)
    count = np.array([len(library[f].members) for f, _ in flat])
    nothing = 1.0 if passed else float(len(library))
    weights = np.exp(members.log_bayes) / count
    share = weights / (weights.sum() + nothing)
    share = np.where(share >= LEAST, share * members.believed, 0.0)
    wanted = np.zeros(SHAPE)
    for m, (f, column) in enumerate(flat):
        alone = added(prepared, replace(found, steps=(step_of(m, f),)), rough=True)
        assert alone.fit is not None
        wanted += share[m] * alone.fit.beta[0] * whole_column(column, SHAPE)
    said = foretold(prepared, found, residuals(errors), own.whole, own.weights)
    assert 0.05 < share.sum() < 0.95
    np.testing.assert_allclose(said, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


def test_a_mean_error_is_a_rival_of_nothing_but_not_of_an_effect_that_was_found() -> None:
    """Either may act without the other: beside a member the mean is free, and says nothing."""
    library = (candidate("cells", (CELLS,)), offset("y"))
    errors = noise(6) + 0.2 * whole_column(CELLS, SHAPE)
    errors[..., 1] -= errors[KEPT][..., 1].mean()
    said = {}
    for passed in (False, True):
        for level in (0.0, 8.0):
            moved = errors + np.array([0.0, level])
            prepared, found, own = seen(moved, library)
            found = replace(found, steps=(step_of(0, 0),) if passed else ())
            said[passed, level] = foretold(
                prepared, found, residuals(moved), own.whole, own.weights
            )
    np.testing.assert_allclose(said[True, 8.0], said[True, 0.0], rtol=0, atol=1e-9)
    assert np.abs(said[True, 0.0][..., 0]).max() > 0.01
    np.testing.assert_array_equal(said[True, 8.0][..., 1], 0.0)
    # Where nothing passed it is the likeliest of all explanations.
    assert said[False, 8.0][..., 1] == pytest.approx(8.0, abs=0.5)
    np.testing.assert_allclose(said[False, 0.0][..., 1], 0.0, atol=1e-9)


def test_the_values_that_an_effect_may_search_are_averaged() -> None:
    """Steps at parts 4 to 8: the data leave two of them open, and each is told by its share."""
    number = np.arange(12)
    columns: list[Column] = [{0: np.asarray(number >= at, float)[:, None]} for at in range(4, 9)]
    library = (candidate("step", *((column,) for column in columns)),)
    kept = number != 11
    errors = noise(11)
    # Part 6 stands about half way: a step before it or behind it.
    errors[:, :, 0] -= errors[:, :, 0].mean(axis=1, keepdims=True)
    errors[..., 0] += 0.4 * RNG.normal(size=(12, 1))
    errors[..., 0] += 6.0 * (number > 6)[:, None]
    errors[6, :, 0] += 3.0 - errors[6, :, 0].mean()
    own = cut_candidates(library, kept, 0)
    prepared = prepare(only_parts(residuals(errors), kept), own.candidates)
    found = search(prepared, calibrated(prepared.scan, 399, 1), alpha=0.05, most=3)
    found = replace(found, steps=found.steps[:1])
    said = foretold(prepared, found, residuals(errors), own.whole, own.weights)[:, 0, 0]
    low, at, high = said[0], said[6], said[11]
    assert 0.1 < (at - low) / (high - low) < 0.9
    assert high - low == pytest.approx(6.0, abs=1.5)


def test_what_would_be_huge_where_it_is_not_seen_is_believed_less() -> None:
    """Two curves that are the same, and weak, on the parts kept; one is huge on the others."""
    number = np.arange(12)
    kept = number >= 3
    errors = noise(12)
    errors[..., 0] += np.where(kept, 0.2 * (number - 7), 0.0)[:, None]
    table = residuals(errors)
    said = []
    for first in (0.1, 40.0):
        rise: Column = {0: np.where(kept, 0.1 * number, first)[:, None]}
        prepared = prepare(only_parts(table, kept), (candidate("rise", ({0: rise[0][kept]},)),))
        found = search(prepared, calibrated(prepared.scan, 399, 1), alpha=0.05, most=3)
        (whole,) = candidate("rise", (rise,)).members
        name = identity("rise", whole)
        own = foretold(prepared, found, table, {name: whole}, {name: 1.0})
        said.append(float(np.ptp(own[kept, :, 0])))
    assert said[0] > 3 * said[1] > 0


def test_a_field_without_a_name_is_foretold_by_the_curve_that_comes_nearest() -> None:
    """What is said of its cause, the pattern of the columns stays: a name takes its share off."""
    P, H = 12, 24
    kept = np.arange(P) % 4 != 3
    x, y = grid_places(H, jitter=3.0)[:, :2].T
    x, y = (x - x.mean()) / np.ptp(x), (y - y.mean()) / np.ptp(y)
    square = (x - 0.3) ** 2 + (y - 0.3) ** 2
    broad = np.exp(-3 * square)
    curve: Column = {0: (broad - broad.mean())[None]}
    field = 5.0 * (np.exp(-9 * square) - np.exp(-9 * ((x + 0.3) ** 2 + (y - 0.2) ** 2)))
    field = field[None, :, None] * [1.0, 0.0]
    errors = crossed(np.random.default_rng(8), (P, H, 2), part=0.5, column=0.3) + field
    table = residuals(errors)
    own = cut_candidates((candidate("curve", (curve,)),), kept, 0)
    prepared = prepare(only_parts(table, kept), own.candidates)
    found = search(prepared, calibrated(prepared.scan, 399, 1), alpha=0.05, most=3)
    looked = State(prepared, None).look()
    assert len(found.steps) == 1
    # The field is far likelier than the name: by Bayes' rule alone nothing would be foretold.
    assert looked.unnamed[2] > looked.log_bayes[0] + 5
    said = foretold(prepared, found, table, own.whole, own.weights)[~kept, :, 0]
    centred = errors[~kept, :, 0] - errors[kept, :, 0].mean()
    # The best that the curve can do for the mean of the kept parts.
    mean = errors[kept, :, 0].mean(axis=0)
    best = (curve[0][0] @ mean) / (curve[0][0] @ curve[0][0]) * curve[0]
    gain = np.mean(centred**2) - np.mean((centred - said) ** 2)
    assert gain > 0.8 * (np.mean(centred**2) - np.mean((centred - best) ** 2)) > 0


def test_nothing_that_is_left_out_takes_part() -> None:
    errors = noise(6) + 0.2 * whole_column(CELLS, SHAPE)
    other = errors.copy()
    other[~KEPT] = 50.0
    np.testing.assert_array_equal(told(errors), told(other))


@pytest.mark.parametrize("start", [0.0, -5.5])
def test_a_fold_finds_the_level_of_an_equation_that_is_centred_on_all_parts(start: float) -> None:
    """Cut to some parts it has a mean, which is no level of its own; one that counts from the first
    part has one, on all parts as on some.
    """
    number = np.arange(12.0)
    library = (candidate("trend", ({0: (number + start)[:, None]},)), offset("x"))
    errors = noise(4)
    errors[..., 0] += 2.0 * number[:, None] + 9.0
    table = residuals(errors)
    for fold in folds_of(table, library, 1, count=4):
        own = of_fold(table, fold, BUILT_IN, alpha=0.05, most=3)
        wanted = {"trend", "offset-x"} if start else {"trend"}
        assert own.chosen == wanted
        # The straight line through the means of the parts kept, carried on.
        kept = fold.split.kept
        line = np.polynomial.Polynomial.fit(number[kept], errors[kept, :, 0].mean(axis=1), 1)
        # Nine means leave a hundredth of the slope in doubt; a level told wrong would be 2 or more.
        np.testing.assert_allclose(own.foretold[:, 0, 0], line(number), rtol=0, atol=0.02 * 22)


def test_a_drift_needs_not_win_against_the_level_beside_it() -> None:
    """The level passed the gate, the drift did not: it is told by its share beside that level."""
    number = np.arange(12.0)
    kept = number >= 3
    drift: Column = {0: (number - number.mean())[:, None]}
    library = (candidate("drift", (drift,)), offset("x"))
    errors = noise(14)
    errors[..., 0] += 12.0 - errors[kept, :, 0].mean(axis=1).mean()
    errors[..., 0] += 0.1 * drift[0]
    own = cut_candidates(library, kept, 0)
    prepared = prepare(only_parts(residuals(errors), kept), own.candidates)
    found = search(prepared, calibrated(prepared.scan, 399, 1), alpha=0.05, most=3)
    level = replace(found, steps=(step_of(-1, 1),))
    said = foretold(prepared, level, residuals(errors), own.whole, own.weights)[:, 0, 0]
    slope = np.polynomial.Polynomial.fit(number[kept], errors[kept, :, 0].mean(axis=1), 1).deriv()
    share = float(np.diff(said).mean() / slope(0.0))
    assert 0.05 < share < 0.95
    assert said[kept].mean() == pytest.approx(12.0, abs=0.5)


def test_gross_entries_are_set_aside_where_a_fold_keeps_them_and_scored_where_it_does_not() -> None:
    clean = noise(3) + 2.0 * whole_column(CELLS, SHAPE)
    spoilt = clean.copy()
    spoilt[1, 4, 0] += 60.0
    found = []
    for errors in (clean, spoilt):
        table = residuals(errors)
        own = held_out(table, folds_of(table, LIBRARY, 1, count=4), alpha=0.05, most=3)
        assert own is not None
        found.append(own)
    one, two = found
    np.testing.assert_array_equal(two.before, spoilt)
    assert one.chosen == two.chosen
    # The fold that leaves it out does not see it; the others lose one of 90 entries.
    foretold_of = [own.before - own.after for own in found]
    np.testing.assert_allclose(foretold_of[0][:3], foretold_of[1][:3], rtol=0, atol=60 * 1e-15)
    assert two.after[1, 4, 0] == pytest.approx(one.after[1, 4, 0] + 60.0)
    moved = np.abs(foretold_of[0] - foretold_of[1])[3:]
    assert moved.max() < 3 / np.sqrt(90) * np.abs(CELLS[0]).max()
