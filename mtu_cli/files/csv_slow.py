"""CSV tables cell by cell: exact rows and plain words for all that is wrong."""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import TYPE_CHECKING

from mtu_cli.errors import counted
from mtu_cli.files.csv_stores import cell_problem, store_of
from mtu_cli.files.csv_table import Columns, ProblemList, TableSpec
from mtu_cli.files.csv_text import CELL_LIMIT, CsvText, lines_from
from mtu_cli.files.odd_rows import odd_row
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def read_slow(
    text: CsvText, spec: TableSpec, problems: ProblemList
) -> tuple[NDArray[np.int64], Columns]:
    """The editor rows and all columns of a table that the fast reader would not vouch for.

    Every bad cell of the file goes to `problems`; nan, NO_TIME or an empty text stands for it,
    so that what the sound cells mean can be checked as well. Short and long rows are left out.
    """
    import numpy as np

    rows = array("q")
    stores = [store_of(name, text, spec, problems) for name in text.header]
    torn = _torn_by_commas(text)
    for row, cells in _records(text, problems):
        if (odd := odd_row(text, row, cells, spec)) is not None:
            problems.add(odd)
        elif len(cells) != len(stores):
            problems.add(_wrong_length(text, row, cells, torn))
        elif tuple(map(str.strip, cells)) == text.header:
            what = "the header again, as in a table that was pasted again"
            problems.add(cell_problem(text, row, None, what, None, "each row once"))
        elif not any(cell.strip() for cell in cells):
            expected = "a row of values, or no separators"
            problems.add(cell_problem(text, row, None, "all cells are empty", None, expected))
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


def _broken(text: CsvText, row: int, reason: str) -> Finding:
    what, expected = f"a cell cannot be read ({reason})", 'quotes inside a cell doubled: ""'
    if "unexpected end" in reason:
        what, expected = "a quote that opens in this row is never closed", 'a closing "'
    elif "field larger" in reason:
        what = f"a cell has more than {CELL_LIMIT} characters"
        expected = 'a closing " where a quote was opened'
        line = next(islice(lines_from(text.content, text.body), row - text.body_row, None), "")
        if '"' not in line:
            expected = "a table of numbers and names"
    return cell_problem(text, row, None, what, None, expected)


_INTEGER = re.compile(r"[+-]?\d+")
_WITH_POINT = re.compile(r"[+-]?\d+\.\d+")


_SIGNS: dict[str, str] = {",": "commas", ";": "semicolons"}


LOOKED_AT = 50
"""Rows by which it is told whether numbers are torn by their decimal commas ..."""
FEWEST_TORN = 3
"""... so many of them, and half of all, at least."""
DECIMAL_COMMAS = "more cells than columns: the numbers look like ones with decimal commas"
SEMICOLONS = "semicolons between the columns, or decimal points, as this file has commas for both"


def _torn_by_commas(text: CsvText) -> bool:
    """Whether many rows are longer by halves of numbers: 0,973 in two cells, beside some number
    with a point or not.
    """
    records = list(islice(_records(text, ProblemList()), LOOKED_AT))
    surplus = [len(cells) - len(text.header) for _, cells in records]
    pairs = zip(records, surplus, strict=True)
    torn = sum(more > 0 and _halves(cells) >= more for (_, cells), more in pairs)
    return text.separator == "," and torn >= FEWEST_TORN and 2 * torn >= len(records)


def _halves(cells: list[str]) -> int:
    """Neighbouring cells that may be one number with a decimal comma."""
    return sum(
        _INTEGER.fullmatch(left.strip()) is not None and right.strip().isdigit()
        for left, right in pairwise(cells)
    )


def _wrong_length(text: CsvText, row: int, cells: list[str], torn: bool) -> Finding:
    wanted = len(text.header)
    (other,) = _SIGNS.keys() - {text.separator}
    # Commas may be decimal ones beside other separators, not where they are the only sign.
    apart = text.separator == "," or len(cells) == 1
    if apart and wanted > 1 and text.separator.join(cells).count(other) == wanted - 1:
        # Without its value the same stands in every such row, and is told once.
        signs = f"{_SIGNS[other]} here, {_SIGNS[text.separator]} in the header"
        what = f"the separators of the columns are mixed: {signs}"
        return cell_problem(text, row, None, what, None, "the same ones in all rows")
    expected = f"{wanted}, as in the header"
    surplus = len(cells) - wanted
    if surplus > 0 and not any(map(str.strip, cells[wanted:])):
        more = f"{text.separator!r}" if surplus == 1 else f"{surplus} {text.separator!r}"
        what = f"{more} too many at the end of the row"
        return cell_problem(text, row, None, what, None, f"{wanted} cells, as in the header")
    if torn and surplus > 0 and _halves(cells) >= surplus:
        # Without its value it is the same in every such row.
        return cell_problem(text, row, None, DECIMAL_COMMAS, None, SEMICOLONS)
    if surplus > 0:
        points = any(_WITH_POINT.fullmatch(cell.strip()) for cell in cells)
        if text.separator == "," and _halves(cells) >= surplus and not points:
            expected += "; do the numbers have decimal commas? Then separate columns by semicolons"
    kind = "a short row" if surplus < 0 else "a long row"
    what = f"{kind} of {counted(len(cells), 'cell')}"
    return cell_problem(text, row, None, what, text.separator.join(cells), expected)
