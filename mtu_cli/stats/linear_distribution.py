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
REACH = 10.0
"""Half a period, in standard deviations."""
FAR_REACH = 32.0
"""The same where the tails are those of t with fewer degrees of freedom than `SHORT_TAILS`."""
SHORT_TAILS = 30.0
LEAST_DOF = 3.0
"""With fewer degrees of freedom the tails of t reach from one period into the next."""
LONG_TAILS = 6.0
"""Below this the tails that do reach into it are taken off."""
CUT = 3e-6
"""What the characteristic function may still be where its series ends; over pi it is the error
of the distribution function where that has a corner, elsewhere far more."""
LAST = POINTS // 32
NEGLIGIBLE = 1e-13
SCALE_NODES = 96
HALF_WIDTH_NODES = 48
SLOW = 24.0
"""Phase over the range of an inexact half-width, rad, up to which the nodes follow it."""
FLAT = 1e-8
"""A trapezoid whose sides are a smaller share of its base is a rectangle; limits that are less
inexact are exact."""


def sum_quantile(terms: Sequence[Term]) -> Quantile | None:
    """Quantiles (n,) at probabilities (n,) of the sum of independent `terms`, which is symmetric
    about 0; None where they are unknown.

    That is where a term of several is Student's t with fewer than 3 degrees of freedom, nothing
    varies, or the sum has corners that its series does not follow, as an arcsine distribution with
    little beside it. The distribution function is right to about 1e-6.
    """
    terms = _gathered(terms)
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


def _gathered(terms: Sequence[Term]) -> list[Term]:
    """Those that vary, with coefficients above 0; all normal ones as one."""
    terms = [(abs(c), item) for c, item in terms if c != 0.0 and item.u > 0.0]
    normal = [c * item.u for c, item in terms if not item.bounded and item.dof >= NORMAL_DOF]
    others = [(c, item) for c, item in terms if item.bounded or item.dof < NORMAL_DOF]
    if not normal:
        return others
    return [(1.0, Distribution(kind="normal", u=math.hypot(*normal))), *others]


def _series(terms: Sequence[Term], sigma: float) -> tuple[FloatArray, FloatArray] | None:
    """F(x) - 1/2 (n,) at x (n,) from 0 up in standard deviations; None where the series is cut
    too early.
    """
    dofs = [item.dof for _, item in terms if not item.bounded]
    reach = FAR_REACH if min(dofs, default=math.inf) < SHORT_TAILS else REACH
    omega = np.arange(1, POINTS // 2, dtype=np.float64) * (math.pi / reach)
    phi = np.ones_like(omega)
    # The quick ones first: where they vanish the others need not be known.
    for c, item in sorted(terms, key=lambda term: (term[1].bounded, term[1].dof < NORMAL_DOF)):
        alive = int(np.count_nonzero(np.maximum.accumulate(np.abs(phi[::-1]))[::-1] > NEGLIGIBLE))
        phi[alive:] = 0.0
        phi[:alive] *= characteristic(item, c / sigma * omega[:alive])
    if float(np.max(np.abs(phi[-LAST:]))) > CUT:
        return None
    x: FloatArray = 2.0 * reach / POINTS * np.arange(POINTS // 2, dtype=np.float64)
    spectrum = np.zeros(POINTS // 2 + 1, dtype=np.complex128)
    spectrum[1:-1] = -1j * phi / omega
    # F(x) - 1/2 = (x + 2 sum over k of phi_k sin(omega_k x)/omega_k) / (2 REACH).
    above = (x + np.fft.irfft(spectrum, POINTS)[: len(x)] * POINTS) / (2.0 * reach)
    return above - _from_next_period(terms, sigma, reach, x), x


def _from_next_period(
    terms: Sequence[Term], sigma: float, reach: float, x: FloatArray
) -> FloatArray:
    """P(2 R - x < X < 2 R + x) (n,), which the series, of period 2 R, counts as within x.

    So far out a sum is as large as the one t that makes it so.
    """
    from scipy.special import stdtr

    result = np.zeros_like(x)
    for c, item in terms:
        if not item.bounded and item.dof < LONG_TAILS:
            scale = sigma / (c * item.u)
            for period in (2.0 * reach, 4.0 * reach, 6.0 * reach):
                result += stdtr(item.dof, scale * (x - period))
                result -= stdtr(item.dof, -scale * (x + period))
    return result


def characteristic(item: Distribution, omega: FloatArray) -> FloatArray:
    """E cos(omega X) (n,) of what is drawn for `item`, at angular frequencies `omega` (n,) > 0."""
    if not item.bounded:
        return _normal(item, omega)
    if item.inexact < FLAT:
        return _shape(item, item.half_width * omega)
    # The half-width is rectangular: the mean of the shape's own function over it. In closed form
    # it cancels at small phases, where few nodes follow it.
    slow = item.inexact * item.half_width * omega <= SLOW
    result = np.empty_like(omega)
    result[slow] = _averaged(item, omega[slow])
    if not np.all(slow):
        high = item.half_width * (1.0 + item.inexact) * omega[~slow]
        low = item.half_width * (1.0 - item.inexact) * omega[~slow]
        result[~slow] = (_integral(item, high) - _integral(item, low)) / (high - low)
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


def _averaged(item: Distribution, omega: FloatArray) -> FloatArray:
    nodes, weights = np.polynomial.legendre.leggauss(HALF_WIDTH_NODES)
    result = np.zeros_like(omega)
    for node, weight in zip(nodes, weights, strict=True):
        width = item.half_width * (1.0 + item.inexact * node)
        result += 0.5 * weight * _shape(item, width * omega)
    return result


def _shape(item: Distribution, x: FloatArray) -> FloatArray:
    """Characteristic function of the shape, x = half-width times frequency."""
    if item.kind == "arcsine":
        from scipy.special import j0

        return j0(x)
    first = 0.5 * (1.0 + item.top_share)
    return np.sinc(first * x / np.pi) * np.sinc((1.0 - first) * x / np.pi)


def _integral(item: Distribution, x: FloatArray) -> FloatArray:
    """Integral (n,) of `_shape` from 0 to `x` (n,) >= 0.

    Arcsine, by the Struve functions H: x J0 + pi x (J1 H0 - J0 H1)/2 (Abramowitz & Stegun,
    11.1.7). Trapezoid of top b: the function is 2 (cos bt - cos t)/((1 - b^2) t^2), its integral by
    parts 2 ((cos x - cos bx)/x + Si(x) - b Si(bx))/(1 - b^2); of a rectangle Si(x).
    """
    from scipy.special import j0, j1, sici, struve

    if item.kind == "arcsine":
        by_struve = j1(x) * struve(0, x) - j0(x) * struve(1, x)
        return x * j0(x) + 0.5 * np.pi * x * by_struve
    b = item.top_share
    if 1.0 - b < FLAT:
        return sici(x)[0]
    fall = np.divide(np.cos(x) - np.cos(b * x), x, out=np.zeros_like(x), where=x > 0.0)
    return 2.0 * (fall + sici(x)[0] - b * sici(b * x)[0]) / (1.0 - b * b)
