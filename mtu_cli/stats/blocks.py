"""One block of Monte Carlo trials: what a model returns, and what is kept of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.mixture_quantile import mixture_quantile
from mtu_cli.stats.ordered_tails import OrderedTails
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]

AT_ONCE = 2**15
"""Values of short blocks that are summarised together: they stay in the processor's cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """What a model returns for one block of m trials; of b blocks of one length, taken together,
    every array has their axis before that of the outputs.

    `values` (outputs, m): the outputs of the model.
    `linear` (outputs, m): their first-order form, evaluated on the same draws.
    `ranked` (outputs, m): `linear` mapped, rank for rank, to a distribution of known quantiles,
    which then serves the ends of the interval; None where `linear` is of one itself.
    `linear_u` (outputs, m) or (outputs, 1): standard deviation of `ranked` (of `linear` where
    that is None) given the trial's variance scales (the chi-square draw of a scaled t). Given
    these it must be exactly normal about `linear_mean`, unless the model states `linear_dof`.
    None where it is not normal (rectangular inputs): then the first-order form serves the mean,
    and u if the model states `linear_variance`.

    The engine reads the arrays before the next `draw` in the same thread and never writes
    to them, so a model may return arrays of its `Workspace`.
    """

    values: FloatArray
    linear: FloatArray | None = None
    ranked: FloatArray | None = None
    linear_u: FloatArray | None = None

    def copy(self) -> Draws:
        """Arrays of its own."""
        return joined([self], lambda arrays: arrays[0].copy())


def joined(parts: Sequence[Draws], join: Callable[[Sequence[FloatArray]], FloatArray]) -> Draws:
    """Each array of several draws made one by `join`, where they have it."""

    def one(arrays: Iterable[FloatArray | None]) -> FloatArray | None:
        found = [item for item in arrays if item is not None]
        return join(found) if found else None

    return Draws(
        values=join([item.values for item in parts]),
        linear=one(item.linear for item in parts),
        ranked=one(item.ranked for item in parts),
        linear_u=one(item.linear_u for item in parts),
    )


class TrialModel(Protocol):
    """A model that can draw m independent trials of all its outputs.

    `names`: one for each output. `linear_mean` (outputs,): exact expectation of
    `Draws.linear`; None where the model has no first-order form.

    Optional attributes: `linear_variance` (outputs,), the exact variance of `linear` over
    everything, scales included (nan where unknown); without it the variance comes from
    `linear_u`. `linear_dof` (outputs,): `linear`, or `ranked` where it is mapped, is exactly
    Student's t with these degrees of freedom (inf: normal), shifted by `linear_mean` and scaled
    by `linear_u` (outputs, 1), so that no scale needs to be averaged out. `u_exists` (outputs,) of
    bool, False where an output has no standard deviation (a t distribution of 2 degrees of freedom
    or fewer).
    `smooth` True: the outputs are smooth functions of what is drawn, without jumps or values
    that many trials share, so that few trials tell how far they are from their first-order form.
    `in_pieces` True: `draw` keeps to the processor's cache by itself, however large m is.

    `draw` is called from several threads at once and must take all randomness from `rng`.
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def linear_mean(self) -> FloatArray | None: ...

    def draw(self, rng: np.random.Generator, m: int) -> Draws: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockSummary:
    """All that is kept of a block; of b blocks of one length, taken together, every array has
    their axis before that of the outputs.

    `statistics` (4, outputs): mean, variance, low end, high end of the block. `controls`
    (4, outputs): the same statistics of the first-order form minus their exact expectation,
    so of mean zero; 0 where that is unknown; None without a first-order form. `squares`
    (outputs, outputs): sums of products about the block's mean. `lower`, `upper`
    (outputs, tail): ordered values from the lowest up and from the highest down, on the
    plan's grid; `linear_lower`, `linear_upper` the same of the first-order form minus the
    normal expectation.
    """

    count: int
    statistics: FloatArray
    controls: FloatArray | None
    squares: FloatArray
    lower: FloatArray
    upper: FloatArray
    linear_lower: FloatArray | None
    linear_upper: FloatArray | None

    def of(self, block: int) -> BlockSummary:
        """That of one of the blocks of which all arrays have an axis before that of the outputs."""
        controls, linear_lower, linear_upper = self.controls, self.linear_lower, self.linear_upper
        return BlockSummary(
            count=self.count,
            statistics=self.statistics[:, block],
            controls=None if controls is None else controls[:, block],
            squares=self.squares[block],
            lower=self.lower[block],
            upper=self.upper[block],
            linear_lower=None if linear_lower is None else linear_lower[block],
            linear_upper=None if linear_upper is None else linear_upper[block],
        )


def block_generator(seed: int, block: int) -> np.random.Generator:
    """The stream of one block: it depends on the seed and the block's number alone."""
    sequence = np.random.SeedSequence(seed, spawn_key=(block,))
    return np.random.Generator(np.random.SFC64(sequence))


def not_finite_in(draws: Draws) -> NDArray[np.int64]:
    """Trials (outputs,) whose value or first-order form is infinite or not a number."""
    values, linear = draws.values, draws.linear
    # A sum that is finite has finite terms; to look at each takes three times as long.
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(values.sum()) + (0.0 if linear is None else float(linear.sum()))
    if np.isfinite(total):
        return np.zeros(len(values), np.int64)
    finite = np.isfinite(values)
    if linear is not None:
        finite &= np.isfinite(linear)
    return np.asarray(np.count_nonzero(~finite, axis=1))


class BlockSummariser:
    """Turns the draws of a block into its summary; safe to call from several threads."""

    def __init__(self, model: TrialModel, plan: BlockPlan) -> None:
        self.plan = plan
        self.linear_mean = model.linear_mean
        self.linear_variance: FloatArray | None = getattr(model, "linear_variance", None)
        dof: FloatArray | None = getattr(model, "linear_dof", None)
        self._end, self._scores = plan.standard_ends(dof)
        self._weights = plan.unbiased_end_weights(dof) if plan.is_short else plan.end_weights
        self._work = Workspace()
        self._ordered, self._ordered_linear = OrderedTails(), OrderedTails()

    def summarise_short(self, blocks: Sequence[Draws]) -> Iterator[BlockSummary]:
        """`summarise` of short blocks in order, many at once: one by one the calls take longer
        than the work. Not where each has scales of its own, of which a quantile is sought.
        """
        for _, alike in groupby(blocks, lambda draws: draws.values.shape[1]):
            own = list(alike)
            u = own[0].linear_u
            fixed = u is None or u.shape[1] == 1
            if not fixed:
                yield from map(self.summarise, own)
                continue
            many = max(1, AT_ONCE // own[0].values.size)
            for first in range(0, len(own), many):
                some = own[first : first + many]
                whole = self.summarise(joined(some, np.stack))
                yield from (whole.of(block) for block in range(len(some)))

    def summarise(self, draws: Draws) -> BlockSummary:
        """Summary of one block of finite values, or of blocks of the same length (b, outputs, m):
        every array of it then has their axis before that of the outputs.
        """
        values = draws.values
        mean, squares = self._moments(values)
        m = values.shape[-1]
        lower, upper = self._tails(values, self._ordered)
        variance = np.diagonal(squares, axis1=-2, axis2=-1) / (m - 1)
        statistics = np.array([mean, variance, self._ends(lower), self._ends(upper)])
        controls, linear_lower, linear_upper = self._control(draws)
        return BlockSummary(
            count=m,
            statistics=statistics,
            controls=controls,
            squares=squares,
            lower=lower,
            upper=upper,
            linear_lower=linear_lower,
            linear_upper=linear_upper,
        )

    def _moments(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean: FloatArray = values.mean(axis=-1)
        centred = self._work.array("centred", values.shape)
        np.subtract(values, mean[..., np.newaxis], out=centred)
        return mean, centred @ centred.swapaxes(-1, -2)

    def _tails(self, values: FloatArray, ordered: OrderedTails) -> tuple[FloatArray, FloatArray]:
        *blocks, m = values.shape
        tails = ordered.of(values.reshape(-1, m), min(self.plan.tail + 1, m))
        lower, upper = (self.plan.on_grid(tail, m) for tail in tails)
        return lower.reshape(*blocks, -1), upper.reshape(*blocks, -1)

    def _ends(self, ordered: FloatArray) -> FloatArray:
        """Ends (..., outputs) of the symmetric interval from ordered values (..., tail)."""
        if self._weights.ndim == 1:
            return np.asarray(ordered @ self._weights)
        return np.asarray((ordered * self._weights).sum(axis=-1))

    def _control(
        self, draws: Draws
    ) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
        linear, mean = draws.linear, self.linear_mean
        if linear is None or mean is None:
            return None, None, None
        m = linear.shape[-1]
        centred = self._work.array("centred", linear.shape)
        controls = np.zeros((4, *linear.shape[:-1]))
        linear_average = linear.mean(axis=-1)
        controls[0] = linear_average - mean
        np.subtract(linear, linear_average[..., np.newaxis], out=centred)
        variance = np.einsum("...j,...j->...", centred, centred) / (m - 1)
        controls[1] = variance - self._expected_variance(draws, variance)
        if draws.linear_u is None:
            return controls, None, None
        ranked = linear if draws.ranked is None else draws.ranked
        lower, upper = self._tails(ranked, self._ordered_linear)
        u, plan = draws.linear_u, self.plan
        fixed = u.shape[-1] == 1
        end = u[..., 0] * self._end if fixed else mixture_quantile(u, plan.end_probability)
        controls[2] = self._ends(lower) - (mean + end)
        controls[3] = self._ends(upper) - (mean - end)
        if not fixed:
            return controls, None, None
        scores = u * self._scores
        column = mean[:, np.newaxis]
        return controls, lower - (column + scores), upper - (column - scores)

    def _expected_variance(self, draws: Draws, observed: FloatArray) -> FloatArray:
        given = np.full_like(observed, np.nan)
        if self.linear_variance is not None:
            given = np.asarray(self.linear_variance, dtype=np.float64)
        if draws.linear_u is not None:
            u = draws.linear_u
            scale = np.einsum("...j,...j->...", u, u) / u.shape[-1]
            given = np.where(np.isnan(given), scale, given)
        # An unknown expectation makes the control 0, which leaves the statistic as it is.
        return np.where(np.isnan(given), observed, given)
