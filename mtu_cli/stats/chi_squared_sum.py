"""Sums of chi-squared variables of different size: the squares of correlated normal variables."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.uncertain_variance import UncertainVariance

STEPS = 80
"""Halvings of a bracket that spans less than exp(60) to a part in 1e-10."""
REACH = 30.0
FAR = 1e6
"""Times the mean."""
NEAR = 1e-3
"""Standard deviations from the mean at which the formula is 0/0 but for its limit."""


def sum_tails(sizes: FloatArray, dof: float, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P (k,) that sum_i sizes_i X_i is larger, and smaller, than `x` (k,); `sizes` (n,) are 0 or
    more, and the X_i independent chi-squared variables of `dof` degrees of freedom.

    By the saddlepoint of K(z) = -(dof/2) sum log(1 - 2 z sizes), as Kuonen (Biometrika 86 (1999)
    929) has it, with r* for Lugannani and Rice's formula: to some percent of the smaller tail.
    """
    from scipy.special import ndtr

    sizes = sizes[sizes > 0]
    largest = float(sizes.max())
    # Beyond that nothing is left of the tail, nor can it be calculated with.
    x = np.minimum(x, FAR * dof * float(sizes.sum()))
    share = sizes / largest
    above = x > 0
    target = np.where(above, x, 1.0) / (dof * largest)
    u = _saddlepoint(share, target)
    # 1 - 2 z sizes, z the saddlepoint.
    left = 1.0 + (u[:, None] - 1.0) * share
    z = (1.0 - u) / (2.0 * largest)
    K = -0.5 * dof * np.log(left).sum(axis=1)
    second = 2.0 * dof * ((sizes / left) ** 2).sum(axis=1)
    w = np.sign(z) * np.sqrt(np.maximum(2.0 * (z * target * dof * largest - K), 0.0))
    near = np.abs(w) < NEAR
    safe = np.where(near, 1.0, w)
    ratio = np.where(near, 1.0, z * np.sqrt(second)) / safe
    skewness = 8.0 * dof * (sizes**3).sum() / (2.0 * dof * (sizes**2).sum()) ** 1.5
    r = w + np.where(near, skewness / 6.0, np.log(np.where(near, 1.0, ratio)) / safe)
    return np.where(above, ndtr(-r), 1.0), np.where(above, ndtr(r), 0.0)


def mean_square_tails(
    mean_square: float, sizes: FloatArray, dof: float, variance: UncertainVariance
) -> tuple[float, float]:
    """P that a mean of squares whose eigenvalues are `sizes` (n,), each of `dof` degrees of
    freedom, is larger, and smaller, than `mean_square`, its expectation being such a `variance`
    (of one measurand): `uncertain_variance.f_tails` for squares that are not all alike.
    """
    values, weights = variance.values[0], variance.weights[0]
    positive = values > 0
    x = np.divide(mean_square, values, out=np.zeros_like(values), where=positive)
    high, low = sum_tails(sizes / (dof * sizes.sum()), dof, x)
    # Where no scatter is expected any is more.
    high, low = np.where(positive, high, 0.0), np.where(positive, low, 1.0)
    return float(high @ weights), float(low @ weights)


def _saddlepoint(share: FloatArray, target: FloatArray) -> FloatArray:
    """u (k,) with sum share/(1 + (u - 1) share) = target, which falls as u grows."""
    low, high = np.full(len(target), -REACH), np.full(len(target), REACH)
    for _ in range(STEPS):
        middle = (low + high) / 2
        value = (share / (1.0 + (np.exp(middle)[:, None] - 1.0) * share)).sum(axis=1)
        more = value > target
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.asarray(np.exp((low + high) / 2))
