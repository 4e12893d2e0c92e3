"""Rounds through all packages in turn, and ratios within a round."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from peers_bench.problem import Found
from peers_bench.tools import Tool
from peers_bench.workers import Worker

PART = 5
"""Of a slow form a fifth of the trials is timed; its times are multiplied by this."""


@dataclass(frozen=True, slots=True)
class Series:
    """Elapsed and processor time, s, and results of a form, one for each round."""

    trials: int
    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    def over(self, other: Series) -> float:
        """Median over the rounds of the ratio of elapsed times."""
        pairs = zip(self.seconds, other.seconds, strict=True)
        return statistics.median(a / b for a, b in pairs)

    def cpu_over(self, other: Series) -> float:
        """The same of processor times of all threads: what a busy machine disturbs less."""
        return statistics.median(a / b for a, b in zip(self.cpu, other.cpu, strict=True))


def timed(
    workers: Sequence[Worker], trials_of: Callable[[Tool], int], rounds: int
) -> dict[str, Series]:
    """Every worker's Monte Carlo in every round, each with a seed of its own."""
    found: dict[str, Series] = {}
    for worker in workers:
        trials = trials_of(worker.tool)
        found[worker.tool.name] = Series(trials // PART if worker.tool.slow else trials)
    for number in range(rounds):
        for place, worker in enumerate(workers):
            series = found[worker.tool.name]
            seed = 100 * (number + 1) + place
            answer = worker.ask("drawn", trials=series.trials, seed=seed)
            times = PART if worker.tool.slow else 1
            series.seconds.append(times * answer["seconds"])
            series.cpu.append(times * answer["cpu"])
            series.found.append(Found(*answer["found"]))
    return found
