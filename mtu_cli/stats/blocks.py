"""Blocks of Monte Carlo trials: how long they are, what a model draws, what is kept of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace

Quantiles = Callable[[FloatArray], FloatArray]

FIXED_BLOCK = 8192
"""Trials a block for a given count: 26 inputs of a block are 1.7 MB and stay in cache."""
ADAPTIVE_BLOCK = 2048
"""Trials a block for an adaptive count: small, so that a first look has many blocks."""
LEAST_BLOCKS = 10
"""Fewest blocks whose scatter is taken as the Monte Carlo's own standard uncertainty."""
FIRST_LOOK = 20
"""Blocks before an adaptive count is first judged: the decision needs a surer scatter."""
WITH_STENCIL = 8
"""First rank with a stencil: one on the very first values would multiply what scatters most."""
QUANTILES = 65
"""Quantiles kept at either end, an odd number: the shortest interval lies between two of them, by
a parabola, to 1e-5 u."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """What a model returns for one block of m trials: `values` (outputs, m) and their first-order
    form `linear` (outputs, m) on the same draws. The engine reads the arrays before the next `draw`
    in the same thread and never writes to them: they may be of the model's `Workspace`.
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
    first-order form, so that few trials tell how far they are from it.

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


def least_block(probability: float, *, smooth: bool = False) -> int:
    """Fewest trials a block: J of JCGM 101:2008, 7.9.4 b), the smallest integer at or above
    100/(1 - p), or a quarter of it for a `smooth` model. The control takes off what so short a
    block's quantiles are biased by: it is the same for the first-order form.
    """
    return math.ceil(round(100.0 / (1.0 - probability), 6)) // (4 if smooth else 1)


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of `size` trials, the first `longer` of them of one more; `blocks` is None where the
    count adapts. Equal blocks weigh the same in an average of block quantiles.
    """

    probability: float
    size: int
    blocks: int | None
    longer: int = 0

    @classmethod
    def fixed(cls, trials: int, probability: float, *, smooth: bool = False) -> BlockPlan:
        """Exactly `trials`: one block, without the control variate, where ten would be too short
        for their quantiles.
        """
        if trials < LEAST_BLOCKS * least_block(probability, smooth=smooth):
            return cls(probability, trials, 1)
        blocks = max(LEAST_BLOCKS, trials // max(FIXED_BLOCK, least_block(probability)))
        return cls(probability, trials // blocks, blocks, trials % blocks)

    @classmethod
    def adaptive(cls, probability: float, *, smooth: bool = False) -> BlockPlan:
        size = least_block(probability, smooth=smooth)
        return cls(probability, size if smooth else max(ADAPTIVE_BLOCK, size), None)

    @property
    def total(self) -> int | None:
        """All trials; None where the count adapts."""
        return None if self.blocks is None else self.size * self.blocks + self.longer

    def trials_in(self, block: int) -> int:
        return self.size + (block < self.longer)

    def first_trial(self, block: int) -> int:
        return self.size * block + min(block, self.longer)

    @cached_property
    def shares(self) -> FloatArray:
        """Probabilities (n,), rising, of the quantiles kept at either end of a block, from that of
        the first ordered value: denser towards both ends, and alike about (1 - p)/2, as the partner
        of a in an interval of probability p is 1 - p - a.
        """
        end = 0.5 * (1.0 - self.probability)
        first = min(1.0 / (self.size + 1), end)
        return end + (end - first) * np.sin(np.linspace(-np.pi / 2, np.pi / 2, QUANTILES))

    def weights(self, m: int) -> FloatArray:
        """Weights (tail, n) of the ordered values of a block of `m` that estimate Q at `shares`."""
        if m not in self._weights:
            tail = min(m, math.ceil(1.5 * (1.0 - self.probability) * (m + 1)) + 2)
            columns = [_of_rank(share * (m + 1), m, tail) for share in self.shares]
            self._weights[m] = np.column_stack(columns)
        return self._weights[m]

    @cached_property
    def _weights(self) -> dict[int, FloatArray]:
        return {}


def _of_rank(rank: float, m: int, tail: int) -> FloatArray:
    """Weights (tail,) of the first ordered values of m that estimate Q(a), a = rank/(m + 1).

    E y_(j) = Q(a) + a (1 - a) Q''(a) / (2 (m + 2)) + O(1/m^2) (David & Johnson 1954). The
    second term, 8e-4 u at an end of a normal output and m = 8192, would not average out over
    blocks. It is taken off, with Q'' from the ordered values by the central difference of
    fourth order, which is right to 2 % where the quantile runs as a logarithm.
    """

    def at(rank: float) -> FloatArray:
        weights = np.zeros(tail)
        j = min(max(1, math.floor(rank)), tail - 1)
        weights[j - 1], weights[j] = 1.0 - (rank - j), rank - j
        return weights

    step = 0.25 * min(rank, m + 1 - rank)
    if rank < WITH_STENCIL or rank + 2.0 * step > tail:
        return at(rank)
    a, h = rank / (m + 1), step / (m + 1)
    near, far = at(rank - step) + at(rank + step), at(rank - 2 * step) + at(rank + 2 * step)
    second_derivative = (16.0 * near - far - 30.0 * at(rank)) / (12.0 * h * h)
    bias: FloatArray = a * (1.0 - a) / (2.0 * (m + 2)) * second_derivative
    return at(rank) - bias


@dataclass(frozen=True, slots=True)
class BlockSummary:
    """All that is kept of a block of `count` trials: `statistics` (2 + 2 n, outputs) mean,
    variance, and the quantiles at the plan's n shares from below and from above; `controls` the
    same of the first-order form minus their exact values, 0 where unknown; `squares` (outputs,
    outputs) sums of products about the block's mean.
    """

    count: int
    statistics: FloatArray
    controls: FloatArray
    squares: FloatArray


class BlockSummariser:
    """Turns the draws of a block into its summary; safe to call from several threads."""

    def __init__(self, model: TrialModel, plan: BlockPlan) -> None:
        self.plan = plan
        outputs, n = len(model.names), QUANTILES
        self._exact = np.full((2 + 2 * n, outputs), np.nan)
        if (mean := model.linear_mean) is not None:
            self._exact[0] = mean
            self._exact[1] = getattr(model, "linear_variance", np.nan)
            quantiles: Quantiles | None = getattr(model, "linear_quantiles", None)
            if quantiles is not None:
                away = quantiles(plan.shares).T
                self._exact[2 : 2 + n], self._exact[2 + n :] = mean + away, mean - away
        self._work = Workspace()

    def summarise(self, draws: Draws) -> BlockSummary:
        """Summary of one block of finite values."""
        statistics, centred = self._statistics(draws.values)
        squares = centred @ centred.T
        statistics[1] = np.diagonal(squares) / (draws.values.shape[1] - 1)
        controls = np.zeros_like(statistics)
        if draws.linear is not None and not np.isnan(self._exact[0]).all():
            controls = np.nan_to_num(self._statistics(draws.linear)[0] - self._exact)
        return BlockSummary(draws.values.shape[1], statistics, controls, squares)

    def _statistics(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Those of a block (outputs, m), and its values less their mean."""
        m = values.shape[1]
        mean = values.mean(axis=1)
        centred = self._work.array("centred", values.shape)
        np.subtract(values, mean[:, np.newaxis], out=centred)
        variance = np.einsum("ij,ij->i", centred, centred) / (m - 1)
        weights = self.plan.weights(m)
        n = len(weights)
        if 2 * n < m:
            # numpy is several times quicker to part at one place than at two.
            parted = np.partition(values, n - 1, axis=1)
            rest = np.partition(parted[:, n:], m - 2 * n, axis=1)
            lower, upper = np.sort(parted[:, :n], axis=1), np.sort(rest[:, m - 2 * n :], axis=1)
        else:
            ordered = np.sort(values, axis=1)
            lower, upper = ordered[:, :n], ordered[:, m - n :]
        return np.vstack(
            [mean, variance, (lower @ weights).T, (upper[:, ::-1] @ weights).T]
        ), centred
