"""Restricted maximum likelihood of one-way components of variance, for many tables at once."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.anova import Cells, Components
from mtu_cli.stats.least_squares import FloatArray

GRID = np.concatenate([[0.0], 10.0 ** np.arange(-5.0, 9.01, 0.25)])
"""Ratios s_part^2/s_repeat^2 at which the likelihood is looked at first."""
STEPS = 70
GOLDEN = (np.sqrt(5.0) - 1) / 2


def reml(cells: Cells) -> Components:
    """Components of variance by REML: s_part^2 >= 0, s_repeat^2.

    With r = s_part^2/s_repeat^2, w_i = n_i/(1 + n_i r), mu = sum w_i m_i / sum w_i and
    Q = SS_within + sum w_i (m_i - mu)^2 the profiled criterion is

        -2 l(r) = (N - 1) log Q + sum log(1 + n_i r) + log sum w_i,

    and s_repeat^2 = Q/(N - 1) (Searle, Casella & McCulloch, Variance Components, 1992, 6.6).
    The minimum over r is bracketed on a grid and closed in on by golden section. A table
    without repeats, or with one part, has nan; one whose repeats are all equal has
    s_repeat^2 = 0 and the sample variance of its parts.
    """
    N = cells.n.sum(axis=1)
    a = cells.present.sum(axis=1)
    known = (a > 1) & (a < N)
    scale = np.where(cells.within > 0, cells.within, 1.0)
    values = np.array([_criterion(cells, scale, np.full(len(N), r))[0] for r in GRID])
    best = np.argmin(values, axis=0)
    low = GRID[np.maximum(best - 1, 0)]
    high = GRID[np.minimum(best + 1, len(GRID) - 1)]
    r = _golden(cells, scale, low, high)
    # At the boundary the interior search stops short of 0.
    r = np.where(
        _criterion(cells, scale, np.zeros_like(r))[0] <= _criterion(cells, scale, r)[0], 0.0, r
    )
    Q = _criterion(cells, scale, r)[1]
    repeat = Q / (N - 1)
    part = r * repeat
    exact = cells.within == 0
    repeat = np.where(exact, 0.0, repeat)
    part = np.where(exact, _variance_of_means(cells), part)
    part, repeat = np.where(known, part, np.nan), np.where(known, repeat, np.nan)
    return Components(part=part, repeat=repeat, part_estimate=part)


def _criterion(cells: Cells, scale: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """-2 l (tables,) and Q (tables,) at the ratios r (tables,)."""
    n = cells.n
    N = n.sum(axis=1)
    growth = 1 + n * r[:, None]
    w = n / growth
    total = w.sum(axis=1)
    mu = (w * cells.mean).sum(axis=1) / total
    Q = cells.within + (w * (cells.mean - mu[:, None]) ** 2).sum(axis=1)
    with np.errstate(divide="ignore"):
        value = (N - 1) * np.log(Q / scale) + np.log(growth).sum(axis=1) + np.log(total)
    return value, Q


def _golden(cells: Cells, scale: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = (_criterion(cells, scale, x)[0] for x in (left, right))
    for _ in range(STEPS):
        smaller = at_left <= at_right
        low, high = np.where(smaller, low, left), np.where(smaller, right, high)
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        at_left, at_right = (_criterion(cells, scale, x)[0] for x in (left, right))
    return (low + high) / 2


def _variance_of_means(cells: Cells) -> FloatArray:
    a = cells.present.sum(axis=1)
    mean = np.where(cells.present, cells.mean, 0.0).sum(axis=1) / a
    away = np.where(cells.present, cells.mean - mean[:, None], 0.0)
    variance: FloatArray = (away**2).sum(axis=1) / np.maximum(a - 1, 1)
    return variance
