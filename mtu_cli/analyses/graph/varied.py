"""A graph under other uncertainties of probing, and whether an output follows them at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.model.graph.chances import may_jump
from mtu_cli.model.graph.first_order import first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.graph.trials import GraphTrials
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream
from mtu_cli.stats.workspace import Workspace

REPEATS = "repeats"
TRIED = 256
"""Trials that tell whether an output follows what is varied."""
SAME = 1e-9
"""Share of u below which the same trials under another uncertainty have the same values."""


def probed_with(graph: Graph, at: Mapping[str, float]) -> Graph:
    """The graph with other uncertainties of probing, um, and another number of probings."""
    probing = {name: value for name, value in at.items() if name != REPEATS}
    changes: dict[str, object] = {"uncertainty": graph.uncertainty.model_copy(update=probing)}
    if REPEATS in at:
        changes["repeats"] = int(at[REPEATS])
        changes["transitions"] = [
            item.model_copy(update={"repeats": None}) for item in graph.transitions
        ]
    return graph.model_copy(update=changes)


def unrelated(
    graph: MeasurementGraph, output: Output, varied: Mapping[str, Sequence[float]], seed: int
) -> tuple[str, ...]:
    """Which of `varied` have no effect on an output.

    The same random numbers are propagated with the largest of all varied values and with half of
    one: where nothing behind the output takes it (every measurement states its own), or
    where the output does not follow those that do, its trials stay where they are. What a step
    makes may stay so by chance: there the scatter of what is behind it tells.
    """
    largest = {name: float(max(values)) for name, values in varied.items()}
    if REPEATS in largest:
        largest[REPEATS] = 1.0
    before = _trials(graph, output, largest, seed)
    found = []
    for name, value in largest.items():
        other = 4.0 if name == REPEATS else value / 2
        if value > 0 and _alike(before, _trials(graph, output, {**largest, name: other}, seed)):
            found.append(name)
    return tuple(found)


def _alike(before: FloatArray, after: FloatArray) -> bool:
    scatter = before.std(axis=1, keepdims=True)
    return bool(np.all(np.abs(after - before) <= SAME * scatter))


def _trials(
    graph: MeasurementGraph, output: Output, at: Mapping[str, float], seed: int
) -> FloatArray:
    """Values (1, m) of the output or, of one behind a step, (k, m) of the random inputs."""
    part = evaluation(graph.with_probing(probed_with(graph.graph, at)), [output])
    if may_jump(item.step for item in part.steps):
        work = Workspace()
        return part.inputs.scaled(part.inputs.draw(stream(seed, 2), TRIED, work))
    return GraphTrials(part, first_order(part)).draw(stream(seed, 2), TRIED).values
