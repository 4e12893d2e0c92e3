"""The registry of instruments' files: which format a file is, and what it holds as the columns of
the contract's CSV, of which that CSV is one entry.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from mtu_cli.files.csv_file import GZIP, Convert, Converted, read_tables
from mtu_cli.files.headers import CellFaults, Decimal, TableSpec, header_names
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, collected, listed, nearest, shorten
from mtu_cli.formats.base import SPECS, Ask, Format, Import, RawFile, local, of_content, raw_file
from mtu_cli.formats.grid import NAMES, evidence, grid_of, separator_of, split

MODULES = ("renishaw", "ecmc", "points", "channels", "wide")
"""From the surest to the least sure: the first that recognises a file reads it."""
Report = Callable[[Import], None]
"""Hands on how a file was understood."""
HEAD = 1 << 16
LISTED = 40
"""Element paths of an XML file that the table shows; the report has all."""


def header_of(content: bytes) -> list[str]:
    """The names in the header of a CSV, in lower case."""
    return header_names(content[:HEAD].decode("utf-8-sig", "replace").splitlines())


def is_contract(content: bytes) -> bool:
    """Whether the header names columns of the contract: that reader then says what is wrong."""
    header = {*header_of(content)}
    columns = {"component", "error", "position_mm", "x_mm", "y_mm", "nominal_x_mm"}
    return bool(header & columns) or len(header & {"part", "feature", "repeat", "unit", "pass"}) > 1


def read_contract(result: Import) -> None:
    """What is shown of the contract's own CSV."""
    grid = grid_of(result.file.lines)
    result.rows = [row.line for row in grid.rows[1:]]
    result.facts = {"columns": grid.rows[0].cells, "separator": NAMES[grid.separator]}
    result.drop("comment lines", grid.comments)


CONTRACT = Format("contract-csv", "columns of the contract", "",
                  lambda file: is_contract(file.content), read_contract)  # fmt: skip


def registry() -> Iterator[Format]:
    """All formats; a module is imported when its turn comes."""
    yield CONTRACT
    for name in MODULES:
        yield from import_module(f"mtu_cli.formats.{name}").FORMATS


def identify(file: RawFile) -> Format | None:
    """The format of a file, or None."""
    return next((entry for entry in registry() if entry.sniff(file)), None)


def read(file: RawFile, ask: Ask) -> Import:
    """What an instrument's file holds; raises InputError for what fits no format, or is at fault
    within its own.
    """
    if ask.profile is not None:
        from mtu_cli.formats.table_map import read_with

        kind = str(ask.kind if ask.kind in SPECS else "readings")
        result = Import(format="table", kind=kind, file=file, ask=ask)
        read_with(result)
        return result
    entry = identify(file)
    if entry is None:
        raise unknown(file)
    if ask.kind in SPECS and ask.kind != entry.gives:
        use = f"gives {entry.gives}" if entry.gives else "needs no import"
        kind = f"{entry.title} ({entry.name}), which {use}"
        raise file.error("other-table", kind=kind, expected=str(ask.kind))
    result = Import(format=entry.name, kind=entry.gives, file=file, ask=ask)
    try:
        entry.read(result)
    except (ValueError, IndexError, KeyError, OverflowError, RecursionError) as fault:
        # A reader checks what its format documents; this is the rest of what bytes can be.
        reason = f"damaged {entry.name} ({shorten(str(fault))})"
        raise file.error("not-readable", reason=reason, expected=entry.title) from None
    return result


def unknown(file: RawFile) -> InputError:
    """What was seen of a file that fits no format, and the nearest ones."""
    lines = [line for line in file.lines if line.strip()]
    if not file.text:
        description = "binary data"
    else:
        separator = separator_of(lines[:50])
        signs = {sign for line in lines[:50] for cell in split(line, separator)
                 if (sign := evidence(cell))} - {"?"}  # fmt: skip
        sign = " and ".join(sorted(signs)) or "not seen"
        description = f"{file.encoding}, {NAMES[separator]}, decimal sign {sign}"
        description += "".join(f" | {shorten(line.strip(), 40)}" for line in lines[:3])
    names = [entry.name for entry in registry()]
    suffix = file.source.path.suffix[1:]
    likely = listed([*(nearest(suffix, names) if suffix else ()), "wide", CONTRACT.name])
    expected = f"{likely}, or a --map profile (mtu help instruments)"
    return file.error("fits-no-format", seen=description, expected=expected)


def converter(ask_of: Callable[[Path, str], Ask], report: Report) -> Convert:
    """For the reader of the contract's CSV: what an instrument's file is as such a CSV; None of
    what is a CSV already, or may be meant as one.
    """
    last = dict[tuple[object, str], int]()

    def convert(source: Source, content: bytes) -> Converted | None:
        ask, names = ask_of(source.path, source.role), header_of(content)
        contract = ask.profile is None and is_contract(content)
        if content.startswith(GZIP):
            return None
        if contract:
            nameless = "error" in names and "component" not in names and ask.kind != "points"
            if not (nameless and ask.component):
                return None
            # A CSV of readings that leaves out the component that the call names.
            columns = {name: name for name in names}
            ask = replace(ask, profile={"schema": "mtu/import/1", "columns": columns})
        file = of_content(source, content)
        if ask.profile is None and identify(file) is None:
            return None
        result = read(file, ask)
        if not contract:
            result.count_on(last)
        report(result)
        return result.converted()

    return convert


def contract_csv(asks: Iterable[tuple[Path, Ask]], spec: TableSpec, report: Report) -> bytes:
    """One CSV of the contract with the rows of all files, checked by its reader; passes and cycles
    are counted on from file to file. Of each file how it was understood is reported.

    Raises InputError with the faults of all files.
    """
    tables, faults, last = list[Import](), CellFaults(), dict[tuple[object, str], int]()
    for path, ask in asks:
        with collected(faults.add):
            table = read(raw_file(path, "file"), ask)
            report(table)
            table.count_on(last)
            tables.append(table)
    # All files have the columns of all: what is read of each is what the one CSV holds of it.
    names = dict.fromkeys(name for table in tables for name in table.columns)
    for table in tables:
        table.columns = {x: table.columns.get(x) or [None] * len(table.rows) for x in names}
    parts = [table.converted() for table in tables]
    if tables:
        rest, files = iter(parts), [(table.file.source.path, "file") for table in tables]
        read_tables(files, spec, faults, lambda source, content: next(rest), parts=True)
    faults.raise_if_any()
    bodies = [content.partition(b"\n")[2] for content, *_ in parts[1:]]
    return b"".join([parts[0][0], *bodies])


def inspection(file: RawFile, decimal: Decimal | None) -> dict[str, Any]:
    """What `mtu inspect` reports of a file: its format, facts and how it would be understood; of an
    XML file its element paths with their counts, too.

    Raises InputError for what fits no format and is no XML.
    """
    entry, faults = identify(file), list[Finding]()
    if entry is None and file.xml is None:
        raise unknown(file)
    name, title, gives, *_ = entry or ("xml", "XML", "")
    ask = Ask(kind="inspect", decimal=decimal)
    result = Import(format=name, file=file, ask=ask)
    if entry:
        with collected(faults.append):
            result = read(file, ask)
    return {
        "format": name,
        "title": title,
        "importable_as": [gives] if gives else [],
        "code_page": file.encoding,
        "rows": len(result.rows),
        "facts": result.facts,
        "says": result.says,
        "left_out": result.left_out,
        "doubts": result.doubts,
        "faults": [each.message for each in faults],
        "elements": dict(Counter(_paths(file))),
    }


def inspection_lines(results: Mapping[str, Any]) -> Iterator[str]:
    """The same as lines of text."""
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


def _paths(file: RawFile) -> Iterator[str]:
    """The path of names of every element of an XML file, without recursion."""
    pending = [] if file.xml is None else [(local(file.xml), file.xml)]
    while pending:
        path, element = pending.pop()
        yield path
        pending += [(f"{path}/{local(child)}", child) for child in reversed(element)]
