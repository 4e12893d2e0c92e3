"""The exact distribution of a sum of independent input contributions, without Monte Carlo.

The characteristic function of c_1 X_1 + c_2 X_2 + ... is the product of those of the terms;
its Fourier series is the distribution function (Gil-Pelaez 1951, on a period much wider than
the distribution). So the first-order form of a budget, whatever its inputs, can serve as a
control variate whose quantiles are known. A single term has its own closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.stats.coverage import t_quantile
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution, bounded_quantile
from mtu_cli.stats.least_squares import FloatArray

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
    terms = _gathered_terms(terms)
    if not terms:
        return None
    if len(terms) == 1 and terms[0][1].inexact == 0.0:
        ((c, item),) = terms
        if item.bounded:
            return lambda p: c * bounded_quantile(item, p)
        dof = item.dof if item.dof < NORMAL_DOF else math.inf
        return lambda p: c * item.u * t_quantile(p, dof)
    if any(not item.bounded and item.dof < LEAST_DOF for _, item in terms):
        return None
    sigma = math.sqrt(math.fsum(c * c * item.drawn_variance for c, item in terms))
    if not (math.isfinite(sigma) and sigma > 0.0):
        return None
    series = _series(terms, sigma)
    if series is None:
        return None
    above, x = series
    half, at = np.maximum.accumulate(above), x * sigma
    return lambda p: np.sign(p - 0.5) * np.interp(np.abs(p - 0.5), half, at)


def _gathered_terms(terms: Sequence[Term]) -> list[Term]:
    """Those that vary, with coefficients above 0; all normal ones as one."""
    terms = [(abs(c), item) for c, item in terms if c != 0.0 and item.u > 0.0]
    normal = [c * item.u for c, item in terms if not item.bounded and item.dof >= NORMAL_DOF]
    rest = [(c, item) for c, item in terms if item.bounded or item.dof < NORMAL_DOF]
    if not normal:
        return rest
    return [(1.0, Distribution(kind="normal", u=math.hypot(*normal))), *rest]


def _series(terms: Sequence[Term], sigma: float) -> tuple[FloatArray, FloatArray] | None:
    """F(x) - 1/2 (n,) at x (n,) from 0 up in standard deviations; None where the series is cut
    too early.
    """
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
    # F(x) - 1/2 = (x + 2 sum over k of phi_k sin(omega_k x)/omega_k) / (2 reach).
    return (x + np.fft.irfft(spectrum, points)[: len(x)] * points) / (2.0 * reach), x


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
        from scipy.special import j0

        return j0(x)
    first = 0.5 * (1.0 + item.top_share)
    return np.sinc(first * x / np.pi) * np.sinc((1.0 - first) * x / np.pi)
