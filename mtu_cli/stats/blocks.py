"""Blocks of Monte Carlo trials: how long they are, what a model draws, what is kept of them, and
the arrays that a model uses again from block to block.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from mtu_cli.findings import error
from mtu_cli.stats.least_squares import FloatArray, IntArray


class Workspace(threading.local):
    """Named scratch arrays, whose memory is allocated once a thread, then used again.

    A fresh large array costs more in page faults than the arithmetic done on it. A model
    holds one `Workspace`, asks for its arrays by name in every call of `draw`, fills them
    with ``out=`` and may return them: the engine is done with a block's arrays before it
    draws the next block in the same thread.
    """

    def __init__(self) -> None:
        self._memory: dict[str, FloatArray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """An uninitialised C-ordered array of `shape`, in the memory of its name where that is
        enough, so that blocks of two lengths do not keep two sets nor make new ones in turn.
        """
        size = math.prod(shape)
        memory = self._memory.get(name)
        if memory is None or len(memory) < size:
            memory = self._memory[name] = np.empty(size)
        return memory[:size].reshape(shape)


Quantiles = Callable[[FloatArray], FloatArray]

AT_ONCE, VALUES_AT_ONCE = 16_000, 128_000
"""Trials that are drawn at once, in one long block or in several, and values of all outputs: their
arrays stay in cache, and rows that are no power of two apart do not drive each other out of it."""
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
    """What a model returns for m trials: `values` (outputs, m) and their first-order
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


def batch_generator(seed: int, batch: range) -> np.random.Generator:
    """The stream of blocks drawn at once: it depends on the seed and the first one alone."""
    sequence = np.random.SeedSequence(seed, spawn_key=(batch.start,))
    return np.random.Generator(np.random.SFC64(sequence))


def stream(seed: int, *key: int) -> np.random.Generator:
    """A generator that depends on `seed` and `key` alone: of every quantity that is simulated one,
    so that no draw moves another.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def least_block(probability: float, *, smooth: bool = False) -> int:
    """Fewest trials a block: J of JCGM 101:2008, 7.9.4 b), the smallest integer at or above
    100/(1 - p), or a quarter of it for a `smooth` model. The control takes off what so short a
    block's quantiles are biased by: it is the same for the first-order form.
    """
    return math.ceil(round(100.0 / (1.0 - probability), 6)) // (4 if smooth else 1)


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of `size` trials, the first `longer` of them of one more; `blocks` is None where the
    count adapts. Equal blocks weigh the same in an average of block quantiles. About `at_once`
    trials are drawn at once.
    """

    probability: float
    size: int
    blocks: int | None
    longer: int = 0
    at_once: int = AT_ONCE

    @classmethod
    def of(cls, model: TrialModel, trials: int | None, most: int, probability: float) -> BlockPlan:
        """Exactly `trials`, in one block, without the control variate, where ten would be too short
        for their quantiles. With None a count that adapts, in blocks as short as can be, so that a
        first look has many; or `most` trials, where these leave no room for one.

        Raises InputError for fewer trials than an interval has ends of.
        """
        fewest = math.ceil(round(2.0 / (1.0 - probability), 6))
        if (most if trials is None else trials) < fewest:
            expected = f"{fewest} or more for a {100 * probability:g} % interval"
            raise error("out-of-range", path="trials", value=str(trials), expected=expected)
        least = least_block(probability, smooth=bool(getattr(model, "smooth", False)))
        at_once = min(AT_ONCE, VALUES_AT_ONCE // len(model.names))
        if trials is None and most >= FIRST_LOOK * least:
            return cls(probability, least, None, at_once=at_once)
        trials = most if trials is None else trials
        if trials < LEAST_BLOCKS * least:
            return cls(probability, trials, 1)
        blocks = max(LEAST_BLOCKS, trials // max(at_once, least_block(probability)))
        return cls(probability, trials // blocks, blocks, trials % blocks, at_once)

    @property
    def total(self) -> int | None:
        """All trials; None where the count adapts."""
        return None if self.blocks is None else self.size * self.blocks + self.longer

    def batches(self, first: int, end: int) -> Iterator[range]:
        """Blocks `first` to `end` in runs of equal length that are drawn at once."""
        most = max(1, self.at_once // self.size)
        while first < end:
            stop = min(first + most, end, self.longer if first < self.longer else end)
            yield range(first, stop)
            first = stop

    def trials_in(self, block: int) -> int:
        return self.size + (block < self.longer)

    def first_trial(self, block: int) -> int:
        return self.size * block + min(block, self.longer)

    @property
    def shares(self) -> FloatArray:
        """Probabilities (n,), rising, of the quantiles kept at either end of a block, from that of
        the first ordered value: denser towards both ends, and alike about (1 - p)/2, as the partner
        of a in an interval of probability p is 1 - p - a.
        """
        end = 0.5 * (1.0 - self.probability)
        first = min(1.0 / (self.size + 1), end)
        return end + (end - first) * np.sin(np.linspace(-np.pi / 2, np.pi / 2, QUANTILES))


@dataclass(frozen=True, slots=True)
class Weights:
    """Estimates of n quantiles as sums of `weight` (r, n), 1 in all, times the ordered values at
    `place` (r, n), counted from 0, all of them among the first `tail`.
    """

    tail: int
    place: IntArray
    weight: FloatArray

    def __call__(self, ordered: FloatArray) -> FloatArray:
        """(..., n) of `ordered` (..., tail); of equal values that value, to the bit."""
        picked = ordered.take(self.place, axis=-1)
        near = picked[..., 0, :].copy()
        picked -= near[..., np.newaxis, :]
        result: FloatArray = near + np.einsum("...rn,rn->...n", picked, self.weight)
        return result


@lru_cache(64)
def weights_of(plan: BlockPlan, m: int) -> Weights:
    """Those of Q(a) at the shares a = rank/(m + 1) of a plan, from the values of a block of `m`.

    E y_(j) = Q(a) + a (1 - a) Q''(a) / (2 (m + 2)) + O(1/m^2) (David & Johnson 1954). The
    second term, 8e-4 u at an end of a normal output and m = 8192, would not average out over
    blocks. It is taken off, with Q'' from the ordered values by the central difference of
    fourth order, which is right to 2 % where the quantile runs as a logarithm.
    """
    tail = min(m, math.ceil(1.5 * (1.0 - plan.probability) * (m + 1)) + 2)
    a = plan.shares
    ranks = a * (m + 1)
    step = 0.25 * np.minimum(ranks, m + 1 - ranks)
    h = step / (m + 1)
    bias = a * (1.0 - a) / (2.0 * (m + 2)) / (12.0 * h * h)
    bias[(ranks < WITH_STENCIL) | (ranks + 2.0 * step > tail)] = 0.0
    share = np.array([1.0 + 30.0 * bias, *[-16.0 * bias] * 2, bias, bias])
    places = ranks + np.multiply.outer([0.0, -1.0, 1.0, -2.0, 2.0], step)
    after = np.clip(np.floor(places).astype(np.int64), 1, tail - 1)
    beyond = places - after
    place = np.concatenate([after - 1, after])
    return Weights(tail, place, np.concatenate([share * (1.0 - beyond), share * beyond]))


@dataclass(frozen=True, slots=True)
class BatchSummary:
    """All that is kept of h blocks of `size` trials: `statistics` (h, 2 + 2 n, outputs) mean,
    variance, and the quantiles at the plan's n shares from below and from above; `controls` the
    same of the first-order form minus their exact values, 0 where unknown.
    """

    size: int
    statistics: FloatArray
    controls: FloatArray


class BlockSummariser:
    """Turns draws of h blocks into their summary; safe to call from several threads."""

    def __init__(self, model: TrialModel, plan: BlockPlan) -> None:
        self.plan, self._work = plan, Workspace()
        outputs, n = len(model.names), QUANTILES
        exact = np.full((2 + 2 * n, outputs), np.nan)
        if (mean := model.linear_mean) is not None:
            exact[0] = mean
            exact[1] = getattr(model, "linear_variance", np.nan)
            quantiles: Quantiles | None = getattr(model, "linear_quantiles", None)
            if quantiles is not None:
                deviation = quantiles(plan.shares).T
                exact[2 : 2 + n], exact[2 + n :] = mean + deviation, mean - deviation
        self._finite = np.isfinite(exact)
        self._exact = np.where(self._finite, exact, 0.0)

    def summarise(self, draws: Draws, h: int) -> BatchSummary:
        """Summary of `h` equal blocks of finite values, one after the other."""
        outputs, count = draws.values.shape
        arrays, m = [draws.values], count // h
        if draws.linear is not None and self._finite.any():
            arrays.append(draws.linear)
        values = self._work.array("values", (len(arrays) * outputs, h, m))
        np.concatenate(arrays, out=values.reshape(-1, count))
        mean = values.mean(axis=2)
        centred = self._work.array("centred", values.shape)
        np.subtract(values, mean[:, :, np.newaxis], out=centred)
        summary = np.empty((h, len(self._exact), len(values)))
        summary[:, 0] = mean.T
        summary[:, 1] = np.einsum("ijk,ijk->ji", centred, centred) / (m - 1)
        weights = weights_of(self.plan, m)
        tail = weights.tail
        lower, upper = values[:, :, :tail], values[:, :, m - tail :]
        if 2 * tail < m:
            # numpy is several times quicker to part at one place than at two, or to sort all.
            values.partition(tail - 1, axis=2)
            values[:, :, tail:].partition(m - 2 * tail, axis=2)
            lower.sort(axis=2)
            upper.sort(axis=2)
        else:
            values.sort(axis=2)
        for ends, ordered in zip(
            np.split(summary[:, 2:], 2, axis=1), (lower, upper[:, :, ::-1]), strict=True
        ):
            ends[:] = weights(ordered).transpose(1, 2, 0)
        statistics, of_form = summary[:, :, :outputs], summary[:, :, outputs:]
        controls = (of_form - self._exact) * self._finite if len(arrays) > 1 else 0.0 * statistics
        return BatchSummary(m, statistics, controls)
