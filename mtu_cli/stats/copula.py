"""Correlated inputs that are not normal: a Gaussian copula with the correlation asked for.

X_i = Q_i(Phi(Z_i)) with jointly normal Z has every marginal distribution as stated. The
correlation of the Z is chosen so that the *X* have the stated coefficient: it is what JCGM 100
propagates, and it is not that of the Z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.distributions import Distribution, shape_moments

FloatArray = NDArray[np.float64]

TERMS = 60
NODES = 4_001
REACH = 8.5
LAST_ODD = TERMS - 1
BEYOND = 1e-8
"""A coefficient larger by no more than this share is the largest there is, as it was written."""
ROUNDING = 1e-12


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Marginal:
    """A distribution as a function of a standard normal z: X = Q(Phi(z)).

    `at` (NODES,): that at equal steps of z over -+`REACH`. `coefficients` (TERMS,): a_k of
    X = sum a_k He_k(z)/sqrt(k!), k from 0; their squares sum to u^2 but for what is cut.
    """

    item: Distribution
    at: FloatArray
    coefficients: FloatArray


def marginal(item: Distribution) -> Marginal:
    """A distribution expanded for `normal_correlation`, at its stated half-width."""
    from scipy.special import ndtr

    z, weight = _nodes()
    if not item.bounded:
        found = np.zeros(TERMS)
        found[1] = item.u
        return Marginal(item=item, at=item.u * z, coefficients=found)
    at = bounded_quantile(item, ndtr(z))
    q = at * weight
    before, own = np.zeros_like(z), np.ones_like(z)
    found = np.empty(TERMS)
    for k in range(TERMS):
        found[k] = float(q @ own)
        before, own = own, (z * own - math.sqrt(k) * before) / math.sqrt(k + 1.0)
    return Marginal(item=item, at=at, coefficients=found)


def largest_covariance(first: Marginal, second: Marginal) -> float:
    """E Q_1(U) Q_2(U): what two inputs have that rise together, the most there can be (Frechet).

    Of two of one shape the product of their standard deviations.
    """
    a, b = first.item, second.item
    if not (a.bounded or b.bounded):
        return a.u * b.u
    # Shares of equal shapes may differ by the rounding of their widths.
    if _family(a) == _family(b) and abs(a.top_share - b.top_share) <= ROUNDING:
        return a.half_width * b.half_width * shape_moments(a.kind, a.top_share)[0]
    return float(first.at @ (second.at * _nodes()[1]))


def normal_correlation(first: Marginal, second: Marginal, covariance: float) -> float | None:
    """rho of the normals for which the inputs have this `covariance`; None where none gives it.

    covariance = sum a_k b_k rho^k over odd k (Mehler), rising in rho; solved by bisection. What
    the series leaves out goes to its last term, so that at rho = +-1, and where the covariance
    is within rounding of that, it is exact.
    """
    most = largest_covariance(first, second)
    terms = first.coefficients * second.coefficients
    terms[0::2] = 0.0
    terms[LAST_ODD] += most - float(terms.sum())
    if abs(covariance) > most * (1.0 + BEYOND):
        return None
    if abs(covariance) >= most * (1.0 - ROUNDING):
        return math.copysign(1.0, covariance)
    low, high = -1.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float(np.polyval(terms[::-1], middle)) < covariance:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _nodes() -> tuple[FloatArray, FloatArray]:
    z = np.linspace(-REACH, REACH, NODES)
    return z, np.exp(-0.5 * z * z) * ((z[1] - z[0]) / math.sqrt(2.0 * math.pi))


def _family(item: Distribution) -> str:
    return "rectangular" if item.kind == "curvilinear-trapezoidal" else item.kind
