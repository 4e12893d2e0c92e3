"""Restricted maximum likelihood of one-way components of variance, for many tables at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.anova import Cells, Components
from mtu_cli.stats.least_squares import FloatArray

GRID = np.concatenate([[0.0], 10.0 ** np.arange(-5.0, 9.01, 0.25)])
"""Ratios r = s_part^2/s_repeat^2 between which the likelihood's maximum is bracketed. Beyond the
last one the limit of large r holds to a relative 1e-9.
"""
HALVINGS = 52
"""Of a bracket: to the last bit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Levels:
    """Parts of equal repeats n (levels,) taken together: `count` of them, their `mean` and sum of
    `squares` about it, (tables, levels); `within` and `N` (tables,).
    """

    n: FloatArray
    count: FloatArray
    mean: FloatArray
    squares: FloatArray
    within: FloatArray
    N: FloatArray


def reml(cells: Cells) -> Components:
    """Components of variance by REML: s_part^2 >= 0, s_repeat^2.

    With r = s_part^2/s_repeat^2, w_i = n_i/(1 + n_i r), mu = sum w_i m_i / sum w_i and
    Q = SS_within + sum w_i (m_i - mu)^2 the profiled criterion is

        -2 l(r) = (N - 1) log Q + sum log(1 + n_i r) + log sum w_i,

    and s_repeat^2 = Q/(N - 1) (Searle, Casella & McCulloch, Variance Components, 1992, 6.6).
    The root of its derivative is bracketed on a grid and bisected; r is 0 where -2 l rises from
    there on. For large r the estimates tend to SS_within/(N - a) and the sample variance of the
    part means, less their share of s_repeat^2. A table without repeats has nan, one with a single
    part has nan for s_part^2; one whose repeats are all equal has s_repeat^2 = 0.
    """
    levels = _levels(cells)
    a = levels.count.sum(axis=1)
    falling = np.array([_slope(levels, np.full(len(a), r)) < 0 for r in GRID])
    last = len(GRID) - 1 - np.argmax(falling[::-1], axis=0)
    low, high = GRID[last], GRID[np.minimum(last + 1, len(GRID) - 1)]
    for _ in range(HALVINGS):
        middle = np.where(low > 0, np.sqrt(low * high), high / 2)
        above = _slope(levels, middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    r = np.where(falling.any(axis=0), high, 0.0)
    repeat = _fit(levels, r)[2] / np.maximum(levels.N - 1, 1)
    part = r * repeat
    far = falling[-1] | (levels.within == 0)
    repeat = np.where(far, levels.within / np.maximum(levels.N - a, 1), repeat)
    mean = (levels.count * levels.mean).sum(axis=1) / a
    squares = levels.squares + levels.count * (levels.mean - mean[:, None]) ** 2
    lost = repeat * (levels.count / levels.n).sum(axis=1) / a
    part = np.where(far, squares.sum(axis=1) / np.maximum(a - 1, 1) - lost, part)
    part = np.where((a > 1) & (a < levels.N), part, np.nan)
    repeat = np.where(a < levels.N, repeat, np.nan)
    return Components(part=part, repeat=repeat, part_estimate=part)


def _levels(cells: Cells) -> _Levels:
    n = np.unique(cells.n)
    n = n[n > 0]
    count, mean, squares = np.empty((3, len(cells.n), len(n)))
    for k, repeats in enumerate(n):
        mask = cells.n == repeats
        count[:, k] = mask.sum(axis=1)
        mean[:, k] = np.where(mask, cells.mean, 0.0).sum(axis=1) / np.maximum(count[:, k], 1)
        deviation = np.where(mask, cells.mean - mean[:, k, None], 0.0)
        squares[:, k] = np.einsum("ij,ij->i", deviation, deviation)
    N, within = cells.n.sum(axis=1), cells.within
    return _Levels(n=n, count=count, mean=mean, squares=squares, within=within, N=N)


def _fit(levels: _Levels, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights w and squares (m - mu)^2 summed (tables, levels), and Q (tables,), at r (tables,)."""
    w = levels.n / (1 + levels.n * r[:, None])
    weights = levels.count * w
    mu = (weights * levels.mean).sum(axis=1) / weights.sum(axis=1)
    squares = levels.squares + levels.count * (levels.mean - mu[:, None]) ** 2
    return w, squares, levels.within + (w * squares).sum(axis=1)


def _slope(levels: _Levels, r: FloatArray) -> FloatArray:
    """d(-2 l)/dr (tables,) at r (tables,):

    (N - 1) Q'/Q + sum w - sum w^2 / sum w, Q' = -sum w^2 (m - mu)^2.
    """
    w, squares, Q = _fit(levels, r)
    total = (levels.count * w).sum(axis=1)
    # Equal values in all of a table have Q = 0; such a table is not the likelihood's to decide.
    change = (w**2 * squares).sum(axis=1) / np.where(Q > 0, Q, 1.0)
    return total - (levels.count * w**2).sum(axis=1) / total - (levels.N - 1) * change
