"""Single values that are too far from the others of their sample, or off what others show."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FEWEST = 3
"""A deviation among fewer values than this says nothing."""
GROSS = 8.0
"""Standard deviations of the others from which on a value is no part of them."""
MOST = 0.2
"""Share of the readings beyond which they are their own distribution."""
NORMAL_MAD = 1.4826
ROUNDED = 1e-9
"""Share of the largest value below which two differ by rounding alone."""
LEAST_DOF = 0.1
"""Share of the degrees of freedom that medians leave at least."""


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


def deviation_limit(count: FloatArray, p: float) -> FloatArray:
    """The deviation (value - mean)/s whose two-sided p is `p`; nan for too few values."""
    from scipy.special import stdtrit

    n = np.maximum(count, float(FEWEST))
    t = stdtrit(n - 2, 1 - p / 2)
    limit = (n - 1) / np.sqrt(n) * np.sqrt(t**2 / (n - 2 + t**2))
    found: FloatArray = np.where(count >= FEWEST, limit, np.nan)
    return found


def display_step(values: FloatArray, rounding: float = 0.0) -> float:
    """What values (n,) were rounded to, as far as they tell: the least that two of them differ by;
    not by `rounding` or less. 0 where all are equal.
    """
    steps = np.unique(values)
    apart = np.diff(steps)
    # Each gap beside its own two values: one that is far off says nothing of the others.
    least = np.maximum(rounding, ROUNDED * np.maximum(np.abs(steps[1:]), np.abs(steps[:-1])))
    return float(apart[apart > least].min(initial=np.inf)) if (apart > least).any() else 0.0


def display_u(values: FloatArray) -> float:
    """Standard uncertainty of a `display_step` (JCGM 100:2008, F.2.2.1): no values scatter less."""
    return display_step(values) / math.sqrt(12.0)


DISPLAYED = 10_000
"""Values that are enough to see what all were rounded to."""
OUTLYING_P = 1e-4
"""Chance that any value of a sound normal sample is beyond the limit of `outlying`."""
MAD_EFFICIENCY = 0.37
"""Of a median absolute deviation as a deviation of normal values (Rousseeuw & Croux,
J. Am. Stat. Assoc. 88 (1993) 1273): so many of its degrees of freedom count."""


def outlying(
    values: FloatArray,
    groups: IntArray,
    *,
    fitted: int = 0,
    factor: float = 2.0,
    floor: float = 0.0,
) -> tuple[BoolArray, float]:
    """Outliers among values (n,) that are alike within their `groups` (n,), and the deviation s.

    r is the distance from the median of the group, s = 1.4826 median |r| / sqrt(1 - g/n) of
    groups that have three values or more, g of them and of parameters `fitted` before, at least
    `floor` and what the display tells. An outlier is beyond GROSS s, beyond s times Student's t at
    OUTLYING_P/n (Bonferroni), and beyond `factor` times the farthest of the rest: no tail of a
    distribution, nor the turn of a curve. More than a fifth are none.

    >>> values = np.append(np.sin(np.arange(30.0)), 40.0)
    >>> mask, s = outlying(values, np.zeros(31, int))
    >>> mask.nonzero()[0].tolist(), round(s, 2)
    ([30], 1.05)
    """
    from scipy.special import stdtrit

    found = np.zeros(len(values), bool)
    group = numbered(groups)
    counts = np.bincount(group)
    usable = (counts >= FEWEST)[group] & np.isfinite(values)
    n, taken = int(usable.sum()), int((counts >= FEWEST).sum()) + fitted
    if n - taken < FEWEST:
        return found, 0.0
    rest = np.abs(values - group_medians(values, group))[usable]
    s = NORMAL_MAD * float(np.median(rest)) / math.sqrt(max(1 - taken / n, LEAST_DOF))
    s = max(s, floor, display_u(values[usable][:DISPLAYED]))
    dof = max(MAD_EFFICIENCY * (n - taken), 1.0)
    limit = max(GROSS, -float(stdtrit(dof, OUTLYING_P / (2 * n)))) * s
    order = np.sort(rest)
    # The outermost gap that is wide enough parts the outliers from the rest.
    first = np.arange(max(math.ceil((1 - MOST) * n), 1), n)
    wide = (order[first] > limit) & (order[first] > factor * order[first - 1])
    if wide.any():
        found[usable] = rest >= order[first[wide][0]]
    return found, s


def spikes(values: FloatArray) -> tuple[BoolArray, float]:
    """Outliers among evenly taken values (n,) of a curve, and the deviation s, as `outlying`.

    A value is compared with the lines through the two before, the two after and those on both
    sides, and its smallest deviation counts: beside a kink one of them is sound. Those that are
    off farthest are taken out and the rest is judged again, as spikes hide beside each other; s
    is that of deviations from the mean of both neighbours. The ends are not judged.

    >>> curve = np.exp(-np.arange(20.0) / 5) + 0.01 * np.cos(np.arange(20.0) ** 2)
    >>> curve[7] += 3
    >>> spikes(curve)[0].nonzero()[0].tolist()
    [7]
    """
    from scipy.special import stdtrit

    found, s = np.zeros(len(values), bool), 0.0
    while len(rest := np.flatnonzero(~found)) >= 2 * FEWEST:
        away, scatter = _off_neighbours(values[rest])
        known = scatter[np.isfinite(scatter)]
        s = max(NORMAL_MAD * float(np.median(np.abs(known))), display_u(values[rest]))
        dof = max(MAD_EFFICIENCY * len(known), 1.0)
        limit = max(GROSS, -float(stdtrit(dof, OUTLYING_P / (2 * len(known)))))
        off = np.where(away > limit * s, away, 0.0)
        padded = np.pad(off, 2)
        top = np.max([padded[i : i + len(off)] for i in range(5)], axis=0)
        worst = (off > 0) & (off == top)
        if s == 0 or not worst.any():
            break
        found[rest[worst]] = True
    return found, s


def _off_neighbours(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The smallest deviation of each value from the lines of its neighbours, 0 where fewer than
    two of them are known, and its deviation from the mean of both.
    """
    n = len(values)
    x = np.pad(values, 2, constant_values=np.nan)
    before2, before, own, after, after2 = (x[i : i + n] for i in range(5))
    both = own - (before + after) / 2
    off = np.abs([own - 2 * before + before2, own - 2 * after + after2, both,
                  own - (before2 + after2) / 2])  # fmt: skip
    judged = np.isfinite(off).sum(axis=0) >= 2
    away = np.where(judged, np.min(np.where(np.isnan(off), np.inf, off), axis=0), 0.0)
    return away, both


def numbered(groups: IntArray) -> IntArray:
    """Groups (n,) of whole numbers as 0, 1, ... in the order of these.

    >>> numbered(np.array([7, 3, 7])).tolist()
    [1, 0, 1]
    """
    if not len(groups) or groups.min() < 0 or groups.max() > 4 * len(groups):
        return np.unique(groups, return_inverse=True)[1].reshape(-1).astype(np.int64)
    seen = np.bincount(groups) > 0
    found: IntArray = (np.cumsum(seen) - 1)[groups]
    return found


def group_medians(values: FloatArray, group: IntArray) -> FloatArray:
    """The median (n,) of the group of each value; `group` (n,) counts from 0."""
    order = np.argsort(values)
    # Small numbers are sorted by counting them, several times quicker.
    small = group.astype(np.uint16) if len(group) and group.max() < 1 << 16 else group
    order = order[np.argsort(small[order], kind="stable")]
    counts = np.bincount(group)
    starts = np.cumsum(counts) - counts
    low, high = starts + (counts - 1) // 2, starts + counts // 2
    found: FloatArray = ((values[order[low]] + values[order[high]]) / 2)[group]
    return found
