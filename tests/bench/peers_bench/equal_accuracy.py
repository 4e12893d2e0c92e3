"""Time to a wanted accuracy: plain Monte Carlo by the others, `mtu`'s with its control variate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from peers_bench.accuracy import OF_ENDS, OF_U, of_scatter, plain_errors, plain_trials, scatter
from peers_bench.agreement import DisagreementError
from peers_bench.problem import Found
from peers_bench.rounds import Series, timed
from peers_bench.tools import ADAPTIVE, BARE, OURS, Tool
from peers_bench.workers import Worker

RUNS = 50
SMALL = 10_000
"""Trials of a run whose scatter tells what plain Monte Carlo is worth."""
BIAS_SIGMAS = 4.0


@dataclass(frozen=True, kw_only=True)
class Accurate:
    """Series of all forms at their own numbers of trials, and what was found on the way."""

    series: dict[str, Series]
    lines: list[str]


def run(workers: Sequence[Worker], rounds: int, *, scatter_too: bool) -> Accurate:
    """Scatter first (once is enough: it does not depend on the threads), then times.

    Raises DisagreementError where results scatter otherwise than is claimed for them.
    """
    lines: list[str] = []
    trials = {BARE.name: plain_trials()}
    for worker in workers:
        tool = worker.tool
        if tool.package == OURS.package:
            trials[tool.name] = worker.ask("least")["trials"]
            if scatter_too:
                lines.append(_ours(worker, trials[tool.name]))
        elif tool != BARE:
            trials[tool.name] = plain_trials()
            if scatter_too:
                lines.append(_plain(worker))
    return Accurate(series=timed(workers, lambda tool: trials[tool.name], rounds), lines=lines)


def _runs(worker: Worker, trials: int) -> list[Found]:
    return [Found(*found) for found in worker.ask("scatter", trials=trials, runs=RUNS)["found"]]


def _plain(worker: Worker) -> str:
    """Its scatter in small runs, which 1/sqrt(n) leads from to the trials it needs."""
    runs = RUNS // 5 if worker.tool.slow else RUNS
    found = worker.ask("scatter", trials=SMALL, runs=runs)["found"]
    seen = scatter([Found(*item) for item in found])
    ratios = [a / b for a, b in zip(seen, plain_errors(SMALL), strict=True)]
    said = (
        f"{worker.tool.name}: scatter of {runs} runs over that of plain Monte Carlo: "
        f"u {ratios[0]:.2f}, ends {ratios[1]:.2f}"
    )
    if max(abs(ratio - 1) for ratio in ratios) > of_scatter(runs):
        raise DisagreementError(said)
    return said


def _ours(worker: Worker, trials: int) -> str:
    """Its scatter against what is wanted, and against the standard errors it states."""
    u, end = scatter(_runs(worker, trials))
    said = f"{worker.tool.name}: scatter of {RUNS} runs: u {u:.1e}, ends {end:.1e} u"
    if u > OF_U or end > OF_ENDS:
        raise DisagreementError(f"{said}; wanted are {OF_U} and {OF_ENDS}")
    if worker.tool == ADAPTIVE:
        return said
    stated = worker.ask("claimed", trials=trials, runs=RUNS)["errors"]
    mean = [(sum(se * se for se in column) / RUNS) ** 0.5 for column in zip(*stated, strict=True)]
    # The scatter of the two ends is the larger of the two: so is what is stated for them.
    ratios = u / mean[0], end / max(mean[1:])
    said += f", over the standard errors it states: u {ratios[0]:.2f}, ends {ratios[1]:.2f}"
    if max(abs(ratio - 1) for ratio in ratios) > of_scatter(RUNS):
        raise DisagreementError(said)
    return said


def unbiased(ours: Series, plain: Mapping[str, Series], tools: Sequence[Tool]) -> str:
    """Ours against all trials of the others together: no accuracy by leaving something out.

    `plain`: series of the others at equal trials. Raises DisagreementError.
    """
    taken = [plain[t.name] for t in tools if t.name in plain]
    trials = sum(series.trials * len(series.found) for series in taken)
    off = []
    for i, se in zip(range(3), (0, 1, 1), strict=True):
        theirs = sum(s.trials * sum(found[i] for found in s.found) for s in taken) / trials
        mine = sum(found[i] for found in ours.found) / len(ours.found)
        off.append((mine - theirs) / ours.found[0].u / plain_errors(trials)[se])
    said = (
        f"mtu minus all {trials:.2g} trials of the others: u, low, high "
        + ", ".join(f"{x:+.1f}" for x in off)
        + f" standard errors of those ({plain_errors(trials)[0]:.1e} of u)"
    )
    if max(map(abs, off)) > BIAS_SIGMAS:
        raise DisagreementError(said)
    return said
