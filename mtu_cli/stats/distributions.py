"""Distributions of input quantities: JCGM 100:2008, 4.3 and JCGM 101:2008, 6.4.

All are symmetric about the estimate and described about it, as deviations.

Correlated inputs that are not normal have a Gaussian copula: X_i = Q_i(Phi(Z_i)) with jointly
normal Z has every marginal distribution as stated. The correlation of the Z is chosen so that the
*X* have the stated coefficient: it is what JCGM 100 propagates, and it is not that of the Z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace

Kind = Literal[
    "normal", "t", "rectangular", "triangular", "trapezoidal", "curvilinear-trapezoidal", "arcsine"
]
TOPS = {"rectangular": 1.0, "curvilinear-trapezoidal": 1.0, "triangular": 0.0}
"""Share of the base that the top takes: these shapes are trapezoids."""
NORMAL_DOF = 1e6
"""From here on Student's t is drawn as normal: its quantiles differ by about a millionth."""
COARSE, FINE = 401, 8001
"""Nodes of a double and of a single integral over normals."""
REACH = 8.5
BEYOND = 1e-8
"""A coefficient that differs by no more than this share is the largest there is, as it was written.
"""
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """One contribution to an input quantity, about 0: `u` the standard uncertainty that the first
    order uses, with `dof`; of bounded kinds the `half_width` of the base, `top` that of a
    trapezoid's flat top, and `inexact` the relative half-range of the half-width, d/a of JCGM
    101:2008, 6.4.3.

    Drawn is, of a normal one with finite `dof`, the scaled and shifted t of JCGM 101:2008, 6.4.9,
    of a bounded one with `inexact` one whose half-width is itself rectangular, so that a rectangle
    becomes the curvilinear trapezoid of 6.4.3.
    """

    kind: Kind
    u: float
    dof: float = math.inf
    half_width: float = 0.0
    top: float = 0.0
    inexact: float = 0.0

    @property
    def bounded(self) -> bool:
        return self.kind not in ("normal", "t")

    @property
    def drawn_variance(self) -> float:
        """Variance of what is drawn; nan where a t of two degrees of freedom or fewer has none."""
        if not self.bounded:
            if self.dof >= NORMAL_DOF:
                return self.u**2
            return self.u**2 * self.dof / (self.dof - 2.0) if self.dof > 2.0 else math.nan
        share = shape_moments(self.kind, self.top_share)[0]
        return self.half_width**2 * share * (1.0 + self.inexact**2 / 3.0)

    @property
    def excess(self) -> float:
        """Fourth cumulant over u^4 of the shape: 0 for a normal one, -6/5 for a rectangle.

        A scaled t counts as normal, as in the whole of the first-order framework.
        """
        if not self.bounded:
            return 0.0
        second, fourth = shape_moments(self.kind, self.top_share)
        d = self.inexact**2
        return fourth * (1.0 + 2.0 * d + d**2 / 5.0) / (second * (1.0 + d / 3.0)) ** 2 - 3.0

    @property
    def top_share(self) -> float:
        """beta, the half-width of the flat top over that of the base."""
        share = self.top / self.half_width if self.half_width > 0.0 else 0.0
        return TOPS.get(self.kind, share)

    def draw(self, rng: np.random.Generator, out: FloatArray, work: Workspace) -> None:
        """Fills `out` (m,) with deviations."""
        if not self.bounded:
            rng.standard_normal(out=out)
            out *= self.u
            if self.dof < NORMAL_DOF:
                out *= t_scales(self.dof, rng, work.array("scale", out.shape))
            return
        rng.random(out=out)
        if self.kind == "arcsine":
            out *= 2.0 * math.pi
            np.sin(out, out=out)
        else:
            # The sum of rectangles of half-widths h1 and h2: base h1 + h2, top |h1 - h2|.
            first = 0.5 * (1.0 + self.top_share)
            out *= 2.0 * first
            if first < 1.0:
                second = work.array("second", out.shape)
                rng.random(out=second)
                second *= 2.0 * (1.0 - first)
                out += second
            out -= 1.0
        out *= self.half_width
        if self.inexact > 0.0:
            width = work.array("width", out.shape)
            rng.random(out=width)
            width *= 2.0 * self.inexact
            width += 1.0 - self.inexact
            out *= width


def t_scales(dof: float, rng: np.random.Generator, out: FloatArray) -> FloatArray:
    """sqrt(nu/chi2_nu) in `out`: times a normal draw it is Student's t, JCGM 101:2008, 6.4.9.4."""
    rng.standard_gamma(0.5 * dof, out=out)
    np.divide(0.5 * dof, out, out=out)
    np.sqrt(out, out=out)
    return out


def shape_moments(kind: str, top: float = 0.0) -> tuple[float, float]:
    """Second and fourth moment about 0 of a bounded shape of half-width 1.

    Arcsine 1/2, 3/8; trapezoid with a top of half-width beta (1 + beta^2)/6,
    (1 + beta^2 + beta^4)/15, of which the rectangle has beta = 1, the triangle 0. (JCGM 100:2008,
    4.3.7 and 4.3.9; JCGM 101:2008, 6.4.2, 6.4.4, 6.4.5, 6.4.6.)
    """
    if kind == "arcsine":
        return 0.5, 0.375
    square = TOPS.get(kind, top) ** 2
    return (1.0 + square) / 6.0, (1.0 + square + square**2) / 15.0


def bounded_quantile(item: Distribution, probability: FloatArray) -> FloatArray:
    """Q(p) (n,) of a bounded distribution about 0, at its stated half-width where it is inexact."""
    p = probability
    if item.kind == "arcsine":
        return item.half_width * np.sin(np.pi * (p - 0.5))
    # Trapezoid with top b: slopes of probability (1 - b)/(2 (1 + b)) at either side.
    b = item.top_share
    near = np.minimum(p, 1.0 - p)
    slope = (1.0 - b) / (2.0 * (1.0 + b))
    side = np.sqrt(np.maximum(2.0 * (1.0 - b * b) * near, 0.0)) - 1.0
    flat = (1.0 + b) * (near - slope) - b
    deviation = np.where(near < slope, side, flat)
    return item.half_width * np.where(p < 0.5, deviation, -deviation)


def copula_covariance(
    first: Distribution, second: Distribution, rho: float, nodes: int = COARSE
) -> float:
    """E Q_1(Phi(z)) Q_2(Phi(y)) of normals z, y of correlation rho, at the stated half-widths."""
    z, weight = _nodes(nodes)
    y = z if rho == 1.0 else rho * z[:, None] + math.sqrt(1.0 - rho * rho) * z
    inner = _of_normal(second, y) if rho == 1.0 else _of_normal(second, y) @ weight
    return float((weight * _of_normal(first, z)) @ inner)


def largest_covariance(first: Distribution, second: Distribution) -> float:
    """That of two inputs that rise together, the most there can be (Frechet)."""
    return copula_covariance(first, second, 1.0, FINE)


@cache
def normal_correlation(
    first: Distribution, second: Distribution, covariance: float
) -> float | None:
    """rho of the normals for which the inputs have this `covariance`; None where none gives it.
    Inputs in pairs are often alike, and each pair takes a double integral.
    """
    from scipy.optimize import brentq

    most = largest_covariance(first, second)
    if abs(covariance) > most * (1.0 + BEYOND):
        return None
    if abs(covariance) >= most * (1.0 - BEYOND):
        return math.copysign(1.0, covariance)
    scale = 1.0 / copula_covariance(first, second, 1.0)

    def excess(rho: float) -> float:
        return scale * copula_covariance(first, second, rho) - covariance / most

    return float(brentq(excess, -1.0, 1.0, xtol=ROUNDING))


def _of_normal(item: Distribution, z: FloatArray) -> FloatArray:
    from scipy.special import ndtr

    return bounded_quantile(item, ndtr(z)) if item.bounded else item.u * z


def _nodes(count: int) -> tuple[FloatArray, FloatArray]:
    z = np.linspace(-REACH, REACH, count)
    return z, np.exp(-0.5 * z * z) * ((z[1] - z[0]) / math.sqrt(2.0 * math.pi))
