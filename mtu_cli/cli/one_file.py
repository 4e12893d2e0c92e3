"""The commands on files that stand alone: `mtu budget`, `mtu graph ...`, and of instruments' files
`mtu inspect` and `mtu import`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.emit import STANDARD_OUTPUT, Listing, Result
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.values import MOST_STEPS, SPAN, assignments, ends, known_name, number_of
from mtu_cli.files.contract import is_name
from mtu_cli.files.csv_file import read_tables
from mtu_cli.files.headers import CellFaults
from mtu_cli.findings import Finding, InputError, error
from mtu_cli.formats import instruments
from mtu_cli.formats.base import Ask, Imported, RawFile, local, raw_file
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from mtu_cli.model.graph.net import MeasurementGraph

EXAMPLE = "--vary axis_um=0.5:2.5:5 (from 0.5 to 2.5 in 5 steps) or --vary repeats=1,2,4"
DIGITS = 12
"""Digits of a value that count: 1:5:5 has whole steps but for rounding."""
LISTED = 40
"""Element paths of an XML file that the table shows; the report has all."""


def budget(inputs: Inputs) -> Result:
    from mtu_cli.analyses.budget import evaluate_budget
    from mtu_cli.files.budget import load_budget

    loaded = inputs.entered(load_budget(inputs.options.file))
    result = evaluate_budget(loaded, inputs.settings, inputs.options.k)
    factors = {output.k for output in result.outputs}
    # The report has one factor only where all outputs have the same.
    k = factors.pop() if len(factors) == 1 else math.nan
    inputs.settings = replace(inputs.settings, coverage_factor=k)
    return Result.reported(inputs, result)


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
    result, title, faults, gives = Imported(format="xml"), "XML", list[Finding](), list[str]()
    if instruments.is_contract(file.content):
        result, title = instruments.contract_rows(file), "columns of the contract"
    elif entry := instruments.identify(file):
        title, gives, result = entry.title, [entry.gives], Imported(format=entry.name)
        try:
            result = instruments.read(file, Ask(kind="inspect", decimal=inputs.options.decimal))
        except InputError as fault:
            faults = list(fault.findings)
    elif file.xml is None:
        raise instruments.unknown(file)
    results = {
        "format": result.format,
        "title": title,
        "importable_as": gives,
        "code_page": file.encoding,
        "rows": len(result.rows),
        "facts": result.facts,
        "says": result.says,
        "left_out": result.left_out,
        "doubts": result.doubts,
        "faults": [each.message for each in faults],
        "elements": dict(Counter(_paths(file))),
    }
    doubts = [file.finding("instrument-doubt", doubt=text) for text in result.doubts]
    return Result(inputs, Listing([*_lines(results)], results), doubts)


def _paths(file: RawFile) -> Iterator[str]:
    """The path of names of every element of an XML file, without recursion."""
    pending = [] if file.xml is None else [(local(file.xml), file.xml)]
    while pending:
        path, element = pending.pop()
        yield path
        pending += [(f"{path}/{local(child)}", child) for child in reversed(element)]


def _lines(results: dict[str, Any]) -> Iterable[str]:
    yield f"{results['format']}: {results['title']}; {results['code_page']}"
    if results["importable_as"]:
        yield f"  importable as {' or '.join(results['importable_as'])}: {results['rows']} rows"
    for name, value in results["facts"].items():
        content = value
        if isinstance(value, list):
            some = [f"{x:g}" if isinstance(x, float) else str(x) for x in value]
            content = ", ".join(some[:12]) + (f" and {len(some) - 12} more" if some[12:] else "")
        yield f"  {name}: {'not stated' if content == '' else content}"
    yield from (f"  {text}" for text in results["says"])
    yield from (f"  left out: {count} {what}" for what, count in results["left_out"].items())
    yield from (f"  fault: {text}" for text in results["faults"])
    yield from (f"  {count:5} {path}" for path, count in [*results["elements"].items()][:LISTED])
    if (rest := len(results["elements"]) - LISTED) > 0:
        yield f"  and {rest} more element paths (-o)"


def import_(inputs: Inputs) -> Result:
    """The contract's CSV of all files, and how they were understood."""
    options, kind = inputs.options, inputs.options.as_
    spec = instruments.SPECS[kind]
    if options.component is not None and not is_name(options.component):
        raise error("wrong-type", path="--component", kind="a name", value=options.component)
    if options.machine and kind != "points":
        spec = spec.with_texts("component", inputs.machine.machine.components)
    known_name("--unit", "value", options.unit, UNITS)
    files, tables = list[tuple[Path, str]](), list[Imported]()
    faults, last = CellFaults(), dict[tuple[object, str], int]()
    for _, path in inputs.named_files("file"):
        try:
            file = raw_file(path, "file")
            if instruments.is_contract(file.content) and not options.map:
                raise file.error("other-table", kind="the contract's CSV already")
            table = instruments.read(file, inputs.ask(path, "file"))
        except InputError as fault:
            for each in fault.findings:
                faults.add(each)
            continue
        inputs.note(file, table)
        if kind != "points":
            table.count_on(last)
        tables.append(table)
        files.append((path, "file"))
    # All files have the columns of all: what is read of each is what the one CSV holds of it.
    names = dict.fromkeys(name for table in tables for name in table.columns)
    for table in tables:
        table.columns = {x: table.columns.get(x) or [None] * len(table.rows) for x in names}
    parts = [table.converted([*spec.columns]) for table in tables]
    if files:
        rest = iter(parts)
        read_tables(files, spec, faults, lambda source, content: next(rest), parts=True)
    faults.raise_if_any()
    bodies = [content.partition(b"\n")[2] for content, *_ in parts[1:]]
    content = b"".join([parts[0][0], *bodies])
    if options.to_csv in (None, STANDARD_OUTPUT):
        return Result(inputs, Listing([content.decode().rstrip("\n")]))
    return Result(inputs, Listing(), files={options.to_csv: content})
