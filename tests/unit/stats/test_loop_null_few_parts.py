"""Of few parts their scatter is an estimate: the drawn null has the tails that this gives."""

from __future__ import annotations

import numpy as np
from crossed_tables import Floats, made, nothing_known, null, sizes, whole_frame
from scipy.stats import binom, f, kstest

from mtu_cli.stats.loop_null import NullModel, draw, null_of, whitening_of
from mtu_cli.stats.strata import Strata

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
    """Their whitened squared length over the number of directions, (B,)."""
    W = whitening_of(STRATA, model)[0]
    return np.asarray(((leading(STRATA, y) @ W.T) ** 2).sum(axis=1) / LEAD)


def test_what_parts_have_in_common_follows_hotellings_distribution() -> None:
    n = 5.0
    model = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=LIVELY, part_dof=n)
    y, _ = draw(whole_frame(STRATA), model, 4000, np.random.default_rng(2))
    left = n - LEAD + 1
    assert kstest(squared(model, y) * left / n, f(LEAD, left).cdf).pvalue > 1e-3
    known = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=LIVELY)
    y, _ = draw(whole_frame(STRATA), known, 4000, np.random.default_rng(2))
    assert kstest(squared(known, y) * LEAD, "chi2", args=(LEAD,)).pvalue > 1e-3


def test_scatter_below_the_noise_leaves_the_noise() -> None:
    """Nothing makes it less, and little is it ever more."""
    nothing = np.zeros((3, 3))
    y = {}
    for share in (1.0, 1e-6):
        model = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=nothing, part_dof=5.0)
        model.with_noise[:] = share * np.eye(3)
        y[share], _ = draw(whole_frame(STRATA), model, 4000, np.random.default_rng(3))
    one, other = (leading(STRATA, y[share]) for share in (1.0, 1e-6))
    assert (np.abs(one) >= np.abs(other) - 1e-12).all()
    # 5/X > 1 where chi^2 of 4 degrees of freedom is below 5: 71.3 %.
    more = int((np.abs(one) > np.abs(other) * (1 + 1e-9)).all(axis=1).sum())
    assert binom.ppf(1e-4, 4000, 0.7127) <= more <= binom.ppf(1 - 1e-4, 4000, 0.7127)
    assert kstest(other.ravel(), "norm").pvalue > 1e-3


def test_what_a_few_parts_have_in_common_passes_as_often_as_stated() -> None:
    """Tables of a scatter that only they tell: the rank of their own value among drawn ones."""
    frame, dof, count = whole_frame(STRATA), sizes(STRATA), 1000
    truth = null(STRATA, interaction=NOISE, column=NO_COLUMN, part=LIVELY)
    rng = np.random.default_rng(4)
    tables, _ = draw(frame, truth, count, rng)
    hits = {0.05: 0, 0.01: 0}
    for own in tables:
        model = null_of(frame, own, dof, nothing_known(STRATA))
        drawn, _ = draw(frame, model, 399, rng)
        above = int((squared(model, drawn) >= squared(model, own[None])[0]).sum())
        for level in hits:
            hits[level] += (above + 1) / 400 <= level
    for level, found in hits.items():
        assert binom.ppf(1e-4, count, level) <= found <= binom.ppf(1 - 1e-4, count, level)
