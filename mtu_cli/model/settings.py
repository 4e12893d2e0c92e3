"""What a user may choose for any prediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mtu_cli.stats.blocks import TrialModel
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.monte_carlo import MonteCarloResult, Progress, monte_carlo
from mtu_cli.stats.validation import CONVERGED_TO, Validation, clause8

Correlation = Literal["shared", "independent"]
PROBABILITY = 0.95

DEFAULT_SEED = 20040126
MOST_TRIALS, ENOUGH_TRIALS = 10_000_000, 300_000
"""Where the count adapts: of one output at most so many, of many at least these."""
MOST_DRAWN = 60_000_000
"""Values of all outputs together: some seconds. What clause 8 cannot decide by then is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """`coverage_factor` k of U = k u, nan where there is not one for all; `correlation` shared
    (full covariance) or independent (Gilsinn & Ling 2004); `trials` None lets the count adapt to
    `digits` digits of u.
    """

    coverage_factor: float = 2.0
    seed: int = DEFAULT_SEED
    correlation: Correlation = "shared"
    trials: int | None = None
    digits: int = 2
    threads: int | None = None
    progress: Progress | None = None

    @property
    def independent(self) -> bool:
        """Whether the papers' independence is asked for as the main result."""
        return self.correlation == "independent"

    def run(self, model: TrialModel, *, keep: int = 0) -> MonteCarloResult:
        """The Monte Carlo of a model under these settings, converged to a fifth of the
        tolerance as clause 8 needs it; the first `keep` trials stay for a picture.
        """
        return monte_carlo(
            model,
            seed=self.seed,
            trials=self.trials,
            probability=PROBABILITY,
            digits=self.digits,
            tolerance_fraction=CONVERGED_TO,
            max_trials=min(MOST_TRIALS, max(ENOUGH_TRIALS, MOST_DRAWN // len(model.names))),
            threads=self.threads,
            keep=keep,
            progress=self.progress,
        )

    def validate(
        self, mean: float, u: float, dof: float, result: MonteCarloResult, index: int
    ) -> Validation:
        """JCGM 101:2008, clause 8, with the coverage factor of Welch-Satterthwaite."""
        k = coverage_factor(PROBABILITY, dof)
        return clause8(mean, u, k, result, self.digits, index)
