"""Coverage: effective degrees of freedom, coverage factors, numerical tolerance, and several tests
or estimates at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from scipy.special import fdtrc, stdtrit

from mtu_cli.stats.least_squares import FloatArray

PROBABILITY = 0.95
"""Of every interval that is not asked for otherwise."""
TAIL = (1 - PROBABILITY) / 2
"""Beyond either end of it."""


def welch_satterthwaite(contributions: FloatArray, dof: FloatArray) -> FloatArray:
    """Effective degrees of freedom (...) of sums of independent variances.

    nu_eff = (sum v_i)^2 / sum(v_i^2 / nu_i), GUM (JCGM 100:2008) eq. (G.2b), of the variances
    v_i = (c_i u(x_i))^2 `contributions` (n, ...), below 0 of a mean square that is subtracted, with
    `dof` (n,) nu_i > 0, which may be infinite. It is not truncated, and infinite where no
    contribution with finite degrees of freedom is there.
    """
    total = contributions.sum(axis=0)
    # Shares keep the squares of very small variances from underflowing.
    shares = contributions / np.where(total == 0.0, 1.0, total)
    spread = np.tensordot(1.0 / dof, shares**2, axes=1)
    return np.divide(1.0, spread, out=np.full(spread.shape, np.inf), where=spread > 0.0)


def coverage_factor(probability: float, dof: float = math.inf) -> float:
    """k = t_p(nu) such that y -+ k u covers `probability` (two-sided), GUM G.3.

    The normal quantile where `dof` is infinite. Non-integer `dof` is used as it is.
    """
    return float(stdtrit(dof, 0.5 * (1.0 + probability)))


def t_interval(value: float, u: float, dof: float) -> tuple[float, float]:
    """value -+ t u, which covers PROBABILITY."""
    half = coverage_factor(PROBABILITY, dof) * u
    return value - half, value + half


def few_blocks_factor(blocks: int) -> float:
    """t(h - 1)/z at 97.5 %, by which two standard errors from the scatter of h blocks fall short:
    1.07 for 20 blocks; 1 for one, whose standard errors do not come from a scatter.
    """
    if blocks == 1:
        return 1.0
    return coverage_factor(PROBABILITY, blocks - 1.0) / coverage_factor(PROBABILITY)


def numerical_tolerance(u: float, digits: int = 2) -> float:
    """delta = 10^l / 2, where u = c 10^l and c is an integer of `digits` digits.

    JCGM 101:2008, 7.9.2. In the unit of u; 0 for u = 0, nan where u is not finite.
    """
    if u == 0.0:
        return 0.0
    if not math.isfinite(u):
        return math.nan
    # Formatting rounds first: 0.0996 to two digits is 10 x 10^-2, not 99 x 10^-3.
    exponent = int(f"{u:.{digits - 1}e}".partition("e")[2])
    return 0.5 * 10.0 ** (exponent - digits + 1)


FAMILY_RATE = 0.05
"""False alarms of all tests of one kind together."""
Key = TypeVar("Key")


def significant(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """The significant ones among all tests of their kind, at the family-wise rate (Bonferroni;
    Dunn, J. Am. Stat. Assoc. 56 (1961) 52).
    """
    return {key: p for key, p in p_values.items() if p * len(p_values) <= FAMILY_RATE}


def holm(p: FloatArray) -> FloatArray:
    """Holm's adjusted p values (Scand. J. Statist. 6 (1979) 65) over all known of `p` (m,).

    A test that was not made has p = nan; it stays nan and does not count.
    """
    adjusted = np.full(len(p), np.nan)
    valid = np.flatnonzero(np.isfinite(p))
    order = valid[np.argsort(p[valid], kind="stable")]
    steps = len(valid) - np.arange(len(valid))
    adjusted[order] = np.maximum.accumulate(np.minimum(p[order] * steps, 1.0))
    return adjusted


ENDLESS = 1e9
"""Degrees of freedom beyond which F is chi^2 / k."""


def yao_p(d: FloatArray, V: FloatArray, sources: Sequence[tuple[FloatArray, float]]) -> float:
    """p of differences `d` (k,) that are all 0 but for their covariance V (k, k), the sum of the
    mean squares `sources` (k, k), each with its degrees of freedom.

    T^2 = d' V^-1 d of V with nu degrees of freedom: (nu - k + 1) T^2 / (nu k) is F(k, nu - k + 1),
    1 where that is 0 (Hotelling, Ann. Math. Stat. 2 (1931) 360), nu the effective ones (Yao,
    Biometrika 52 (1965) 139, with Welch's weights taken over all of them): a chi-square would
    reject far too often, the covariances being estimated.
    """
    scale = np.sqrt(np.diag(V))
    size = np.outer(scale, scale)
    of_correlation = np.linalg.pinv(V / size, rcond=1e-9, hermitian=True)
    k, inverse = int(np.linalg.matrix_rank(of_correlation)), of_correlation / size
    shares = np.array([float(np.trace(part @ inverse)) for part, _ in sources])
    nu = min(float(welch_satterthwaite(shares, np.array([dof for _, dof in sources]))), ENDLESS)
    df2 = nu - k + 1
    return float(fdtrc(k, df2, d @ inverse @ d * df2 / (nu * k))) if df2 > 0 else 1.0
