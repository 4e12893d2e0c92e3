"""Tables that are not the one that is asked for: told by what they are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import islice

from mtu_cli.errors import Problem, fault
from mtu_cli.files.column_words import ACTUAL, AXES, AXIS, NOMINAL, UNIT, VALUE, WORDS, plain
from mtu_cli.files.csv_cells import number
from mtu_cli.files.csv_first_line import LOOKED_AT, header_below
from mtu_cli.files.csv_table import TableSpec
from mtu_cli.files.csv_text import DECIMALS, CsvText, lines_from

KINDS = {
    ("component", "error", "unit"): ("readings of components", "--lbb, --laser or --drift"),
    ("part", "feature", "x_mm", "y_mm"): ("measured points", "--cmm"),
}
"""What a table is that requires these columns, and the options that take it."""


def refuse_other_table(text: CsvText, spec: TableSpec) -> None:
    """Raises InputError for a header without any required column where another kind of table, a
    header further down or rows without a header explain that.
    """
    header, shown = text.header, text.source.shown
    if any(name in header for name in spec.required):
        return
    own, _ = KINDS.get(spec.required, ("a table", ""))
    for names, (what, options) in KINDS.items():
        if names != spec.required and all(name in header for name in names):
            raise fault(
                f"holds {what}",
                file=shown,
                row=text.header_row,
                value=text.separator.join(header),
                expected=f"a file of {own} (this one goes to {options})",
            )
    if found := _further_down(text, spec.required) or _below_a_title(text):
        raise header_below(text.source, text.header_row, text.separator.join(header), found)
    if any(number(cell, sign) is not None for cell in header for sign in DECIMALS):
        raise fault(
            "the file begins without a header",
            file=shown,
            row=text.header_row,
            value=text.separator.join(header),
            expected=f"a header row with {', '.join(spec.required)}, ...",
        )


def row_per_axis(text: CsvText, names: Sequence[str]) -> Problem | None:
    """The Problem of a table with a row for each axis of a feature, as CMMs report them, where the
    coordinates `names` are asked for side by side; None for any other.
    """
    axis = _called(text.header, AXIS) or _of_axes(text)
    measured, nominal = _called(text.header, ACTUAL + VALUE), _called(text.header, NOMINAL)
    deviation = _called(text.header, WORDS["error"])
    if axis is None or measured == deviation is None:
        return None
    value = repr(measured) if measured else f"nominal plus {deviation!r}"
    expected = f"one row for each feature, as a pivot table makes them: {value} of X in a column "
    expected += ", ".join(f"{name!r}" if not i else f"of {name[0].upper()} in {name!r}"
                          for i, name in enumerate(names))  # fmt: skip
    if len(names) < len(AXES):
        expected += ", and of Z, where it has rows, in 'z_mm'"
    if nominal:
        expected += f"; {nominal!r} likewise in {', '.join(f'nominal_{name}' for name in names)}"
    return Problem(
        what="the table has a row for each axis",
        file=text.source.shown,
        row=text.header_row,
        column=axis,
        expected=expected,
    )


def _of_axes(text: CsvText) -> str | None:
    """The column whose first cells are axes, of whatever name (`Property`, `Merkmalsart`)."""
    rows = [
        [cell.strip(' "\r\n').casefold() for cell in line.split(text.separator)]
        for line in islice(lines_from(text.content, text.body), LOOKED_AT)
    ]
    for i, name in enumerate(text.header):
        cells = {row[i] for row in rows if len(row) > i and row[i]}
        if name and len(cells) > 1 and cells <= {*AXES}:
            return name
    return None


def _called(header: Sequence[str], words: Sequence[str]) -> str | None:
    """The first column that is called by one of some words, its unit aside."""
    for name in header:
        own = [word for word in re.findall("[a-z]+", plain(name)) if word != UNIT]
        if len(own) == 1 and own[0] in words:
            return name
    return None


def _further_down(text: CsvText, names: Sequence[str]) -> int | None:
    """The row below the first one that holds all of some names."""
    for row, line in enumerate(islice(lines_from(text.content, text.body), LOOKED_AT)):
        cells = {cell.strip(' "\r\n') for sign in ",;" for cell in line.split(sign)}
        if all(name in cells for name in names):
            return text.body_row + row
    return None


def _below_a_title(text: CsvText) -> int | None:
    """The row right below a first one of mostly empty cells, where it is full of names: programs
    put their own name and that of the part into a row of the table.
    """
    header = text.header
    line = next(iter(lines_from(text.content, text.body)), "")
    cells = [cell.strip(' "\r\n') for cell in line.split(text.separator)]
    names = [
        cell for cell in cells if cell and all(number(cell, sign) is None for sign in DECIMALS)
    ]
    empty = sum(not name for name in header)
    full = len(names) == len(cells) >= len(header) and len(set(names)) == len(names)
    return text.body_row if full and 2 * empty >= len(header) > 1 else None
