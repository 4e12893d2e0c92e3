"""The process of one package: reads what to do, a line of JSON each, and answers with one."""

from __future__ import annotations

import gc
import json
import os
import resource
import statistics
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

from peers_bench.problem import Inputs
from peers_bench.tools import Tool, tool_named

WARM_UP = 20_000
"""Trials of the untimed first call: few, but as many as make `mtu` use all of its core."""
CALLS = 11
"""Calls of first order a round at most: one alone is too short to time."""
LONG = 0.5
"""Seconds after which no further call is made."""


class Work:
    """What a package can be asked for."""

    def __init__(self, tool: Tool, inputs: Inputs, threads: int | None) -> None:
        module = import_module(f"peers_bench.tools.{tool.module}")
        self.inputs, self.threads = inputs, threads
        self.monte_carlo = module.MONTE_CARLO.get(tool.form)
        self.propagate = module.FIRST_ORDER.get(tool.form)

    def warm_up(self) -> dict[str, Any]:
        """Once, untimed: what is loaded or compiled at the first call is paid here."""
        if self.monte_carlo is not None:
            self.monte_carlo(self.inputs, WARM_UP, 1, self.threads)
        return {}

    def drawn(self, trials: int, seed: int) -> dict[str, Any]:
        """One Monte Carlo from the inputs to u and the ends: elapsed and processor time."""
        gc.collect()
        start, used = time.perf_counter(), time.process_time()
        found = self.monte_carlo(self.inputs, trials, seed, self.threads)
        seconds, cpu = time.perf_counter() - start, time.process_time() - used
        return {"seconds": seconds, "cpu": cpu, "found": list(found)}

    def scatter(self, trials: int, runs: int) -> dict[str, Any]:
        """Results of many small runs."""
        return {
            "found": [
                list(self.monte_carlo(self.inputs, trials, 1000 + seed, self.threads))
                for seed in range(runs)
            ]
        }

    def first_order(self) -> dict[str, Any]:
        """Value and u, and the median processor time of some calls.

        Not the elapsed time: on a busy machine a long call is interrupted, a short one is not.
        """
        found: tuple[float, float] = (0.0, 0.0)
        cpu: list[float] = []
        while len(cpu) < CALLS and sum(cpu) < LONG:
            start = time.process_time()
            found = self.propagate(self.inputs)
            cpu.append(time.process_time() - start)
        return {"cpu": statistics.median(cpu), "found": list(found)}

    def memory(self, trials: int) -> dict[str, Any]:
        """Largest memory in MiB of a run, beyond that of the process before it."""
        before = _peak()
        self.monte_carlo(self.inputs, trials, 1, self.threads)
        return {"added": _peak() - before, "whole": _peak()}

    def claimed(self, trials: int, runs: int) -> dict[str, Any]:
        """Standard errors over u that `mtu` states for its own results: of u, low, high."""
        from peers_bench.tools.with_mtu import run

        errors = []
        for seed in range(runs):
            result = run(trials, 1000 + seed, self.threads)
            stated = (result.se_u, result.se_low, result.se_high)
            errors.append([float(se[0] / result.u[0]) for se in stated])
        return {"errors": errors}

    def least(self) -> dict[str, Any]:
        """The fewest trials with which `mtu` uses its control variate."""
        from peers_bench.tools.with_mtu import LEAST

        return {"trials": LEAST}


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    name, path, threads = sys.argv[1:]
    # What packages print must not come between the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    work = Work(tool_named(name), Inputs.read(Path(path)), int(threads) or None)
    for line in sys.stdin:
        asked = json.loads(line)
        answer = getattr(work, asked.pop("do"))(**asked)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
