"""How many trials an accuracy takes, and whether results are as accurate as that."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from statistics import NormalDist

from peers_bench.problem import Found

OF_U = 0.001
"""Standard error of u wanted, relative."""
OF_ENDS = 0.01
"""Standard error of the ends of the 95 % interval wanted, over u."""
END = 0.025


def plain_errors(trials: int) -> tuple[float, float]:
    """Standard errors over u of u and of an end, by plain Monte Carlo of a normal quantity.

    1/sqrt(2 n) and sqrt(a (1 - a)/n) / phi(z_a) (JCGM 101:2008, 7.9.4, note; asymptotic).
    """
    z = NormalDist().inv_cdf(END)
    end = math.sqrt(END * (1 - END) / trials) / NormalDist().pdf(z)
    return 1 / math.sqrt(2 * trials), end


def plain_trials() -> int:
    """Trials with which plain Monte Carlo has both accuracies."""
    u, end = plain_errors(1)
    return math.ceil(round(max((u / OF_U) ** 2, (end / OF_ENDS) ** 2), 6))


def scatter(found: Sequence[Found]) -> tuple[float, float]:
    """Standard deviation over runs of u and of the worse end, over u."""
    u = statistics.mean(run.u for run in found)
    low, high = (statistics.stdev(end) / u for end in zip(*(run[1:] for run in found), strict=True))
    return statistics.stdev(run.u for run in found) / u, max(low, high)


def of_scatter(runs: int) -> float:
    """Four standard errors, relative, of a standard deviation from that many runs."""
    return 4 / math.sqrt(2 * (runs - 1))
