"""Restricted maximum likelihood of one-way components of variance, for many tables at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.anova import Cells, Components
from mtu_cli.stats.least_squares import FloatArray

GRID = np.concatenate([[0.0], 10.0 ** np.arange(-5.0, 9.01, 0.25)])
"""Ratios s_part^2/s_repeat^2 at which the likelihood is looked at first."""
NEGLIGIBLE = 1e-9
STEPS = 70
GOLDEN = (np.sqrt(5.0) - 1) / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class _Levels:
    """All that the likelihood needs: parts of equal repeats n (levels,) taken together.

    `count` parts, their `mean` and their sum of `squares` about it, (tables, levels); `within`
    and `N` (tables,).
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
    The minimum over r is bracketed on a grid and closed in on by golden section. A table
    without repeats has nan, one with a single part has nan for s_part^2; one whose repeats are
    all equal has s_repeat^2 = 0 and the sample variance of its parts.
    """
    levels = _levels(cells)
    a = levels.count.sum(axis=1)
    values = np.array([_criterion(levels, np.full(len(a), r))[0] for r in GRID])
    best = np.argmin(values, axis=0)
    low = GRID[np.maximum(best - 1, 0)]
    high = GRID[np.minimum(best + 1, len(GRID) - 1)]
    r = _golden(levels, low, high)
    # At the boundary the interior search stops short of 0.
    r = np.where(r < NEGLIGIBLE, 0.0, r)
    repeat = _criterion(levels, r)[1] / np.maximum(levels.N - 1, 1)
    part = r * repeat
    exact = levels.within == 0
    repeat = np.where(exact, 0.0, repeat)
    part = np.where(exact, _variance_of_means(levels), part)
    part = np.where((a > 1) & (a < levels.N), part, np.nan)
    repeat = np.where(a < levels.N, repeat, np.nan)
    return Components(part=part, repeat=repeat, part_estimate=part)


def _levels(cells: Cells) -> _Levels:
    found = np.unique(cells.n)
    found = found[found > 0]
    count, mean, squares = (np.empty((len(cells.n), len(found))) for _ in range(3))
    for k, n in enumerate(found):
        own = cells.n == n
        count[:, k] = own.sum(axis=1)
        mean[:, k] = np.where(own, cells.mean, 0.0).sum(axis=1) / np.maximum(count[:, k], 1)
        away = np.where(own, cells.mean - mean[:, k, None], 0.0)
        squares[:, k] = np.einsum("ij,ij->i", away, away)
    return _Levels(
        n=found,
        count=count,
        mean=mean,
        squares=squares,
        within=cells.within,
        N=cells.n.sum(axis=1),
    )


def _criterion(levels: _Levels, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """-2 l (tables,) and Q (tables,) at the ratios r (tables,)."""
    growth = 1 + levels.n * r[:, None]
    w = levels.n / growth
    total = (levels.count * w).sum(axis=1)
    mu = (levels.count * w * levels.mean).sum(axis=1) / total
    away = levels.count * (levels.mean - mu[:, None]) ** 2
    Q = levels.within + (w * (levels.squares + away)).sum(axis=1)
    scale = np.where(levels.within > 0, levels.within, 1.0)
    # Equal values in all of a table have Q = 0; such a table is not the likelihood's to decide.
    relative = np.where(Q > 0, Q / scale, 1.0)
    value = (levels.N - 1) * np.log(relative)
    value += (levels.count * np.log(growth)).sum(axis=1) + np.log(total)
    return value, Q


def _golden(levels: _Levels, low: FloatArray, high: FloatArray) -> FloatArray:
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = (_criterion(levels, x)[0] for x in (left, right))
    for _ in range(STEPS):
        smaller = at_left <= at_right
        low, high = np.where(smaller, low, left), np.where(smaller, right, high)
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        at_left, at_right = (_criterion(levels, x)[0] for x in (left, right))
    return (low + high) / 2


def _variance_of_means(levels: _Levels) -> FloatArray:
    a = levels.count.sum(axis=1)
    mean = (levels.count * levels.mean).sum(axis=1) / a
    squares = levels.squares + levels.count * (levels.mean - mean[:, None]) ** 2
    variance: FloatArray = squares.sum(axis=1) / np.maximum(a - 1, 1)
    return variance
