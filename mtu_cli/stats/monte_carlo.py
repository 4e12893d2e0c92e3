"""The one Monte Carlo engine: seeded, in blocks, threaded, adaptive (JCGM 101:2008, 7)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import error
from mtu_cli.stats.atoms import with_atoms
from mtu_cli.stats.block_plan import FIRST_LOOK, LEAST_BLOCKS, BlockPlan, trials_for_tails
from mtu_cli.stats.blocks import TrialModel
from mtu_cli.stats.coverage import coverage_factor, few_blocks_factor, numerical_tolerance
from mtu_cli.stats.pooling import Estimates, Gain, Pool
from mtu_cli.stats.runner import BlockRunner, available_threads
from mtu_cli.stats.short_blocks import (
    all_controlled,
    crossed_gain,
    short_block_estimates,
)
from mtu_cli.stats.single_block import single_block_estimates

FloatArray = NDArray[np.float64]
Progress = Callable[[int, int | None], None]

LARGEST_PROBABILITY = 0.999
"""Beyond it a block of 100/(1 - p) trials no longer fits the memory the engine promises."""
SURELY = 0.5
"""Share of what is asked for to which so few trials must have converged to be enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarloResult:
    """Result of a Monte Carlo, each array (outputs,) in the unit of the output unless said.

    `mean`, `u`: estimate and standard uncertainty (JCGM 101:2008, 7.6); u and `covariance`
    (outputs, outputs) are nan where the model says that no standard deviation exists; `mean`
    is then the plain sample mean and `se_mean` is nan. `low`, `high`: the probabilistically
    symmetric coverage interval for `probability`; `shortest_low`, `shortest_high`: the shortest
    (7.7). `se_*`: the Monte Carlo's own standard uncertainty of mean, u, low, high.
    `converged`: 2 se is within the tolerance asked for, for every output and statistic.
    `gain`: variance reduction by the control variate. `blocks`: how many blocks the standard
    errors come from; 1 where they are asymptotic. `samples` (outputs, kept): the first trials.
    """

    names: tuple[str, ...]
    trials: int
    blocks: int
    converged: bool
    probability: float
    mean: FloatArray
    u: FloatArray
    low: FloatArray
    high: FloatArray
    shortest_low: FloatArray
    shortest_high: FloatArray
    covariance: FloatArray
    se_mean: FloatArray
    se_u: FloatArray
    se_low: FloatArray
    se_high: FloatArray
    gain: Gain
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
    error of mean, u, low and high is at most `tolerance_fraction` times the numerical tolerance
    of u at `digits` significant digits, for every output (JCGM 101:2008, 7.9.4; 0.2 for the
    validation of clause 8), or `max_trials` is reached. Published are two standard errors from two
    blocks on; here from 20 on, times t(h - 1)/z (`few_blocks_factor`): it never stops before. Where
    no u exists, the ends alone decide, with the u of a normal distribution of equal interval.

    The same seed gives the same bits for any number of `threads`. `progress` is called with
    trials done and the total (None while the count adapts). Fewer than 1000/(1 - p) trials run
    as one block, without the control variate; of a smooth model fewer than 100/(1 - p). A smooth
    model's count is first judged after 200/(1 - p) trials (`_few`).

    Raises InputError for settings out of range, too few trials (fewer than 2/(1 - p)), or
    model values that are not finite, which are counted and never dropped.
    """
    _check(seed, trials, probability, digits, tolerance_fraction, threads, max_trials)
    criterion = _Criterion(probability, digits, tolerance_fraction)
    few = None if trials else _few(model, seed, criterion, max_trials, keep, progress)
    if few is not None:
        return few
    plan, most = _plan(model, trials, max_trials, probability), trials or max_trials
    kept = most if plan.is_short else min(keep, most)
    with BlockRunner(model, plan, seed, threads or available_threads(), kept, progress) as run:
        estimates = _estimates(model, run, plan, criterion, max_trials)
    return _result(model, run, estimates, criterion, keep)


def _few(
    model: TrialModel,
    seed: int,
    criterion: _Criterion,
    most: int,
    keep: int,
    progress: Progress | None,
) -> MonteCarloResult | None:
    """The result of a first look at a smooth model, where that is surely enough.

    That is where the control variate gains much for every statistic and all of them are twice as
    sure as is asked for. A count that then goes on starts anew: blocks of one length only.
    """
    trials = FIRST_LOOK * trials_for_tails(criterion.probability) // LEAST_BLOCKS
    if not getattr(model, "smooth", False) or trials > most:
        return None
    plan = BlockPlan.short(trials, criterion.probability)
    with BlockRunner(model, plan, seed, 1, trials, None) as run:
        estimates = _estimates(model, run, plan, criterion, trials)
    if not all_controlled(estimates, _exists(model)) or criterion.ratio(estimates) > SURELY:
        return None
    if progress is not None:
        progress(run.trials, None)
    return _result(model, run, estimates, criterion, keep)


def _result(
    model: TrialModel, run: BlockRunner, estimates: Estimates, criterion: _Criterion, keep: int
) -> MonteCarloResult:
    # Those of short blocks are stated with Student's factor already.
    scatter = 1.0 if run.is_short else few_blocks_factor(run.blocks)
    return MonteCarloResult(
        names=tuple(model.names),
        trials=run.trials,
        blocks=run.blocks,
        converged=criterion.ratio(estimates) * scatter <= 1.0,
        probability=criterion.probability,
        samples=run.samples()[:, :keep],
        **{field.name: getattr(estimates, field.name) for field in fields(Estimates)},
    )


def _plan(model: TrialModel, trials: int | None, max_trials: int, probability: float) -> BlockPlan:
    """Blocks for a given count, or for one that adapts where it leaves room for a first look."""
    if trials is None:
        plan = BlockPlan.adaptive(probability)
        if max_trials >= FIRST_LOOK * plan.size:
            return plan
        trials = max_trials
    return BlockPlan.fixed(
        trials,
        probability,
        smooth=getattr(model, "smooth", False),
        in_pieces=getattr(model, "in_pieces", False),
    )


def _estimates(
    model: TrialModel, run: BlockRunner, plan: BlockPlan, criterion: _Criterion, most: int
) -> Estimates:
    """Runs the plan, at most `most` trials where the count adapts."""
    exists = _exists(model)
    if plan.blocks == 1:
        estimates = single_block_estimates(run.only_block(), plan.probability, exists)
        return with_atoms(estimates, run.samples(), plan.probability)
    pool = Pool(plan, exists)
    if plan.is_short and plan.blocks is not None:
        run.run_to(plan.blocks, pool)
        pooled = pool.estimates()
        gain = crossed_gain(pooled.gain, run.draws, run.summariser, exists)
        estimates = short_block_estimates(pooled, gain, run.samples(), plan.probability, exists)
        return with_atoms(estimates, run.samples(), plan.probability)
    return _grow(run, pool, criterion, plan.blocks, most // plan.size)


def _exists(model: TrialModel) -> NDArray[np.bool_]:
    return np.asarray(getattr(model, "u_exists", np.ones(len(model.names), dtype=bool)))


def _grow(
    run: BlockRunner, pool: Pool, criterion: _Criterion, blocks: int | None, most: int
) -> Estimates:
    if blocks is not None:
        run.run_to(blocks, pool)
        return with_atoms(pool.estimates(), run.samples(), pool.plan.probability)
    goal = FIRST_LOOK
    while True:
        run.run_to(goal, pool)
        estimates = with_atoms(pool.estimates(), run.samples(), pool.plan.probability)
        ratio = criterion.ratio(estimates)
        if ratio * few_blocks_factor(goal) <= 1.0 or goal >= most:
            return estimates
        # Standard errors fall as 1/sqrt(h). The goals follow from the results alone, so they
        # are the same for any number of threads; a quarter more at least, to look rarely.
        wanted = goal * min(4.0, max(1.25, 1.1 * ratio * ratio))
        goal = min(most, math.ceil(wanted))


@dataclass(frozen=True, slots=True)
class _Criterion:
    probability: float
    digits: int
    fraction: float

    def ratio(self, estimates: Estimates) -> float:
        """Largest of 2 se over the tolerance; converged at 1 or below."""
        k = coverage_factor(self.probability)
        largest = 0.0
        for i, u in enumerate(estimates.u):
            errors = [estimates.se_low[i], estimates.se_high[i]]
            if math.isnan(u):
                u = (estimates.high[i] - estimates.low[i]) / (2.0 * k)
            else:
                errors += [estimates.se_mean[i], estimates.se_u[i]]
            tolerance = self.fraction * numerical_tolerance(float(u), self.digits)
            twice = 2.0 * float(max(errors))
            if twice > 0.0:
                largest = max(largest, twice / tolerance if tolerance > 0.0 else math.inf)
        return largest


def _check(
    seed: int,
    trials: int | None,
    probability: float,
    digits: int,
    fraction: float,
    threads: int | None,
    max_trials: int,
) -> None:
    most = LARGEST_PROBABILITY
    asked = max_trials if trials is None else trials
    inside = 0.0 < probability <= most
    least = math.ceil(round(2.0 / (1.0 - probability), 6)) if inside else 0
    for name, value, sound, expected in (
        ("seed", seed, seed >= 0, "an integer of 0 or more"),
        ("probability", probability, inside, f"above 0 and at most {most}"),
        (
            "trials",
            asked,
            asked >= least,
            f"{least} or more for a {100 * probability:g} % interval",
        ),
        ("digits", digits, digits >= 1, "1 or more"),
        ("fraction of the tolerance", fraction, fraction > 0.0, "above 0"),
        ("threads", threads, threads is None or threads >= 1, "1 or more"),
    ):
        if not sound:
            raise error("out-of-range", path=name, value=str(value), expected=expected)
