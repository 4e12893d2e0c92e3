"""A package's process, and what it can be asked for."""

from __future__ import annotations

import gc
import json
import os
import resource
import statistics
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

from peers_bench.problem import Inputs
from peers_bench.tools import OURS, TOOLS, Tool, least

CALLS = 11
"""Calls of first order a round at most: one alone is too short to time."""
LONG = 0.5
"""Seconds after which no further call is made."""
AS_THE_COMMAND = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Set to 1 by the command `mtu` before anything else (`cli/process.py`): its threads run blocks."""
ONE_THREAD = (*AS_THE_COMMAND, "OPENTURNS_NUM_THREADS", "TBB_NUM_THREADS")


class Worker:
    """A package's process; `threads` None leaves the package its own choice."""

    def __init__(self, tool: Tool, inputs: Path, threads: int | None) -> None:
        self.tool = tool
        limits = {} if threads is None else dict.fromkeys(ONE_THREAD, str(threads))
        if tool.package == OURS.package:
            limits |= dict.fromkeys(AS_THE_COMMAND, "1")
        self._pool = ProcessPoolExecutor(
            1, get_context("spawn"), initializer=begin, initargs=(tool.name, inputs, threads)
        )
        with patch.dict(os.environ, {"PYTHONWARNINGS": "ignore", **limits}):
            self.ask("least")

    def ask(self, do: str, **given: Any) -> dict[str, Any]:
        """The answer to one request. Raises BrokenProcessPool where the process has ended."""
        return self._pool.submit(answer, do, given).result()

    def close(self) -> None:
        self._pool.shutdown()


@contextmanager
def workers(
    tools: Sequence[Tool], inputs: Path, threads: int | None, *, warm: bool = True
) -> Iterator[list[Worker]]:
    """A process for each tool; what is loaded or compiled at the first call is paid untimed."""
    started = [Worker(tool, inputs, threads) for tool in tools]
    try:
        for worker in started if warm else ():
            worker.ask("drawn" if worker.tool.draw else "first_order")
        yield started
    finally:
        for worker in started:
            worker.close()


class Work:
    """What a package can be asked for."""

    def __init__(self, tool: Tool, inputs: Inputs, threads: int | None) -> None:
        self.tool, self.inputs, self.threads = tool, inputs, threads

    def drawn(self, trials: int = 20_000, seed: int = 1) -> dict[str, Any]:
        """One Monte Carlo from the inputs to u and the ends: elapsed and processor time."""
        assert self.tool.draw is not None
        gc.collect()
        start, used = time.perf_counter(), time.process_time()
        found = self.tool.draw(self.tool.build(self.inputs), trials, seed, self.threads)
        seconds, cpu = time.perf_counter() - start, time.process_time() - used
        return {"seconds": seconds, "cpu": cpu, "found": found}

    def first_order(self) -> dict[str, Any]:
        """Value and u, and the median processor time of some calls, set-up included.

        Not the elapsed time: on a busy machine a long call is interrupted, a short one is not.
        """
        assert self.tool.propagate is not None
        cpu: list[float] = []
        while len(cpu) < CALLS and sum(cpu) < LONG:
            start = time.process_time()
            found = self.tool.propagate(self.tool.build(self.inputs))
            cpu.append(time.process_time() - start)
        return {"cpu": statistics.median(cpu), "found": found}

    def memory(self, trials: int) -> dict[str, Any]:
        """Largest memory in MiB of a run, beyond that of the process before it."""
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        self.drawn(trials)
        return {"added": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024}

    def least(self) -> dict[str, Any]:
        return {"trials": least()}


work: Work
"""Of a package's process."""


def begin(name: str, inputs: Path, threads: int | None) -> None:
    """At the start of a package's process; what the package prints is no output of ours."""
    os.dup2(2, 1)
    global work
    work = Work(TOOLS[name], Inputs(*json.loads(inputs.read_text())), threads)


def answer(do: str, given: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = getattr(work, do)(**given)
    return found
