"""Passes there and back: whether both directions of a run scatter alike, and reversal then.

What the two passes of one run have in common is what they have not to do with the direction: the
axis was as warm both times. With forward coefficients f_r and reverse ones g_r of P runs,

    m_r = (f_r + g_r)/2,    h_r = (f_r - g_r)/2,

m and h are uncorrelated, and of one variance where nothing is shared; h holds the reversal.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray, PassFit
from mtu_cli.stats.pass_tests import FTest, Shift, f_test, shift

FEWEST_RUNS = 3
"""Two runs may agree by chance in anything."""


def _halves(fit: PassFit, runs: IntArray) -> tuple[FloatArray, FloatArray] | None:
    """m and h (P, q) of the runs read once there and once back; None of too few.

    `runs` (G,) number the run of each pass of `fit`.
    """
    if not fit.separated:
        return None
    order = np.lexsort([-fit.group_direction, runs])
    first, second = order[:-1], order[1:]
    sign = fit.group_direction
    pairs = (runs[first] == runs[second]) & (sign[first] > 0) & (sign[second] < 0)
    if pairs.sum() < FEWEST_RUNS:
        return None
    there = fit.pass_coefficients[first[pairs]]
    back = fit.pass_coefficients[second[pairs]]
    return (there + back) / 2, (there - back) / 2


def shared_scatter(fit: PassFit, runs: IntArray) -> FTest | None:
    """Do both directions of a run differ alike from other runs? None where that cannot be told.

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
    p = min(1.0, len(told) * best.p)
    return FTest(F=best.F, p=p, df_numerator=df, df_denominator=df)


def paired_reversal(fit: PassFit, runs: IntArray) -> Shift | None:
    """Mean reversal value (forward minus reverse, ISO 230-2) at the mean position, by runs.

    Student's paired t: what both directions of a run share is no uncertainty of it.
    """
    halves = _halves(fit, runs)
    if halves is None:
        return None
    differences = 2 * halves[1][:, 0]
    u = float(np.std(differences, ddof=1)) / len(differences) ** 0.5
    return shift(float(differences.mean()), u, len(differences) - 1)
