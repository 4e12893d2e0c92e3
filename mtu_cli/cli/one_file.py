"""The commands on files that stand alone: `mtu budget`, `mtu graph ...`, and of instruments' files
`mtu inspect` and `mtu import`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mtu_cli.cli.emit import STANDARD_OUTPUT
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.values import MOST_STEPS, SPAN, assignments, ends, known_name, number_of
from mtu_cli.files.contract import is_name
from mtu_cli.findings import error
from mtu_cli.formats import instruments
from mtu_cli.formats.base import SPECS, raw_file
from mtu_cli.result import Listing, Result
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from mtu_cli.model.graph.net import MeasurementGraph

EXAMPLE = "--vary axis_um=0.5:2.5:5 (from 0.5 to 2.5 in 5 steps) or --vary repeats=1,2,4"
DIGITS = 12
"""Digits of a value that count: 1:5:5 has whole steps but for rounding."""


def budget(inputs: Inputs) -> Result:
    from mtu_cli.analyses.budget import evaluate_budget
    from mtu_cli.files.budget import load_budget

    loaded = inputs.entered(load_budget(inputs.options.file))
    result = evaluate_budget(loaded, inputs.settings, inputs.options.k)
    factors = {output.k for output in result.outputs}
    # The report has one factor only where all outputs have the same.
    k = factors.pop() if len(factors) == 1 else math.nan
    inputs.settings = replace(inputs.settings, coverage_factor=k)
    return Result.reported(inputs, result, loaded.warnings)


def _graph(inputs: Inputs) -> MeasurementGraph:
    """The graph of the call's file, checked whole."""
    from mtu_cli.model.graph.net import load_graph

    graph = load_graph(inputs.options.file)
    inputs.entered(graph.document)
    return graph


def graph_check(inputs: Inputs) -> Result:
    """Whether the graph is sound, and its firing order."""
    return Result.reported(inputs, _graph(inputs))


def graph_draw(inputs: Inputs) -> Result:
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
    return Result(inputs, Listing(), files={target: content})


def graph_simulate(inputs: Inputs) -> Result:
    """The places asked for, by Monte Carlo and to first order."""
    from mtu_cli.analyses.graph import simulate_graph

    result = simulate_graph(_graph(inputs), inputs.settings, tuple(inputs.options.of or ()))
    return Result.reported(inputs, result)


def graph_sweep(inputs: Inputs) -> Result:
    """One place over the grid of --vary, and as the file has it."""
    from mtu_cli.analyses.graph import PARAMETERS, sweep_graph

    vary = inputs.options.vary
    grid = assignments("--vary", vary, "NAME=VALUES", EXAMPLE, variation, PARAMETERS)
    result = sweep_graph(_graph(inputs), inputs.settings, inputs.options.of, grid)
    return Result.reported(inputs, result)


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


def inspect(inputs: Inputs) -> Result:
    """Format, facts and how the file would be understood; of XML its element paths, too."""
    file = inputs.entered(raw_file(inputs.options.file, "file"))
    results = instruments.inspection(file, inputs.options.decimal)
    doubts = [file.finding("instrument-doubt", doubt=text) for text in results["doubts"]]
    return Result(inputs, Listing([*instruments.inspection_lines(results)], results), doubts)


def import_(inputs: Inputs) -> Result:
    """The contract's CSV of all files, and how they were understood."""
    options, kind = inputs.options, inputs.options.as_
    spec = SPECS[kind]
    if options.component is not None and not is_name(options.component):
        raise error("wrong-type", path="--component", kind="a name", value=options.component)
    if options.machine and kind != "points":
        spec = spec.with_texts("component", inputs.machine.machine.components)
    known_name("--unit", "value", options.unit, UNITS)
    asks = [(path, inputs.ask(path, "file")) for _, path in inputs.named_files("file")]
    content = instruments.contract_csv(asks, spec, inputs.note)
    return Result(inputs, Listing(), files={options.to_csv or STANDARD_OUTPUT: content})
