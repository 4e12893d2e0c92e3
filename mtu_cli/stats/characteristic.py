"""Characteristic functions of what is drawn for input contributions: E cos(omega X)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.distributions import NORMAL_DOF, Distribution

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-13
SCALE_NODES = 96
HALF_WIDTH_NODES = 48
SLOW = 24.0
"""Phase over the range of an inexact half-width, rad, up to which the nodes follow it."""
FLAT = 1e-8
"""A trapezoid whose sides are a smaller share of its base is a rectangle."""


def characteristic(item: Distribution, omega: FloatArray) -> FloatArray:
    """E cos(omega X) (n,) of what is drawn for `item`, at angular frequencies `omega` (n,) > 0."""
    if not item.bounded:
        return _normal(item, omega)
    if item.inexact == 0.0:
        return _shape(item, item.half_width * omega)
    # The half-width is rectangular: an average over it.
    slow = item.inexact * item.half_width * omega <= SLOW
    found = np.empty_like(omega)
    found[slow] = _averaged(item, omega[slow])
    if not np.all(slow):
        # Beyond, the integral of the shape's own function in closed form.
        high = item.half_width * (1.0 + item.inexact) * omega[~slow]
        low = item.half_width * (1.0 - item.inexact) * omega[~slow]
        found[~slow] = (_integral(item, high) - _integral(item, low)) / (high - low)
    return found


def _normal(item: Distribution, omega: FloatArray) -> FloatArray:
    square = 0.5 * (item.u * omega) ** 2
    if item.dof >= NORMAL_DOF:
        return np.asarray(np.exp(-square))
    # Student's t is a normal mixture: variance u^2 nu/g, g from chi-squared of nu. In log g its
    # density is smooth and falls off at both ends, so that equal steps converge at once.
    half = 0.5 * item.dof
    spread = 9.0 / math.sqrt(half) + 9.0 / half
    logs = np.linspace(-spread, min(spread, 9.0 / math.sqrt(half)), SCALE_NODES)
    weights = np.exp(half * (logs - np.expm1(logs)))
    weights /= weights.sum()
    found = np.zeros_like(omega)
    for log, weight in zip(logs, weights, strict=True):
        if weight > NEGLIGIBLE:
            found += weight * np.exp(-square * math.exp(-log))
    return found


def _averaged(item: Distribution, omega: FloatArray) -> FloatArray:
    nodes, weights = np.polynomial.legendre.leggauss(HALF_WIDTH_NODES)
    found = np.zeros_like(omega)
    for node, weight in zip(nodes, weights, strict=True):
        width = item.half_width * (1.0 + item.inexact * node)
        found += 0.5 * weight * _shape(item, width * omega)
    return found


def _shape(item: Distribution, x: FloatArray) -> FloatArray:
    """Characteristic function of the shape, x = half-width times frequency."""
    match item.kind:
        case "rectangular" | "curvilinear-trapezoidal":
            return np.asarray(np.sinc(x / np.pi))
        case "triangular":
            return np.asarray(np.sinc(x / (2.0 * np.pi)) ** 2)
        case "arcsine":
            from scipy.special import j0

            return np.asarray(j0(x))
    first = 0.5 * (1.0 + item.top_share)
    return np.asarray(np.sinc(first * x / np.pi) * np.sinc((1.0 - first) * x / np.pi))


def _integral(item: Distribution, x: FloatArray) -> FloatArray:
    """Integral (n,) of `_shape` from 0 to `x` (n,) >= 0.

    Rectangle Si(x). Triangle and trapezoid of top b: the function is
    2 (cos bt - cos t)/((1 - b^2) t^2), its integral by parts
    2 ((cos x - cos bx)/x + Si(x) - b Si(bx))/(1 - b^2).
    """
    from scipy.special import itj0y0, sici

    if item.kind == "arcsine":
        return np.asarray(itj0y0(x)[0])
    b = 0.0 if item.kind == "triangular" else item.top_share
    if item.kind not in ("triangular", "trapezoidal") or 1.0 - b < FLAT:
        return np.asarray(sici(x)[0])
    fall = np.divide(np.cos(x) - np.cos(b * x), x, out=np.zeros_like(x), where=x > 0.0)
    return np.asarray(2.0 * (fall + sici(x)[0] - b * sici(b * x)[0]) / (1.0 - b * b))
