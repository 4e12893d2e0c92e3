"""The exact distribution of a sum of independent input contributions, without Monte Carlo.

The characteristic function of c_1 X_1 + c_2 X_2 + ... is the product of those of the terms;
its Fourier series is the distribution function (Gil-Pelaez 1951, on a period much wider than
the distribution). So the first-order form of a budget, whatever its inputs, can serve as a
control variate whose quantiles are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.distributions import NORMAL_DOF, Distribution

FloatArray = NDArray[np.float64]
Term = tuple[float, Distribution]
"""(coefficient, distribution) of one independent contribution."""

POINTS = 2**15
REACH = 32.0
"""Half a period, in standard deviations."""
LEAST_DOF = 3.0
"""With fewer degrees of freedom the tails of t reach from one period into the next."""
SURE = 1e-7
"""Probability beyond either end of the table."""
NEARLY_NORMAL = 12.0
"""Degrees of freedom whose tails a map to the normal distribution bends little."""
NEGLIGIBLE = 1e-13
SCALE_NODES = 96
HALF_WIDTH_NODES = 48


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearDistribution:
    """A symmetric distribution about 0: P(X <= at[i]) = Phi(score[i]).

    `sigma`: the standard deviation. `at`, `score` (n,): rising. Beyond the table the score
    stays at its ends, where it is -+5.2.
    """

    sigma: float
    at: FloatArray
    score: FloatArray

    def quantile(self, probability: float) -> float:
        """x with P(X <= x) = `probability`."""
        return float(np.interp(NormalDist().inv_cdf(probability), self.score, self.at))


@dataclass(frozen=True, slots=True, kw_only=True)
class RankMap:
    """A rising map of draws of one distribution to draws of `scale` times Student's t.

    It keeps the ranks. `at` (n,): in equal steps, `to` (n,): where they are mapped to. `dof` is
    infinite where it leads to the normal distribution. `variance` is that of the mapped draws,
    which the ends of the table bound.
    """

    at: FloatArray
    to: FloatArray
    scale: float
    dof: float
    variance: float

    def __call__(self, deviations: FloatArray) -> FloatArray:
        # Equal steps need no search, which would take a fifth of a budget's Monte Carlo.
        last = len(self.at) - 1
        place = (deviations - self.at[0]) * (last / (self.at[-1] - self.at[0]))
        np.clip(place, 0.0, last, out=place)
        below = np.minimum(place.astype(np.intp), last - 1)
        place -= below
        low = self.to[below]
        mapped: FloatArray = low + place * (self.to[below + 1] - low)
        return mapped


def rank_map(known: LinearDistribution, dof: float) -> RankMap:
    """The map of `known` to a t of `dof` degrees of freedom (3 or more) with its 95 % interval.

    From `NEARLY_NORMAL` on to a normal distribution. The nearer the tails of both, the less
    the map bends.
    """
    if dof >= NEARLY_NORMAL:
        dof, to = math.inf, known.score * (known.quantile(0.975) / NormalDist().inv_cdf(0.975))
        scale = float(to[-1] / known.score[-1])
    else:
        t = linear_distribution([(1.0, Distribution(kind="t", u=1.0, dof=dof))])
        if t is None:
            raise ValueError(f"no map to a t of {dof} degrees of freedom")
        scale = known.quantile(0.975) / t.quantile(0.975)
        to = scale * np.interp(known.score, t.score, t.at)
    # E X^2 = integral of 2 x P(X > x) over positive x, doubled for both sides.
    normal = NormalDist()
    positive = len(to) // 2
    x, beyond = to[positive:], np.array([normal.cdf(-z) for z in known.score[positive:].tolist()])
    variance = 4.0 * float(np.sum(0.5 * (x[1:] * beyond[1:] + x[:-1] * beyond[:-1]) * np.diff(x)))
    return RankMap(at=known.at, to=to, scale=scale, dof=dof, variance=variance)


def linear_distribution(terms: Sequence[Term]) -> LinearDistribution | None:
    """The distribution of the sum of independent `terms`; None where it cannot be had.

    That is where a term is Student's t with fewer than 3 degrees of freedom, or nothing varies.
    The distribution function is right to about 1e-6.
    """
    terms = [(abs(c), item) for c, item in terms if c != 0.0 and item.u > 0.0]
    if not terms or any(not item.bounded and item.dof < LEAST_DOF for _, item in terms):
        return None
    sigma = math.sqrt(math.fsum(c * c * item.drawn_variance for c, item in terms))
    if not (math.isfinite(sigma) and sigma > 0.0):
        return None
    # All in units of sigma: the period is 2 REACH.
    omega = np.arange(1, POINTS // 2, dtype=np.float64) * (math.pi / REACH)
    phi = np.ones_like(omega)
    # The quick ones first: where they vanish the others need not be known.
    for c, item in sorted(terms, key=lambda term: (term[1].bounded, term[1].dof < NORMAL_DOF)):
        alive = int(np.count_nonzero(np.maximum.accumulate(np.abs(phi[::-1]))[::-1] > NEGLIGIBLE))
        phi[alive:] = 0.0
        phi[:alive] *= characteristic(item, c / sigma * omega[:alive])
    spectrum = np.zeros(POINTS // 2 + 1, dtype=np.complex128)
    spectrum[1:-1] = -1j * phi / omega
    step = 2.0 * REACH / POINTS
    x = step * np.arange(POINTS // 2)
    # F(x) - 1/2 = (x + 2 sum over k of phi_k sin(omega_k x)/omega_k) / (2 REACH).
    above = (x + np.fft.irfft(spectrum, POINTS)[: len(x)] * POINTS) / (2.0 * REACH)
    inside = int(np.argmax(above >= 0.5 - SURE)) or len(x)
    normal = NormalDist()
    half = np.maximum.accumulate(above[1:inside])
    score = np.array([normal.inv_cdf(0.5 + p) for p in half.tolist()])
    at = x[1:inside] * sigma
    return LinearDistribution(
        sigma=sigma,
        at=np.concatenate([-at[::-1], [0.0], at]),
        score=np.concatenate([-score[::-1], [0.0], score]),
    )


def characteristic(item: Distribution, omega: FloatArray) -> FloatArray:
    """E cos(omega X) (n,) of what is drawn for `item`, at angular frequencies `omega` (n,)."""
    if not item.bounded:
        return _normal(item, omega)
    if item.inexact == 0.0:
        return _shape(item, item.half_width * omega)
    # The half-width is rectangular: an average over it.
    nodes, weights = np.polynomial.legendre.leggauss(HALF_WIDTH_NODES)
    found = np.zeros_like(omega)
    for node, weight in zip(nodes, weights, strict=True):
        width = item.half_width * (1.0 + item.inexact * node)
        found += 0.5 * weight * _shape(item, width * omega)
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
