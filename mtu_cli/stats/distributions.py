"""Distributions of input quantities (JCGM 100:2008, 4.3 and JCGM 101:2008, 6.4), and the exact
distribution of a sum of independent ones.

All are symmetric about the estimate and described about it, as deviations.

Correlated inputs that are not normal have a Gaussian copula: X_i = Q_i(Phi(Z_i)) with jointly
normal Z has every marginal distribution as stated. The correlation of the Z is chosen so that the
*X* have the stated coefficient: it is what JCGM 100 propagates, and it is not that of the Z.

The characteristic function of c_1 X_1 + c_2 X_2 + ... is the product of those of the terms;
its Fourier series is the distribution function (Gil-Pelaez 1951, on a period much wider than
the distribution). So the first-order form of a budget, whatever its inputs, can serve as a
control variate whose quantiles are known. A single term has its own closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from scipy.special import j0, ndtr, stdtrit

from mtu_cli.stats.blocks import Workspace
from mtu_cli.stats.least_squares import FloatArray

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
    z = np.linspace(-REACH, REACH, nodes)
    weight = np.exp(-0.5 * z * z) * ((z[1] - z[0]) / math.sqrt(2.0 * math.pi))
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
    return bounded_quantile(item, ndtr(z)) if item.bounded else item.u * z


Quantile = Callable[[FloatArray], FloatArray]
Term = tuple[float, Distribution]
"""(coefficient, distribution) of one independent contribution."""

POINTS = 2**15
REACHES = ((30.0, 10.0, POINTS), (6.0, 32.0, POINTS), (0.0, 128.0, 4 * POINTS))
"""Half a period in standard deviations, and its points, by the degrees of freedom from which on the
tails of t do not reach into the next one."""
LEAST_DOF = 3.0
"""With fewer degrees of freedom they always do."""
CUT = 3e-6
"""What the characteristic function may still be where its series ends; over pi it is the error
of the distribution function where that has a corner, elsewhere far more."""
LAST = POINTS // 32
NEGLIGIBLE = 1e-13
SCALE_NODES = 96
PHASE_STEP = 0.01
"""Of the integral over phases, rad: right to 1e-8."""
SLIGHT = 0.1
"""Range of phases, rad, over which what is averaged is a parabola."""


def sum_quantile(terms: Sequence[Term]) -> Quantile | None:
    """Quantiles (n,) at probabilities (n,) of the sum of independent `terms`, which is symmetric
    about 0; None where they are unknown.

    That is where a term of several is Student's t with fewer than 3 degrees of freedom, nothing
    varies, or the sum has corners that its series does not follow, as an arcsine distribution with
    little beside it. The distribution function is right to about 1e-6.
    """
    terms = [(abs(c), item) for c, item in terms if c != 0.0 and item.u > 0.0]
    # All normal ones are one.
    normal = [c * item.u for c, item in terms if not item.bounded and item.dof >= NORMAL_DOF]
    if normal:
        rest = [(c, item) for c, item in terms if item.bounded or item.dof < NORMAL_DOF]
        terms = [(1.0, Distribution(kind="normal", u=math.hypot(*normal))), *rest]
    if not terms:
        return None
    if len(terms) == 1 and terms[0][1].inexact == 0.0:
        ((c, item),) = terms
        if item.bounded:
            return lambda p: c * bounded_quantile(item, p)
        dof = item.dof if item.dof < NORMAL_DOF else math.inf
        return lambda p: c * item.u * np.asarray(stdtrit(dof, p), np.float64)
    if any(not item.bounded and item.dof < LEAST_DOF for _, item in terms):
        return None
    sigma = math.sqrt(math.fsum(c * c * item.drawn_variance for c, item in terms))
    if not (math.isfinite(sigma) and sigma > 0.0):
        return None
    # F(x) - 1/2 at x from 0 up in standard deviations.
    dof = min((item.dof for _, item in terms if not item.bounded), default=math.inf)
    reach, points = next((reach, points) for least, reach, points in REACHES if dof >= least)
    omega = np.arange(1, points // 2, dtype=np.float64) * (math.pi / reach)
    phi = np.ones_like(omega)
    # The quick ones first: where they vanish the others need not be known.
    for c, item in sorted(terms, key=lambda term: (term[1].bounded, term[1].dof < NORMAL_DOF)):
        alive = int(np.count_nonzero(np.maximum.accumulate(np.abs(phi[::-1]))[::-1] > NEGLIGIBLE))
        phi[alive:] = 0.0
        phi[:alive] *= characteristic(item, c / sigma * omega[:alive])
    if float(np.max(np.abs(phi[-LAST:]))) > CUT:
        return None
    x: FloatArray = 2.0 * reach / points * np.arange(points // 2, dtype=np.float64)
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    spectrum[1:-1] = -1j * phi / omega
    # (x + 2 sum over k of phi_k sin(omega_k x)/omega_k) / (2 reach).
    above = (x + np.fft.irfft(spectrum, points)[: len(x)] * points) / (2.0 * reach)
    half, at = np.maximum.accumulate(above), x * sigma
    return lambda p: np.sign(p - 0.5) * np.interp(np.abs(p - 0.5), half, at)


def characteristic(item: Distribution, omega: FloatArray) -> FloatArray:
    """E cos(omega X) (n,) of what is drawn for `item`, at angular frequencies `omega` (n,) > 0.

    An inexact half-width is rectangular: the mean of the shape's own function over its phases.
    """
    if not item.bounded:
        return _normal(item, omega)
    phase = item.half_width * omega
    half = item.inexact * phase
    wide = half > SLIGHT
    # To the fourth order in the range: f + f'' half^2/6, the mean of both at half/sqrt(3).
    step = half[~wide] / math.sqrt(3.0)
    result = np.empty_like(omega)
    result[~wide] = 0.5 * (_shape(item, phase[~wide] + step) + _shape(item, phase[~wide] - step))
    if wide.any():
        h = PHASE_STEP
        f = _shape(item, np.arange(0.0, (phase + half).max() + 2.0 * h, h))
        slope = np.gradient(f, h)
        bend = np.gradient(slope, h)
        # Trapezoids with their end correction, and Taylor's series from the nearest node.
        integral = np.cumsum(f) * h - h / 2.0 * (f + f[0]) - h * h / 12.0 * slope
        ends = []
        for t in ((phase + half)[wide], (phase - half)[wide]):
            i = np.rint(t / h).astype(np.int64)
            u = t - h * i
            ends.append(integral[i] + u * (f[i] + u / 2.0 * (slope[i] + u / 3.0 * bend[i])))
        result[wide] = np.subtract(*ends) / (2.0 * half[wide])
    return result


def _normal(item: Distribution, omega: FloatArray) -> FloatArray:
    square = 0.5 * (item.u * omega) ** 2
    if item.dof >= NORMAL_DOF:
        return np.exp(-square)
    # Student's t is a normal mixture: variance u^2 nu/g, g from chi-squared of nu. In log g its
    # density is smooth and falls off at both ends, so that equal steps converge at once.
    half = 0.5 * item.dof
    spread = 9.0 / math.sqrt(half) + 9.0 / half
    logs = np.linspace(-spread, min(spread, 9.0 / math.sqrt(half)), SCALE_NODES)
    weights = np.exp(half * (logs - np.expm1(logs)))
    weights /= weights.sum()
    result = np.zeros_like(omega)
    for log, weight in zip(logs, weights, strict=True):
        if weight > NEGLIGIBLE:
            result += weight * np.exp(-square * math.exp(-log))
    return result


def _shape(item: Distribution, x: FloatArray) -> FloatArray:
    """Characteristic function of the shape, x = half-width times frequency."""
    if item.kind == "arcsine":
        return j0(x)
    first = 0.5 * (1.0 + item.top_share)
    return np.sinc(first * x / np.pi) * np.sinc((1.0 - first) * x / np.pi)
