"""Runs everything in one go, each package on one thread, and prints the tables; see the package."""

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from statistics import NormalDist
from unittest.mock import patch

from peers_bench.problem import ARCSEC
from peers_bench.tools import BARE, OURS, PEERS, Drawn, Tool, begin, drawn, least

TRIALS = 1_000_000
WANTED_TRIALS, WANTED_ACCURACY = 2.5, 50.0
"""How much longer the fastest peer is to take, at equal trials and at equal accuracy."""
OF_U, OF_ENDS = 0.001, 0.01
"""Standard errors wanted, of u relative and of the ends of the 95 % interval over u."""
RUNS = 50
"""Runs whose scatter is looked at."""
SIGMAS = 4.5
"""Standard errors that the largest of some twenty differences does not reach by chance."""
ONE_THREAD = (
    *("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"),
    *("OPENTURNS_NUM_THREADS", "TBB_NUM_THREADS"),
)


class DisagreementError(Exception):
    """Two packages answer the same question differently, or one not as accurately as it says."""


class Worker:
    """A package's process; what is loaded or compiled at the first call is paid untimed."""

    def __init__(self, tool: Tool, inputs: Path) -> None:
        self.tool, self.inputs = tool, inputs
        self.pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=begin)
        limits = dict.fromkeys(ONE_THREAD, "1")
        with patch.dict(os.environ, {"PYTHONWARNINGS": "ignore", **limits}):
            self.drawn(20_000, 1)

    def drawn(self, trials: int, seed: int) -> Drawn:
        """Raises BrokenProcessPool where the process has ended."""
        return self.pool.submit(drawn, self.tool.name, self.inputs, trials, seed).result()


def plain_errors(trials: int) -> list[float]:
    """Standard errors over u of u and of both ends, by plain Monte Carlo of a normal quantity.

    1/sqrt(2 n) and sqrt(a (1 - a)/n) / phi(z_a) (JCGM 101:2008, 7.9.4, note; asymptotic).
    """
    a = 0.025
    end = math.sqrt(a * (1 - a) / trials) / NormalDist().pdf(NormalDist().inv_cdf(a))
    return [1 / math.sqrt(2 * trials), end, end]


def needed(tool: Tool) -> int:
    """Trials for the accuracy that is wanted: `mtu`'s fewest, plain Monte Carlo's of the others."""
    if tool == OURS:
        return least()
    u, end, _ = plain_errors(1)
    return math.ceil(round(max((u / OF_U) ** 2, (end / OF_ENDS) ** 2), 6))


def main() -> int:
    parser = argparse.ArgumentParser(prog="peers_bench")
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    print(f"{os.cpu_count()} cores; load {os.getloadavg()[0]:.1f}; medians of {rounds} rounds")
    versions = {tool.name: tool.installed or "not installed" for tool in (OURS, *PEERS)}
    print(", ".join(f"{name} {number}" for name, number in versions.items()))
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "inputs.json"
        subprocess.run([sys.executable, "-m", "peers_bench.problem", inputs], check=True)
        present = [tool for tool in PEERS if tool.installed]
        bare, ours, *peers = (Worker(tool, inputs) for tool in (BARE, OURS, *present))
        agreement(ours, peers)
        accuracy(ours)
        goal = f"equal accuracy (u to {OF_U:.1%} and ends to {OF_ENDS:.0%} of u)"
        workers = [bare, ours, *peers]
        met = [
            compared("equal trials", workers, lambda tool: TRIALS, rounds, WANTED_TRIALS),
            compared(goal, workers, needed, rounds, WANTED_ACCURACY),
        ]
        for worker in workers:
            worker.pool.shutdown()
    return int(not all(met))


def agreement(ours: Worker, peers: Sequence[Worker]) -> None:
    """The results of the peers against those of `mtu`."""
    trials = 100_000
    _, own = ours.drawn(10 * trials, 7)
    print(f"mtu: u {ARCSEC * own[0]:.4f} arcsec")
    for worker in peers:
        _, found = worker.drawn(trials, 11)
        errors = plain_errors(trials)
        off = [(a - b) / own[0] / se for a, b, se in zip(found, own[:3], errors, strict=True)]
        said = f"{worker.tool.name}: u, low, high off by " + ", ".join(f"{x:+.1f}" for x in off)
        if max(map(abs, off)) > SIGMAS:
            raise DisagreementError(said)
        print(f"{said} se")


def accuracy(ours: Worker) -> None:
    """Results of many runs of `mtu`: as accurate as is wanted and as it states."""
    found = [ours.drawn(needed(OURS), 1000 + i)[1] for i in range(RUNS)]
    columns = [*zip(*found, strict=True)]
    u = statistics.mean(columns[0])
    seen = [statistics.stdev(column) / u for column in columns[:3]]
    stated = [statistics.mean(se * se for se in column) ** 0.5 / u for column in columns[3:]]
    ratios = [a / b for a, b in zip(seen, stated, strict=True)]
    said = f"mtu: scatter of {RUNS} runs: u {seen[0]:.1e}, ends {max(seen[1:]):.1e} u; over what "
    said += "is stated: " + ", ".join(f"{ratio:.2f}" for ratio in ratios)
    # Four standard errors, relative, of a standard deviation from that many runs.
    far = max(abs(ratio - 1) for ratio in ratios) > 4 / math.sqrt(2 * (RUNS - 1))
    if far or seen[0] > OF_U or max(seen[1:]) > OF_ENDS:
        raise DisagreementError(f"{said}; wanted are {OF_U} and {OF_ENDS}")
    print(said)


def compared(
    kind: str, workers: Sequence[Worker], trials: Callable[[Tool], int], rounds: int, wanted: float
) -> bool:
    """Every worker's Monte Carlo in every round, each with a seed of its own: medians of the times
    over those of the bare normals and of `mtu`; False where the fastest peer is not slow enough.
    """
    seconds: dict[str, list[float]] = {worker.tool.name: [] for worker in workers}
    for number in range(rounds):
        for place, worker in enumerate(workers):
            took, _ = worker.drawn(trials(worker.tool), 100 * (number + 1) + place)
            seconds[worker.tool.name].append(took)
    over = {
        name: [
            statistics.median(a / b for a, b in zip(own, seconds[other.name], strict=True))
            for other in (BARE, OURS)
        ]
        for name, own in seconds.items()
    }
    print(f"\n{kind}\n{'':12}{'trials':>10}{'/ bare':>9}{'/ mtu':>9}")
    for worker in workers:
        name = worker.tool.name
        ratios = "".join(f"{ratio:9.2f}" for ratio in over[name])
        print(f"{name:12}{trials(worker.tool):10}{ratios}")
    peers = {worker.tool.name: over[worker.tool.name][1] for worker in workers[2:]}
    if not peers:
        print("no peer is installed: nothing to judge")
        return True
    fastest = min(peers, key=peers.__getitem__)
    met = peers[fastest] >= wanted
    print(f"{fastest} takes {peers[fastest]:.2f} x mtu; {wanted:g} x {'met' if met else 'missed'}")
    return met


if __name__ == "__main__":
    sys.exit(main())
