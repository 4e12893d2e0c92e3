"""What the trials of one output of a graph say: its mean, u and interval, and how sure they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mtu_cli.analyses.graph.convergence import (
    chance_end_errors,
    chance_error,
    chance_intervals,
    chance_u_error,
)
from mtu_cli.stats.monte_carlo import MonteCarloResult


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """The Monte Carlo's own standard errors, in the unit of the output; nan where the trials do
    not tell one.
    """

    mean: float
    u: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trials:
    """What became of one output: its row `at` in a `run`. `ratio`: 1 or less where it has its
    digits. `still`: it may vary, and did not in any trial.
    """

    run: MonteCarloResult
    at: int
    ratio: float
    chance: bool
    still: bool

    @property
    def converged(self) -> bool:
        """Whether mean, u and interval are sure to the digits of u asked for."""
        return self.ratio <= 1.0

    @property
    def mean(self) -> float:
        """Of the trials; of a chance the share of 1."""
        return float(self.run.mean[self.at])

    @property
    def u(self) -> float:
        """Standard deviation of the trials."""
        return float(self.run.u[self.at])

    @property
    def interval(self) -> tuple[float, float]:
        """Probabilistically symmetric."""
        if self.chance:
            return chance_intervals(self.mean)[0]
        return float(self.run.low[self.at]), float(self.run.high[self.at])

    @property
    def shortest(self) -> tuple[float, float]:
        """Shortest interval."""
        if self.chance:
            return chance_intervals(self.mean)[1]
        return float(self.run.shortest_low[self.at]), float(self.run.shortest_high[self.at])

    @property
    def errors(self) -> Errors:
        """Those of a chance follow from it, and are never 0; of another jump that no trial saw
        nothing is known.
        """
        if self.chance:
            low, high = chance_end_errors(self.mean, self.run.trials)
            return Errors(
                mean=chance_error(self.mean, self.run.trials),
                u=chance_u_error(self.mean, self.run.trials),
                low=low,
                high=high,
            )
        if self.still:
            return Errors(mean=math.nan, u=math.nan, low=math.nan, high=math.nan)
        se = (self.run.se_mean, self.run.se_u, self.run.se_low, self.run.se_high)
        mean, u, low, high = (float(item[self.at]) for item in se)
        return Errors(mean=mean, u=u, low=low, high=high)
