"""Rows that spreadsheets write among those that were measured: units, totals, rows in quotes."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mtu_cli.errors import Problem, shorten
from mtu_cli.files.column_words import plain
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from mtu_cli.files.csv_table import TableSpec
    from mtu_cli.files.csv_text import CsvText

TOTALS = {
    "mean", "average", "avg", "sum", "total", "totals", "minimum", "maximum", "range", "median",
    "std", "stdev", "std dev", "standard deviation", "mittelwert", "mittel", "durchschnitt",
    "summe", "gesamt", "spannweite", "standardabweichung", "stabw", "moyenne", "somme", "media",
    "promedio", "suma", "somma",
}  # fmt: skip
"""Without accents and in lower case."""
_UNIT = re.compile(
    r"[\[(]?(?:[mun\u00b5\u03bc]?m|um/m|arcsec|[um\u00b5\u03bc]?rad|deg|(?:deg|\u00b0) ?[cC]"
    r"|min|s|-)[\])]?"
)


def is_total(text: str) -> bool:
    """Whether a cell says that its row sums up others: `Mittelwert`, `Sum:`."""
    return plain(text).strip(" :.") in TOTALS


def odd_row(text: CsvText, row: int, cells: list[str], spec: TableSpec) -> Finding | None:
    """The one Problem of a whole row that holds no measurement; None of any other."""
    found = _what(text, cells, spec, first=row == text.body_row)
    if found is None:
        return None
    what, value, expected = found
    return Problem(what=what, file=text.source.shown, row=row, value=value, expected=expected)


def _what(
    text: CsvText, cells: list[str], spec: TableSpec, *, first: bool
) -> tuple[str, str | None, str] | None:
    if len(cells) == 1 and cells[0].count(text.separator) == len(text.header) - 1 > 0:
        return "the whole row stands in quotes", None, "quotes around single cells alone"
    given = [cell.strip() for cell in cells if cell.strip()]
    if first and given and all(map(_UNIT.fullmatch, given)):
        shown = shorten(" ".join(given))
        return "a row of units", shown, "rows of values: the names of columns tell their units"
    pairs = zip(text.header, cells, strict=False)
    lacks = any(not cell.strip() and not spec.empty_allowed(name) for name, cell in pairs)
    if lacks or len(cells) != len(text.header):
        total = next(filter(is_total, given), None)
        if total is not None:
            return "a row that sums up others", total, "rows of values alone"
    return None
