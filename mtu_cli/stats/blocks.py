"""Blocks of Monte Carlo trials: how long they are, what a model draws, what is kept of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]
Quantiles = Callable[[FloatArray], FloatArray]

FIXED_BLOCK = 8192
"""Trials a block for a given count: 26 inputs of a block are 1.7 MB and stay in cache."""
ADAPTIVE_BLOCK = 2048
"""Trials a block for an adaptive count: small, so that a first look has many blocks."""
LONG_BLOCK = 2**15
"""Trials a block of a given count where the model draws them in pieces that stay in cache: what
a block costs by itself, whatever its length, is a tenth of a block of `FIXED_BLOCK`."""
LEAST_BLOCKS = 10
"""Fewest blocks whose scatter is taken as the Monte Carlo's own standard uncertainty."""
ENOUGH_BLOCKS = 30
"""Blocks whose scatter is known well enough to make them longer instead of more."""
FIRST_LOOK = 20
"""Blocks before an adaptive count is first judged: the decision needs a surer scatter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """What a model returns for one block of m trials.

    `values` (outputs, m): the outputs of the model. `linear` (outputs, m): their first-order
    form, evaluated on the same draws. The engine reads the arrays before the next `draw` in the
    same thread and never writes to them, so a model may return arrays of its `Workspace`.
    """

    values: FloatArray
    linear: FloatArray | None = None


class TrialModel(Protocol):
    """A model that can draw m independent trials of all its outputs.

    `names`: one for each output. `linear_mean` (outputs,): exact expectation of
    `Draws.linear`; None where the model has no first-order form.

    Optional attributes: `linear_variance` (outputs,), the exact variance of `linear`;
    `linear_quantiles`, from probabilities (n,) to exact quantiles (outputs, n) of `linear` less its
    mean, about which it is symmetric: nan in either where it is unknown. `u_exists` (outputs,) of
    bool, False where an output has no standard deviation (a t distribution of 2 degrees of freedom
    or fewer). `smooth` True: the outputs are smooth functions of what is drawn, nearly their
    first-order form, so that few trials tell how far they are from it. `in_pieces` True: `draw`
    keeps to the processor's cache, however large m is.

    `draw` is called from several threads at once and must take all randomness from `rng`.
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def linear_mean(self) -> FloatArray | None: ...

    def draw(self, rng: np.random.Generator, m: int) -> Draws: ...


def block_generator(seed: int, block: int) -> np.random.Generator:
    """The stream of one block: it depends on the seed and the block's number alone."""
    sequence = np.random.SeedSequence(seed, spawn_key=(block,))
    return np.random.Generator(np.random.SFC64(sequence))


def trials_for_tails(probability: float) -> int:
    """J = smallest integer at or above 100/(1 - p) of JCGM 101:2008, 7.9.4 b): 50 a tail."""
    return math.ceil(round(100.0 / (1.0 - probability), 6))


def least_block(probability: float, *, smooth: bool = False) -> int:
    """Fewest trials a block: J, or a quarter of it for a `smooth` model. The control takes off
    what so short a block's quantiles are biased by: it is the same for the first-order form.
    """
    return trials_for_tails(probability) // (4 if smooth else 1)


def is_one_block(trials: int | None, probability: float, *, smooth: bool = False) -> bool:
    """Whether that many trials are too few for blocks: no control variate is then used."""
    return trials is not None and trials < LEAST_BLOCKS * least_block(probability, smooth=smooth)


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of `size` trials; the first `longer` of them have one trial more.

    `blocks` is None where the count adapts. Equal blocks weigh the same in an average of
    block quantiles; a short last block would not.
    """

    probability: float
    size: int
    blocks: int | None
    longer: int = 0

    @classmethod
    def fixed(
        cls, trials: int, probability: float, *, smooth: bool = False, in_pieces: bool = False
    ) -> BlockPlan:
        """Exactly `trials`: one block where ten would be too short for their quantiles; longer
        blocks of a model that draws `in_pieces`.
        """
        if is_one_block(trials, probability, smooth=smooth):
            return cls(probability, trials, 1)
        least = trials_for_tails(probability)
        blocks = max(LEAST_BLOCKS, trials // max(FIXED_BLOCK, least))
        if in_pieces:
            blocks = max(min(blocks, ENOUGH_BLOCKS), trials // max(LONG_BLOCK, least))
        return cls(probability, trials // blocks, blocks, trials % blocks)

    @classmethod
    def adaptive(cls, probability: float, *, smooth: bool = False) -> BlockPlan:
        size = least_block(probability, smooth=smooth)
        return cls(probability, size if smooth else max(ADAPTIVE_BLOCK, size), None)

    def trials_in(self, block: int) -> int:
        return self.size + (block < self.longer)

    def first_trial(self, block: int) -> int:
        return self.size * block + min(block, self.longer)

    @property
    def end_probability(self) -> float:
        """(1 - p)/2, the probability beyond either end of the symmetric interval."""
        return 0.5 * (1.0 - self.probability)

    @cached_property
    def tail(self) -> int:
        """Ordered values kept at either end: 1 - p of the block and half as many again.

        The lower end of the shortest interval lies within the first share (JCGM 101:2008,
        7.7.2); the rest lets a second difference reach beyond it.
        """
        return min(self.size, math.ceil(1.5 * (1.0 - self.probability) * (self.size + 1)) + 2)

    @cached_property
    def end_weights(self) -> FloatArray:
        """Weights (tail,) of the ordered values that give the end of the symmetric interval."""
        return self.weights_at(self.end_probability * (self.size + 1))

    def weights_at(self, rank: float) -> FloatArray:
        """Weights (tail,) of the ordered values that estimate Q(a), a = rank/(m + 1).

        E y_(j) = Q(a) + a (1 - a) Q''(a) / (2 (m + 2)) + O(1/m^2) (David & Johnson 1954). The
        second term, 8e-4 u at an end of a normal output and m = 8192, would not average out over
        blocks. It is taken off, with Q'' from the ordered values by the central difference of
        fourth order, which is right to 2 % where the quantile runs as a logarithm.
        """
        at = self._interpolation
        m = self.size
        step = 0.25 * min(rank, m + 1 - rank)
        if rank - 2.0 * step < 1.0 or rank + 2.0 * step > self.tail:
            return at(rank)
        a, h = rank / (m + 1), step / (m + 1)
        near, far = at(rank - step) + at(rank + step), at(rank - 2 * step) + at(rank + 2 * step)
        second_derivative = (16.0 * near - far - 30.0 * at(rank)) / (12.0 * h * h)
        bias: FloatArray = a * (1.0 - a) / (2.0 * (m + 2)) * second_derivative
        return at(rank) - bias

    def expected_ordered(self, quantiles: Quantiles) -> FloatArray:
        """E y_(j) (outputs, tail) of a distribution of known `quantiles`, to the second order of
        `weights_at`; of a known function a near difference gives Q'' to a part in 1e3.
        """
        m = self.size
        a = np.arange(1, self.tail + 1) / (m + 1)
        h = np.minimum(a, 1.0 - a) / 16.0
        q = quantiles(a)
        second_derivative = (quantiles(a - h) - 2.0 * q + quantiles(a + h)) / (h * h)
        return q + a * (1.0 - a) / (2.0 * (m + 2)) * second_derivative

    def on_grid(self, ordered: FloatArray, m: int) -> FloatArray:
        """Ordered values (outputs, tail) of a block of `m` at the probabilities j/(size + 1)."""
        if m == self.size:
            return ordered[:, : self.tail]
        share = np.arange(1, self.tail + 1) / (self.size + 1)
        return ordered[:, : self.tail] + share * np.diff(ordered[:, : self.tail + 1], axis=1)

    def _interpolation(self, rank: float) -> FloatArray:
        weights = np.zeros(self.tail)
        j = min(max(1, math.floor(rank)), self.tail - 1)
        weights[j - 1], weights[j] = 1.0 - (rank - j), rank - j
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockSummary:
    """All that is kept of a block of `count` trials.

    `statistics` (4, outputs): mean, variance, low end, high end of the block. `controls`
    (4, outputs): the same statistics of the first-order form minus their exact expectation,
    so of mean zero; 0 where that is unknown. `squares` (outputs, outputs): sums of products about
    the block's mean. `tails` (2, outputs, tail): ordered values from the lowest up and from the
    highest down, on the plan's grid; `linear_tails` the same of the first-order form minus their
    expectation, 0 where that is unknown.
    """

    count: int
    statistics: FloatArray
    controls: FloatArray
    squares: FloatArray
    tails: FloatArray
    linear_tails: FloatArray


class BlockSummariser:
    """Turns the draws of a block into its summary; safe to call from several threads."""

    def __init__(self, model: TrialModel, plan: BlockPlan) -> None:
        self.plan = plan
        self.linear_mean = model.linear_mean
        unknown = np.full(len(model.names), np.nan)
        self.linear_variance: FloatArray = getattr(model, "linear_variance", unknown)
        quantiles: Quantiles | None = getattr(model, "linear_quantiles", None)
        self._knows_ends = quantiles is not None and self.linear_mean is not None
        if self._knows_ends and quantiles is not None:
            self._end = quantiles(np.array([plan.end_probability]))[:, 0]
            self._expected = plan.expected_ordered(quantiles)
        self._work = Workspace()

    def summarise(self, draws: Draws) -> BlockSummary:
        """Summary of one block of finite values."""
        values = draws.values
        m = values.shape[1]
        mean = values.mean(axis=1)
        centred = self._work.array("centred", values.shape)
        np.subtract(values, mean[:, np.newaxis], out=centred)
        squares = centred @ centred.T
        lower, upper = self._tails(values)
        weights = self.plan.end_weights
        ends = lower @ weights, upper @ weights
        controls, linear_tails = self._control(draws)
        return BlockSummary(
            count=m,
            statistics=np.array([mean, np.diagonal(squares) / (m - 1), *ends]),
            controls=controls,
            squares=squares,
            tails=np.array([lower, upper]),
            linear_tails=linear_tails,
        )

    def _tails(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ordered values of a block (outputs, tail), from the lowest up and the highest down."""
        m = values.shape[1]
        n = min(self.plan.tail + 1, m)
        if 2 * n < m:
            parted = np.partition(values, (n - 1, m - n), axis=1)
            lower, upper = np.sort(parted[:, :n], axis=1), np.sort(parted[:, m - n :], axis=1)
        else:
            ordered = np.sort(values, axis=1)
            lower, upper = ordered[:, :n], ordered[:, m - n :]
        upper = np.ascontiguousarray(upper[:, ::-1])
        return self.plan.on_grid(lower, m), self.plan.on_grid(upper, m)

    def _control(self, draws: Draws) -> tuple[FloatArray, FloatArray]:
        linear, mean, outputs = draws.linear, self.linear_mean, len(draws.values)
        controls = np.zeros((4, outputs))
        if linear is None or mean is None:
            return controls, np.zeros((2, outputs, self.plan.tail))
        average = linear.mean(axis=1)
        centred = self._work.array("centred", linear.shape)
        np.subtract(linear, average[:, np.newaxis], out=centred)
        variance = np.einsum("ij,ij->i", centred, centred) / (linear.shape[1] - 1)
        controls[0] = average - mean
        controls[1] = variance - self.linear_variance
        if not self._knows_ends:
            return np.nan_to_num(controls), np.zeros((2, outputs, self.plan.tail))
        lower, upper = self._tails(linear)
        weights, column = self.plan.end_weights, mean[:, np.newaxis]
        controls[2] = lower @ weights - (mean + self._end)
        controls[3] = upper @ weights - (mean - self._end)
        tails = np.array([lower - (column + self._expected), upper - (column - self._expected)])
        return np.nan_to_num(controls), np.nan_to_num(tails)
