"""The one Monte Carlo engine: seeded, in blocks, threaded, adaptive (JCGM 101:2008, 7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import islice

import numpy as np

from mtu_cli.findings import InputError, error, finding
from mtu_cli.stats.blocks import (
    FIRST_LOOK,
    BatchSummary,
    BlockPlan,
    BlockSummariser,
    Draws,
    TrialModel,
    batch_generator,
    least_block,
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
QUEUED = 256
"""Batches of blocks that are given to the threads at once."""


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
    (outputs, n): the first trials.
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

    Raises InputError for fewer than 2/(1 - p) trials, or model values that are not finite, which
    are counted and never dropped.
    """
    plan = _plan(model, trials, max_trials, probability)
    single, total = plan.blocks == 1, plan.total
    exists = np.asarray(getattr(model, "u_exists", np.ones(len(model.names), dtype=bool)))
    summariser, pool = None if single else BlockSummariser(model, plan), Pool(exists)
    # Untouched pages of an empty array take no memory. Of a single block all are needed.
    capacity = plan.size if single else min(keep, max_trials if total is None else total)
    samples = np.empty((len(model.names), capacity))

    def batch(blocks: range) -> tuple[range, int, IntArray, BatchSummary | None]:
        m, start = len(blocks) * plan.trials_in(blocks.start), plan.first_trial(blocks.start)
        draws = model.draw(batch_generator(seed, blocks), m)
        not_finite, room = _not_finite(draws), capacity - start
        if room > 0:
            samples[:, start : start + m] = draws.values[:, :room]
        if summariser is None or np.any(not_finite):
            return blocks, m, not_finite, None
        return blocks, m, not_finite, summariser.summarise(draws, len(blocks))

    done = blocks = 0
    goal, largest = plan.blocks or FIRST_LOOK, plan.blocks or max_trials // plan.size
    threads = threads or available_threads()
    # A product split among threads would not give the same bits: blocks are the unit of work.
    with one_blas_thread(), workers(threads) as executor:
        each = executor.map if threads > 1 and not single else map
        while True:
            # Some at a time: while tasks are queued an interrupt may leave the queue locked.
            batches = plan.batches(blocks, goal)
            while some := list(islice(batches, QUEUED)):
                for of_batch, count, not_finite, summary in each(batch, some):
                    blocks, done = of_batch.stop, done + count
                    _refuse(model.names, not_finite, done)
                    if summary is not None:
                        pool.add(summary)
                    if progress is not None:
                        progress(done, total)
            estimates = single_block_estimates(samples, probability, exists) if single else None
            estimates = estimates or pool.estimates()
            ratio = _ratio(estimates, probability, digits, tolerance_fraction)
            converged = ratio * few_blocks_factor(blocks) <= 1.0
            if goal >= largest or converged:
                break
            # Standard errors fall as 1/sqrt(h). The goals follow from the results alone, so they
            # are the same for any number of threads; a quarter more at least, to look rarely.
            goal = min(largest, math.ceil(goal * min(4.0, max(1.25, 1.1 * ratio * ratio))))
    return MonteCarloResult(
        names=tuple(model.names),
        trials=done,
        blocks=blocks,
        converged=converged,
        probability=probability,
        samples=samples[:, : min(keep, done)],
        **{field.name: getattr(estimates, field.name) for field in fields(Estimates)},
    )


def _plan(model: TrialModel, trials: int | None, max_trials: int, probability: float) -> BlockPlan:
    """The blocks of a fixed count, or of one that adapts and has room for a first look.

    Raises InputError for fewer trials than an interval has ends of.
    """
    least = math.ceil(round(2.0 / (1.0 - probability), 6))
    if (max_trials if trials is None else trials) < least:
        expected = f"{least} or more for a {100 * probability:g} % interval"
        raise error("out-of-range", path="trials", value=str(trials), expected=expected)
    smooth, outputs = bool(getattr(model, "smooth", False)), len(model.names)
    least = least_block(probability, smooth=smooth)
    if trials is None and max_trials < FIRST_LOOK * least:
        trials = max_trials
    return BlockPlan.of(trials, probability, smooth=smooth, outputs=outputs)


def _refuse(names: Sequence[str], not_finite: IntArray, trials: int) -> None:
    """Raises InputError of outputs that are not finite in some of the first `trials`."""
    if np.any(not_finite):
        raise InputError(
            finding(
                "no-finite-value",
                output=name,
                what=repr(name),
                where=f" in {bad} of the first {trials} Monte Carlo trials",
                expected="a model that is defined for all values its inputs may take",
            )
            for name, bad in zip(names, not_finite, strict=True)
            if bad
        )


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
        tolerance, bound = fraction * numerical_tolerance(u, digits), 2.0 * float(max(errors))
        if bound > 0.0:
            largest = max(largest, bound / tolerance if tolerance > 0.0 else math.inf)
    return largest
