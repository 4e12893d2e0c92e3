"""Tests on the passes of one component: scatter, trend, reversal, lack of fit.

Each compares two mean squares that are independent on a balanced design; p values are from
F or t with their exact degrees of freedom there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, stdtr

from mtu_cli.stats.groups import group_means
from mtu_cli.stats.least_squares import FloatArray, IntArray, least_squares, polynomial
from mtu_cli.stats.mixed_model import ARITHMETIC, PassFit, lines_by_pass
from mtu_cli.stats.resolution import hidden

MAX_POSITIONS = 400
"""More distinct positions than this count as a continuous run, without replicates."""
FEWEST_PASSES = 3
"""Two passes have one difference, which is the reversal itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FTest:
    """F with its degrees of freedom (2,) and p = P(F' > F)."""

    F: float
    p: float
    df: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A difference or a slope with its standard uncertainty u and p of Student's t."""

    value: float
    u: float
    p: float
    dof: int


def f_test(numerator: float, denominator: float, df1: int, df2: int) -> FTest | None:
    """Of two independent mean squares (Draper & Smith, Applied Regression Analysis, 1998); None
    without degrees of freedom or scatter to compare.
    """
    if df1 < 1 or df2 < 1 or denominator <= 0:
        return None
    F = max(numerator, 0.0) / denominator
    return FTest(F=F, p=float(fdtrc(df1, df2, F)), df=(df1, df2))


def _shift(value: float, u: float, dof: int, rounding: float) -> Shift | None:
    """None where nothing scatters, or where both value and u are rounding errors of 0: the
    errors of sums depend on their order, and look as steady as any trend.
    """
    if dof < 1 or u <= 0 or max(abs(value), u) <= rounding:
        return None
    return Shift(value=value, u=u, p=float(2 * stdtr(dof, -abs(value) / u)), dof=dof)


def pass_scatter(fit: PassFit, r: float = 0.0) -> FTest | None:
    """Do the passes differ by more than repeatability? None where that is undecided. The extra
    sum of squares of one line a pass over one line a direction, against s_repeat^2 (Draper & Smith,
    Applied Regression Analysis, 6.1): exact on any design. What the last digit hides from
    s_repeat^2, `r` at most, counts as scatter (`stats.resolution`).
    """
    df = fit.pooled_dof - fit.within_dof
    if not fit.separated or fit.within_dof < 1 or df < 1:
        return None
    noise = fit.s2 + float(hidden(fit.s2, r)) if fit.s2 > 0 else 0.0
    return f_test((fit.pooled_rss - fit.within_rss) / df, noise, df, fit.within_dof)


def pass_trend(fit: PassFit, order: IntArray | FloatArray, r: float = 0.0) -> Shift | None:
    """Drift a pass of the level at the mean position, direction taken out; `order` (G,) is the
    sequence of the passes in time. With a trend passes are not exchangeable, which D and every
    interval built on it assume. Passes there and back of a run are one unit, their mean, and count
    as one pass; `r` as in `pass_scatter`.
    """
    if not fit.separated or fit.pass_dof < 2:
        return None
    unit = np.arange(fit.n_passes)
    if fit.half_differences is not None:
        unit[fit.pairs[:, 1]] = fit.pairs[:, 0]
    unit = np.unique(unit, return_inverse=True)[1].astype(np.int64)
    columns = np.column_stack([fit.deviations[:, 0], fit.group_direction, _ranks(order)])
    level, sign, rank = group_means(columns, unit, int(unit.max()) + 1).T
    count = _ranks(rank)
    fixed = [np.ones(len(level)), *([sign] if np.ptp(sign) > 0 else [])]
    line = least_squares(np.column_stack([*fixed, count - count.mean()]), level)
    if line.rank < len(line.coefficients) or line.dof < 1:
        return None
    s2 = line.s2 + float(hidden(max(line.s2, fit.s2), r))
    u = float(np.sqrt(s2 * line.unscaled_covariance[-1, -1]))
    return _shift(float(line.coefficients[-1]), u, line.dof, fit.rounding)


def _ranks(order: IntArray | FloatArray) -> FloatArray:
    return np.argsort(np.argsort(order, kind="stable"), kind="stable").astype(np.float64)


def reversal(
    fit: PassFit, order: IntArray | FloatArray, *, timed: bool = True, r: float = 0.0
) -> Shift | None:
    """Mean reversal value (forward minus reverse, ISO 230-2) at the mean position.

    Of runs there and back it is the mean of their differences 2 h_r, less what a steady drift
    b of the runs' means m_r makes of them, whose passes are d apart in `order` (G,):

        2 h + b d,    u^2 = 4 S_h/P + d^2 S_m/sum (t_r - t)^2,    P - 1 degrees of freedom,

    where S_m holds the drift itself: of runs that share all their scatter u is too large. Where
    the order is not `timed` but assumed b d may have either sign: it is then in u alone.
    Without runs it is judged against pass-to-pass scatter: the passes are the units that were
    repeated. None with two passes, whose only difference is the reversal itself. Readings that the
    last digit, of variance `r`, makes alike add r to the variance of either mean.
    """
    forward, reverse = fit.group_direction > 0, fit.group_direction < 0
    if not fit.separated or not forward.any() or not reverse.any() or fit.n_passes < FEWEST_PASSES:
        return None
    level = fit.pass_coefficients[:, 0]
    if fit.half_differences is not None:
        level, rank = level[fit.pairs], _ranks(order)[fit.pairs]
        mean, time = level.mean(axis=1), rank.mean(axis=1) - rank.mean()
        difference, spread = level[:, 0] - level[:, 1], float(time @ time)
        lag = float(np.mean(rank[:, 1] - rank[:, 0]))
        drift, of_drift = 0.0, 0.0
        if spread > 0:
            drift, of_drift = float(time @ mean) / spread, float(np.var(mean, ddof=1)) / spread
        s2, shift = float(np.var(difference, ddof=1)), drift * lag
        u2 = s2 / len(level) + lag**2 * of_drift + 2 * float(hidden(max(s2 / 2, fit.s2), r))
        value = float(difference.mean()) + (shift if timed else 0.0)
        u = float(np.sqrt(u2 + (0.0 if timed else shift**2)))
        return _shift(value, u, len(level) - 1, fit.rounding)
    value = float(level[forward].mean() - level[reverse].mean())
    count = 1 / forward.sum() + 1 / reverse.sum()
    s2 = float(fit.between[0, 0])
    u = float(np.sqrt(s2 * count + 2 * hidden(max(s2, fit.s2), r)))
    return _shift(value, u, fit.pass_dof, fit.rounding)


def lack_of_fit(
    y: FloatArray, position: FloatArray, degree: int, group: IntArray | None, r: float = 0.0
) -> FTest | None:
    """Does a free mean at each position fit better than the polynomial? Every pass has an
    intercept (and a slope, from degree 1), so that drift does not count as error (Draper & Smith,
    Applied Regression Analysis, 1.5, within passes); what the last digit hides of n readings a
    position, n r, does.
    """
    distinct, at = np.unique(position, return_inverse=True)
    m = len(distinct)
    if m <= degree + 1 or m > MAX_POSITIONS:
        return None
    codes = np.zeros(len(y), np.int64)
    if group is not None:
        codes = np.unique(group, return_inverse=True)[1].astype(np.int64)
    slope = min(degree, 1)
    centred = (position - position.mean()) / float(np.ptp(position))
    columns = np.column_stack([np.eye(m)[at], polynomial(centred, degree), y])
    _, residual = lines_by_pass(columns, polynomial(centred, slope), codes, int(codes.max()) + 1)
    powers, response = residual[:, m:-1], residual[:, -1]
    # Columns that the passes' lines absorbed count as 0.
    line, means = (
        least_squares(X[:, np.abs(X).max(axis=0) > 1e-9], response)
        for X in (powers, np.column_stack([powers, residual[:, :m]]))
    )
    # Parameters of one line a pass: slope + 1, 1 where a pass has one position only.
    per_pass = np.bincount(np.unique(codes * m + at) // m)
    df_pure = len(y) - int(np.minimum(per_pass, slope + 1).sum()) - means.rank
    df_lack = means.rank - line.rank
    rounding = len(y) * float(ARITHMETIC * np.abs(y).max()) ** 2
    if df_pure < 1 or means.rss <= rounding:
        return None
    pure = means.rss / df_pure
    pure += len(y) / m * float(hidden(pure, r))
    return f_test((line.rss - means.rss) / max(df_lack, 1), pure, df_lack, df_pure)
