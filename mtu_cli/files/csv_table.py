"""What a CSV contract asks of a table and of its cells, and the table that was read."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from mtu_cli.files.contract import number_expectation
from mtu_cli.files.covariates import is_covariate
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, finding

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Decimal = Literal[".", ","]
DECIMALS: tuple[Decimal, ...] = (".", ",")
Kind = Literal["number", "text", "time", "sign", "covariate"]
LISTED_PROBLEMS = 10_000
WHOLE = ("pass", "repeat", "sequence")
"""Columns of whole numbers where a contract names them."""
LARGEST_INTEGER = 2.0**53 - 1.0
"""2^53 and 2^53 + 1 are one float, and so are whole numbers beyond."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSpec:
    """The columns that a contract names; every other column is a covariate.

    `may_be_empty` are named columns whose cells may be empty; `exclusive` pairs must not
    both be there, `together` pairs only both. `units` are texts that are units, `signs` numbers -1
    or +1 that may be written in words. `says` words what a cell of a column should be.
    """

    required: tuple[str, ...]
    numbers: frozenset[str]
    texts: frozenset[str]
    times: frozenset[str] = frozenset()
    signs: frozenset[str] = frozenset()
    may_be_empty: frozenset[str] = frozenset()
    exclusive: tuple[tuple[str, str], ...] = ()
    together: tuple[tuple[str, str], ...] = ()
    units: frozenset[str] = frozenset()
    says: Mapping[str, str] = field(default_factory=dict)

    def kind(self, name: str) -> Kind:
        """How the cells of a column are read."""
        if name in self.numbers:
            return "number"
        if name in self.texts:
            return "text"
        if name in self.times:
            return "time"
        if name in self.signs:
            return "sign"
        return "number" if is_covariate(name) else "covariate"

    @property
    def names(self) -> tuple[str, ...]:
        """All columns that the contract names."""
        return tuple(sorted(self.numbers | self.texts | self.times | self.signs))

    def named(self, name: str) -> bool:
        """Whether the contract names the column."""
        return any(name in own for own in (self.numbers, self.texts, self.times, self.signs))

    def empty_allowed(self, name: str) -> bool:
        """Whether cells of the column may be empty."""
        return name in self.may_be_empty or not self.named(name)


@dataclass(frozen=True, slots=True)
class TextColumn:
    """Texts as codes: `labels[codes[i]]`, code -1 for an empty cell."""

    codes: NDArray[np.int32]
    labels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TimeColumn:
    """Times in microseconds; `aware` where they state their offset from UTC."""

    microseconds: NDArray[np.int64]
    aware: bool


@dataclass(slots=True)
class Columns:
    """Cells of a table by column name; all arrays have one entry a row."""

    numbers: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    texts: dict[str, TextColumn] = field(default_factory=dict)
    times: dict[str, TimeColumn] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A checked CSV table: `rows` (n,) are its rows as an editor counts them.

    A table that is not `sound` has bad cells, reported already; nan and empty texts stand for them.
    """

    source: Source
    header: tuple[str, ...]
    header_row: int
    rows: NDArray[np.int64]
    columns: Columns
    covariates: tuple[str, ...]
    sound: bool = True

    def __len__(self) -> int:
        return len(self.rows)


def cell_text(value: object) -> str:
    """A cell's value as it would be written."""
    return repr(float(value)).removesuffix(".0") if isinstance(value, float) else str(value)


@dataclass(slots=True)
class CellFaults:
    """The faults of cells of a file: the first ten thousand in full, the rest counted."""

    listed: list[Finding] = field(default_factory=list)
    uncounted: int = 0
    _cells: set[tuple[str | None, int, str | int]] = field(default_factory=set)

    def add(self, problem: Finding) -> None:
        """One more problem; of several of one cell the first counts."""
        if problem.row is not None and problem.column is not None:
            cell = (problem.file, problem.row, problem.column)
            if cell in self._cells:
                return
            self._cells.add(cell)
        if len(self.listed) < LISTED_PROBLEMS:
            self.listed.append(problem)
        else:
            self.uncounted += 1

    def add_cells(
        self,
        table: Table,
        at: Sequence[int] | NDArray[np.int64],
        column: str,
        code: str,
        values: Sequence[object],
        expected: str | None = None,
        **facts: Any,
    ) -> None:
        """One problem for each of the rows `at`, counted from 0; `values` is one for each row, or
        one for all.
        """
        room = max(0, self.room())
        for i, index in enumerate(at[:room]):
            value = values[i] if len(values) > 1 else values[0]
            shown = None if value in ("", None) else cell_text(value)
            place = {"file": table.source.shown, "row": int(table.rows[index]), "column": column}
            self.add(finding(code, **place, value=shown, expected=expected, **facts))
        self.uncounted += max(0, len(at) - room)

    def room(self) -> int:
        """How many more are listed one by one."""
        return LISTED_PROBLEMS - len(self.listed)

    def extend(self, other: CellFaults) -> None:
        """All problems of another list."""
        for problem in other.listed:
            self.add(problem)
        self.uncounted += other.uncounted

    def raise_if_any(self) -> None:
        """Raises InputError with every problem, file by file in the order of the rows."""
        if self.listed:
            raise InputError(self.listed, self.uncounted)


# No digit may belong to two of the parts: a long cell would be tried in all ways of cutting it.
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII),
    ",": re.compile(r"[+-]?(?:\d++(?:,\d*+)?|,\d++)(?:[eE][+-]?\d++)?", re.ASCII),
}
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)|[+-]?1\.#(?:inf|ind|qnan)", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:([,.' \u00a0\u202f])\d{3})(?:\1\d{3})*(?:[.,]\d+)?")
_DATE = re.compile(r"\d{4}-?\d{2}-?\d{2}(?:[T ].*)?", re.ASCII)

NO_TIME = -(2**63)
TIME_EXPECTED = "an ISO 8601 time such as 2024-05-03T14:30:00"


def number(cell: str, decimal: Decimal = ".") -> float | None:
    """The value of a cell, or None where it is no number; infinite where it overflows."""
    cell = cell.strip()
    if decimal == "," and "." in cell:
        return None
    text = cell.replace(",", ".") if decimal == "," else cell
    try:
        value = float(text)
    except ValueError:
        return None
    if math.isfinite(value) and "_" not in text and text.isascii():
        return value
    # Python also reads nan, 1_000 and digits of other scripts.
    return value if _NUMBER[decimal].fullmatch(cell) else None


def is_not_finite(cell: str, decimal: Decimal = ".") -> bool:
    """Whether a cell says nan or infinity, or is a number too large for one."""
    value = number(cell, decimal)
    if value is not None:
        return not math.isfinite(value)
    return _NOT_FINITE.fullmatch(cell.strip()) is not None


def is_text(cell: str, decimal: Decimal = ".") -> bool:
    """Whether a cell is neither empty nor a number nor one of the ways to write nan."""
    cell = cell.strip()
    return bool(cell) and number(cell, decimal) is None and not is_not_finite(cell, decimal)


def expectation(cell: str, decimal: Decimal = ".") -> str:
    """What was expected of a cell that is no finite number."""
    cell = cell.strip()
    if is_not_finite(cell, decimal):
        return "a finite number"
    if "\u2212" in cell or "\u2013" in cell:
        return "a number with a plain minus sign (-)"
    if number(cell, "." if decimal == "," else ",") is not None:
        if decimal == ",":
            return "a number with a decimal comma, as in the rest of the file"
        return "a number with a decimal point (a decimal comma needs semicolons between columns)"
    if _THOUSANDS.fullmatch(cell):
        return "a number without thousands separators"
    return number_expectation(cell)


def microseconds(cells: Sequence[str]) -> tuple[NDArray[np.int64], frozenset[bool]]:
    """ISO 8601 times as microseconds, and whether they state an offset from UTC.

    A cell that is no time gives the smallest integer (`NO_TIME`).
    """
    import numpy as np
    import pandas as pd

    shaped = [cell if _DATE.fullmatch(cell) else None for cell in map(str.strip, cells)]
    parsed = pd.to_datetime(
        pd.Series(shaped, dtype="object"), format="ISO8601", errors="coerce", utc=True
    )
    values = parsed.dt.tz_localize(None).to_numpy(dtype="datetime64[us]").astype(np.int64)
    pairs = zip(shaped, values.tolist(), strict=True)
    aware = {_states_offset(cell) for cell, value in pairs if cell and value != NO_TIME}
    return values, frozenset(aware)


def _states_offset(cell: str) -> bool:
    clock = cell[10:] if cell[4] == "-" else cell[8:]
    return clock.endswith(("Z", "z")) or "+" in clock or "-" in clock
