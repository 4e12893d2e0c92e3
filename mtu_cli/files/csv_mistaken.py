"""Tables that are not the one that is asked for: told by what they are."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import islice

from mtu_cli.errors import Problem, fault
from mtu_cli.files.column_words import (
    ACTUAL,
    AXES,
    AXIS,
    NOMINAL,
    UNIT,
    VALUE,
    WORDS,
    direction_along,
    plain,
)
from mtu_cli.files.csv_cells import number
from mtu_cli.files.csv_first_line import LOOKED_AT, header_below
from mtu_cli.files.csv_missing import squeezed
from mtu_cli.files.csv_table import TableSpec
from mtu_cli.files.csv_text import DECIMALS, CsvText, first_rows, lines_from
from mtu_cli.findings import Finding

KINDS = {
    ("component", "error", "unit"): ("readings of components", "--lbb, --laser or --drift"),
    ("part", "feature", "x_mm", "y_mm"): ("measured points", "--cmm"),
}
"""What a table is that requires these columns, and the options that take it."""

ROWS = 10_000
"""Rows among which axes are looked for: some programs write all X before the first Y."""
BESIDE_AXES = {"d", "r", "a", "t", "f", "l", "m", "tp", "pr", "pa", "df", "dm", "dia", "diam",
               "diameter", "durchmesser", "radius", "angle", "winkel", "form",
               "\u00f8"}  # fmt: skip
"""What CMMs report of a feature in rows of the same table."""
COORDINATE = {*ACTUAL, *NOMINAL, *VALUE, *WORDS["position_mm"]}


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


def row_per_axis(
    text: CsvText, names: Sequence[str], spec: TableSpec, meant: Mapping[str, str | None]
) -> Finding | None:
    """The Problem of a table with a row for each axis of a feature, as CMMs report them, where the
    coordinates `names` are asked for side by side; None for any other. `meant` are the columns
    that are taken for those that are missing.
    """
    axis = _called(text.header, AXIS) or _of_axes(text, spec, meant.values())
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


def _of_axes(text: CsvText, spec: TableSpec, known: Collection[str | None]) -> str | None:
    """The column whose first cells are axes, of whatever name (`Property`, `Merkmalsart`), beside
    no coordinates side by side: there they are axes of approach.

    What is `known` as another column, by its name, is left alone: features may be called X and Y.
    """
    header = text.header
    along = {_along(name) for name in header if not (spec.named(name) or direction_along(name))}
    if len(along - {None}) > 1:
        return None
    own = {squeezed(name) for name in spec.names if name not in header}
    rows = first_rows(text, ROWS)
    for i, name in enumerate(header):
        if not name or spec.named(name) or name in known or squeezed(name) in own:
            continue
        cells = {row[i].strip().casefold() for row in rows if len(row) > i} - {""}
        if len(cells & {*AXES}) > 1 and cells <= {*AXES, *BESIDE_AXES}:
            return name
    return None


def _along(name: str) -> str | None:
    """The axis along which a column has a coordinate, of whatever kind: x of `x_pos` and `XIst`."""
    words = re.findall("[a-z]+", plain(name))
    axes = [word for word in words if word in AXES]
    for word in words if len(words) == 1 else ():
        ends = ((word[0], word[1:]), (word[-1], word[:-1]))
        axes += [axis for axis, rest in ends if axis in AXES and rest in COORDINATE]
    return axes[0] if len(axes) == 1 else None


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
