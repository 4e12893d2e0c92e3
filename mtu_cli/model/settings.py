"""What a user may choose for any prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from mtu_cli.findings import Finding, finding
from mtu_cli.stats.blocks import TrialModel
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import (
    CONVERGED_TO,
    Happens,
    MonteCarloResult,
    Progress,
    Validation,
    clause8,
    monte_carlo,
    probabilities,
)

Correlation = Literal["shared", "independent"]

DEFAULT_SEED = 20040126
MOST_TRIALS, ENOUGH_TRIALS = 10_000_000, 300_000
"""Where the count adapts: of one output at most so many, of many at least these."""
MOST_DRAWN = 60_000_000
"""Values of all outputs: some seconds. What clause 8 cannot decide by then is reported."""
COUNTED_TRIALS = 200_000
"""Trials behind a probability that is counted; its standard error is stated."""


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
        """Whether the papers' independence is the requested main result."""
        return self.correlation == "independent"

    def run(
        self,
        model: TrialModel,
        *,
        keep: int = 0,
        fraction: float = CONVERGED_TO,
        most: int | None = None,
        probability: float = PROBABILITY,
    ) -> MonteCarloResult:
        """The Monte Carlo of a model under these settings, converged to a fifth of the tolerance
        as clause 8 needs it, or to another `fraction`; at `most` so many trials where the count
        adapts. The first `keep` trials stay for a picture.
        """
        enough = min(MOST_TRIALS, max(ENOUGH_TRIALS, MOST_DRAWN // len(model.names)))
        return monte_carlo(
            model,
            seed=self.seed,
            trials=self.trials,
            probability=probability,
            digits=self.digits,
            tolerance_fraction=fraction,
            max_trials=self.trials or most or enough,
            threads=self.threads,
            keep=keep,
            progress=self.progress,
        )

    def count(self, names: tuple[str, ...], happens: Happens) -> tuple[FloatArray, FloatArray]:
        """Probabilities (events,) by Monte Carlo, and their standard errors."""
        trials = self.trials or COUNTED_TRIALS
        return probabilities(names, happens, self.seed, trials, self.threads)

    def validate(
        self, mean: float, u: float, dof: float, result: MonteCarloResult, index: int
    ) -> Validation:
        """JCGM 101:2008, clause 8, with the coverage factor of Welch-Satterthwaite."""
        k = coverage_factor(PROBABILITY, dof)
        return clause8(mean, u, k, result, self.digits, index)


def validation_warnings(
    names: Sequence[str], results: Sequence[Validation], unit: str, size: float
) -> list[Finding]:
    """Which first-order intervals the Monte Carlo rejects, and which it leaves undecided; the
    largest difference in `unit`, of `size` in internal units.
    """
    failed = [i for i, item in enumerate(results) if item.passed is False]
    undecided = [names[i] for i, item in enumerate(results) if item.passed is None]
    warnings = []
    if failed:
        largest = max(max(results[i].d_low, results[i].d_high) for i in failed) / size
        # A ratio has no unit.
        difference = f"up to {largest:.2g} {unit}".rstrip()
        names_failed = [names[i] for i in failed]
        warnings.append(finding("validation-failed", names=names_failed, difference=difference))
    if undecided:
        warnings.append(finding("validation-undecided", names=undecided))
    return warnings


def convergence_warnings(run: MonteCarloResult) -> list[Finding]:
    """A Monte Carlo that ended, as asked or at its largest count, before its goal."""
    if run.converged:
        return []
    goal = "a fifth of the numerical tolerance (JCGM 101, 7.9.4 and 8.2)"
    return [finding("not-converged", trials=run.trials, goal=goal)]
