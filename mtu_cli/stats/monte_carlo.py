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
from mtu_cli.stats.coverage import coverage_factor, few_blocks_factor, numerical_tolerance
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
    probability: float = 0.95,
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
    plan = _plan(model, trials, max_trials, probability)
    threads = threads or available_threads()

    def criterion(estimates: Estimates) -> float:
        return _ratio(estimates, probability, digits, tolerance_fraction)

    # A product split among threads would not give the same bits: blocks are the unit of work.
    with one_blas_thread(), workers(threads) as executor:
        each = executor.map if threads > 1 and plan.blocks != 1 else map
        run = _Runner(model, plan, seed, each, min(keep, asked), progress)
        estimates = _estimates(run, criterion, max_trials)
    return MonteCarloResult(
        names=tuple(model.names),
        trials=run.trials,
        blocks=run.blocks,
        converged=criterion(estimates) * few_blocks_factor(run.blocks) <= 1.0,
        probability=probability,
        samples=run.samples()[:, :keep],
        **{field.name: getattr(estimates, field.name) for field in fields(Estimates)},
    )


def _plan(model: TrialModel, trials: int | None, max_trials: int, probability: float) -> BlockPlan:
    """Blocks for a given count, or for one that adapts where it leaves room for a first look."""
    smooth = bool(getattr(model, "smooth", False))
    if trials is None:
        plan = BlockPlan.adaptive(probability, smooth=smooth)
        if max_trials >= FIRST_LOOK * plan.size:
            return plan
        trials = max_trials
    return BlockPlan.fixed(trials, probability, smooth=smooth)


def _estimates(run: _Runner, criterion: Criterion, most: int) -> Estimates:
    """Runs the plan, at most `most` trials where the count adapts."""
    plan, model = run.plan, run.model
    exists = np.asarray(getattr(model, "u_exists", np.ones(len(model.names), dtype=bool)))
    pool = Pool(exists)
    if plan.blocks == 1:
        run.run_to(1, pool)
        return single_block_estimates(run.samples(), plan.probability, exists)
    largest = plan.blocks or most // plan.size
    goal = plan.blocks or FIRST_LOOK
    while True:
        run.run_to(goal, pool)
        estimates = pool.estimates()
        ratio = criterion(estimates)
        if goal >= largest or ratio * few_blocks_factor(goal) <= 1.0:
            return estimates
        # Standard errors fall as 1/sqrt(h). The goals follow from the results alone, so they
        # are the same for any number of threads; a quarter more at least, to look rarely.
        goal = min(largest, math.ceil(goal * min(4.0, max(1.25, 1.1 * ratio * ratio))))


class _Runner:
    """Runs the blocks of a plan, each by `each`, a `map`, and takes their summaries in the order
    of their numbers; `trials` and `blocks` count what has been done. The first `keep` trials are
    kept, all of a single block.
    """

    def __init__(
        self,
        model: TrialModel,
        plan: BlockPlan,
        seed: int,
        each: Callable[..., Iterable[Any]],
        keep: int,
        progress: Progress | None,
    ) -> None:
        self.model, self.plan, self._seed, self._each = model, plan, seed, each
        self._progress, self.trials, self.blocks = progress, 0, 0
        # Untouched pages of an empty array take no memory.
        self._samples = np.empty((len(model.names), plan.size if plan.blocks == 1 else keep))
        self._summariser = None if plan.blocks == 1 else BlockSummariser(model, plan)

    def run_to(self, goal: int, pool: Pool) -> None:
        """Runs blocks up to number `goal`, exclusive, and adds them to `pool` in order.

        Raises InputError for values that are not finite.
        """
        # Some at a time: while tasks are queued an interrupt may leave the queue locked.
        for first in range(self.blocks, goal, AT_ONCE):
            some = range(first, min(first + AT_ONCE, goal))
            for count, not_finite, summary in self._each(self._block, some):
                self.blocks += 1
                self.trials += count
                if np.any(not_finite):
                    where = f"of the first {self.trials} Monte Carlo trials"
                    expected = "a model that is defined for all values its inputs may take"
                    raise InputError(
                        finding(
                            "no-finite-value",
                            output=name,
                            what=repr(name),
                            where=f" in {bad} {where}",
                            expected=expected,
                        )
                        for name, bad in zip(self.model.names, not_finite, strict=True)
                        if bad
                    )
                if summary is not None:
                    pool.add(summary)
                if self._progress is not None:
                    self._progress(self.trials, self.plan.total)

    def samples(self) -> FloatArray:
        """The first trials (outputs, kept), in order."""
        return self._samples[:, : self.trials]

    def _block(self, block: int) -> tuple[int, IntArray, BlockSummary | None]:
        m, start = self.plan.trials_in(block), self.plan.first_trial(block)
        draws = self.model.draw(block_generator(self._seed, block), m)
        not_finite, room = _not_finite(draws), self._samples.shape[1] - start
        if room > 0:
            self._samples[:, start : start + m] = draws.values[:, :room]
        if self._summariser is None or np.any(not_finite):
            return m, not_finite, None
        return m, not_finite, self._summariser.summarise(draws)


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
