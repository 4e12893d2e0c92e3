"""A process of manufacture by its parts in their sequence: whether it drifts, and whether it is
capable of its limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from scipy.special import chdtri, nctdtrinc, ndtr, stdtr

from mtu_cli.stats.coverage import TAIL
from mtu_cli.stats.least_squares import BoolArray, FloatArray

FEWEST_FOR_TREND = 4
"""Values that a line is fitted to, at least."""
MOVING_RANGE = 1.128
"""d2: mean difference of two normal values in standard deviations (Tippett, 1925)."""
T_FAR = 1000.0
"""Of Student's t: above it the series of the noncentral distribution hardly ends."""
WITHIN = 0.9973
"""Share of parts within the natural limits: what six standard deviations hold."""
Interval = tuple[float, float]
OPEN: Interval = (nan, nan)


def slopes(
    sequence: FloatArray, values: FloatArray, present: BoolArray, rounding: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slopes of m rows of `values` (m, n) over their `sequence` (m, n) by least squares, with
    standard uncertainty u and two-sided p of Student's t, each (m,); nan of rows with fewer values
    `present` (m, n) than FEWEST_FOR_TREND. `rounding` (m,) is the variance of a value that its last
    digit hides.
    """
    n = present.sum(axis=1)
    arrays = (np.ma.array(each, mask=~present) for each in (sequence, values))
    x, y = (np.asarray((each - each.mean(axis=1)[:, None]).filled(0.0)) for each in arrays)
    spread = (x**2).sum(axis=1)
    valid = (n >= FEWEST_FOR_TREND) & (spread > 0)
    spread, dof = np.where(valid, spread, np.nan), np.where(valid, n - 2.0, np.nan)
    slope = (x * y).sum(axis=1) / spread
    s2 = ((y - slope[:, None] * x) ** 2).sum(axis=1) / dof
    u = np.sqrt((s2 + rounding) / spread)
    # Values that are all equal have no trend, those on a line have one beyond doubt.
    t = np.where(valid & (slope != 0), np.inf, np.nan)
    np.divide(np.abs(slope), u, out=t, where=u > 0)
    return slope, u, 2 * stdtr(dof, -t)


@dataclass(frozen=True, kw_only=True)
class Capability:
    """Capability of a quantity that must lie from `low` to `high`; nan where undefined.

    `values` (n,) in their sequence, `s` their overall standard deviation, `s_moving` = mean moving
    range/1.128 that of neighbours. With 95 % intervals for normal values (nan: undefined)

        pp = (high - low)/(6 s),    ppk = min(high - mean, mean - low)/(3 s),

    chi-squared and noncentral t of the nearer limit; `cp` and `cpk` have `s_moving` for s. Of a
    position the radial error must lie from 0 to `high`, and ppk = high/q, q the 99.73 % quantile of
    the radial error of a bivariate normal law.
    """

    low: float
    high: float
    values: FloatArray
    mean: float
    s: float = nan
    s_moving: float = nan
    pp: float = nan
    pp_interval: Interval = OPEN
    ppk: float
    ppk_interval: Interval = OPEN
    cp: float = nan
    cpk: float = nan


def capability(values: FloatArray, low: float, high: float, r: float) -> Capability:
    """Of `values` (n,), two or more, of which the last digit hides the variance `r` each."""
    n, mean, s = len(values), float(values.mean()), float(np.sqrt(values.var(ddof=1) + r))
    moving = np.abs(np.diff(values)).mean() / MOVING_RANGE
    s_moving, nearer = float(np.sqrt(moving**2 + r)), min(high - mean, mean - low)
    pp, ppk = _ratio(high - low, 6 * s), _ratio(nearer, 3 * s)
    scale, tails = 3 * np.sqrt(n), (1 - TAIL, TAIL)
    lower, upper = (float(np.sqrt(chdtri(n - 1, p) / (n - 1))) for p in tails)
    least, most = (noncentrality(n - 1, p, scale * ppk) / scale for p in tails)
    return Capability(
        low=low,
        high=high,
        values=values,
        mean=mean,
        s=s,
        s_moving=s_moving,
        pp=pp,
        pp_interval=(pp * lower, pp * upper),
        ppk=ppk,
        ppk_interval=(least, most),
        cp=_ratio(high - low, 6 * s_moving),
        cpk=_ratio(nearer, 3 * s_moving),
    )


def noncentrality(dof: float, probability: float, t: float) -> float:
    """The delta of which Student's noncentral t is at most `t` with this probability.

    Where |t| > T_FAR it is t sqrt(chi^2/dof) to four digits, as t W - Z with W^2 = chi^2/dof and Z
    normal is.

    >>> round(noncentrality(9, 0.975, 40.0), 3), round(noncentrality(9, 0.975, -4e6))
    (21.79, -5815346)
    """
    if abs(t) <= T_FAR or np.isnan(t):
        return float(nctdtrinc(dof, probability, t))
    upper = probability if t > 0 else 1 - probability
    return t * float(np.sqrt(chdtri(dof, upper) / dof))


def radial_capability(errors: FloatArray, high: float, r: float) -> Capability:
    """Of a position, by its `errors` (n, 2) along two axes; `r` as above."""
    C, radial = np.cov(errors.T) + r * np.eye(2), np.hypot(*errors.T)
    ppk = _ratio(high, radial_quantile(errors.mean(axis=0), C, WITHIN)) if C.any() else nan
    return Capability(low=0.0, high=high, values=radial, mean=float(radial.mean()), ppk=ppk)


def _ratio(part: float, whole: float) -> float:
    """Of a process that does not scatter there is none: nan."""
    return part / whole if whole > 0 else nan


def radial_quantile(mean: FloatArray, C: FloatArray, probability: float) -> float:
    """The quantile of the length of a normal vector with `mean` (2,) and covariance `C` (2, 2).

    P(length <= R) is integrated along the principal axis of the larger variance, with the normal
    law of the other one in closed form.

    >>> round(radial_quantile(np.zeros(2), np.eye(2), 0.9973), 3)  # sqrt(-2 ln 0.0027)
    3.439
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq

    variances, axes = np.linalg.eigh(C)
    unit = float(np.sqrt(variances[1]))
    ratio = np.sqrt(max(float(variances[0]) / unit**2, 1e-12))
    (across, along), root = axes.T @ mean / unit, np.sqrt(2 * np.pi)

    def beyond(R: float) -> float:
        def density(x: float) -> float:
            half = np.sqrt(max(R**2 - x**2, 0.0))
            share = ndtr((half - across) / ratio) - ndtr((-half - across) / ratio)
            return float(np.exp(-((x - along) ** 2) / 2) * share / root)

        low, high = max(-R, along - 9), min(R, along + 9)
        return float(quad(density, low, high)[0] if low < high else 0.0) - probability

    return unit * float(brentq(beyond, 0.0, np.hypot(across, along) + 9))
