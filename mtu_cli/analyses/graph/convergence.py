"""Has an output of a Monte Carlo its digits? Each for itself (JCGM 101:2008, 7.9.4)."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.stats.coverage import numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult

MARGIN = 1.1
"""More trials than the standard errors of a first look ask for: these are estimates too."""


def ratios(run: MonteCarloResult, digits: int, *, ends: bool) -> FloatArray:
    """Twice the largest standard error of each output (n,) over its numerical tolerance.

    Of mean and u and, with `ends`, of both ends of the interval: 1 or below is what 7.9.4 wants
    for `digits` significant digits of u. An output that took one value only has 0.
    """
    errors = [run.se_mean, run.se_u]
    if ends:
        errors += [run.se_low, run.se_high]
    twice = 2.0 * np.max(errors, axis=0)
    tolerance = np.array([numerical_tolerance(float(u), digits) for u in run.u])
    found = np.full(len(twice), np.inf)
    np.divide(twice, tolerance, out=found, where=tolerance > 0.0)
    return np.where(twice > 0.0, found, 0.0)


def chance_error(chance: float, trials: int) -> float:
    """Standard error of a chance: sqrt(p (1 - p)/n), and 1/(n + 2) where that is less.

    The latter is about the standard deviation of p, all values of it being equally likely
    before, where none or all of n trials hit.
    """
    plain = math.sqrt(max(chance * (1.0 - chance), 0.0) / trials)
    return max(plain, 1.0 / (trials + 2))


def chance_trials(chance: float, digits: int) -> int:
    """Trials after which twice the standard error of a chance is within the tolerance of its
    standard deviation sqrt(p (1 - p)): its u and interval follow from the chance alone.
    """
    u = math.sqrt(max(chance * (1.0 - chance), 0.0))
    if u == 0.0:
        return 0
    return math.ceil(4.0 * u * u / numerical_tolerance(u, digits) ** 2)


def wanted_trials(trials: int, ratio: float, fraction: float) -> float:
    """Trials that bring a `ratio` after `trials` down to `fraction`: it falls as their root."""
    return MARGIN * trials * (ratio / fraction) ** 2
