"""Runs everything in one go and prints the tables; see the package."""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from peers_bench import accuracy, agreement, end_gauge, equal_accuracy, table
from peers_bench.rounds import Series, timed
from peers_bench.tools import ADAPTIVE, BARE, OURS, PEERS, Tool
from peers_bench.workers import Worker, workers

TRIALS = 1_000_000
WANTED_TRIALS = 3.0
WANTED_ACCURACY = 50.0
THREADS = (1, None)

Both = dict[int | None, dict[str, Series]]


def main() -> int:
    parser = argparse.ArgumentParser(prog="peers_bench")
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    print(f"{os.cpu_count()} cores; load {os.getloadavg()[0]:.1f}; medians of {rounds} rounds")
    present = [tool for tool in PEERS if tool.installed]
    versions = {tool.package: tool.installed or "not installed" for tool in (OURS, *PEERS)}
    print(", ".join(f"{name} {number}" for name, number in versions.items()))
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "inputs.json"
        subprocess.run([sys.executable, "-m", "peers_bench.problem", inputs], check=True)
        with workers([OURS, *present], inputs, None) as started:
            heading("Results against each other", agreement.check(started))
        equal, accurate = measured([t for t in present if t.monte_carlo], inputs, rounds)
        memory = memories([BARE, OURS, *(t for t in present if t.monte_carlo)], inputs)
        heading("Equal trials", table.monte_carlo(equal[1], equal[None], memory))
        heading("Equal accuracy", table.monte_carlo(accurate[1], accurate[None]))
        heading("First order", first_order([OURS, *present], inputs, rounds))
    heading("A process that does GUM H.1", processes(rounds))
    return judged(equal, accurate)


def heading(title: str, lines: Sequence[str]) -> None:
    print(f"\n{title}", *lines, sep="\n", flush=True)


def measured(peers: Sequence[Tool], inputs: Path, rounds: int) -> tuple[Both, Both]:
    """Series at equal trials and at equal accuracy, with one thread and with the default."""
    equal: Both = {}
    accurate: Both = {}
    for threads in THREADS:
        start = time.monotonic()
        with workers([BARE, OURS, *peers], inputs, threads) as started:
            equal[threads] = timed(started, lambda tool: TRIALS, rounds)
        with workers([BARE, OURS, ADAPTIVE, *peers], inputs, threads) as started:
            found = equal_accuracy.run(started, rounds, scatter_too=threads == 1)
        accurate[threads] = found.series
        said = found.lines
        if peers:
            said.append(equal_accuracy.unbiased(found.series[OURS.name], equal[threads], peers))
        name = "one thread" if threads else "default threads"
        heading(f"Accuracy, {name} ({time.monotonic() - start:.0f} s)", said)
    return equal, accurate


def memories(tools: Sequence[Tool], inputs: Path) -> dict[str, float]:
    """MiB that 1e6 trials add to a fresh process, default threads."""
    found: dict[str, float] = {}
    for tool in tools:
        worker = Worker(tool, inputs, None)
        try:
            found[tool.name] = worker.ask("memory", trials=TRIALS)["added"]
        finally:
            worker.close()
    return found


def first_order(tools: Sequence[Tool], inputs: Path, rounds: int) -> list[str]:
    """Processor time of first-order propagation, set-up included."""
    with workers(tools, inputs, 1) as started:
        cpu: dict[str, list[float]] = {tool.name: [] for tool in tools}
        for _ in range(rounds):
            for worker in started:
                cpu[worker.tool.name].append(worker.ask("first_order")["cpu"])
    rows = {tool.name: ("not installed", "") for tool in PEERS if not tool.installed}
    for name, own in cpu.items():
        over = statistics.median(a / b for a, b in zip(own, cpu[OURS.name], strict=True))
        rows[name] = (f"{over:.2f}", f"{1e3 * statistics.median(own):.2f}")
    return table.plain_rows(rows, ["/ mtu", "cpu ms"])


def processes(rounds: int) -> list[str]:
    found = end_gauge.run(rounds)
    rows = {name: ("not installed", "", "") for name in end_gauge.SCRIPTS if name not in found}
    for name, process in found.items():
        bare, ours = process.over(found["import numpy"]), process.over(found[OURS.package])
        rows[name] = (f"{bare:.2f}", f"{ours:.2f}", f"{statistics.median(process.seconds):.2f}")
    return table.plain_rows(rows, ["/ import numpy", "/ mtu", "s"])


def judged(equal: Both, accurate: Both) -> int:
    """Prints the fastest peer over ours; 1 where it is less than wanted with default threads."""
    missed = 0
    goal = f"u to {accuracy.OF_U:.1%} and ends to {accuracy.OF_ENDS:.0%} of u"
    print()
    for kind, both, wanted in (
        ("equal trials", equal, WANTED_TRIALS),
        (f"equal accuracy ({goal})", accurate, WANTED_ACCURACY),
    ):
        for threads in THREADS:
            best = table.fastest(both[threads])
            if best is None:
                print("no peer is installed: nothing to judge")
                return 0
            tool, ratio = best
            name = "one thread" if threads else "default threads"
            verdict = "met" if ratio >= wanted else "missed"
            print(f"{kind}, {name}: {tool.name} takes {ratio:.2f} x mtu; {wanted:g} x {verdict}")
            missed |= threads is None and ratio < wanted
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
