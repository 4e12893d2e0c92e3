"""Blocks run on threads, their summaries taken in the order of their numbers."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import InputError, finding
from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.blocks import (
    BlockSummariser,
    BlockSummary,
    Draws,
    TrialModel,
    block_generator,
    not_finite_in,
)
from mtu_cli.stats.pooling import Pool
from mtu_cli.stats.threads import one_blas_thread

FloatArray = NDArray[np.float64]
_Done = tuple[int, NDArray[np.int64], BlockSummary | None]

MOST_THREADS = 8
"""Each thread holds its own scratch arrays: more would break the memory promised."""
AHEAD = 4
"""Blocks submitted ahead for each thread: bounds what waits to be pooled."""


def available_threads() -> int:
    """Processors this process may use, at most `MOST_THREADS`."""
    if hasattr(os, "sched_getaffinity"):
        return min(MOST_THREADS, len(os.sched_getaffinity(0)))
    return min(MOST_THREADS, os.cpu_count() or 1)


class BlockRunner:
    """Runs the blocks of a plan; `trials` and `blocks` count what has been done. `summariser`
    is theirs, `draws` all that was drawn where they are short.

    Linear algebra is held to one thread of its own meanwhile: blocks are the unit of
    parallel work, and a product split among threads would not give the same bits.
    """

    def __init__(
        self,
        model: TrialModel,
        plan: BlockPlan,
        seed: int,
        threads: int,
        keep: int,
        progress: Callable[[int, int | None], None] | None,
    ) -> None:
        self._model, self._plan, self._seed, self._threads = model, plan, seed, threads
        self.summariser = BlockSummariser(model, plan)
        # Untouched pages of an empty array take no memory.
        self._samples = np.empty((len(model.names), keep))
        self._progress = progress
        self.draws: list[Draws] = []
        self.trials = 0
        self.blocks = 0

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        self._stack.enter_context(one_blas_thread())
        self._executor: ThreadPoolExecutor | None = None
        if self._threads > 1 and self._plan.blocks != 1 and not self._plan.is_short:
            self._executor = self._stack.enter_context(ThreadPoolExecutor(self._threads))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def is_short(self) -> bool:
        """Whether the plan is one of short blocks."""
        return self._plan.is_short

    def run_to(self, goal: int, pool: Pool) -> None:
        """Runs blocks up to number `goal`, exclusive, and adds them to `pool` in order."""
        for count, not_finite, summary in self._done(self.blocks, goal):
            self._count(count, not_finite)
            if summary is not None:
                pool.add(summary)
        for summary in self.summariser.summarise_short(self.draws[pool.blocks :]):
            pool.add(summary)

    def only_block(self) -> FloatArray:
        """The values (outputs, m) of a plan of one block."""
        m = self._plan.trials_in(0)
        draws = self._model.draw(block_generator(self._seed, 0), m)
        self._count(m, not_finite_in(draws))
        self._keep(draws.values, 0)
        return draws.values

    def samples(self) -> FloatArray:
        """The first trials (outputs, kept), in order."""
        return self._samples[:, : self.trials]

    def _block(self, block: int) -> _Done:
        m = self._plan.trials_in(block)
        draws = self._model.draw(block_generator(self._seed, block), m)
        not_finite = not_finite_in(draws)
        if np.any(not_finite):
            return m, not_finite, None
        self._keep(draws.values, self._plan.first_trial(block))
        if self._plan.is_short:
            self.draws.append(draws.copy())
            return m, not_finite, None
        return m, not_finite, self.summariser.summarise(draws)

    def _keep(self, values: FloatArray, start: int) -> None:
        room = self._samples.shape[1] - start
        if room > 0:
            part = values[:, :room]
            self._samples[:, start : start + part.shape[1]] = part

    def _done(self, start: int, stop: int) -> Iterator[_Done]:
        if self._executor is None:
            yield from map(self._block, range(start, stop))
            return
        waiting: deque[Future[_Done]] = deque()
        for block in range(start, stop):
            if len(waiting) >= AHEAD * self._threads:
                yield waiting.popleft().result()
            waiting.append(self._executor.submit(self._block, block))
        while waiting:
            yield waiting.popleft().result()

    def _count(self, trials: int, not_finite: NDArray[np.int64]) -> None:
        self.blocks += 1
        self.trials += trials
        if np.any(not_finite):
            raise InputError(
                finding(
                    "no-finite-value",
                    output=name,
                    what=repr(name),
                    where=f" in {bad} of the first {self.trials} Monte Carlo trials",
                    expected="a model that is defined for all values its inputs may take",
                )
                for name, bad in zip(self._model.names, not_finite, strict=True)
                if bad
            )
        if self._progress is not None:
            plan = self._plan
            total = None if plan.blocks is None else plan.size * plan.blocks + plan.longer
            self._progress(self.trials, total)
