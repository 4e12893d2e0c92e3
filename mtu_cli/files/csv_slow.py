"""CSV tables cell by cell: exact rows and plain words for all that is wrong."""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import TYPE_CHECKING

from mtu_cli.errors import Problem
from mtu_cli.files.csv_cells import (
    NO_TIME,
    TIME_EXPECTED,
    expectation,
    is_not_finite,
    is_text,
    microseconds,
    number,
    overflows,
)
from mtu_cli.files.csv_table import (
    LARGEST_INTEGER,
    LARGEST_READING,
    WHOLE,
    Columns,
    ProblemList,
    TableSpec,
    TextColumn,
    TimeColumn,
)
from mtu_cli.files.csv_text import CELL_LIMIT, CsvText, lines_from
from mtu_cli.files.csv_times import time_faults

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_DATE = re.compile(r"\s*(?:[0-9]{1,4}[-./][0-9]{1,2}[-./][0-9]|[0-9]{1,2}:[0-9]{2})")
"""How a date or a time of day begins."""


def read_slow(
    text: CsvText, spec: TableSpec, problems: ProblemList
) -> tuple[NDArray[np.int64], Columns]:
    """The editor rows and all columns of a table that the fast reader would not vouch for.

    Every bad cell of the file goes to `problems`; nan, NO_TIME or an empty text stands for it,
    so that what the sound cells mean can be checked as well. Short and long rows are left out.
    """
    import numpy as np

    rows = array("q")
    stores = [_store(name, text, spec, problems) for name in text.header]
    for row, cells in _records(text, problems):
        if len(cells) != len(stores):
            problems.add(_wrong_length(text, row, cells))
        elif tuple(map(str.strip, cells)) == text.header:
            what = "the header again, as in a table that was pasted again"
            problems.add(_problem(text, row, None, what, None, "each row once"))
        elif not any(cell.strip() for cell in cells):
            expected = "a row of values, or no separators"
            problems.add(_problem(text, row, None, "all cells are empty", None, expected))
        else:
            rows.append(row)
            for store, cell in zip(stores, cells, strict=True):
                store.add(row, cell)
    columns = Columns()
    for store in stores:
        store.finish(columns)
    return np.frombuffer(rows, np.int64) if rows else np.zeros(0, np.int64), columns


def _records(text: CsvText, problems: ProblemList) -> Iterator[tuple[int, list[str]]]:
    """(editor row, cells) of every record; a cell that never closes ends them."""
    lines = lines_from(text.content, text.body)
    reader = csv.reader(lines, delimiter=text.separator, strict=True)
    while True:
        row = text.body_row + reader.line_num
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            problems.add(_broken(text, row, str(error)))
            return
        if cells and not (len(cells) == 1 and not cells[0].strip() and len(text.header) > 1):
            yield row, cells


def _broken(text: CsvText, row: int, reason: str) -> Problem:
    what, expected = f"a cell cannot be read ({reason})", 'quotes inside a cell doubled: ""'
    if "unexpected end" in reason:
        what, expected = "a quote that opens in this row is never closed", 'a closing "'
    elif "field larger" in reason:
        what = f"a cell has more than {CELL_LIMIT} characters"
        expected = 'a closing " where a quote was opened'
        line = next(islice(lines_from(text.content, text.body), row - text.body_row, None), "")
        if '"' not in line:
            expected = "a table of numbers and names"
    return _problem(text, row, None, what, None, expected)


def _problem(
    text: CsvText, row: int, column: str | None, what: str, value: str | None, expected: str | None
) -> Problem:
    return Problem(
        what=what,
        file=text.source.shown,
        row=row,
        column=column,
        value=value,
        expected=expected,
    )


_INTEGER = re.compile(r"[+-]?\d+")


_SIGNS: dict[str, str] = {",": "commas", ";": "semicolons"}


def _wrong_length(text: CsvText, row: int, cells: list[str]) -> Problem:
    wanted = len(text.header)
    (other,) = _SIGNS.keys() - {text.separator}
    # Commas may be decimal ones beside other separators, not where they are the only sign.
    apart = text.separator == "," or len(cells) == 1
    if apart and wanted > 1 and text.separator.join(cells).count(other) == wanted - 1:
        # Without its value the same stands in every such row, and is told once.
        signs = f"{_SIGNS[other]} here, {_SIGNS[text.separator]} in the header"
        what = f"the separators of the columns are mixed: {signs}"
        return _problem(text, row, None, what, None, "the same ones in all rows")
    expected = f"{wanted}, as in the header"
    surplus = len(cells) - wanted
    if surplus > 0:
        pairs = pairwise(cells)
        halves = sum(
            _INTEGER.fullmatch(left.strip()) is not None and right.strip().isdigit()
            for left, right in pairs
        )
        if text.separator == "," and halves >= surplus:
            expected += "; do the numbers have decimal commas? Then separate columns by semicolons"
    kind = "a short row" if surplus < 0 else "a long row"
    what = f"{kind} of {len(cells)} cells"
    return _problem(text, row, None, what, text.separator.join(cells), expected)


class _Store:
    """One column while it is read."""

    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        self.name = name
        self.text = text
        self.problems = problems
        self.empty_allowed = spec.empty_allowed(name)

    def add(self, row: int, cell: str) -> None:
        raise NotImplementedError

    def finish(self, columns: Columns) -> None:
        raise NotImplementedError

    def fault(self, row: int, what: str, cell: str | None, expected: str | None) -> None:
        self.problems.add(_problem(self.text, row, self.name, what, cell, expected))


class _NumberStore(_Store):
    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        super().__init__(name, text, spec, problems)
        self.expected = spec.says.get(name)
        self.whole = name in WHOLE and name in spec.numbers
        self.largest = LARGEST_INTEGER if self.whole else float("inf")
        measured = name in spec.numbers and name != "time_min"
        self.at_most = f"at most {LARGEST_READING:g} in size" if measured else "a smaller number"
        self.values = array("d")

    def add(self, row: int, cell: str) -> None:
        decimal = self.text.decimal
        value = number(cell, decimal)
        if value is None or value - value != 0:
            if overflows(cell, decimal):
                self._too_large(row, cell)
            elif cell.strip():
                what = "not finite" if is_not_finite(cell, decimal) else "not a number"
                expected = self.expected or expectation(cell, decimal)
                if self.name == "time_min" and _DATE.match(cell):
                    expected = "minutes; dates and times belong in a column 'time'"
                self.fault(row, what, cell, expected)
            elif not self.empty_allowed:
                self.fault(row, "empty cell", None, self.expected or "a number")
            value = float("nan")
        elif abs(value) > self.largest:
            self._too_large(row, cell)
            value = float("nan")
        self.values.append(value)

    def _too_large(self, row: int, cell: str) -> None:
        expected = self.expected or self.at_most
        if self.whole:
            expected = f"a whole number, at most {self.largest:.0f} in size"
        self.fault(row, "too large", cell, expected)

    def finish(self, columns: Columns) -> None:
        import numpy as np

        columns.numbers[self.name] = np.array(self.values, np.float64)


class _TextStore(_Store):
    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        super().__init__(name, text, spec, problems)
        self.expected = spec.says.get(name, "a text")
        self.codes = array("i")
        self.index: dict[str, int] = {}

    def add(self, row: int, cell: str) -> None:
        label = cell.strip()
        if not label and not self.empty_allowed:
            self.fault(row, "empty cell", None, self.expected)
        self.codes.append(self.index.setdefault(label, len(self.index)) if label else -1)

    def finish(self, columns: Columns) -> None:
        import numpy as np

        columns.texts[self.name] = TextColumn(np.array(self.codes, np.int32), tuple(self.index))


class _TimeStore(_TextStore):
    """Checked as a whole: texts are collected, and their rows for the message."""

    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        super().__init__(name, text, spec, problems)
        self.expected = TIME_EXPECTED
        self.minutes = "time_min" in spec.numbers
        self.rows = array("q")

    def add(self, row: int, cell: str) -> None:
        super().add(row, cell)
        self.rows.append(row)

    def finish(self, columns: Columns) -> None:
        import numpy as np

        labels = tuple(self.index)
        values, aware = microseconds(labels)
        codes = np.array(self.codes, np.int32)
        whole = np.append(values, NO_TIME)[codes]
        faulty = np.flatnonzero((whole == NO_TIME) & (codes >= 0))
        cells = [labels[codes[index]] for index in faulty]
        rows, given = [self.rows[i] for i in faulty], int((codes >= 0).sum())
        for found in time_faults(cells, rows, given, self.text.decimal, minutes=self.minutes):
            self.fault(rows[found.place], found.what, cells[found.place], found.expected)
        if len(aware) > 1:
            expected = "all times with an offset, or none"
            self.fault(self.rows[0], "times with and without an offset from UTC", None, expected)
        columns.times[self.name] = TimeColumn(whole, True in aware)


class _CovariateStore(_TextStore):
    """Numbers where every cell that is not empty is a finite number, else texts."""

    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        super().__init__(name, text, spec, problems)
        self.unfinite: list[tuple[int, str]] = []

    def add(self, row: int, cell: str) -> None:
        super().add(row, cell)
        if cell.strip() and is_not_finite(cell, self.text.decimal):
            self.unfinite.append((row, cell))

    def finish(self, columns: Columns) -> None:
        import numpy as np

        values = [number(label, self.text.decimal) for label in self.index]
        if any(is_text(label, self.text.decimal) for label in self.index):
            super().finish(columns)
            return
        for row, cell in self.unfinite:
            large = overflows(cell, self.text.decimal)
            what, expected = ("too large", "smaller") if large else ("not finite", "finite")
            self.fault(row, what, cell, f"a {expected} number, or an empty cell")
        known = np.array([*(np.nan if v is None else v for v in values), np.nan], np.float64)
        columns.numbers[self.name] = known[np.array(self.codes, np.int32)]


_STORES: dict[str, type[_Store]] = {
    "number": _NumberStore,
    "text": _TextStore,
    "time": _TimeStore,
    "covariate": _CovariateStore,
}


def _store(name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> _Store:
    return _STORES[spec.kind(name)](name, text, spec, problems)
