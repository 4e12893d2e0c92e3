"""The uncertainty of a measurement that one file states: `mtu budget` and `mtu graph ...`."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.values import MOST_STEPS, SPAN, assignments, ends, number_of
from mtu_cli.findings import error
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.model.graph.net import MeasurementGraph

EXAMPLE = "--vary axis_um=0.5:2.5:5 (from 0.5 to 2.5 in 5 steps) or --vary repeats=1,2,4"
DIGITS = 12
"""Digits of a value that count: 1:5:5 has whole steps but for rounding."""


def budget(inputs: Inputs, settings: Settings) -> Outcome:
    """An uncertainty budget."""
    from mtu_cli.analyses.budget import evaluate_budget
    from mtu_cli.files.budget import load_budget

    loaded = load_budget(inputs.options.file)
    inputs.sources.append(loaded.source)
    result = evaluate_budget(loaded, settings, inputs.options.k)
    factors = {output.k for output in result.outputs}
    # The report has one factor only where all outputs have the same.
    k = factors.pop() if len(factors) == 1 else math.nan
    return Outcome.reported(inputs, result, settings=replace(settings, coverage_factor=k))


def _graph(inputs: Inputs) -> MeasurementGraph:
    """The graph of the call's file, checked whole."""
    from mtu_cli.model.graph.net import load_graph

    graph = load_graph(inputs.options.file)
    inputs.sources.append(graph.document.source)
    return graph


def graph_check(inputs: Inputs, settings: Settings) -> Outcome:
    """Whether the graph is sound, and its firing order."""
    from mtu_cli.reports import graph as report

    return Outcome.of(report.check(_graph(inputs)))


def graph_draw(inputs: Inputs, settings: Settings) -> Outcome:
    """The file at --to, and nothing else."""
    from mtu_cli.analyses.graph import shares_by_place
    from mtu_cli.reports import graph_drawing
    from mtu_cli.reports.figures import figure_bytes

    graph, of, target = _graph(inputs), inputs.options.of, inputs.options.to
    net = graph_drawing.net_of(graph, of, None if of is None else shares_by_place(graph, of))

    match suffix := target.suffix.lower():
        case ".dot":
            content = graph_drawing.dot(net).encode()
        case ".mmd":
            content = graph_drawing.mermaid(net).encode()
        case ".pl":
            content = graph_drawing.assertions(net, graph).encode()
        case _:
            content = figure_bytes(partial(graph_drawing.drawing, net), suffix)
    return Outcome(files=lambda: {target: content})


def graph_simulate(inputs: Inputs, settings: Settings) -> Outcome:
    """The places asked for, by Monte Carlo and to first order."""
    from mtu_cli.analyses.graph import simulate_graph
    from mtu_cli.reports import graph as report

    result = simulate_graph(_graph(inputs), settings, tuple(inputs.options.of or ()))
    return Outcome.of(report.simulate(result, settings.digits), warnings=result.warnings)


def graph_sweep(inputs: Inputs, settings: Settings) -> Outcome:
    """One place over the grid of --vary, and as the file has it."""
    from mtu_cli.analyses.graph import PARAMETERS, sweep_graph
    from mtu_cli.reports import graph as report

    vary = inputs.options.vary
    grid = assignments("--vary", vary, "NAME=VALUES", EXAMPLE, variation, PARAMETERS)
    result = sweep_graph(_graph(inputs), settings, inputs.options.of, grid)
    return Outcome.of(report.sweep(result, settings.digits), warnings=result.warnings)


def variation(name: str, text: str) -> tuple[float, ...]:
    """Numbers from ``low:high:count``, downwards too, or ``a,b,c``; each once.

    >>> variation("repeats", "1,2"), variation("axis_um", "1:2:3")
    ((1.0, 2.0), (1.0, 1.5, 2.0))
    """
    option = f"--vary {name}"
    if ":" not in text:
        values = [number_of(option, item) for item in text.split(",")]
    else:
        low, high, count = ends(option, text, SPAN, EXAMPLE)
        values = [low + i * (high - low) / (count - 1) for i in range(int(count) - 1)] + [high]
    grid = tuple(float(f"{value:.{DIGITS}g}") for value in values[: MOST_STEPS + 1])
    if len(set(grid)) < len(grid):
        raise error("appears-twice", what=option, value=text)
    return grid
