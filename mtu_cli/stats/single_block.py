"""A Monte Carlo of few trials: JCGM 101 to the letter on the whole sample, no control."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.pooling import Estimates, Gain

FloatArray = NDArray[np.float64]

REACH = 2.0
"""Binomial standard deviations about an end's rank: the interval of 95 % for a quantile, whatever
the distribution (David & Nagaraja 2003, 7.1). The spread over one has half as many values in it
and is itself so unsure that two standard errors hold 92 % of the errors."""


def single_block_estimates(
    values: FloatArray, probability: float, u_exists: NDArray[np.bool_]
) -> Estimates:
    """Estimates from `values` (outputs, M).

    Mean and u by JCGM 101:2008, 7.6; q = pM rounded, the symmetric interval from
    r = (M - q)/2 or (M - q + 1)/2 and the shortest as the least y_(r+q) - y_(r), by 7.7.2.

    Standard errors are asymptotic: u/sqrt(M) for the mean, sqrt((m4 - u^4 (M-3)/(M-1))/M)/(2u)
    for u with the fourth central moment m4; for an end half the way to the values `REACH` binomial
    standard deviations sqrt(M a (1 - a)), a = (1 - p)/2, from its rank, rms of both sides.
    """
    outputs, trials = values.shape
    mean = values.mean(axis=1)
    centred = values - mean[:, np.newaxis]
    covariance = centred @ centred.T / (trials - 1)
    variance = np.where(u_exists, np.diagonal(covariance), np.nan)
    u = np.sqrt(variance)
    ordered = np.sort(values, axis=1)
    q = covered_ranks(trials, probability)
    r = symmetric_rank(trials, q)
    widths = ordered[:, q:] - ordered[:, : trials - q]
    best = np.argmin(widths, axis=1)
    each = np.arange(outputs)
    undefined = np.where(u_exists, 1.0, np.nan)
    ones = np.ones(outputs)
    return Estimates(
        mean=mean,
        u=u,
        low=ordered[:, r - 1],
        high=ordered[:, r + q - 1],
        se_mean=u / math.sqrt(trials),
        se_u=_u_error(centred, variance, u),
        se_low=_end_error(ordered, r, probability),
        se_high=_end_error(ordered, r + q, probability),
        shortest_low=ordered[each, best],
        shortest_high=ordered[each, best + q],
        covariance=covariance * np.outer(undefined, undefined),
        gain=Gain(ones, ones, ones, ones),
    )


def covered_ranks(trials: int, probability: float) -> int:
    """q of JCGM 101:2008, 7.7.2: pM where that is an integer, else its integer part after 1/2."""
    exact = probability * trials
    # 0.95 * 1e6 is 949999.9999999999: an integer but for rounding is an integer.
    nearest = round(exact)
    return nearest if math.isclose(exact, nearest, rel_tol=1e-12) else math.floor(exact + 0.5)


def symmetric_rank(trials: int, q: int) -> int:
    """r of JCGM 101:2008, 7.7.2: (M - q)/2, or the integer part of (M - q + 1)/2; from 1."""
    return max(1, (trials - q + 1) // 2)


def _u_error(centred: FloatArray, variance: FloatArray, u: FloatArray) -> FloatArray:
    outputs, trials = centred.shape
    fourth = np.mean(centred**4, axis=1)
    spread = np.maximum(fourth - variance**2 * (trials - 3) / (trials - 1), 0.0)
    found = np.zeros(outputs)
    np.divide(np.sqrt(spread / trials), 2.0 * u, out=found, where=u != 0.0)
    return found


def _end_error(ordered: FloatArray, rank: int, probability: float) -> FloatArray:
    trials = ordered.shape[1]
    a = 0.5 * (1.0 - probability)
    deviation = math.sqrt(trials * a * (1.0 - a))
    below = max(1, math.floor(rank - REACH * deviation))
    above = min(trials, math.ceil(rank + REACH * deviation))
    end = ordered[:, rank - 1]
    sides = [
        (ordered[:, above - 1] - end) / max(above - rank, 1),
        (end - ordered[:, below - 1]) / max(rank - below, 1),
    ]
    return np.asarray(np.sqrt(np.mean(np.square(sides), axis=0)) * deviation)
