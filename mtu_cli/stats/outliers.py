"""Single values that are too far from the others of their sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

IntArray = NDArray[np.int64]

FEWEST = 3
"""A deviation among fewer values than this says nothing."""
TAKEN_OUT, MOST_TAKEN_OUT = 0.1, 5
"""Share of a sample, and number, of values that are taken out as too far from the others."""
HIDDEN = 0.8
"""k equal values far off hide each other in a deviation of sqrt((n - 1)/k) (1 - k/n), the others'
scatter apart: below this share of it nothing is hidden."""


def deviation_p(d: FloatArray, count: FloatArray) -> FloatArray:
    """Two-sided p of deviations `d` = (value - mean)/s, s the sample's own deviation.

    `count` is the sample's size n. For normal values t = d sqrt(n (n - 2)/((n - 1)^2 - n d^2))
    has Student's t with n - 2 degrees of freedom (Grubbs, Technometrics 11 (1969) 1).
    """
    from scipy.special import stdtr

    n = np.maximum(count, float(FEWEST))
    left = (n - 1) ** 2 - n * d**2
    with np.errstate(over="ignore"):
        t = np.abs(d) * np.sqrt(n * (n - 2) / np.maximum(left, np.finfo(np.float64).tiny))
    p: FloatArray = np.where(count >= FEWEST, 2 * stdtr(n - 2, -t), 1.0)
    return p


def outlying_p(values: FloatArray, fewest: int = FEWEST) -> FloatArray:
    """Two-sided p (m, n) of the values farthest from their row's mean; 1 of all others.

    `values` (m, n), nan where one is missing; rows with fewer than `fewest` are not judged. One
    in ten of a row, 5 at most, are taken out, the farthest first, so that two values do not hide
    each other: each has the least p of its own and of those taken out after it, as in Rosner's
    generalized ESD procedure (Technometrics 25 (1983) 165), times how many are taken out. The n
    values that each is the farthest of are left to the caller.
    """
    column, d, size = _farthest(values)
    rounds = np.clip(np.floor(TAKEN_OUT * size), 1, MOST_TAKEN_OUT)
    p = _judged(d, size, rounds, fewest)
    found = np.ones(values.shape)
    found[np.arange(len(values)), column] = p
    least = np.sqrt((size - 1).clip(0) / rounds) * (1 - rounds / size.clip(1))
    rows = np.flatnonzero((rounds > 1) & (np.abs(d) > HIDDEN * least))
    left, own, taken, judged = values[rows], np.arange(len(rows)), [column[rows]], [p[rows]]
    for turn in range(1, int(rounds[rows].max(initial=1))):
        left[own, taken[-1]] = np.nan
        column, d, size = _farthest(left)
        p = _judged(d, size, rounds[rows], fewest)
        taken.append(column)
        judged.append(np.where(turn < rounds[rows], p, 1.0))
    for column, p in zip(taken, np.minimum.accumulate(judged[::-1])[::-1], strict=True):
        found[rows, column] = np.minimum(found[rows, column], p)
    return found


def _farthest(values: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Of each row of `values` (m, n): the column of the value farthest from the mean, its
    deviation in standard deviations (0 where there are none) and the number of values; (m,).
    """
    known = np.isfinite(values)
    count = known.sum(axis=1).astype(np.float64)
    mean = np.where(known, values, 0.0).sum(axis=1) / np.maximum(count, 1.0)
    away = np.where(known, values - mean[:, None], 0.0)
    s = np.sqrt((away**2).sum(axis=1) / np.maximum(count - 1, 1.0))
    column = np.argmax(np.abs(away), axis=1)
    farthest = away[np.arange(len(values)), column]
    return column, np.divide(farthest, s, out=np.zeros(len(values)), where=s > 0), count


def _judged(d: FloatArray, size: FloatArray, rounds: FloatArray, fewest: int) -> FloatArray:
    p = np.minimum(rounds * deviation_p(d, size), 1.0)
    return np.where((size >= fewest) & (d != 0), p, 1.0)


def deviation_limit(count: FloatArray, p: float) -> FloatArray:
    """The deviation (value - mean)/s whose two-sided p is `p`; nan for too few values."""
    from scipy.special import stdtrit

    n = np.maximum(count, float(FEWEST))
    t = stdtrit(n - 2, 1 - p / 2)
    limit = (n - 1) / np.sqrt(n) * np.sqrt(t**2 / (n - 2 + t**2))
    found: FloatArray = np.where(count >= FEWEST, limit, np.nan)
    return found
