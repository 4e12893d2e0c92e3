"""Has an output of a Monte Carlo its digits? Each for itself (JCGM 101:2008, 7.9.4)."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.coverage import few_blocks_factor, numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult

MARGIN = 1.1
"""More trials than the standard errors of a first look ask for: these are estimates too."""
OUTSIDE = 0.5 * (1.0 - PROBABILITY)
"""Chance beyond either end of the interval."""


def ratios(run: MonteCarloResult, digits: int, *, ends: bool) -> FloatArray:
    """Twice the largest standard error of each output (n,) over its numerical tolerance.

    Of mean and u and, with `ends`, of both ends of the interval: 1 or below is what 7.9.4 wants
    for `digits` significant digits of u. Twice is for many blocks, Student's t for fewer
    (`few_blocks_factor`). An output without any error has 0.
    """
    errors = [run.se_mean, run.se_u]
    if ends:
        errors += [run.se_low, run.se_high]
    twice = 2.0 * few_blocks_factor(run.blocks) * np.max(errors, axis=0)
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


def chance_u_error(chance: float, trials: int) -> float:
    """Standard error of u = sqrt(p (1 - p)): |du/dp| times that of p, |1 - 2 p|/(2 sqrt n).

    At p = 1/2 that is 0, and u is less by the square of the error of p, whose root mean square of
    sqrt 3 p (1 - p)/n is left.
    """
    first = abs(1.0 - 2.0 * chance) / (2.0 * math.sqrt(trials))
    return max(first, math.sqrt(3.0) / 4.0 / trials)


def chance_intervals(chance: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Symmetric and shortest interval of what is 1 with a chance p and else 0, for PROBABILITY P.

    The smallest v with F(v) >= (1 - P)/2 and F(v) >= (1 + P)/2 (JCGM 101:2008, 7.7.1, for a G that
    has jumps); one value alone where its share is P or more.
    """
    symmetric = float(1.0 - chance < OUTSIDE), float(1.0 - chance < 1.0 - OUTSIDE)
    return symmetric, (float(chance >= PROBABILITY), float(1.0 - chance < PROBABILITY))


def chance_end_errors(chance: float, trials: int) -> tuple[float, float]:
    """Standard errors of both ends of the symmetric interval: 0 where two of those of the chance
    leave the end at its value, nan where they do not. It is one or the other, nothing between.
    """
    reach = 2.0 * chance_error(chance, trials)
    low, high = (abs(chance - at) > reach for at in (1.0 - OUTSIDE, OUTSIDE))
    return 0.0 if low else math.nan, 0.0 if high else math.nan


def chance_trials(chance: float, digits: int, *, ends: bool) -> float:
    """Trials n after which a chance p is as sure as 7.9.4 wants it for `digits` digits of its
    u = sqrt(p (1 - p)), whose tolerance is delta:

        2 se(p) = 2 sqrt(p (1 - p)/n) <= delta,    2 se(u) = |1 - 2 p|/sqrt n <= delta

    and, with `ends`, two se(p) between p and where an end of the interval goes from 0 to 1.
    Infinite where no trial was different from the others: no digit of u is known.
    """
    variance = chance * (1.0 - chance)
    if variance <= 0.0:
        return math.inf
    delta = numerical_tolerance(math.sqrt(variance), digits)
    wanted = max(4.0 * variance, (1.0 - 2.0 * chance) ** 2) / delta**2
    gap = min(abs(chance - OUTSIDE), abs(1.0 - chance - OUTSIDE))
    if not ends:
        return wanted
    return max(wanted, 4.0 * variance / gap**2) if gap > 0.0 else math.inf


def not_converged(trials: int, digits: int, what: str) -> Finding:
    """The warning of so many trials; `what`: of which places, or how far they have come."""
    goal = f"{counted(digits, 'significant digit')} of u (JCGM 101, 7.9.4), {what}"
    return finding("not-converged", trials=trials, goal=goal)


def wanted_trials(trials: int, ratio: float, fraction: float) -> float:
    """Trials that bring a `ratio` after `trials` down to `fraction`: it falls as their root."""
    return MARGIN * trials * (ratio / fraction) ** 2
