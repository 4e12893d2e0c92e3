"""Columns of a CSV table while they are read cell by cell, each in its own way."""

from __future__ import annotations

import re
from array import array

from mtu_cli.errors import SHOWN_ALIKE, Problem
from mtu_cli.files.csv_cells import (
    NO_TIME,
    TIME_EXPECTED,
    expectation,
    is_not_finite,
    is_text,
    microseconds,
    number,
    overflows,
    unit_in,
)
from mtu_cli.files.csv_table import (
    LARGEST_INTEGER,
    LARGEST_READING,
    LISTED_PROBLEMS,
    WHOLE,
    Columns,
    ProblemList,
    TableSpec,
    TextColumn,
    TimeColumn,
)
from mtu_cli.files.csv_text import CsvText
from mtu_cli.files.csv_times import time_faults
from mtu_cli.files.sign_words import direction_hint, direction_sign
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding

_DATE = re.compile(r"\s*(?:[0-9]{1,4}[-./][0-9]{1,2}[-./][0-9]|[0-9]{1,2}:[0-9]{2})")
"""How a date or a time of day begins."""


def cell_problem(
    text: CsvText, row: int, column: str | None, what: str, value: str | None, expected: str | None
) -> Finding:
    """A Problem of a cell of a text, or of its row."""
    return Problem(
        what=what,
        file=text.source.shown,
        row=row,
        column=column,
        value=value,
        expected=expected,
    )


class Store:
    """One column while it is read: its cells by `add`, in order, then `finish`."""

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
        self.problems.add(cell_problem(self.text, row, self.name, what, cell, expected))


class _NumberStore(Store):
    def __init__(self, name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
        super().__init__(name, text, spec, problems)
        self.expected = spec.says.get(name)
        self.whole = name in WHOLE and name in spec.numbers
        self.largest = LARGEST_INTEGER if self.whole else float("inf")
        measured = name in spec.numbers and name != "time_min"
        self.at_most = f"at most {LARGEST_READING:g} in size" if measured else "a smaller number"
        # Of what the contract names, and of a drift's temperatures, some rows may need the cell.
        self.optional = not spec.named(name) and text.source.role != DRIFT
        self.values = array("d")
        self.with_unit: dict[str, list[tuple[int, str]]] = {}

    def add(self, row: int, cell: str) -> None:
        decimal = self.text.decimal
        value = number(cell, decimal)
        if value is None or value - value != 0:
            if overflows(cell, decimal):
                self._too_large(row, cell)
            elif cell.strip():
                what = "not finite" if is_not_finite(cell, decimal) else "not a number"
                expected = self.expected or expectation(cell, decimal)
                if self.optional and expected in ("a number", "a finite number"):
                    expected += ", or an empty cell"
                if self.name == "time_min" and _DATE.match(cell):
                    expected = "minutes; dates and times belong in a column 'time'"
                if not self.whole and (unit := unit_in(cell)) is not None:
                    self.with_unit.setdefault(unit, []).append((row, cell))
                else:
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
        for unit, cells in self.with_unit.items():
            if len(cells) <= SHOWN_ALIKE:
                for row, cell in cells:
                    expected = self.expected or expectation(cell, self.text.decimal)
                    self.fault(row, "not a number", cell, expected)
                continue
            # Without its value it is the same in every row of the column.
            what, expected = f"numbers with their unit, {unit}, in the cells", "the numbers alone"
            for row, _ in cells[:LISTED_PROBLEMS]:
                self.fault(row, what, None, expected)
            self.problems.uncounted += max(0, len(cells) - LISTED_PROBLEMS)


class _TextStore(Store):
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


class _SignStore(_NumberStore):
    """Directions: +1 and -1, in whatever way they are written."""

    def add(self, row: int, cell: str) -> None:
        sign = direction_sign(cell)
        if sign is None and cell.strip():
            self.fault(row, "not a direction", cell, direction_hint(cell))
        self.values.append(float("nan") if sign is None else sign)


_STORES: dict[str, type[Store]] = {
    "number": _NumberStore,
    "text": _TextStore,
    "time": _TimeStore,
    "sign": _SignStore,
    "covariate": _CovariateStore,
}


def store_of(name: str, text: CsvText, spec: TableSpec, problems: ProblemList) -> Store:
    """The store of a column, whose faults go to `problems`."""
    return _STORES[spec.kind(name)](name, text, spec, problems)
