"""Processes of the packages, kept waiting; one works at a time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from peers_bench.tools import OURS, Tool

ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENTURNS_NUM_THREADS",
    "TBB_NUM_THREADS",
)


AS_THE_COMMAND = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Set to 1 by the command `mtu` before anything else (`cli/process.py`): its threads run blocks."""


class Worker:
    """A package's process; `threads` None leaves the package its own choice.

    This module and what imports it stay small: Linux counts the memory of the process that
    starts another into the other's peak.
    """

    def __init__(self, tool: Tool, inputs: Path, threads: int | None) -> None:
        self.tool = tool
        limits = {} if threads is None else dict.fromkeys(ONE_THREAD, str(threads))
        if tool.package == OURS.package:
            limits |= dict.fromkeys(AS_THE_COMMAND, "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "peers_bench.worker", tool.name, inputs, str(threads or 0)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONWARNINGS": "ignore", **limits},
        )

    def ask(self, do: str, **given: Any) -> dict[str, Any]:
        """The answer to one request.

        Raises RuntimeError where the package's process has ended instead.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"do": do, **given}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.tool.name} ended with {self._process.wait()} at {do!r}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


@contextmanager
def workers(tools: Sequence[Tool], inputs: Path, threads: int | None) -> Iterator[list[Worker]]:
    """A process for each tool, warmed up."""
    started = [Worker(tool, inputs, threads) for tool in tools]
    try:
        for worker in started:
            worker.ask("warm_up")
        yield started
    finally:
        for worker in started:
            worker.close()
