"""Passes there and back: whether both directions of a run scatter alike.

What the two passes of one run have in common is what they have not to do with the direction: the
axis was as warm both times. With forward coefficients f_r and reverse ones g_r of P runs,

    m_r = (f_r + g_r)/2,    h_r = (f_r - g_r)/2,

m and h are uncorrelated, and of one variance where nothing is shared; h holds the reversal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray, PassFit
from mtu_cli.stats.pass_tests import FTest, f_test

FEWEST_RUNS = 3
"""Two runs may agree by chance in anything."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedScatter:
    """p that passes there and back differ from others alike by chance, by `test` of level or slope.

    `understated`: u of the mean of all passes is so many times that of independent ones, by the
    larger of level and slope, and sqrt(2) where all is shared.
    """

    test: FTest
    p: float
    understated: float


def shared_scatter(fit: PassFit, runs: IntArray) -> SharedScatter | None:
    """Do both directions of a run differ alike from other runs? None where that cannot be told.

    `runs` (G,) number the run of each pass of `fit`; those read one way only do not count.
    F = var(m)/var(h) with P - 1 and P - 1 degrees of freedom, that of blocks in a two-way analysis
    of variance with runs as blocks and the directions as treatments (Box, Hunter & Hunter,
    Statistics for Experimenters, 4.2); of level and slope that which has the smaller p, times
    their number.
    """
    halves = _halves(fit, runs)
    if halves is None:
        return None
    df = len(halves[0]) - 1
    of_mean, of_half = (np.var(part, axis=0, ddof=1) for part in halves)
    tests = [f_test(float(a), float(b), df, df) for a, b in zip(of_mean, of_half, strict=True)]
    told = [test for test in tests if test is not None]
    if not told:
        return None
    best = min(told, key=lambda test: test.p)
    # Each way is m + h or m - h: taken as independent, their mean has half of var(m) + var(h).
    of_pass = of_mean + of_half
    share = np.divide(of_mean, of_pass, out=np.full_like(of_pass, 0.5), where=of_pass > 0)
    understated = float(np.sqrt(2 * share.max()))
    return SharedScatter(test=best, p=min(1.0, len(told) * best.p), understated=understated)


def _halves(fit: PassFit, runs: IntArray) -> tuple[FloatArray, FloatArray] | None:
    """m and h (P, q) of the runs read once there and once back; None of too few."""
    if not fit.separated:
        return None
    sign = fit.group_direction
    order = np.lexsort([-sign, runs])
    first, second = order[:-1], order[1:]
    pairs = (runs[first] == runs[second]) & (sign[first] > 0) & (sign[second] < 0)
    if pairs.sum() < FEWEST_RUNS:
        return None
    there, back = fit.pass_coefficients[first[pairs]], fit.pass_coefficients[second[pairs]]
    return (there + back) / 2, (there - back) / 2
