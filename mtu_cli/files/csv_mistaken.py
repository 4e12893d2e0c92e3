"""Tables that are not the one that is asked for: told by what they are."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

from mtu_cli.errors import fault
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
    if found := _further_down(text, spec.required):
        raise header_below(text.source, text.header_row, text.separator.join(header), found)
    if any(number(cell, sign) is not None for cell in header for sign in DECIMALS):
        raise fault(
            "the file begins without a header",
            file=shown,
            row=text.header_row,
            value=text.separator.join(header),
            expected=f"a header row with {', '.join(spec.required)}, ...",
        )


def _further_down(text: CsvText, names: Sequence[str]) -> int | None:
    """The row below the first one that holds all of some names."""
    for row, line in enumerate(islice(lines_from(text.content, text.body), LOOKED_AT)):
        cells = {cell.strip(' "\r\n') for sign in ",;" for cell in line.split(sign)}
        if all(name in cells for name in names):
            return text.body_row + row
    return None
