"""Runs everything in one go and prints the tables; see the package."""

from __future__ import annotations

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist

from peers_bench.problem import ARCSEC
from peers_bench.tools import ADAPTIVE, BARE, OURS, PEERS, Tool
from peers_bench.worker import Worker, workers

TRIALS = 1_000_000
WANTED_TRIALS, WANTED_ACCURACY = 2.5, 50.0
"""How much longer the fastest peer is to take, at equal trials and at equal accuracy."""
OF_U, OF_ENDS = 0.001, 0.01
"""Standard errors wanted, of u relative and of the ends of the 95 % interval over u."""
PART = 5
"""Of a slow form a fifth of the trials is timed; its times are multiplied by this."""
RUNS, SMALL = 50, 10_000
"""Runs whose scatter is looked at, and their trials where plain Monte Carlo is worth the same."""
SIGMAS = 4.5
"""Standard errors that the largest of some twenty differences does not reach by chance."""
FIRST_ORDER = 1e-5
"""Relative difference of first-order u: derivatives by differences have no more digits."""


class DisagreementError(Exception):
    """Two packages answer the same question differently, or one not as accurately as it says."""


@dataclass(frozen=True, slots=True)
class Series:
    """Elapsed and processor time, s, and u, low, high of a form, one for each round."""

    trials: int
    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    found: list[list[float]] = field(default_factory=list)

    def over(self, other: Series, what: str = "seconds") -> float:
        """Median over the rounds of the ratio of times."""
        pairs = zip(getattr(self, what), getattr(other, what), strict=True)
        return statistics.median(a / b for a, b in pairs)


def plain_errors(trials: int) -> list[float]:
    """Standard errors over u of u and of both ends, by plain Monte Carlo of a normal quantity.

    1/sqrt(2 n) and sqrt(a (1 - a)/n) / phi(z_a) (JCGM 101:2008, 7.9.4, note; asymptotic).
    """
    a = 0.025
    end = math.sqrt(a * (1 - a) / trials) / NormalDist().pdf(NormalDist().inv_cdf(a))
    return [1 / math.sqrt(2 * trials), end, end]


def plain_trials() -> int:
    """Trials with which plain Monte Carlo has both accuracies."""
    u, end, _ = plain_errors(1)
    return math.ceil(round(max((u / OF_U) ** 2, (end / OF_ENDS) ** 2), 6))


def main() -> int:
    parser = argparse.ArgumentParser(prog="peers_bench")
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    print(f"{os.cpu_count()} cores; load {os.getloadavg()[0]:.1f}; medians of {rounds} rounds")
    versions = {tool.package: tool.installed or "not installed" for tool in (OURS, *PEERS)}
    print(", ".join(f"{name} {number}" for name, number in versions.items()))
    present = [tool for tool in PEERS if tool.installed]
    drawing = [tool for tool in present if tool.draw]
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "inputs.json"
        subprocess.run([sys.executable, "-m", "peers_bench.problem", inputs], check=True)
        with workers([OURS, *present], inputs, None) as started:
            heading("Results against each other", agreement(started))
        equal, accurate = {}, {}
        for threads in (1, None):
            with workers([BARE, OURS, *drawing], inputs, threads) as started:
                equal[threads] = timed(started, lambda worker: TRIALS, rounds)
            with workers([BARE, OURS, ADAPTIVE, *drawing], inputs, threads) as started:
                if threads == 1:
                    # It does not depend on the threads.
                    heading("Accuracy", [scatter(worker) for worker in started[1:]])
                accurate[threads] = timed(started, needed, rounds)
        memory = {}
        for tool in [BARE, OURS, *drawing]:
            with workers([tool], inputs, None, warm=False) as (worker,):
                memory[tool.name] = f"{worker.ask('memory', trials=TRIALS)['added']:.0f}"
        heading("Equal trials", monte_carlo(equal[1], equal[None], memory))
        heading("Equal accuracy", monte_carlo(accurate[1], accurate[None], {}))
        heading("First order", first_order([OURS, *present], inputs, rounds))
    goal = f"equal accuracy (u to {OF_U:.1%} and ends to {OF_ENDS:.0%} of u)"
    met = [
        judged("equal trials", equal, WANTED_TRIALS),
        judged(goal, accurate, WANTED_ACCURACY),
    ]
    return int(not all(met))


def heading(title: str, lines: Sequence[str]) -> None:
    print(f"\n{title}", *lines, sep="\n", flush=True)


def in_columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Texts in columns: the first to the left, the others to the right."""
    table = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [
        f"{first:<{widths[0]}}" + "".join(f"  {x:>{w}}" for x, w in zip(rest, widths[1:]))  # noqa: B905  # one more
        for first, *rest in table
    ]


def agreement(started: Sequence[Worker]) -> list[str]:
    """A line for each form; the first worker is `mtu`, the others are held against it."""
    trials = 100_000
    ours = started[0].ask("drawn", trials=10 * trials, seed=7)["found"]
    value, u = started[0].ask("first_order")["found"]
    lines = [f"mtu: u {ARCSEC * ours[0]:.4f} arcsec, first order {ARCSEC * u:.4f}"]
    for worker in started[1:]:
        said, sound = f"{worker.tool.name}:", True
        if worker.tool.draw:
            found = worker.ask("drawn", trials=trials, seed=11)["found"]
            off = [
                (a - b) / ours[0] / se
                for a, b, se in zip(found, ours[:3], plain_errors(trials), strict=True)
            ]
            said += " u, low, high off by " + ", ".join(f"{x:+.1f}" for x in off) + " se;"
            sound = max(map(abs, off)) <= SIGMAS
        own_value, own_u = worker.ask("first_order")["found"]
        off = [own_u / u - 1, (own_value - value) / u]
        said += " first order off by " + ", ".join(f"{x:+.0e}" for x in off)
        if not sound or max(map(abs, off)) > FIRST_ORDER:
            raise DisagreementError(said)
        lines.append(said)
    return lines


def needed(worker: Worker) -> int:
    """Trials for the accuracy that is wanted: `mtu`'s fewest, plain Monte Carlo's of the others."""
    own = worker.tool.package == OURS.package
    return int(worker.ask("least")["trials"]) if own else plain_trials()


def scatter(worker: Worker) -> str:
    """Results of many runs: of `mtu` as accurate as is wanted and as it states, of the others as
    plain Monte Carlo of small runs is, from which 1/sqrt(n) leads to the trials they need.
    """
    own = worker.tool.package == OURS.package
    trials, runs = (needed(worker), RUNS) if own else (SMALL, RUNS // (PART**worker.tool.slow))
    found = [worker.ask("drawn", trials=trials, seed=1000 + i)["found"] for i in range(runs)]
    columns = [*zip(*found, strict=True)]
    u = statistics.mean(columns[0])
    seen = [statistics.stdev(column) / u for column in columns[:3]]
    said = f"{worker.tool.name}: scatter of {runs} runs: u {seen[0]:.1e}, ends {seen[1]:.1e} u"
    if own and (seen[0] > OF_U or max(seen[1:]) > OF_ENDS):
        raise DisagreementError(f"{said}; wanted are {OF_U} and {OF_ENDS}")
    if worker.tool == ADAPTIVE:
        return said
    stated = plain_errors(trials)
    if own:
        stated = [statistics.mean(se * se for se in column) ** 0.5 / u for column in columns[3:]]
    ratios = [a / b for a, b in zip(seen, stated, strict=True)]
    said += ", over what is stated: " + ", ".join(f"{ratio:.2f}" for ratio in ratios)
    # Four standard errors, relative, of a standard deviation from that many runs.
    if max(abs(ratio - 1) for ratio in ratios) > 4 / math.sqrt(2 * (runs - 1)):
        raise DisagreementError(said)
    return said


def timed(
    started: Sequence[Worker], trials_of: Callable[[Worker], int], rounds: int
) -> dict[str, Series]:
    """Every worker's Monte Carlo in every round, each with a seed of its own."""
    found = {
        worker.tool.name: Series(trials_of(worker) // PART**worker.tool.slow) for worker in started
    }
    for number in range(rounds):
        for place, worker in enumerate(started):
            series, times = found[worker.tool.name], PART**worker.tool.slow
            answer = worker.ask("drawn", trials=series.trials, seed=100 * (number + 1) + place)
            series.seconds.append(times * answer["seconds"])
            series.cpu.append(times * answer["cpu"])
            series.found.append(answer["found"][:3])
    return found


def monte_carlo(
    one: dict[str, Series], free: dict[str, Series], memory: dict[str, str]
) -> list[str]:
    """Time over that of the bare normals and over `mtu`'s, with one thread and the default."""
    rows = [["", "trials", "1 thread: / bare", "/ mtu", "cpu / mtu", "default: / bare", "/ mtu",
             "MiB"]]  # fmt: skip
    for tool in (BARE, OURS, ADAPTIVE, *PEERS):
        if tool.draw and not tool.installed:
            rows.append([tool.name, "not installed", *[""] * 6])
        if tool.name not in one:
            continue
        series, own, times = one[tool.name], free[tool.name], PART**tool.slow
        trials = "its own" if tool == ADAPTIVE else f"{'~' * tool.slow}{series.trials * times}"
        ratios = [series.over(one[BARE.name]), series.over(one[OURS.name])]
        ratios += [series.over(one[OURS.name], "cpu")]
        ratios += [own.over(free[BARE.name]), own.over(free[OURS.name])]
        shown = [f"{ratio:.2f}" for ratio in ratios]
        rows.append([tool.name, trials, *shown, memory.get(tool.name, "-")])
    return in_columns(rows)


def first_order(tools: Sequence[Tool], inputs: Path, rounds: int) -> list[str]:
    """Processor time of first-order propagation, set-up included."""
    with workers(tools, inputs, 1) as started:
        cpu: dict[str, list[float]] = {tool.name: [] for tool in tools}
        for _ in range(rounds):
            for worker in started:
                cpu[worker.tool.name].append(worker.ask("first_order")["cpu"])
    rows = [["", "/ mtu", "cpu ms"]]
    for name, own in cpu.items():
        over = statistics.median(a / b for a, b in zip(own, cpu[OURS.name], strict=True))
        rows.append([name, f"{over:.2f}", f"{1e3 * statistics.median(own):.2f}"])
    return in_columns(rows)


def judged(kind: str, both: dict[int | None, dict[str, Series]], wanted: float) -> bool:
    """Prints the fastest peer over ours; False where it is less than wanted by default threads."""
    met = True
    for threads, series in both.items():
        ratios = {t.name: series[t.name].over(series[OURS.name]) for t in PEERS if t.name in series}
        if not ratios:
            print(f"{kind}: no peer is installed: nothing to judge")
            return True
        fastest = min(ratios, key=lambda name: ratios[name])
        met = ratios[fastest] >= wanted
        print(
            f"{kind}, {'one thread' if threads else 'default threads'}: {fastest} takes "
            f"{ratios[fastest]:.2f} x mtu; {wanted:g} x {'met' if met else 'missed'}"
        )
    return met


if __name__ == "__main__":
    sys.exit(main())
