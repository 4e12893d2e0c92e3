"""Of few parts their scatter is an estimate: the drawn null has the tails that this gives."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, frame_of, made, nothing_known, null, sizes, whole_frame
from scipy.stats import binom, kstest

from mtu_cli.close_loop_sealed.stats.loop_null import (
    KnownScatter,
    NullModel,
    draw,
    null_of,
    whitening_of,
)
from mtu_cli.close_loop_sealed.stats.strata import Strata

STRATA = made(6, 10, 1)
NOISE = np.ones(1)
NO_COLUMN = np.zeros(1)
ROOT = np.random.default_rng(1).normal(size=(3, 3))
LIVELY = 40.0 * (ROOT @ ROOT.T + np.eye(3))
LEAD = 2
"""Both straight directions are tested beside the columns."""


def leading(strata: Strata, y: Floats) -> Floats:
    """The coordinates (B, 2) of the columns along the straight directions."""
    column = strata.find("column", 0)
    assert column is not None
    assert column.lead == (1, 2)
    return y[:, column.start : column.start + LEAD]


def squared(model: NullModel, y: Floats) -> Floats:
    """Of the first direction beside the other, the squared estimate over its variance, (B,)."""
    W = whitening_of(STRATA, model)[0]
    own = leading(STRATA, y) @ W.T
    return np.asarray((own @ W[:, 0]) ** 2 / (W[:, 0] @ W[:, 0]))


def test_what_a_few_parts_have_in_common_passes_as_often_as_stated() -> None:
    """Tables of a scatter that only they tell: the rank of their own value among drawn ones."""
    frame, dof, count = whole_frame(STRATA), sizes(STRATA), 1000
    truth = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=LIVELY)
    rng = np.random.default_rng(4)
    tables, _ = draw(frame, truth, count, rng)
    hits = {0.05: 0, 0.01: 0}
    for own in tables:
        model = null_of(frame, own, dof, nothing_known(STRATA))
        assert model.part_dof == 5.0
        drawn, _ = draw(frame, model, 399, rng)
        above = int((squared(model, drawn) >= squared(model, own[None])[0]).sum())
        for level in hits:
            hits[level] += (above + 1) / 400 <= level
    for level, found in hits.items():
        assert binom.ppf(1e-4, count, level) <= found <= binom.ppf(1 - 1e-4, count, level)


def test_known_scatter_has_no_tails_and_moves_no_other_draw() -> None:
    own = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=LIVELY, part_dof=5.0)
    few, _ = draw(whole_frame(STRATA), own, 4000, np.random.default_rng(2))
    known, _ = draw(whole_frame(STRATA), own.as_estimated(), 4000, np.random.default_rng(2))
    assert kstest(squared(own, known), "chi2", args=(1,)).pvalue > 1e-3
    assert kstest(squared(own, few), "chi2", args=(1,)).pvalue < 1e-6
    column = STRATA.find("column", 0)
    assert column is not None
    rest = np.delete(np.arange(STRATA.size), np.arange(column.start, column.start + LEAD))
    np.testing.assert_array_equal(few[:, rest], known[:, rest])


def test_parts_that_do_not_tell_their_lines_do_not_count() -> None:
    there = np.ones((6, 10), bool)
    there[1, 3:] = there[4, 2:] = False
    frame = frame_of(STRATA, there)
    rng = np.random.default_rng(5)
    y, _ = frame.coordinates(np.where(there[:, :, None], rng.normal(size=(6, 10, 1)), 0.0))
    model = null_of(frame, y, sizes(STRATA, int((~there).sum())), nothing_known(STRATA))
    assert model.part_dof == 3.0


@pytest.mark.parametrize(("dof", "trust"), [(1.0, 1.0), (3.0, 3.0), (np.inf, 3.0)])
def test_a_prediction_counts_for_no_more_than_it_knows(dof: float, trust: float) -> None:
    frame, rng = whole_frame(STRATA), np.random.default_rng(6)
    y, _ = frame.coordinates(rng.normal(size=(6, 10, 1)))
    known = KnownScatter(np.diag([9.0, 4.0, 1.0]), np.zeros((3, 0)), dof)
    model = null_of(frame, y, sizes(STRATA), known)
    assert model.part_dof == 5.0 + trust
    alone = null_of(frame, y, sizes(STRATA), nothing_known(STRATA))
    mixed = (5 * alone.with_noise + trust * (known.part + alone.interaction * np.eye(3))) / (
        5 + trust
    )
    np.testing.assert_allclose(model.with_noise, mixed, rtol=1e-9)
