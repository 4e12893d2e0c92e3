"""The exact distribution of a sum of independent input contributions, without Monte Carlo.

The characteristic function of c_1 X_1 + c_2 X_2 + ... is the product of those of the terms;
its Fourier series is the distribution function (Gil-Pelaez 1951, on a period much wider than
the distribution). So the first-order form of a budget, whatever its inputs, can serve as a
control variate whose quantiles are known. A single bounded term has its own closed form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.characteristic import NEGLIGIBLE, characteristic
from mtu_cli.stats.copula import bounded_quantile
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution

FloatArray = NDArray[np.float64]
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
SURE = 1e-7
"""Probability beyond either end of the table."""
CUT = 3e-6
"""What the characteristic function may still be where its series ends; over pi it is the error
of the distribution function where that has a corner, elsewhere far more."""
LAST = POINTS // 32
FAR_TERMS = 6
RANKS = 2**14


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearDistribution:
    """A symmetric distribution about 0: P(X <= at[i]) = Phi(score[i]).

    `sigma`: the standard deviation. `at`, `score` (n,): rising. Beyond the table the score
    stays at its ends, where it is -+5.2 or, of a heavy t, less. `at` is in equal steps; of a
    distribution with a closed form the probability is, and `single` is its one term, with
    a positive coefficient.
    """

    sigma: float
    at: FloatArray
    score: FloatArray
    single: Term | None = None

    def quantile(self, probability: float) -> float:
        """x with P(X <= x) = `probability`."""
        if self.single is not None:
            c, item = self.single
            return c * float(bounded_quantile(item, np.array(probability)))
        return float(np.interp(NormalDist().inv_cdf(probability), self.score, self.at))


def linear_distribution(terms: Sequence[Term]) -> LinearDistribution | None:
    """The distribution of the sum of independent `terms`; None where it is undefined.

    That is where a term is Student's t with fewer than 3 degrees of freedom, nothing varies, or
    the sum has corners that its series does not follow, as an arcsine distribution with little
    beside it. The distribution function is right to about 1e-6.
    """
    terms = [(abs(c), item) for c, item in terms if c != 0.0 and item.u > 0.0]
    if not terms or any(not item.bounded and item.dof < LEAST_DOF for _, item in terms):
        return None
    sigma = math.sqrt(math.fsum(c * c * item.drawn_variance for c, item in terms))
    if not (math.isfinite(sigma) and sigma > 0.0):
        return None
    if len(terms) == 1 and terms[0][1].bounded and terms[0][1].inexact == 0.0:
        return _closed(sigma, terms[0])
    series = _series(terms, sigma)
    if series is None:
        return None
    above, x = series
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


def _closed(sigma: float, term: Term) -> LinearDistribution:
    c, item = term
    p = np.clip(np.linspace(0.0, 1.0, RANKS + 1), SURE, 1.0 - SURE)
    normal = NormalDist()
    score = np.array([normal.inv_cdf(value) for value in p[: RANKS // 2].tolist()])
    return LinearDistribution(
        sigma=sigma,
        at=c * bounded_quantile(item, p),
        score=np.concatenate([score, [0.0], -score[::-1]]),
        single=term,
    )


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
    found = np.zeros_like(x)
    for c, item in terms:
        if not item.bounded and item.dof < LONG_TAILS:
            scale = sigma / (c * item.u)
            for period in (2.0 * reach, 4.0 * reach, 6.0 * reach):
                found += _far_tail(item.dof, scale * (period - x))
                found -= _far_tail(item.dof, scale * (period + x))
    return found


def _far_tail(dof: float, t: FloatArray) -> FloatArray:
    """P(T > t) (n,) of Student's t for t^2 far above `dof`: its density, integrated term by term.

    f = K nu^((nu+1)/2) t^-(nu+1) (1 + nu/t^2)^(-(nu+1)/2), K as in `log_density`. It spares the
    import of scipy, which takes longer than the rest.
    """
    half = 0.5 * (dof + 1.0)
    log_k = math.lgamma(half) - math.lgamma(0.5 * dof) - 0.5 * math.log(dof * math.pi)
    small = dof / (t * t)
    series, factor = np.zeros_like(t), 1.0
    for j in range(FAR_TERMS):
        series += factor * small**j / (dof + 2.0 * j)
        factor *= -(half + j) / (j + 1.0)
    return np.asarray(np.exp(log_k + half * math.log(dof) - dof * np.log(t)) * series)
