"""The one Monte Carlo engine: seeded, in blocks, threaded, adaptive (JCGM 101:2008, 7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mtu_cli.findings import InputError, error, finding
from mtu_cli.stats.blocks import (
    FIRST_LOOK,
    BlockPlan,
    BlockSummariser,
    BlockSummary,
    Draws,
    TrialModel,
    block_generator,
)
from mtu_cli.stats.coverage import (
    PROBABILITY,
    coverage_factor,
    few_blocks_factor,
    numerical_tolerance,
)
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.pooling import Estimates, Pool, single_block_estimates
from mtu_cli.stats.threads import available_threads, one_blas_thread, workers

Progress = Callable[[int, int | None], None]

LARGEST_PROBABILITY = 0.999
"""Beyond it a block of 100/(1 - p) trials no longer fits the memory the engine promises."""
AT_ONCE = 256
"""Blocks that are given to the threads at once."""
Criterion = Callable[[Estimates], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarloResult(Estimates):
    """Result of a Monte Carlo, each array (outputs,) in the unit of the output unless said.

    `mean`, `u`: estimate and standard uncertainty (JCGM 101:2008, 7.6); u and `covariance`
    (outputs, outputs) are nan where the model says that no standard deviation exists; `mean`
    is then the plain sample mean and `se_mean` is nan. `low`, `high`: the probabilistically
    symmetric coverage interval for `probability`; `shortest_low`, `shortest_high`: the shortest
    (7.7). `se_*`: the Monte Carlo's own standard uncertainty of mean, u, low, high.
    `converged`: 2 se is within the tolerance asked for, for every output and statistic.
    `blocks`: how many blocks the standard errors come from; 1 where they are asymptotic. `samples`
    (outputs, kept): the first trials.
    """

    names: tuple[str, ...]
    trials: int
    blocks: int
    converged: bool
    probability: float
    samples: FloatArray


def monte_carlo(
    model: TrialModel,
    *,
    seed: int,
    trials: int | None = None,
    probability: float = PROBABILITY,
    digits: int = 2,
    tolerance_fraction: float = 1.0,
    threads: int | None = None,
    max_trials: int = 10_000_000,
    keep: int = 2**18,
    progress: Progress | None = None,
) -> MonteCarloResult:
    """Propagates distributions through `model` by Monte Carlo.

    With `trials` exactly that many are run. Without, blocks are added until twice the standard
    error of mean, u, low and high, times `few_blocks_factor`, is at most `tolerance_fraction` of
    the numerical tolerance of u at `digits` digits for every output (JCGM 101:2008, 7.9.4; 0.2 for
    clause 8), or `max_trials` is reached. Where no u exists, the ends alone decide, with the u of a
    normal distribution of equal interval.

    The same seed gives the same bits for any number of `threads`. `progress` is called with
    trials done and the total (None while the count adapts). Fewer than 1000/(1 - p) trials, of
    a smooth model a quarter of that, run as one block, without the control variate.

    Raises InputError for settings out of range, too few trials (fewer than 2/(1 - p)), or
    model values that are not finite, which are counted and never dropped.
    """
    asked = max_trials if trials is None else trials
    _check(seed, asked, probability, digits, tolerance_fraction, threads)
    run = _Run(model, trials, max_trials, probability, seed, keep, progress)
    threads = threads or available_threads()

    def criterion(estimates: Estimates) -> float:
        ratio = _ratio(estimates, probability, digits, tolerance_fraction)
        return ratio * few_blocks_factor(run.blocks)

    # A product split among threads would not give the same bits: blocks are the unit of work.
    with one_blas_thread(), workers(threads) as executor:
        each = executor.map if threads > 1 and run.plan.blocks != 1 else map
        estimates = run.estimates(criterion, each)
    return MonteCarloResult(
        names=tuple(model.names),
        trials=run.trials,
        blocks=run.blocks,
        converged=criterion(estimates) <= 1.0,
        probability=probability,
        samples=run.samples[:, : min(keep, run.trials)],
        **{field.name: getattr(estimates, field.name) for field in fields(Estimates)},
    )


class _Run:
    """The blocks of a Monte Carlo, whose summaries are pooled in the order of their numbers;
    `trials` and `blocks` count what has been done. The first `keep` trials stay in `samples`
    (outputs, kept), all of a single block.
    """

    def __init__(
        self,
        model: TrialModel,
        trials: int | None,
        most: int,
        probability: float,
        seed: int,
        keep: int,
        progress: Progress | None,
    ) -> None:
        smooth = bool(getattr(model, "smooth", False))
        self.plan = BlockPlan.adaptive(probability, smooth=smooth)
        # A count that adapts needs room for a first look.
        if trials is not None or most < FIRST_LOOK * self.plan.size:
            asked = most if trials is None else trials
            self.plan = BlockPlan.fixed(asked, probability, smooth=smooth)
        self.model, self.seed, self.progress = model, seed, progress
        self.trials, self.blocks, self.largest = 0, 0, self.plan.blocks or most // self.plan.size
        single, total = self.plan.blocks == 1, self.plan.total
        # Untouched pages of an empty array take no memory.
        kept = self.plan.size if single else min(keep, most if total is None else total)
        self.samples = np.empty((len(model.names), kept))
        self.exists = np.asarray(getattr(model, "u_exists", np.ones(len(model.names), dtype=bool)))
        self.pool = Pool(self.exists)
        self.summariser = None if single else BlockSummariser(model, self.plan)

    def estimates(self, criterion: Criterion, each: Callable[..., Iterable[Any]]) -> Estimates:
        """Runs the plan, each block by `each`, a `map`; where the count adapts until the criterion
        is 1 or below.

        Raises InputError for values that are not finite.
        """
        goal = self.plan.blocks or FIRST_LOOK
        while True:
            # Some at a time: while tasks are queued an interrupt may leave the queue locked.
            while self.blocks < goal:
                some = range(self.blocks, min(self.blocks + AT_ONCE, goal))
                for count, not_finite, summary in each(self._block, some):
                    self._take(count, not_finite, summary)
            if self.summariser is None:
                return single_block_estimates(self.samples, self.plan.probability, self.exists)
            found = self.pool.estimates()
            ratio = criterion(found)
            if goal >= self.largest or ratio <= 1.0:
                return found
            # Standard errors fall as 1/sqrt(h). The goals follow from the results alone, so they
            # are the same for any number of threads; a quarter more at least, to look rarely.
            ratio /= few_blocks_factor(goal)
            goal = min(self.largest, math.ceil(goal * min(4.0, max(1.25, 1.1 * ratio * ratio))))

    def _take(self, count: int, not_finite: IntArray, summary: BlockSummary | None) -> None:
        self.blocks += 1
        self.trials += count
        if np.any(not_finite):
            expected = "a model that is defined for all values its inputs may take"
            raise InputError(
                finding(
                    "no-finite-value",
                    output=name,
                    what=repr(name),
                    where=f" in {bad} of the first {self.trials} Monte Carlo trials",
                    expected=expected,
                )
                for name, bad in zip(self.model.names, not_finite, strict=True)
                if bad
            )
        if summary is not None:
            self.pool.add(summary)
        if self.progress is not None:
            self.progress(self.trials, self.plan.total)

    def _block(self, block: int) -> tuple[int, IntArray, BlockSummary | None]:
        m, start = self.plan.trials_in(block), self.plan.first_trial(block)
        draws = self.model.draw(block_generator(self.seed, block), m)
        not_finite, room = _not_finite(draws), self.samples.shape[1] - start
        if room > 0:
            self.samples[:, start : start + m] = draws.values[:, :room]
        if self.summariser is None or np.any(not_finite):
            return m, not_finite, None
        return m, not_finite, self.summariser.summarise(draws)


def _not_finite(draws: Draws) -> IntArray:
    """Trials (outputs,) whose value or first-order form is infinite or not a number."""
    values, linear = draws.values, draws.linear
    # A sum that is finite has finite terms; to look at each takes three times as long.
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(values.sum()) + (0.0 if linear is None else float(linear.sum()))
    if np.isfinite(total):
        return np.zeros(len(values), np.int64)
    finite = np.isfinite(values) & (True if linear is None else np.isfinite(linear))
    return np.count_nonzero(~finite, axis=1)


def _ratio(estimates: Estimates, probability: float, digits: int, fraction: float) -> float:
    """Largest of 2 se over the tolerance; converged at 1 or below."""
    k, largest = coverage_factor(probability), 0.0
    for i, u in enumerate(estimates.u.tolist()):
        errors = [estimates.se_low[i], estimates.se_high[i]]
        if math.isnan(u):
            u = float(estimates.high[i] - estimates.low[i]) / (2.0 * k)
        else:
            errors += [estimates.se_mean[i], estimates.se_u[i]]
        tolerance, twice = fraction * numerical_tolerance(u, digits), 2.0 * float(max(errors))
        if twice > 0.0:
            largest = max(largest, twice / tolerance if tolerance > 0.0 else math.inf)
    return largest


def _check(
    seed: int, trials: int, probability: float, digits: int, fraction: float, threads: int | None
) -> None:
    most, shown = LARGEST_PROBABILITY, f"for a {100 * probability:g} % interval"
    inside = 0.0 < probability <= most
    least = math.ceil(round(2.0 / (1.0 - probability), 6)) if inside else 0
    for name, value, sound, expected in (
        ("seed", seed, seed >= 0, "an integer of 0 or more"),
        ("probability", probability, inside, f"above 0 and at most {most}"),
        ("trials", trials, trials >= least, f"{least} or more {shown}"),
        ("digits", digits, digits >= 1, "1 or more"),
        ("fraction of the tolerance", fraction, fraction > 0.0, "above 0"),
        ("threads", threads, threads is None or threads >= 1, "1 or more"),
    ):
        if not sound:
            raise error("out-of-range", path=name, value=str(value), expected=expected)
