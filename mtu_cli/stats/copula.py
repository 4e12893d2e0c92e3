"""Correlated inputs that are not normal: a Gaussian copula with the correlation asked for.

X_i = Q_i(Phi(Z_i)) with jointly normal Z has every marginal distribution as stated. The
correlation of the Z is chosen so that the *X* have the stated coefficient: it is what JCGM 100
propagates, and it is not that of the Z.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.distributions import Distribution

FloatArray = NDArray[np.float64]

TERMS = 60
NODES = 4_001
REACH = 8.5


def bounded_quantile(item: Distribution, probability: FloatArray) -> FloatArray:
    """Q(p) (n,) of a bounded distribution about 0, at its stated half-width where it is inexact.

    Raises ValueError for a normal one.
    """
    if not item.bounded:
        raise ValueError(f"no closed quantile: {item.kind}")
    p = np.asarray(probability, dtype=np.float64)
    if item.kind in ("rectangular", "curvilinear-trapezoidal"):
        return item.half_width * (2.0 * p - 1.0)
    if item.kind == "arcsine":
        return item.half_width * np.sin(np.pi * (p - 0.5))
    # Trapezoid with top b: slopes of probability (1 - b)/(2 (1 + b)) at either side.
    b = item.top_share
    near = np.minimum(p, 1.0 - p)
    slope = (1.0 - b) / (2.0 * (1.0 + b))
    side = np.sqrt(np.maximum(2.0 * (1.0 - b * b) * near, 0.0)) - 1.0
    flat = (1.0 + b) * (near - slope) - b
    deviation = np.where(near < slope, side, flat)
    return np.asarray(item.half_width * np.where(p < 0.5, deviation, -deviation))


def hermite_coefficients(item: Distribution) -> FloatArray:
    """a_k (TERMS,) of Q(Phi(z)) = sum a_k He_k(z)/sqrt(k!), k from 0: their squares sum to u^2."""
    from scipy.special import ndtr

    if not item.bounded:
        found = np.zeros(TERMS)
        found[1] = item.u
        return found
    z = np.linspace(-REACH, REACH, NODES)
    weight = np.exp(-0.5 * z * z) * ((z[1] - z[0]) / math.sqrt(2.0 * math.pi))
    q = bounded_quantile(item, ndtr(z)) * weight
    before, own = np.zeros_like(z), np.ones_like(z)
    found = np.empty(TERMS)
    for k in range(TERMS):
        found[k] = float(q @ own)
        before, own = own, (z * own - math.sqrt(k) * before) / math.sqrt(k + 1.0)
    return found


def normal_correlation(first: FloatArray, second: FloatArray, covariance: float) -> float | None:
    """rho of the normals for which the inputs have this `covariance`; None where none gives it.

    covariance = sum a_k b_k rho^k over k >= 1 (Mehler), rising in rho; solved by bisection.
    """
    goal = covariance
    terms = (first * second)[::-1]
    low, high = -1.0, 1.0
    at_low, at_high = float(np.polyval(terms, low)), float(np.polyval(terms, high))
    rounding = 1e-3 * (at_high - at_low)
    if goal < at_low - rounding or goal > at_high + rounding:
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float(np.polyval(terms, middle)) < goal:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
