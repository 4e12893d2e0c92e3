"""Single values that are too far from the others of their sample, or off what others show."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.stats.resolution import hidden

FEWEST = 3
"""A deviation among fewer values than this says nothing."""
GROSS = 8.0
"""Standard deviations of the others from which on a value is no part of them."""
MOST = 0.2
"""Share of the readings beyond which they are another distribution, no outliers."""
NORMAL_MAD = 1.4826
LEAST_DOF = 0.1
"""Share of the degrees of freedom that medians leave at least."""


def deviation_p(d: FloatArray, count: FloatArray) -> FloatArray:
    """Two-sided p of deviations `d` = (value - mean)/s, s the sample's own deviation.

    `count` is the sample's size n. For normal values t = d sqrt(n (n - 2)/((n - 1)^2 - n d^2))
    has Student's t with n - 2 degrees of freedom (Grubbs, Technometrics 11 (1969) 1).
    """
    from scipy.special import stdtr

    n = np.maximum(count, float(FEWEST))
    divisor = (n - 1) ** 2 - n * d**2
    with np.errstate(over="ignore"):
        t = np.abs(d) * np.sqrt(n * (n - 2) / np.maximum(divisor, np.finfo(np.float64).tiny))
    return np.where(count >= FEWEST, 2 * stdtr(n - 2, -t), 1.0)


SAMPLED = 100_000
"""Values that are enough for a median and a deviation to half a percent."""
OUTLYING_P = 1e-4
"""Chance that any value of a sound normal sample is beyond the limit of `outlying`."""
FACTOR = 2.0
"""Outliers are so many times farther off than all that are none."""
NEAR = 0.8
"""Share of the values, those near the median, that give s."""
NEAR_SQUARE, NEAR_EFFICIENCY = 0.4377245949036389, 0.6277679967579073
"""Mean square of the NEAR = q of normal values of variance 1 that are nearest to 0, and the share
of the degrees of freedom of s^2 that those count.

With P(|x| < k) = q and A = E x^2 [|x| < k] = q - 2 k f(k) these are A/q and
2 A^2/var(min(x^2, k^2)) by the influence function of A (Huber, Robust Statistics, 1981, 3.3), as
moving k takes k^2 from the density at the edge."""
MAD_EFFICIENCY = 0.37
"""Of a median absolute deviation as a deviation of normal values (Rousseeuw & Croux,
J. Am. Stat. Assoc. 88 (1993) 1273): so many of its degrees of freedom count."""


def medians(table: FloatArray, axis: int) -> FloatArray:
    """Medians of the finite values of a table along an axis, which stays; nan where none is.

    >>> medians(np.array([[1.0, np.nan], [2.0, 5.0], [4.0, 7.0]]), 0).tolist()
    [[2.0, 6.0]]
    """
    count = np.isfinite(table).sum(axis=axis, keepdims=True)
    if (count == table.shape[axis]).all():
        return np.median(table, axis=axis, keepdims=True)
    ordered = np.sort(table, axis=axis)  # nan last
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, table.shape[axis] - 1), axis)
    return (low + high) / 2


def median_polish(table: FloatArray, x: FloatArray | None = None) -> FloatArray:
    """A table (rows, columns) less the medians of its columns, of its rows, and of its columns
    again (the median polish of Tukey, 1977); of rows at `x` (columns,) also less their slope, the
    median of those of all pairs (Theil 1950, Sen 1968). Rows of FEWEST values or fewer keep their
    level.
    """
    rest = table - medians(table, 0)
    if x is not None and np.ptp(x) > 0:
        i, j = np.triu_indices(len(x), 1)
        i, j = i[x[j] > x[i]], j[x[j] > x[i]]
        rest = rest - medians((rest[:, j] - rest[:, i]) / (x[j] - x[i]), 1) * (x - np.median(x))
    several = np.isfinite(table).sum(axis=1, keepdims=True) > FEWEST
    rest = rest - np.where(several, medians(rest, 1), 0.0)
    return rest - medians(rest, 0)


def outlying(values: FloatArray, fitted: int = 0, r: float = 0.0) -> tuple[BoolArray, float]:
    """Outliers among values of any shape that are one sample, and its deviation s; nan is none.

    d is the distance from the median, s^2 = mean of the NEAR smallest d^2 / 0.4377 / (1 - g/n) of n
    values and g parameters, this median and those `fitted` before, with the variance `r` that a
    coarse display hides (`resolution.hidden`). An outlier is beyond GROSS s, beyond s times
    Student's t at OUTLYING_P/n (Bonferroni), and beyond FACTOR times the farthest of the rest: no
    tail of a distribution, nor the turn of a curve. More than a fifth are none.

    >>> values = np.append(np.sin(np.arange(30.0)), 40.0)
    >>> mask, s = outlying(values)
    >>> mask.nonzero()[0].tolist(), round(s, 2)
    ([30], 0.9)
    """
    from scipy.special import stdtrit

    result = np.zeros(values.shape, bool)
    usable = np.isfinite(values)
    finite = values[usable]
    n, dof = len(finite), len(finite) - fitted - 1
    if dof < FEWEST:
        return result, 0.0
    middle = np.median(finite[:: n // SAMPLED + 1])
    rest = np.abs(finite - middle)
    sample = rest[:: n // SAMPLED + 1]
    count = max(int(NEAR * len(sample)), 1)
    near = np.partition(sample, count - 1)[:count]
    s2 = float(np.mean(near**2)) / NEAR_SQUARE / max(dof / n, LEAST_DOF)
    s = math.sqrt(s2 + float(hidden(s2, r)))
    t = -float(stdtrit(max(NEAR_EFFICIENCY * dof, 1.0), OUTLYING_P / (2 * n)))
    beyond = rest > max(GROSS, t) * s
    tail = np.sort(rest[beyond])
    # The outermost gap that is wide enough parts the outliers from the rest.
    wide = tail > FACTOR * np.append(rest[~beyond].max(initial=0.0), tail[:-1])[: len(tail)]
    wide[: max(len(tail) - int(MOST * n), 0)] = False
    if wide.any():
        result[usable] = rest >= tail[wide][0]
    return result, s


def spikes(values: FloatArray, least: float = 0.0, r: float = 0.0) -> tuple[BoolArray, float]:
    """Outliers among evenly taken values (n,) of a curve that are off by `least` or more, and the
    deviation s, as `outlying`, with the variance `r` that a coarse display hides.

    A value is compared with the lines through the two before, the two after and those on both
    sides, and its smallest deviation counts: beside a kink one of them is sound. Those that are
    off farthest are taken out and the rest is judged again, as spikes hide beside each other; s
    is that of deviations from the mean of both neighbours. The ends are not judged;
    nan is skipped.

    >>> curve = np.exp(-np.arange(20.0) / 5) + 0.01 * np.cos(np.arange(20.0) ** 2)
    >>> curve[7] += 3
    >>> spikes(curve)[0].nonzero()[0].tolist()
    [7]
    """
    from scipy.special import stdtrit

    result, s, usable = np.zeros(len(values), bool), 0.0, np.isfinite(values)
    while len(rest := np.flatnonzero(usable & ~result)) >= 2 * FEWEST:
        x = values[rest]
        scatter = np.abs(x[1:-1] - (x[:-2] + x[2:]) / 2)
        n = len(scatter)
        s2 = (NORMAL_MAD * float(np.median(scatter[:: n // SAMPLED + 1]))) ** 2
        s = math.sqrt(s2 + float(hidden(s2, r)))
        t = -float(stdtrit(max(MAD_EFFICIENCY * n, 1.0), OUTLYING_P / (2 * n)))
        limit = max(max(GROSS, t) * s, least)
        near = np.flatnonzero(scatter > limit) + 1
        if s == 0 or not len(near):
            break
        deviation = np.zeros(len(x) + 4)  # two more at each end
        before2, before, mid, after, after2 = (
            np.pad(x, 2, constant_values=np.nan)[near + i] for i in range(5)
        )
        ways = (mid - 2 * before + before2, mid - 2 * after + after2, mid - (before + after) / 2,
                mid - (before2 + after2) / 2)  # fmt: skip
        deviation[near + 2] = np.nanmin(np.abs(ways), axis=0)
        deviation[deviation <= limit] = 0.0
        top = np.max([deviation[near + i] for i in range(5)], axis=0)
        worst = near[(deviation[near + 2] > 0) & (deviation[near + 2] == top)]
        if not len(worst):
            break
        result[rest[worst]] = True
    return result, s
