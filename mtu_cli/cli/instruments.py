"""`mtu inspect` and `mtu import`: what an instrument's file holds, and the contract's CSV of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from mtu_cli.cli.emit import STANDARD_OUTPUT, Listing, Result
from mtu_cli.cli.load import Inputs, named_file
from mtu_cli.cli.values import known_name
from mtu_cli.files.contract import is_name
from mtu_cli.files.csv_file import Converted, read_tables
from mtu_cli.files.headers import CellFaults
from mtu_cli.files.source import same
from mtu_cli.findings import Finding, InputError, error
from mtu_cli.formats import instruments
from mtu_cli.formats.base import Ask, Imported, RawFile, local, raw_file
from mtu_cli.formats.wide import DIRECTIONS
from mtu_cli.units import UNITS

LISTED = 40
"""Element paths of an XML file that the table shows; the report has all."""


def inspect(inputs: Inputs) -> Result:
    """Format, facts and how the file would be understood; of XML its element paths, too."""
    file = raw_file(inputs.options.file, "file")
    inputs.sources.append(file.source)
    decimal = known_name("--decimal", "value", inputs.options.decimal, (".", ","))
    result, title, faults, gives = Imported(format="xml"), "XML", list[Finding](), list[str]()
    if instruments.is_contract(file.content):
        result, title = instruments.contract_rows(file), "columns of the contract"
    elif entry := instruments.identify(file):
        title, gives, result = entry.title, [entry.gives], Imported(format=entry.name)
        try:
            result = instruments.read(file, Ask(kind="inspect", decimal=decimal))
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
    return Result.of(inputs, Listing([*_lines(results)], results), doubts)


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
    if rest := len(results["elements"]) - LISTED:
        yield from [f"  and {rest} more element paths (-o)"] if rest > 0 else []


def import_(inputs: Inputs) -> Result:
    """The contract's CSV of all files, and how they were understood."""
    options = inputs.options
    kind = known_name("--as", "value", options.as_, ("readings", "points", "drift"))
    words = {"unit": tuple(UNITS), "decimal": (".", ","), "directions": DIRECTIONS}
    values = {
        name: known_name(f"--{name}", "value", options.values.get(name), choices)
        for name, choices in words.items()
    }
    entries = inputs.machine.machine.components if options.machine else {}
    units = {name: entry.unit for name, entry in entries.items()}
    if options.component is not None and not is_name(options.component):
        raise error("wrong-type", path="--component", kind="a name", value=options.component)
    tables, findings, faults = list[Imported](), list[Finding](), CellFaults()
    files = list[RawFile]()
    target = None if options.to_csv == STANDARD_OUTPUT else options.to_csv
    for path in options.file:
        try:
            file = raw_file(named_file(path)[1], "file")
            if target and same(target, file.source.path):
                raise file.error("not-overwritten", reason="it is an input")
            name = named_file(path)[0] or options.component
            if instruments.is_contract(file.content) and not options.map:
                raise file.error("other-table", kind="the contract's CSV already")
            ask = Ask(kind=kind, component=name, machine_units=units, profile=options.map, **values)
            table = instruments.read(file, ask)
        except InputError as fault:
            for each in fault.findings:
                faults.add(each)
            continue
        findings.append(file.finding("instrument-file", how=table.sentence))
        findings += [file.finding("instrument-doubt", doubt=text) for text in table.doubts]
        tables.append(table)
        files.append(file)
    joined = _join(tables, kind)
    if files:
        _check(inputs, files, tables, joined, faults)
    faults.raise_if_any()
    text = joined.csv(list(instruments.SPECS[kind].columns))
    if target is None:
        return Result.of(inputs, Listing([text.rstrip("\n")]), findings)
    lines = [each.message for each in findings if each.severity == "note"]
    warnings = [each for each in findings if each.severity != "note"]
    return Result.of(inputs, Listing(lines), warnings, files={target: text.encode()})


def _join(tables: list[Imported], kind: str) -> Imported:
    """Files end to end; passes and cycles of a component that was read before are counted on."""
    result, last = Imported(format="", kind=kind), dict[tuple[object, str], int]()
    for table in tables:
        if kind != "points":
            table.count_on(last)
        for i, row in enumerate(table.rows):
            result.add(row, **{name: column[i] for name, column in table.columns.items()})
    return result


def _check(
    inputs: Inputs, files: list[RawFile], tables: list[Imported], joined: Imported,
    faults: CellFaults,
) -> None:  # fmt: skip
    """Adds to `faults`, by the rows of the files, what in their `joined` tables is none of the
    contract's CSV.
    """
    spec, parts, first = instruments.SPECS[joined.kind], list[Converted](), 0
    if inputs.options.machine and joined.kind != "points":
        spec = spec.with_texts("component", inputs.machine.machine.components)
    for table in tables:
        rows = slice(first, first := first + len(table.rows))
        columns = {name: cells[rows] for name, cells in joined.columns.items()}
        part = replace(table, columns=columns or table.columns)
        parts.append(part.converted(list(spec.columns)))
    places, rest = [(file.source.path, file.source.role) for file in files], iter(parts)
    read_tables(places, spec, faults, lambda source, raw: next(rest), parts=True)
