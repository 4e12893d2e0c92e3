"""What a contract states of the columns of a CSV table, the check of a header against it, and the
rows of the files of a call as one table.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime, timedelta
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.contract import A_NAME, is_name
from mtu_cli.files.covariates import SIGN_EXPECTED, direction_sign, is_covariate
from mtu_cli.files.source import SYNTHETIC, Source
from mtu_cli.findings import Finding, InputError, error, finding, listed, nearest, suggestion
from mtu_cli.units import UNITS

Decimal = Literal[".", ","]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Kind = Literal["number", "whole", "count", "free", "sign", "time", "text"]
LARGEST_READING = 1e12
"""Beyond it no cell is a measurement, and squares would overflow."""
LARGEST_INTEGER = 2.0**53 - 1.0
"""2^53 and 2^53 + 1 are one float, and so are whole numbers beyond."""
TIME_EXPECTED = "an ISO 8601 time such as 2024-05-03T14:30:00"
WANTED = {
    "text": ("a name that a table can show", A_NAME),
    "time": ("a time", TIME_EXPECTED),
    "sign": ("a direction", SIGN_EXPECTED),
}
"""What a cell of a kind is, and how it is written; those of other kinds are numbers."""
OF_DECIMAL = {
    ".": "a number with a decimal point (a decimal comma needs semicolons between columns)",
    ",": "a number with a decimal comma, as in the rest of the file",
}
"""What is expected of a number with the other decimal sign."""
SAYS_NOTHING = {"no", "nr", "number", "num", "id", "name", "mm", "s"}
"""Words of a column's name that tell it from no other."""
LIKE = 0.6
"""Likeness of the name of a column that has to be there."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column that a contract names.

    A `whole` number may be negative, a `count` is not; a `free` column holds numbers or texts; a
    `sign` is -1 or +1 and may be written in words. `largest` bounds a number in size. `texts` are
    what its cells may be (None: any name). `says`: what a cell should be, where the kind
    does not say it.
    """

    kind: Kind = "number"
    required: bool = False
    may_be_empty: bool = False
    largest: float = LARGEST_READING
    texts: Collection[str] | None = None
    says: str = ""

    @property
    def numeric(self) -> bool:
        """Whether its cells are numbers and nothing else."""
        return self.kind in ("number", "whole", "count")

    @property
    def whole(self) -> bool:
        """Whether its numbers are whole."""
        return self.kind in ("whole", "count")

    def value(self, cell: str, file: File) -> float:
        """What stands for a cell: 0 for a text; nan for an empty cell, infinity for what may not
        be. Whether a time states its offset from UTC is noted in the `file`.
        """
        value: float | None
        if not cell:
            return math.nan
        if self.kind == "text":
            sound = is_name(cell) if self.texts is None else cell in self.texts
            value = 0.0 if sound else None
        elif self.kind == "sign":
            value = direction_sign(cell)
        elif self.kind == "time":
            value, *aware = time_of(cell) or (None,)
            file.aware |= {*aware}
        else:
            value = number(cell, file.decimal)
        return math.inf if value is None or math.isnan(value) else value

    def excludes(self, numbers: Floats) -> Flags:
        """Where numbers (n,) are none that it may hold; nan is an empty cell."""
        largest = min(self.largest, sys.float_info.max)
        # Extremes cost less than flags: nan makes both nan.
        in_range = numbers.min(initial=0.0) >= -largest and numbers.max(initial=0.0) <= largest
        odd = np.zeros(len(numbers), bool) if in_range else ~(np.abs(numbers) <= largest)
        if self.whole:
            odd |= numbers != np.rint(numbers)
        if self.kind == "count":
            odd |= numbers < 0
        return odd & ~np.isnan(numbers) if self.may_be_empty and odd.any() else odd

    def fault(self, name: str, cell: str, decimal: Decimal) -> dict[str, Any]:
        """What a Finding says of a cell that is no value of the column of this `name`."""
        kind, expected = WANTED.get(self.kind, ("a number", "a number"))
        if not cell:
            return {"code": "empty-cell", "expected": self.says or expected}
        if self.texts is not None:
            hint = suggestion(cell, self.texts)
            return {"code": "unknown-name", "value": cell, "what": name, **hint}
        facts = {"code": "wrong-type", "value": cell, "kind": kind, "expected": expected}
        if self.kind in WANTED:
            meant = nearest(cell, ("forward", "reverse")) if self.kind == "sign" else ()
            return {**facts, "meant": meant}
        value, other = number(cell, decimal), number(cell, "." if decimal == "," else ",")
        if value is None or not math.isfinite(value):
            if value is not None:
                expected = "a finite number"
            elif other is not None:
                expected = OF_DECIMAL[decimal]
            return {**facts, "expected": self.says or expected}
        expected = f"at most {self.largest:g} in size"
        if self.whole and (value % 1 or value < 0):
            expected = "a whole number" + " from 0 on" * (self.kind == "count")
        facts["expected"] = self.says or expected
        if self.whole and value % 1:
            return {**facts, "kind": "a whole number"}
        return {**facts, "code": "out-of-range"}


SENSOR = Column(may_be_empty=True, largest=math.inf)
FREE = Column("free", may_be_empty=True, largest=math.inf)
"""What no contract names: covariates of every machine, and any other column."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSpec:
    """The `columns` that a contract names; every other column is a covariate.

    What the table `holds`, and the `option` that takes it. Of each of `pairs` both columns must be
    there, or none.
    """

    columns: Mapping[str, Column]
    holds: str = "a table"
    option: str = ""
    pairs: tuple[tuple[str, str], ...] = ()

    @property
    def required(self) -> list[str]:
        """The columns that every table has."""
        return [name for name, column in self.columns.items() if column.required]

    def column(self, name: str) -> Column:
        """How the cells of a column are read."""
        return self.columns.get(name) or (SENSOR if is_covariate(name) else FREE)

    def with_texts(self, name: str, texts: Collection[str] | None) -> TableSpec:
        """The same contract where the cells of a column are one of `texts` (None: any)."""
        column = replace(self.columns[name], texts=texts)
        return replace(self, columns={**self.columns, name: column})


EXCLUSIVE = ("time", "time_min")
"""Columns of which a table has one at most."""
TIMES = {
    "time": Column("time", largest=math.inf),
    # Minutes since 1970 are within a century, seconds are not.
    "time_min": Column(largest=5.3e7, says="minutes, at most a century (5.3e+07) from the start"),
}
PASS = Column("count", largest=LARGEST_INTEGER, says="a whole number from 0 to 2^53 - 1")
READINGS = TableSpec(
    holds="readings of components",
    option="--lbb, --laser or --drift",
    columns={
        "component": Column("text", required=True, says="the name of a component of the machine"),
        "position_mm": Column(may_be_empty=True),
        "pass": PASS,
        "direction": Column("sign", may_be_empty=True),
        "error": Column(required=True),
        "unit": Column("text", required=True, texts=UNITS, says=f"one of: {', '.join(UNITS)}"),
        "cycle": Column(
            "text", says="the name of a warm-up or cool-down in every row, or no column 'cycle'"
        ),
        **TIMES,
    },
)
"""Of ``--lbb``, ``--laser`` and ``--drift``: one row per reading of one error component."""
POINTS = TableSpec(
    holds="measured points",
    option="--cmm",
    pairs=(("nominal_x_mm", "nominal_y_mm"),),
    columns={
        "part": Column("text", required=True, says="the serial number or name of the part"),
        "feature": Column("text", required=True, says="the name of a feature of the part"),
        "operation": Column(
            "text", says="a name such as drilled in every row, or no column 'operation'"
        ),
        "repeat": Column("count"),
        "sequence": Column(
            "whole", largest=LARGEST_INTEGER, says="a whole number, at most 2^53 - 1 in size"
        ),
        **{f"{axis}_mm": Column(required=axis != "z") for axis in "xyz"},
        **{f"nominal_{axis}_mm": Column(may_be_empty=True) for axis in "xyz"},
        **{f"dir_{axis}": Column("sign", may_be_empty=True) for axis in "xyz"},
        **TIMES,
    },
)
"""Of ``--cmm``: one row per measured point."""
SYNONYMS = {
    "component": "error component, error name, parameter, komponente",
    "error": "value, reading, deviation, abweichung",
    "unit": "units, einheit",
    "position_mm": "position, pos, target, target position, nominal position",
    "pass": "run, repeat, repetition, durchlauf",
    "direction": "dir, approach, richtung",
    "cycle": "warm up, zyklus",
    "time": "timestamp, date, datetime, zeit",
    "time_min": "minutes, elapsed min",
    "part": "workpiece, piece, serial, serial number, sn, teil, werkst\u00fcck",
    "feature": "hole, bore, point, element, characteristic, merkmal, bohrung",
    "operation": "process",
    "repeat": "repetition, replicate, run, trial, measurement, wiederholung",
    "sequence": "order, reihenfolge",
    **{f"{a}_mm": f"{a}, actual {a}, measured {a}, act {a}, ist {a}" for a in "xyz"},
    **{f"nominal_{a}_mm": f"nominal {a}, nom {a}, soll {a}" for a in "xyz"},
    **{f"dir_{a}": f"direction {a}, approach {a}" for a in "xyz"},
}
"""What other programs call a column: words in any order, without unit, number and accents."""


def measured_in(path: Path) -> str | None:
    """What a file holds by its header: readings or points; None of anything else."""
    names = {*header_names(filled_lines(path))}
    return next((x.holds for x in (READINGS, POINTS) if {*x.required} <= names), None)


def header_names(lines: Iterable[str]) -> list[str]:
    """The cells of the first line that is no comment, in lower case."""
    line = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    return [cell.strip().strip('"').lower() for cell in re.split(r"[,;\t]", line)]


def is_made(path: Path) -> bool:
    """Whether a file is empty, or says that it is synthetic."""
    return next(filled_lines(path), SYNTHETIC).lstrip().startswith(SYNTHETIC)


def filled_lines(path: Path) -> Iterator[str]:
    """The lines of a text file that are not empty, as far as it can be read."""
    with suppress(OSError), path.open(encoding="utf-8-sig", errors="replace") as file:
        yield from (line for line in file if line.strip())


def check_header(source: Source, row: int, header: Sequence[str], spec: TableSpec) -> None:
    """Raises InputError for columns that are missing, doubled, without a name or at odds, and for
    a table of another contract.
    """
    place = {"file": source.shown, "row": row}
    if not {*spec.required} & {*header}:
        for contract in (READINGS, POINTS):
            if {*contract.required} <= {*header}:
                expected = f"{spec.holds} ({contract.option} takes {contract.holds})"
                raise error("other-table", kind=contract.holds, expected=expected, **place)
    faults: list[Finding] = []
    for i, name in enumerate(header, 1):
        if not is_name(name):
            expected = A_NAME if name else "a name, or no such column"
            facts: dict[str, Any] = {"value": name, "column": i, "expected": expected, **place}
            faults.append(finding("wrong-type", kind="a name that a table can show", **facts))
        elif name in header[: i - 1]:
            expected = f"one of the columns {header.index(name) + 1} and {i}"
            facts = {"column": name, "expected": expected, **place}
            faults.append(finding("appears-twice", what="the column", **facts))
    required_names = {*spec.required}
    required_names |= {name for pair in spec.pairs if {*pair} & {*header} for name in pair}
    extras = [name for name in header if name and name not in spec.columns]
    for name in spec.columns:
        if name not in required_names or name in header:
            continue
        match = meant_by(name, extras, LIKE)
        extras = [column for column in extras if column != match]
        hint = f"a column {name!r} (the columns are {listed(header, 12)})"
        unit = name.rpartition("_")[2]
        values = f", its values in {unit}" if unit in UNITS and unit not in f"{match}" else ""
        expected = f"{match!r} renamed to {name!r}{values}" if match else hint
        faults.append(finding("missing-column", column=name, expected=expected, **place))
    if {*EXCLUSIVE} <= {*header}:
        faults.append(finding("exclusive", names=EXCLUSIVE, expected="one of them", **place))
    if faults:
        raise InputError(faults)


def meant_by(name: str, columns: Sequence[str], likeness: float) -> str | None:
    """The one of `columns` that is probably meant as `name` of a contract: by a synonym, by
    its words in another order or case, or by letters that are alike.
    """
    words = {_words(text) for text in (name, *SYNONYMS.get(name, name).split(", "))}
    if same := [column for column in columns if _words(column) in words]:
        return same[0] if len(same) == 1 else None
    letters = {column[:200].casefold(): column for column in columns}
    matches = get_close_matches(name, letters, 1, likeness)
    return letters[matches[0]] if matches else None


def _words(name: str) -> frozenset[str]:
    """The words of a name in lower case, without units in brackets and plain numbers."""
    plain = re.sub(r"[\[(/].*$", "", name[:200].casefold())
    words = frozenset(re.findall(r"[^\W\d_]+", plain))
    return words - SAYS_NOTHING or words


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

    def __len__(self) -> int:
        return len(self.row)

    def place(self, i: int) -> dict[str, Any]:
        """File and row of a row counted from 0."""
        return {"file": self.sources[self.file_index[i]].shown, "row": int(self.row[i])}

    def where(self, rows: NDArray[Any]) -> Self:
        """Some of the rows, by index (k,) or mask (n,); names keep their codes."""
        columns = {item.name: getattr(self, item.name) for item in fields(self)}
        arrays = {name: x[rows] for name, x in columns.items() if isinstance(x, np.ndarray)}
        covariates = {name: column[rows] for name, column in self.covariates.items()}
        return replace(self, covariates=covariates, **arrays)


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

    Rows are compared by marks of 64 bits: those of unequal rows agree with probability 2^-64. To
    group them by pandas takes three times as long.
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
