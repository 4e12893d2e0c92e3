"""The one Monte Carlo engine: seeded, in blocks, threaded, adaptive (JCGM 101:2008, 7); estimates
from its blocks with the first-order form as control variate, or from one block to the letter; and
the first-order result against them (clause 8).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np

from mtu_cli.findings import InputError, finding
from mtu_cli.stats.blocks import (
    FIRST_LOOK,
    LEAST_BLOCKS,
    QUANTILES,
    BatchSummary,
    BlockPlan,
    BlockSummariser,
    Draws,
    TrialModel,
    batch_generator,
)
from mtu_cli.stats.coverage import (
    PROBABILITY,
    coverage_factor,
    few_blocks_factor,
    numerical_tolerance,
)
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray
from mtu_cli.stats.threads import available_threads, one_blas_thread, workers

GROUPS = 64
"""Groups of blocks for the control: their scatter tells its variance to a tenth or so."""
KNOWN = 1e-6
"""Share of the interval to which quantiles of a first-order form are known (`sum_quantile`): no end
is stated to be surer, be the output equal to its form."""
REACH = 2.0
"""Binomial standard deviations about an end's rank: the interval of 95 % for a quantile, whatever
the distribution (David & Nagaraja 2003, 7.1). The spread over one has half as many values in it
and is itself so unsure that two standard errors hold 92 % of the errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """Pooled estimates, each (outputs,)."""

    mean: FloatArray
    u: FloatArray
    low: FloatArray
    high: FloatArray
    se_mean: FloatArray
    se_u: FloatArray
    se_low: FloatArray
    se_high: FloatArray
    shortest_low: FloatArray
    shortest_high: FloatArray


MIDDLE = QUANTILES // 2
ENDS = np.array([0, 1, 2 + MIDDLE, 2 + QUANTILES + MIDDLE])
"""Mean, variance and the ends of the symmetric interval among a block's statistics."""


class Pool:
    """Running sums over blocks, added in the order of their numbers. Those of statistics are about
    the first block's, so that their squares do not cancel; nothing grows with the number of blocks.
    """

    def __init__(self, u_exists: BoolArray) -> None:
        outputs = len(u_exists)
        self.u_exists, self.blocks, self.trials = u_exists, 0, 0
        self._origin = np.zeros((2 + 2 * QUANTILES, outputs))
        self._shift, self._squares = np.zeros(outputs), np.zeros(outputs)
        self._sums = np.zeros((5, *self._origin.shape))
        self._groups = np.zeros((GROUPS, 5, len(ENDS), outputs))

    def add(self, batch: BatchSummary) -> None:
        """Takes in the next blocks."""
        if self.blocks == 0:
            self._origin = batch.statistics[0]
        deviations, c = batch.statistics - self._origin, batch.controls
        means, variances = deviations[:, 0], batch.statistics[:, 1]
        self._shift += batch.size * means.sum(axis=0)
        within = (batch.size - 1) * variances.sum(axis=0)
        self._squares += within + batch.size * (means**2).sum(axis=0)
        products = np.stack([deviations, deviations * deviations, c, c * c, deviations * c], axis=1)
        self._sums += products.sum(axis=0)
        groups = np.arange(self.blocks, self.blocks + len(c)) % GROUPS
        np.add.at(self._groups, groups, products[:, :, ENDS])
        self.trials += batch.size * len(c)
        self.blocks += len(c)

    def estimates(self) -> Estimates:
        """Estimates and their standard errors from all blocks so far (at least two): mean and
        variance with divisor n - 1 over all trials where no control is used (JCGM 101:2008, 7.6,
        eq. (16) and (17)); interval ends as averages over blocks (7.9.4); standard errors
        s/sqrt(h).
        """
        value, of_value, slope = self._controlled()
        shift = self._shift / self.trials
        variances = (self._squares - self.trials * shift**2) / (self.trials - 1)
        plain = np.array([self._origin[0] + shift, variances, value[2], value[3]])
        mean, variance, low, high = np.where(slope == 0.0, plain, value)
        u = np.where(self.u_exists, np.sqrt(np.maximum(variance, 0.0)), np.nan)
        se = np.sqrt(of_value)
        shortest_low, shortest_high = self._shortest()
        return Estimates(
            mean=mean,
            u=u,
            low=low,
            high=high,
            # Without a variance the scatter of block means says nothing about their error.
            se_mean=np.where(self.u_exists, se[0], np.nan),
            se_u=np.divide(se[1], 2.0 * u, out=np.zeros_like(u), where=u != 0.0),
            se_low=se[2],
            se_high=se[3],
            shortest_low=shortest_low,
            shortest_high=shortest_high,
        )

    def _controlled(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Each statistic with and without its control, the one of less variance: values,
        variances and slopes (0 without the control).

        Plain: the blocks' average with s_ss/(h (h - 1)). Controlled: group g of blocks gives
        Y_g = s_g - beta_g c_g with beta_g = S_sc/S_cc over the blocks outside the group, so
        that beta_g and c_g are independent and E Y_g = E s whatever their joint distribution
        (splitting; Avramidis & Wilson 1993). A slope from all blocks would have a bias of
        half a standard error where s is a curved function of c. The variance is that of the
        Y_g, sum n_g^2 (Y_g - Y)^2 G/(G - 1)/h^2.
        """
        h = self.blocks
        # Blocks in each group, of which the first have one more.
        groups = np.arange(min(h, GROUPS))
        n = (h // GROUPS + (groups < h % GROUPS))[:, np.newaxis, np.newaxis]
        s, _, c, cc, sc = self._groups[: len(n)].transpose(1, 0, 2, 3)
        total_s, total_ss, total_c, total_cc, total_sc = self._sums[:, ENDS]
        plain = np.maximum(total_ss - total_s**2 / h, 0.0) / (h * (h - 1))
        rest_c, rest_s, rest = total_c - c, total_s - s, h - n
        s_cc = total_cc - cc - rest_c**2 / rest
        s_sc = total_sc - sc - rest_s * rest_c / rest
        usable = (s_cc > 0.0).all(axis=0) & (h >= LEAST_BLOCKS)
        usable[:2] &= self.u_exists
        slope = np.divide(s_sc, s_cc, out=np.zeros_like(s_sc), where=usable)
        adjusted = s - slope * c
        value = adjusted.sum(axis=0) / h
        scatter = ((adjusted - n * value) ** 2).sum(axis=0) / h**2
        variance = scatter * (len(n) / max(len(n) - 1, 1))
        better = usable & (variance < plain)
        value = self._origin[ENDS] + np.where(better, value, total_s / h)
        # Rounding leaves no less of the scatter than this, whatever the difference says.
        least = np.finfo(np.float64).eps ** 2 * plain
        least[2:] = np.maximum(least[2:], (KNOWN * (value[3] - value[2])) ** 2)
        variance = np.where(better, np.maximum(variance, np.minimum(least, plain)), plain)
        return value, variance, np.where(better, slope.mean(axis=0), 0.0)

    def _shortest(self) -> tuple[FloatArray, FloatArray]:
        """Shortest interval (JCGM 101:2008, 7.7.2) from the block averages of the quantiles, the
        width being a parabola of the place between those at the plan's shares. A quantile takes the
        slope of its own control: that of another one may be worse than none.
        """
        s, _, c, cc, sc = self._sums
        spread = cc - c**2 / self.blocks
        usable = (spread > 0.0) & (self.blocks >= LEAST_BLOCKS)
        slope = np.divide(sc - s * c / self.blocks, spread, out=np.zeros_like(s), where=usable)
        averages = self._origin + (s - slope * c) / self.blocks
        lower, upper = averages[2 : 2 + QUANTILES], averages[: 1 + QUANTILES : -1]
        width = upper - lower
        best = np.argmin(width, axis=0)
        near = np.clip(best + np.array([[-1], [0], [1]]), 0, len(width) - 1)
        place = near, np.arange(len(best))
        before, least, after = width[place]
        bend = before - 2.0 * least + after
        inner = (near[0] < best) & (best < near[2]) & (bend > 0.0)
        step = np.where(inner, 0.5 * (before - after) / np.where(inner, bend, 1.0), 0.0)
        # The parabolas through both ends' values at -1, 0 and 1, at the step.
        before, middle, after = np.stack([lower[place], upper[place]], axis=1)
        bend = before - 2.0 * middle + after
        low, high = middle + 0.5 * step * (after - before + step * bend)
        return low, high


def single_block_estimates(
    values: FloatArray, probability: float, u_exists: BoolArray
) -> Estimates:
    """Estimates from `values` (outputs, M).

    Mean and u by JCGM 101:2008, 7.6; q = pM rounded, the symmetric interval from
    r = (M - q)/2 or (M - q + 1)/2 and the shortest as the least y_(r+q) - y_(r), by 7.7.2.

    Standard errors are asymptotic: u/sqrt(M) for the mean, sqrt((m4 - u^4 (M-3)/(M-1))/M)/(2u)
    for u with the fourth central moment m4; for an end half the way to the values `REACH` binomial
    standard deviations sqrt(M a (1 - a)), a = (1 - p)/2, from its rank, rms of both sides.
    """
    outputs, trials = values.shape
    mean = values.mean(axis=1)
    centred = values - mean[:, np.newaxis]
    squares = np.einsum("ij,ij->i", centred, centred)
    variance = np.where(u_exists, squares / (trials - 1), np.nan)
    u = np.sqrt(variance)
    ordered = np.sort(values, axis=1)
    # 0.95 * 1e6 is 949999.9999999999: an integer but for rounding is an integer.
    q = math.floor(round(probability * trials, 6) + 0.5)
    r = max(1, (trials - q + 1) // 2)
    widths = ordered[:, q:] - ordered[:, : trials - q]
    best = np.argmin(widths, axis=1)
    rows = np.arange(outputs)
    fourth = np.mean(centred**4, axis=1) - variance**2 * (trials - 3) / (trials - 1)
    of_variance = np.sqrt(np.maximum(fourth, 0.0) / trials)
    return Estimates(
        mean=mean,
        u=u,
        low=ordered[:, r - 1],
        high=ordered[:, r + q - 1],
        se_mean=u / math.sqrt(trials),
        se_u=np.divide(of_variance, 2.0 * u, out=np.zeros(outputs), where=u != 0.0),
        se_low=_end_error(ordered, r, probability),
        se_high=_end_error(ordered, r + q, probability),
        shortest_low=ordered[rows, best],
        shortest_high=ordered[rows, best + q],
    )


def _end_error(ordered: FloatArray, rank: int, probability: float) -> FloatArray:
    trials = ordered.shape[1]
    a = 0.5 * (1.0 - probability)
    deviation = math.sqrt(trials * a * (1.0 - a))
    below = max(1, math.floor(rank - REACH * deviation))
    above = min(trials, math.ceil(rank + REACH * deviation))
    end = ordered[:, rank - 1]
    higher = (ordered[:, above - 1] - end) / max(above - rank, 1)
    lower = (end - ordered[:, below - 1]) / max(rank - below, 1)
    return np.sqrt((higher**2 + lower**2) / 2) * deviation


Progress = Callable[[int, int | None], None]

LARGEST_PROBABILITY = 0.999
"""Beyond it a block of 100/(1 - p) trials no longer fits the memory the engine promises."""
QUEUED = 256
"""Batches of blocks that are given to the threads at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarloResult(Estimates):
    """Result of a Monte Carlo, each array (outputs,) in the unit of the output unless said.

    `mean`, `u`: estimate and standard uncertainty (JCGM 101:2008, 7.6); u is nan where the model
    says that no standard deviation exists; `mean` is then the plain sample mean and `se_mean` is
    nan. `low`, `high`: the probabilistically symmetric coverage interval for `probability`;
    `shortest_low`, `shortest_high`: the shortest (7.7). `se_*`: the Monte Carlo's own standard
    uncertainty of mean, u, low, high. `converged`: 2 se is within the tolerance asked for, for
    every output and statistic. `blocks`: how many blocks the standard errors come from; 1 where
    they are asymptotic. `samples` (outputs, n): the first trials.
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
    plan = BlockPlan.of(model, trials, max_trials, probability)
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
    finite = np.isfinite(draws.values)
    if draws.linear is not None:
        finite &= np.isfinite(draws.linear)
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


Happens = Callable[[np.random.Generator, int], BoolArray]
"""Random numbers and a count m -> whether each event happens (events, m)."""


def probabilities(
    names: tuple[str, ...], happens: Happens, seed: int, trials: int, threads: int | None
) -> tuple[FloatArray, FloatArray]:
    """Probabilities (events,) of the events `names` by Monte Carlo, and their standard errors."""
    model: Any = SimpleNamespace(names=names, linear_mean=None)
    model.draw = lambda rng, m: Draws(values=happens(rng, m).astype(np.float64))
    result = monte_carlo(model, seed=seed, trials=trials, threads=threads)
    n, p = result.trials, result.mean
    # One miss more and one hit more: 200 000 hits of 200 000 are not certainty.
    cautious = (p * n + 1) / (n + 2)
    return p, np.sqrt(cautious * (1 - cautious) / n)


CONVERGED_TO = 0.2
"""Share of the tolerance to which the Monte Carlo must have converged, 8.2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """Outcome of clause 8 for one output, in its unit. `passed`: whether both differences of
    interval ends are at most `tolerance`; None where there is no first order, or the Monte Carlo
    cannot tell: its own two standard errors exceed a fifth of the tolerance at an end (8.2), and a
    difference is within those two of the tolerance. `settled`: whether more trials would be of no
    use.
    """

    passed: bool | None
    d_low: float
    d_high: float
    tolerance: float
    settled: bool


def clause8(
    mean: float, u: float, k: float, result: MonteCarloResult, digits: int = 2, index: int = 0
) -> Validation:
    """d_low = |y - k u - y_low|, d_high = |y + k u - y_high|, JCGM 101:2008, 8.1, eq. (30)-(31).

    `mean`, `u`: first-order estimate y and u(y) of output `index`, u nan without one. `k`: the
    coverage factor for `result.probability` at the Welch-Satterthwaite degrees of freedom, not a
    rounded 2.
    `digits`: the significant digits of u(y) that matter; they set the tolerance delta (7.9.2).
    """
    tolerance = numerical_tolerance(u, digits)
    d_low = float(abs(mean - k * u - result.low[index]))
    d_high = float(abs(mean + k * u - result.high[index]))
    twice_low, twice_high = 2.0 * float(result.se_low[index]), 2.0 * float(result.se_high[index])
    # Without any uncertainty the ends differ by rounding alone.
    allowed = tolerance if u > 0 else 1e-9 * abs(mean)
    passed: bool | None = d_low <= allowed and d_high <= allowed
    clearly_failed = d_low - twice_low > allowed or d_high - twice_high > allowed
    clearly_passed = d_low + twice_low <= allowed and d_high + twice_high <= allowed
    short = max(twice_low, twice_high) > CONVERGED_TO * tolerance
    if u == 0.0 and result.u[index] > allowed:
        # The ends of a step's interval may agree: no u is still wrong where there is one.
        passed = False
    elif math.isnan(u) or (short and not (clearly_failed or clearly_passed)):
        passed = None
    return Validation(
        passed=passed,
        d_low=d_low,
        d_high=d_high,
        tolerance=tolerance,
        settled=clearly_failed or not short,
    )


def validated(
    run_to: Callable[[float], MonteCarloResult],
    first: Sequence[tuple[float, float, float]],
    digits: int,
    adaptive: bool,
) -> tuple[MonteCarloResult, list[Validation]]:
    """A Monte Carlo run to its numerical tolerance (JCGM 101:2008, 7.9.4) and, where clause 8 is
    not settled by that and the count is `adaptive`, to a fifth of clause 8's (8.2): what first
    order plainly fails needs no more trials to say so.

    `run_to` a fraction of the engine's tolerance; `first`: y, u(y) and k of every output, of nan
    where there is no first order, which leaves its outcome open.
    """
    run = run_to(1.0)
    verdicts = [clause8(*item, run, digits, i) for i, item in enumerate(first)]
    unsettled = any(not v.settled and u > 0.0 for v, (_, u, _) in zip(verdicts, first, strict=True))
    if adaptive and run.converged and unsettled:
        # The engine takes its tolerance from its own u, which may need a digit more: 0.105 beside
        # 0.074. The least of the tolerances of clause 8 over those of the engine.
        both = [(u, float(v)) for (_, u, _), v in zip(first, run.u, strict=True) if u > 0 and v > 0]
        ratios = [numerical_tolerance(u, digits) / numerical_tolerance(v, digits) for u, v in both]
        run = run_to(CONVERGED_TO * min([1.0, *filter(math.isfinite, ratios)]))
        verdicts = [clause8(*item, run, digits, i) for i, item in enumerate(first)]
    return run, verdicts
