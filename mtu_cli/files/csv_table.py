"""The rows of the files of a call as one table, and what is wrong with its cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.headers import TableSpec
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, finding

Decimal = Literal[".", ","]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

LISTED_FAULTS = 10_000
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)
MINUTE = 60_000_000
"""In microseconds."""
ODD, SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


class CellFaults:
    """The faults of the files of a call: the first ten thousand in full, the rest counted."""

    def __init__(self) -> None:
        self.listed: list[Finding] = []
        self.uncounted = 0
        self._cells: set[tuple[str | None, int, str | int]] = set()

    def add(self, fault: Finding) -> None:
        """One more; of several of one cell the first counts."""
        if fault.row is not None and fault.column is not None:
            cell = (fault.file, fault.row, fault.column)
            if cell in self._cells:
                return
            self._cells.add(cell)
        if len(self.listed) < LISTED_FAULTS:
            self.listed.append(fault)
        else:
            self.uncounted += 1

    def cells(
        self,
        table: Table,
        bad: Flags,
        column: str,
        describe: Callable[[int], dict[str, Any]] = lambda i: {},
        **facts: Any,
    ) -> None:
        """One fault for each of the `bad` rows (n,), with the `facts` and those of `describe` for
        the row, counted from 0: its code and what belongs to it.
        """
        rows = np.flatnonzero(bad)
        room = max(0, LISTED_FAULTS - len(self.listed))
        for i in rows[:room].tolist():
            self.add(finding(**{**table.place(i, column), **facts, **describe(i)}))
        self.uncounted += max(0, len(rows) - room)

    def raise_if_any(self) -> None:
        """Raises InputError with every fault, file by file in the order of the rows."""
        if self.listed:
            raise InputError(self.listed, self.uncounted)


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of texts as codes (n,): `labels[codes[i]]`, code -1 for an empty cell."""

    codes: Ints
    labels: tuple[str, ...]


@dataclass(slots=True, kw_only=True)
class File:
    """A file of a table: UTF-8 text with plain line ends, comment lines blanked, so that lines
    still count as in an editor; its `content` until that is read.

    `body` is the offset of the line after the header; `aware`: whether its times state their
    offset from UTC, both where they contradict each other; `lines` and `headings`: of rows and
    columns that were made from an instrument's file, those there.
    """

    source: Source
    content: bytes
    header: tuple[str, ...]
    header_row: int
    body: int
    separator: str
    decimal: Decimal
    aware: frozenset[bool] = frozenset()
    lines: list[int] | None = None
    headings: Mapping[str, str] = field(default_factory=dict)

    @property
    def place(self) -> dict[str, Any]:
        """File and row of its header."""
        return {"file": self.source.shown, "row": self.header_row}


@dataclass(slots=True, kw_only=True)
class Table:
    """The rows of one or several files, end to end; every array has one entry a row.

    `rows` as in an editor, in the file `files[file_index[i]]`; `numbers` are nan where there is
    none, those of ``time`` microseconds since 1970.
    """

    files: tuple[File, ...]
    rows: Ints
    file_index: Ints
    numbers: dict[str, Floats] = field(default_factory=dict)
    texts: dict[str, Texts] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files as reports know them."""
        return tuple(file.source for file in self.files)

    @property
    def header(self) -> list[str]:
        """The columns of all files."""
        return [*dict.fromkeys(name for file in self.files for name in file.header)]

    def place(self, i: int, column: str | None = None) -> dict[str, Any]:
        """File and row of a row counted from 0, and the heading of a column in that file."""
        file = self.files[self.file_index[i]]
        place = {"file": file.source.shown, "row": int(self.rows[i])}
        return place if column is None else {**place, "column": file.headings.get(column, column)}

    def number(self, name: str) -> Floats:
        """A column of numbers (n,), nan where there is none; not to be written to."""
        return self.numbers.get(name, np.broadcast_to(np.nan, len(self)))

    def whole(self, name: str) -> Ints:
        """A column of whole numbers (n,), -1 where there is none; not to be written to."""
        if name not in self.numbers:
            return np.broadcast_to(np.int64(-1), len(self))
        return np.nan_to_num(self.numbers[name], nan=-1.0).astype(np.int64)

    def labelled(self, name: str, order: Sequence[str] = ()) -> tuple[tuple[str, ...], Ints]:
        """Labels and each row's code (n,); -1 where there is none.

        Labels in this `order`, then in that of appearance; those that no row has are left out.
        """
        column = self.texts.get(name, Texts(np.full(len(self), -1), ()))
        rank = {label: i for i, label in enumerate(order)}
        labels = sorted(column.labels, key=lambda label: rank.get(label, len(rank)))
        if tuple(labels) == column.labels:
            return column.labels, column.codes
        place = {label: i for i, label in enumerate(labels)}
        return tuple(labels), np.array([*(place[x] for x in column.labels), -1])[column.codes]

    def of_files(self, judge: Callable[[File], bool]) -> Flags:
        """What `judge` says of each row's file (n,)."""
        return np.array([judge(file) for file in self.files])[self.file_index]

    def has(self, name: str) -> Flags:
        """Whether each row's file has the column (n,)."""
        return self.of_files(lambda file: name in file.header)

    def fields(self, spec: TableSpec) -> dict[str, Any]:
        """What the rows of every contract have: the fields of `Measured`."""
        if (times := self.numbers.get("time")) is None:
            minutes = self.number("time_min")
        else:
            minutes = (times - np.nanmin(times)) / MINUTE
        covariates: dict[str, Floats | NDArray[np.object_]] = {}
        for name in (name for name in self.header if name not in spec.columns):
            if name in self.numbers:
                covariates[name] = self.numbers[name]
            else:
                column = self.texts[name]
                covariates[name] = np.array([*column.labels, ""], dtype=object)[column.codes]
        return {
            "time_min": minutes,
            "covariates": covariates,
            "file_index": self.file_index,
            "row": self.rows,
            "sources": self.sources,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """What readings and points have alike, of all files, end to end; every array has one entry a
    row and may be read-only.

    `time_min` in minutes, from the earliest time of all files where those are dates, nan where not
    given; `covariates`, the columns that the contract does not name, are floats (nan where not
    given) or texts ("" where not given); `row` counts as a text editor in the file
    `sources[file_index[i]]`.
    """

    time_min: Floats
    covariates: dict[str, Floats | NDArray[np.object_]]
    file_index: Ints
    row: Ints
    sources: tuple[Source, ...]


def joined(tables: Sequence[Table]) -> Table:
    """Tables end to end. A covariate that is a number in one file and a text in another is a text
    in all.
    """
    if len(tables) == 1:
        return tables[0]
    result = Table(
        files=tuple(table.files[0] for table in tables),
        rows=np.concatenate([table.rows for table in tables]),
        file_index=np.repeat(np.arange(len(tables)), [len(table) for table in tables]),
    )
    for name in result.header:
        if all(name not in table.texts for table in tables):
            result.numbers[name] = np.concatenate([table.number(name) for table in tables])
            continue
        parts: list[tuple[Ints, Sequence[str]]] = []
        for table in tables:
            if column := table.texts.get(name):
                parts.append((column.codes, column.labels))
            else:
                cells = ["" if v != v else cell_text(v) for v in table.number(name).tolist()]
                parts.append((np.arange(len(cells)), cells))
        result.texts[name] = stacked(parts)
    return result


def stacked(parts: Sequence[tuple[Ints, Sequence[str]]]) -> Texts:
    """Parts of a column, each `cells[codes[i]]`, end to end: no text twice, none that is empty."""
    labels: dict[str, int] = {}
    codes = [np.zeros(0, np.int64)]
    for code, cells in parts:
        index = [labels.setdefault(cell, len(labels)) if cell else -1 for cell in cells]
        codes.append(np.array([*index, -1])[code])
    return Texts(np.concatenate(codes), tuple(labels))


def perhaps_equal(columns: Sequence[NDArray[Any]]) -> Flags:
    """Whether another row may equal each row (n,), over `columns` (n,) of floats or whole numbers.

    Rows are compared by marks of 64 bits: those of unequal rows agree with probability 2^-64.
    """
    marks = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        # Adding 0 makes -0.0 the 0.0 that it equals.
        marks = (marks ^ (column + 0).view(np.uint64)) * ODD
        marks ^= marks >> SHIFT
    ordered = np.sort(marks)
    return np.isin(marks, ordered[1:][ordered[1:] == ordered[:-1]])


def cell_text(value: object) -> str:
    """A cell's value as it would be written."""
    return repr(float(value)).removesuffix(".0") if isinstance(value, float) else str(value)


def number(cell: str, decimal: Decimal = ".") -> float | None:
    """The value of a cell; nan or infinite where it reads so or overflows, None of no number."""
    text = cell.strip()
    if decimal == ",":
        text = "" if "." in text else text.replace(",", ".")
    try:
        value = float(text)
    except ValueError:
        return None
    # Python also reads 1_000 and digits of other scripts.
    return value if text.isascii() and "_" not in text else None


def expectation(cell: str, decimal: Decimal) -> str:
    """What was expected of a cell that is no finite number."""
    if number(cell, decimal) is not None:
        return "a finite number"
    if number(cell, "." if decimal == "," else ",") is None:
        return "a number"
    if decimal == ",":
        return "a number with a decimal comma, as in the rest of the file"
    return "a number with a decimal point (a decimal comma needs semicolons between columns)"


def time_of(cell: str) -> tuple[float, bool] | None:
    """An ISO 8601 time in microseconds since 1970, and whether it states its offset from UTC; None
    of anything else.
    """
    try:
        time = datetime.fromisoformat(cell.upper())
    except ValueError:
        return None
    aware = time.tzinfo is not None
    return ((time if aware else time.replace(tzinfo=UTC)) - EPOCH) / MICROSECOND, aware
