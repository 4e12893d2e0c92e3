"""How many trials go into which block, and how a block's quantiles are read from its order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.coverage import t_quantile
from mtu_cli.stats.distributions import quantile_curvature
from mtu_cli.stats.ordered_moments import end_weights

FloatArray = NDArray[np.float64]

FIXED_BLOCK = 8192
"""Trials a block for a given count: 26 inputs of a block are 1.7 MB and stay in cache."""
ADAPTIVE_BLOCK = 2048
"""Trials a block for an adaptive count: small, so that a first look has many blocks."""
LEAST_BLOCKS = 10
"""Fewest blocks whose scatter is taken as the Monte Carlo's own standard uncertainty."""
LONG_BLOCK = 2**15
"""Trials a block of a given count where the model draws them in pieces that stay in cache: what
a block costs by itself, whatever its length, is a tenth of a block of `FIXED_BLOCK`."""
ENOUGH_BLOCKS = 30
"""Blocks whose scatter is known well enough to make them longer instead of more."""
FIRST_LOOK = 20
"""Blocks before an adaptive count is first judged: the decision needs a surer scatter."""


def trials_for_tails(probability: float) -> int:
    """J = smallest integer at or above 100/(1 - p) of JCGM 101:2008, 7.9.4 b): 50 a tail."""
    return math.ceil(round(100.0 / (1.0 - probability), 6))


def is_one_block(trials: int | None, probability: float) -> bool:
    """Whether that many trials are too few for blocks: no control variate is then used.

    A smooth model is the exception, see `BlockPlan.short`.
    """
    return trials is not None and trials < LEAST_BLOCKS * trials_for_tails(probability)


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of `size` trials; the first `longer` of them have one trial more.

    `blocks` is None where the count adapts. Equal blocks weigh the same in an average of
    block quantiles; a short last block would not. `is_short`: blocks are too short for their
    quantiles to be averaged as they are; with the control variate they may be.
    """

    probability: float
    size: int
    blocks: int | None
    longer: int = 0
    is_short: bool = False

    @classmethod
    def fixed(
        cls, trials: int, probability: float, *, smooth: bool = False, in_pieces: bool = False
    ) -> BlockPlan:
        """Exactly `trials`: one block where ten would be too short for their quantiles.

        Blocks of a `smooth` model may be shorter, those of one that draws `in_pieces` longer
        (`TrialModel`).
        """
        least = trials_for_tails(probability)
        if is_one_block(trials, probability):
            if smooth and trials >= least:
                return cls.short(trials, probability)
            return cls(probability, trials, 1)
        blocks = max(LEAST_BLOCKS, trials // max(FIXED_BLOCK, least))
        if in_pieces:
            blocks = max(min(blocks, ENOUGH_BLOCKS), trials // max(LONG_BLOCK, least))
        return cls(probability, trials // blocks, blocks, trials % blocks)

    @classmethod
    def short(cls, trials: int, probability: float) -> BlockPlan:
        """Ten blocks or more, at most `FIRST_LOOK`, that have 50 trials a tail only together.

        That is 5 trials a tail in each at least. The bias of their quantiles is much the same as
        that of the first-order form's, whose exact quantiles are known: the control takes it
        off. Without one of use the whole sample is taken instead (`short_block_estimates`).
        """
        least = trials_for_tails(probability)
        blocks = min(FIRST_LOOK, LEAST_BLOCKS * trials // least)
        return cls(probability, trials // blocks, blocks, trials % blocks, is_short=True)

    @classmethod
    def adaptive(cls, probability: float) -> BlockPlan:
        return cls(probability, max(ADAPTIVE_BLOCK, trials_for_tails(probability)), None)

    def trials_in(self, block: int) -> int:
        return self.size + (block < self.longer)

    def first_trial(self, block: int) -> int:
        return self.size * block + min(block, self.longer)

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

    def unbiased_end_weights(self, dof: FloatArray | None) -> FloatArray:
        """The same for blocks that are short, for each output (outputs, tail) or (1, tail).

        For outputs nearly those of standard t with `dof` (outputs,), or of normal variables.
        """
        rank = self.end_probability * (self.size + 1)
        places = np.array([self._interpolation(share * rank) for share in (0.5, 1.0, 1.5)])
        weights = [
            end_weights(self.size, places, self.end_probability, value)
            for value in ([math.inf] if dof is None else dof.tolist())
        ]
        return np.array([self.end_weights if own is None else own for own in weights])

    def standard_ends(self, dof: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Quantiles of standard normal variables or, with `dof` (outputs,), of Student's t.

        At `end_probability`, (outputs,) or (1,), and the expected ordered values at the grid's
        probabilities a = j/(m + 1), (outputs, tail) or (1, tail): Q(a) and the second-order
        bias of `weights_at`.
        """
        listed = [math.inf] if dof is None else [float(value) for value in dof]
        # Outputs that share their degrees of freedom share their quantiles.
        known = {
            value: _standard(self.end_probability, self.size, self.tail, value)
            for value in dict.fromkeys(listed)
        }
        return (
            np.array([known[value][0] for value in listed]),
            np.array([known[value][1] for value in listed]),
        )

    @property
    def end_probability(self) -> float:
        """(1 - p)/2, the probability beyond either end of the symmetric interval."""
        return 0.5 * (1.0 - self.probability)

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


@lru_cache(maxsize=64)
def _standard(end: float, size: int, tail: int, dof: float) -> tuple[float, FloatArray]:
    """Quantile at `end` and expected ordered values (tail,); Monte Carlo runs of one plan share
    them, which take longer than a tenth of a short run.
    """
    grid = np.arange(1, tail + 1) / (size + 1)
    quantiles = t_quantile(np.concatenate([[end], grid]), dof)
    ordered = quantiles[1:]
    bias = grid * (1.0 - grid) / (2.0 * (size + 2)) * quantile_curvature(ordered, dof)
    found: FloatArray = ordered + bias
    found.flags.writeable = False
    return float(quantiles[0]), found
