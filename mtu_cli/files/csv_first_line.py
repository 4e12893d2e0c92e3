"""First lines of files that are no table: of JSON or YAML, for a spreadsheet, or a title."""

from __future__ import annotations

import re

from mtu_cli.errors import InputError, fault
from mtu_cli.files.source import Source

LOOKED_AT = 100
"""Lines below the first one among which a header is looked for."""
_YAML = re.compile(r"[A-Za-z_]+:(?:\s[^,;]*)?|---")
_EXCEL = re.compile(r'"?sep=(.?)"?', re.IGNORECASE)


def refuse_no_table(line: str, row: int, source: Source) -> None:
    """Raises InputError for a first line that is of JSON, YAML, or meant for a spreadsheet."""
    what = None
    expected = "a CSV file: a header row, and rows of values below it"
    if line.startswith(("{", "[")):
        what = "is a JSON document, no table"
    elif _YAML.fullmatch(line):
        what = "is a YAML file, no table"
    elif _EXCEL.fullmatch(line):
        what, expected = "a line for spreadsheets, no header", "the header row: delete this line"
    if what is not None:
        raise fault(what, file=source.shown, row=row, value=line, expected=expected)


def refuse_title(line: str, row: int, rest: bytes, source: Source) -> None:
    """Raises InputError for a line without separators where lines below it, `rest`, have them."""
    below = rest[: 1 << 16].decode("utf-8", "replace").split("\n")[:LOOKED_AT]
    for count, other in enumerate(below, row + 1):
        if max(other.count(","), other.count(";")) > 1:
            raise header_below(source, row, line, count)


def header_below(source: Source, row: int, line: str, header: int) -> InputError:
    """The fault of a file whose header does not come first."""
    return fault(
        "no header",
        file=source.shown,
        row=row,
        value=line,
        expected=f"the header row first (that of row {header}?): lines above it begin with #",
    )
