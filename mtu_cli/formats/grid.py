"""Tables in text: separators, the decimal sign by the consensus of columns, and cells by place."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from mtu_cli.files.headers import Decimal
from mtu_cli.files.headers import number as plain_number
from mtu_cli.formats.base import Import

NAMES = {";": "semicolons", "\t": "tabs", "|": "bars", ",": "commas", " ": "blanks"}
"""Of separators, in the order in which they are tried."""
SAMPLE = 400
"""Lines that a separator is chosen by."""
_NUMBER = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")
_GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?"),
}
OPEN = "?"


class Row(NamedTuple):
    """The cells of a line, counted from 1 as an editor does."""

    line: int
    cells: list[str]


class Grid(NamedTuple):
    """The lines of a text as cells; blank lines and comments (#) are not among them."""

    separator: str
    rows: list[Row]
    comments: int = 0


def grid_of(lines: Sequence[str], first: int = 1, separator: str | None = None) -> Grid:
    """The table in `lines`, the first of which is line `first` of its file."""
    nonblank = [(i, line) for i, line in enumerate(lines, first) if line.strip()]
    data_lines = [(i, line) for i, line in nonblank if not line.lstrip().startswith("#")]
    sign = separator or separator_of([line for _, line in data_lines[:SAMPLE]])
    rows = [Row(i, split(line, sign)) for i, line in data_lines]
    return Grid(sign, rows, len(nonblank) - len(data_lines))


def split(line: str, separator: str) -> list[str]:
    """The stripped cells of a line."""
    if separator == " ":
        return line.split()
    if separator == "|":
        line = line.strip().strip("|")
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        except csv.Error:
            pass
    return [cell.strip() for cell in line.split(separator)]


def separator_of(lines: Sequence[str]) -> str:
    """The separator that gives most lines the same number of cells, two or more."""
    best, count = " ", 0
    for sign in NAMES:
        counts = Counter(len(split(line, sign)) for line in lines)
        counts.pop(1, None)
        counts.pop(0, None)
        if sign == "," and any(re.search(r"\d[ \t]+[-+]?[\d,]", line) for line in lines[1:]):
            continue
        if counts and max(counts.values()) > count:
            best, count = sign, max(counts.values())
    return best


def evidence(cell: str) -> str:
    """What a cell says of the decimal sign: ``.``, ``,``, ``?`` where it may be either, or "".

    >>> [evidence(cell) for cell in ("0,5", "1.234", "1.234,5", "1.234.567", "12", "x")]
    [',', '?', ',', ',', '', '']
    """
    if not _NUMBER.fullmatch(cell):
        return ""
    mantissa, exponent, _ = cell.lower().lstrip("+-").partition("e")
    dots, commas = mantissa.count("."), mantissa.count(",")
    if dots and commas:
        return "." if mantissa.rindex(".") > mantissa.rindex(",") else ","
    if not dots and not commas:
        return ""
    sign = "." if dots else ","
    if dots + commas > 1:
        return "," if dots else "."
    integer, _, part = mantissa.partition(sign)
    grouped = len(part) == 3 and re.fullmatch(r"[1-9]\d{0,2}", integer) and not exponent
    return OPEN if grouped else sign


def decimals(
    result: Import, columns: Iterable[Iterable[str]], separator: str = ""
) -> list[Decimal]:
    """The decimal sign of each column: as asked for, or decided by all its cells, else by all other
    columns.

    Raises InputError where cells of a column contradict each other, or nothing decides.
    """
    counts = [Counter(map(evidence, column)) for column in columns]
    if result.ask.decimal:
        return [result.ask.decimal] * len(counts)
    signs = [{sign for sign in (".", ",") if count[sign]} for count in counts]
    all_signs: set[str] = set().union(*signs)
    if separator == "," and not all_signs:
        all_signs = {"."}
    decided: list[Decimal] = []
    for number, (marks, count) in enumerate(zip(signs, counts, strict=True), 1):
        if len(marks) > 1 or (count[OPEN] and not marks and len(all_signs) != 1):
            kind = (
                "both signs in one column" if len(marks) > 1 else "numbers as 1.234 or 1,234 alone"
            )
            expected = "--decimal . or --decimal , (a map profile has `decimal`)"
            what = f"the decimal sign of column {number}: {kind}"
            raise result.file.error("undecided", what=what, expected=expected)
        decided.append("," if "," in marks or (not marks and all_signs == {","}) else ".")
    return decided


def number(cell: str, decimal: Decimal) -> float | None:
    """The value of a cell, None where it is no finite number; groups of thousands are read."""
    text = cell.strip().replace("\u2212", "-").replace("\u00a0", "")
    if _GROUPED[decimal].fullmatch(text):
        text = text.replace("." if decimal == "," else ",", "")
    value = plain_number(text, decimal)
    return value if value is not None and abs(value) < 1e15 else None


def summary(grid: Grid, signs: Iterable[Decimal]) -> str:
    """Separator and decimal sign in words."""
    words = {".": "decimal points", ",": "decimal commas"}
    result = " and ".join(words[sign] for sign in sorted(set(signs)))
    return f"{NAMES[grid.separator]} between columns, {result or 'whole numbers'}"


def check_widths(
    result: Import, rows: Iterable[Row], width: int, fewest: int | None = None
) -> None:
    """Raises InputError with every row that has not as many cells as the header."""
    for row in rows:
        if len(row.cells) < fewest if fewest else len(row.cells) != width:
            cells, expected = f"{len(row.cells)} cells", f"{width} cells"
            result.fault("row-length", row=row.line, cells=cells, expected=expected)
    result.faults.raise_if_any()


class Columns:
    """The cells of a table by column, each column with its decimal sign.

    Raises InputError for rows of another width than the header, and where a sign is undecided.
    """

    def __init__(
        self, result: Import, header: Sequence[str], rows: Sequence[Row], separator: str
    ) -> None:
        check_widths(result, rows, len(header))
        self.result, self.header, self.rows = result, header, rows
        self.texts = [[row.cells[i] for row in rows] for i in range(len(header))]
        self.signs = decimals(result, self.texts, separator)

    def numbers(self, i: int, *, may_be_empty: bool = False) -> list[Any]:
        """The numbers of a column; what is none is a fault; None of an empty cell that may be."""
        values = [number(cell, self.signs[i]) for cell in self.texts[i]]
        for row, cell, value in zip(self.rows, self.texts[i], values, strict=True):
            if value is None and (cell or not may_be_empty):
                self.result.bad_cell(row.line, self.header[i], cell)
        return values
