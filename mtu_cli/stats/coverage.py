"""Coverage: effective degrees of freedom, coverage factors and numerical tolerance."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MANY_DOF = 1e5


def welch_satterthwaite(contributions: FloatArray, dof: FloatArray) -> float:
    """Effective degrees of freedom of a sum of independent variances.

    nu_eff = (sum v_i)^2 / sum(v_i^2 / nu_i), GUM (JCGM 100:2008) eq. (G.2b).

    `contributions` (n,): the variances v_i = (c_i u(x_i))^2, not standard uncertainties.
    `dof` (n,): nu_i > 0, which may be infinite. The result is not truncated to an integer
    and is infinite where no contribution with finite degrees of freedom is above zero.

    Raises ValueError for unequal lengths, a negative variance or nu_i <= 0.
    """
    v = np.asarray(contributions, dtype=np.float64)
    nu = np.asarray(dof, dtype=np.float64)
    if v.shape != nu.shape or v.ndim != 1:
        raise ValueError(f"contributions {v.shape} and degrees of freedom {nu.shape} differ")
    if not (np.all(v >= 0.0) and np.all(nu > 0.0)):
        raise ValueError("variances must be at least 0 and degrees of freedom above 0")
    total = float(v.sum())
    if total == 0.0:
        return math.inf
    # Shares keep the squares of very small variances from underflowing.
    return dof_of_shares(v / total, nu)


def dof_of_shares(shares: FloatArray, dof: FloatArray) -> float:
    """nu_eff = 1/sum(w_i^2 / nu_i) of a variance whose sources have the `shares` w_i (n,) of it.

    The same formula for shares that are had otherwise, such as traces of matrices, and may be
    negative where a mean square is subtracted. Infinite where all `dof` (n,) of shares are.
    """
    denominator = float(np.sum(shares**2 / dof))
    return 1.0 / denominator if denominator > 0.0 else math.inf


def effective_dof(total: FloatArray, squares: FloatArray, dof: FloatArray) -> FloatArray:
    """The same for m variances at once: `total` (m,), the sums of the `squares` (K, m).

    `dof` (K,) is that of each mean square, which may be subtracted. Infinite (m,) where no
    square with finite degrees of freedom is there.
    """
    spread = (squares**2 / dof[:, None]).sum(axis=0)
    found: FloatArray = np.full_like(total, np.inf)
    np.divide(total**2, spread, out=found, where=spread > 0)
    return found


def coverage_factor(probability: float, dof: float = math.inf) -> float:
    """k = t_p(nu) such that y -+ k u covers `probability` (two-sided), GUM G.3.

    The normal quantile where `dof` is infinite. Non-integer `dof` is used as it is.

    Raises ValueError for a probability outside (0, 1) or dof <= 0.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"coverage probability {probability} is not between 0 and 1")
    if not dof > 0.0:
        raise ValueError(f"degrees of freedom {dof} are not above 0")
    upper = 0.5 * (1.0 + probability)
    return float(t_quantile(np.array([upper]), dof)[0])


def t_quantile(probability: FloatArray, dof: float) -> FloatArray:
    """Quantiles (n,) of Student's t at `probability` (n,); of the normal for infinite `dof`.

    From `MANY_DOF` on by the expansion in 1/dof about the normal quantile z (Abramowitz & Stegun,
    26.7.5), whose next term is below 1e-19: it spares short commands the import of
    scipy.special, which takes longer than all they do.
    """
    if dof < MANY_DOF:
        from scipy.special import stdtrit

        return np.asarray(stdtrit(dof, probability), dtype=np.float64)
    normal = NormalDist()
    z = np.array([normal.inv_cdf(float(p)) for p in probability])
    # Beyond 1e20 the terms in 1/dof are below the rounding of z, and dof cubed overflows.
    return z if dof > 1e20 else _near_normal(z, dof)


def _near_normal(z: FloatArray, dof: float) -> FloatArray:
    first = (z**3 + z) / 4
    second = (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    quantile: FloatArray = z + first / dof + second / dof**2 + third / dof**3
    return quantile


def few_blocks_factor(blocks: int) -> float:
    """t(h - 1)/z at 97.5 %: by which two standard errors from the scatter of h blocks fall short.

    1.07 for 20 blocks and 1.02 for 80. By the expansion of `t_quantile`, whose next term is below
    3e-4 for the 10 blocks that there are at least; 1 for one block, whose standard errors do not
    come from a scatter.
    """
    if blocks == 1:
        return 1.0
    z = np.array([NormalDist().inv_cdf(0.975)])
    return float(_near_normal(z, blocks - 1.0)[0] / z[0])


def numerical_tolerance(u: float, digits: int = 2) -> float:
    """delta = 10^l / 2, where u = c 10^l and c is an integer of `digits` digits.

    JCGM 101:2008, 7.9.2. In the unit of u; 0 for u = 0, nan where u is not finite.

    Raises ValueError for u < 0 or fewer than one digit.
    """
    if digits < 1:
        raise ValueError(f"{digits} significant digits; at least 1 is needed")
    if u < 0.0:
        raise ValueError(f"standard uncertainty {u} is negative")
    if u == 0.0:
        return 0.0
    if not math.isfinite(u):
        return math.nan
    # Formatting rounds first: 0.0996 to two digits is 10 x 10^-2, not 99 x 10^-3.
    exponent = int(f"{u:.{digits - 1}e}".partition("e")[2])
    return 0.5 * 10.0 ** (exponent - digits + 1)
