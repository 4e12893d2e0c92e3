"""What all instruments' files share: their text, what is asked of them, and what they hold."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from mtu_cli.files.csv_file import GZIP, Converted, inflated
from mtu_cli.files.headers import POINTS, READINGS, CellFaults, Decimal, number
from mtu_cli.files.source import MARKS, Source, read_source
from mtu_cli.findings import Finding, InputError, error, finding, suggestion
from mtu_cli.units import UNITS, plain_unit

CODE_PAGES = ("utf-8-sig", "cp1252", "gbk")
"""In this order: the first that fits; each later one accepts more."""
MOJIBAKE = {"\u00c2\u00b0": "\u00b0", "\u00c2\u00b5": "\u00b5", "\u00ce\u00bc": "\u00b5"}
"""UTF-8 that was once read as cp1252 and saved again."""
MAX_BYTES = 200_000_000
SPECS = {"readings": READINGS, "drift": READINGS, "points": POINTS}


@dataclass(frozen=True, kw_only=True)
class RawFile:
    """An instrument's file: its bytes, and its text where it is one (code page `encoding`)."""

    source: Source
    content: bytes
    text: str = ""
    encoding: str = "binary"

    @cached_property
    def lines(self) -> list[str]:
        """Lines by line feeds alone: other separators may stand inside names and records."""
        text = self.text if "\n" in self.text else self.text.replace("\r", "\n")
        return [line.removesuffix("\r") for line in text.split("\n")]

    @cached_property
    def xml(self) -> ElementTree.Element | None:
        """The root of an XML file, None of any other; entities are not expanded but refused."""
        if not self.text.lstrip().startswith("<") or re.search(r"<!(DOCTYPE|ENTITY)", self.text):
            return None
        try:
            return ElementTree.fromstring(self.text)
        except (ElementTree.ParseError, ValueError, RecursionError):
            return None

    def finding(self, code: str, **facts: Any) -> Finding:
        """A finding of this file."""
        return finding(code, file=self.source.shown, **facts)

    def error(self, code: str, **facts: Any) -> InputError:
        """An error of this file."""
        return error(code, file=self.source.shown, **facts)


@dataclass(frozen=True, kw_only=True)
class Ask:
    """What the caller says of a file: the component it reads and its unit, what it is wanted as,
    and what the file leaves open; `machine_units` are those of the machine's components. Of `kind`
    inspect nothing has to be answered.
    """

    kind: str | None = None
    component: str | None = None
    unit: str | None = None
    machine_units: Mapping[str, str] = field(default_factory=dict)
    decimal: Decimal | None = None
    directions: str | None = None
    profile: Path | Mapping[str, Any] | None = None


@dataclass(kw_only=True)
class Import:
    """What a file holds, and what the caller asks of it: columns of the contract's CSV, one entry a
    row, whose line in the file is `rows`; `headings` of columns in the file. `says` how it was
    understood, `left_out` what is not in the columns with its count, `doubts` what ought to be
    looked at, `facts` what `mtu inspect` shows; all `faults` are reported before anything is made
    of what is sound.
    """

    format: str
    file: RawFile
    ask: Ask
    kind: str = "readings"
    columns: dict[str, list[Any]] = field(default_factory=dict)
    rows: list[int] = field(default_factory=list)
    headings: dict[str, str] = field(default_factory=dict)
    says: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    left_out: dict[str, int] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    faults: CellFaults = field(default_factory=CellFaults)

    def add(self, row: int, **cells: Any) -> None:
        """One more row; a cell that is not given is empty."""
        for name in cells:
            self.columns.setdefault(name, [None] * len(self.rows))
        for name, column in self.columns.items():
            column.append(cells.get(name))
        self.rows.append(row)

    def drop(self, what: str, count: int = 1) -> None:
        """Counts what is left out."""
        if count:
            self.left_out[what] = self.left_out.get(what, 0) + count

    def count_on(self, last: dict[tuple[object, str], int]) -> None:
        """Counts the passes and cycles of each component on from the `last` of earlier files, by
        component and column, and keeps its own there.
        """
        for name in () if self.kind == "points" else ("pass", "cycle"):
            cells, components = self.columns.get(name, []), self.columns.get("component", [])
            values = {i: number(str(cell), ".") for i, cell in enumerate(cells)}
            whole = {i: int(x) for i, x in values.items() if x is not None and x.is_integer()}
            # They count from 1, or from 0.
            first, earlier = dict[object, int](), dict(last)
            for i, value in whole.items():
                first[components[i]] = min(first.get(components[i], 1), value)
            for i, value in whole.items():
                place = components[i], name
                offset = earlier[place] + 1 - first[components[i]] if place in earlier else 0
                cells[i] = value + offset
                last[place] = max(last.get(place, cells[i]), cells[i])

    @property
    def sentence(self) -> str:
        """How the file was understood, and what was left out."""
        kind = "drift readings" if self.kind == "drift" else self.kind
        omissions = ", ".join(f"{count} {what}" for what, count in self.left_out.items())
        # First what must not be lost where a message is cut.
        parts = [f"{len(self.rows)} {kind}", f"left out: {omissions or 'nothing'}", *self.says]
        return f"{self.format}: {'; '.join(parts)}"

    def converted(self) -> Converted:
        """The contract's CSV, numbers to the last digit, for the reader of that."""
        order = (*SPECS[self.kind].columns, *self.columns)
        names = [name for name in dict.fromkeys(order) if name in self.columns]
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")  # floats in full, None as nothing
        writer.writerow(names)
        writer.writerows(zip(*(self.columns[name] for name in names), strict=True))
        return out.getvalue().encode(), self.rows, self.headings

    def fault(self, code: str, **facts: Any) -> None:
        """One more fault of the file."""
        self.faults.add(self.file.finding(code, **facts))

    def bad_cell(self, row: int, column: str, value: str, expected: str = "a number") -> None:
        """A cell that is not what stands in its column."""
        place = {"row": row, "column": column, "expected": expected}
        if value:
            self.fault("wrong-type", kind=expected, value=value, **place)
        else:
            self.fault("empty-cell", **place)

    def unit_of(self, stated: str | None, component: str | None = None) -> str:
        """The unit of the readings of a component: as the file has it, or as the caller says where
        it has none, or the machine.
        """
        ask, name = self.ask, component or self.ask.component
        unit = stated or ask.unit or ask.machine_units.get(name or "", "")
        if stated:
            self.says.append(f"readings in {stated}, as the file says")
        elif unit:
            whose = "the unit given" if ask.unit else "the component's unit"
            self.says.append(f"readings without a unit taken in {unit}, {whose}")
        elif ask.machine_units and name:
            facts = suggestion(name, ask.machine_units)
            raise self.file.error("unknown-name", value=name, what="component", **facts)
        elif ask.kind != "inspect":
            expected = "`unit: um` in the study, import --unit um, or a machine with the component"
            raise self.file.error("missing-input", what="the unit of the readings",
                                  expected=expected)  # fmt: skip
        return unit

    def add_readings(
        self, unit: str, readings: Iterable[tuple[int, float, int, str | None, float]]
    ) -> None:
        """Adds readings of one component: line, target, pass, direction and error of each.

        Raises InputError where the caller does not name the component, and where there are none.
        """
        component = self.ask.component
        if not component and self.ask.kind != "inspect":
            expected = "NAME=FILE, as --laser dx_x=FILE (of mtu import: --component NAME)"
            raise self.file.error("missing-input", what="the component that the file reads",
                                  expected=expected)  # fmt: skip
        for line, target, run, way, value in readings:
            self.add(line, component=component or "?", position_mm=target, **{"pass": run},
                     direction=way, error=value, unit=unit)  # fmt: skip
        if not self.rows:
            expected = f"a whole {self.format}"
            raise self.file.error("empty-file", what="readings", expected=expected)


class Format(NamedTuple):
    """One entry of the registry: what recognises a file, and reads it; it `gives` readings, points,
    drift, features that are shown and not imported, or "": it is the contract's CSV already.
    """

    name: str
    title: str
    gives: str
    sniff: Callable[[RawFile], bool]
    read: Callable[[Import], None]


def raw_file(path: Path, role: str) -> RawFile:
    """The file with its text; raises InputError where it cannot be read."""
    return of_content(*read_source(path, role, max_bytes=MAX_BYTES))


def of_content(source: Source, content: bytes) -> RawFile:
    """The same of bytes that were read; no text where there are zero bytes, or a mark of another
    kind of file.
    """
    if content.startswith(GZIP):
        content = inflated(content, source.shown)
    start = content[:64].lower()
    if b"\0" in content or any(start.startswith(mark) for mark in MARKS if b"<" not in mark):
        return RawFile(source=source, content=content)
    for encoding in CODE_PAGES:
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            for broken, sign in MOJIBAKE.items():
                text = text.replace(broken, sign)
            name = encoding.removesuffix("-sig")
            return RawFile(source=source, content=content, text=text, encoding=name)
    return RawFile(source=source, content=content)


def unit_in(text: str) -> str | None:
    """The unit of a reading that a heading names.

    >>> unit_in("Run 1 [\u00b5m]"), unit_in("error_um"), unit_in("Run 1")
    ('um', 'um', None)
    """
    plain = plain_unit(text)
    bracketed = re.search(r"[\[(]([^\])]*)[\])]", plain)
    names = [bracketed[1].strip()] if bracketed else re.split(r"[\s_,:]+", plain)[1:]
    units = {name.casefold(): name for name in UNITS} | {"micron": "um", "'": "", '"': "arcsec"}
    result = [units.get(name.casefold(), "") for name in names]
    return next((name for name in reversed(result) if name), None)


def local(element: ElementTree.Element) -> str:
    """The name of an XML element without its namespace."""
    return element.tag.rpartition("}")[2]
