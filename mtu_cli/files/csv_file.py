"""The one CSV reader: header checked, cells typed, every fault with its row and column."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mtu_cli.errors import fault
from mtu_cli.files.csv_cells import is_not_finite, number
from mtu_cli.files.csv_fast import read_fast
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_header import check_header
from mtu_cli.files.csv_rows import editor_rows
from mtu_cli.files.csv_slow import read_slow
from mtu_cli.files.csv_table import Columns, ProblemList, Table, TableSpec, TextColumn
from mtu_cli.files.csv_text import DECIMALS, CsvText, Decimal, read_csv_text
from mtu_cli.units import UNITS, plain_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SMALL = 128 << 10
"""Bytes that are read cell by cell sooner than pandas is imported."""


def read_table(
    path: Path, role: str, spec: TableSpec, problems: ProblemList | None = None
) -> Table:
    """A CSV table whose columns are those of `spec` and covariates.

    Large sound tables go through pandas' C engine; where anything is amiss, the table is read
    again cell by cell, so that every fault is told with the row of a text editor.

    Raises InputError with all problems of the header or, with a sound one, of all rows; with
    `problems` those of rows are added there, and the table holds what stands for them.
    """
    found = ProblemList()
    text = read_csv_text(path, role)
    check_header(text, spec)
    table = table_from(text, spec, found)
    if not len(table):
        found.raise_if_any()
        raise fault("holds a header but no rows", file=text.source.shown, expected="rows below it")
    source = replace(text.source, rows=len(table), sha256=text.digest.hexadecimal())
    table = replace(table, source=source)
    _check_covariates(table, text, spec, found)
    if problems is None:
        found.raise_if_any()
    else:
        problems.extend(found)
    return table


def table_from(text: CsvText, spec: TableSpec, problems: ProblemList) -> Table:
    """The rows of a text with a sound header; the faults of its cells go to `problems`."""
    rows, columns = _read(text, spec, problems)
    for name in spec.units & columns.texts.keys():
        columns.texts[name] = _plain_units(columns.texts[name])
    return Table(
        source=text.source,
        header=text.header,
        header_row=text.header_row,
        rows=rows,
        columns=columns,
        covariates=tuple(name for name in text.header if not spec.named(name)),
        sound=not problems.listed,
    )


def _plain_units(column: TextColumn) -> TextColumn:
    """Units as `UNITS` names them, where another sign for micro is all that differs."""
    import numpy as np

    plain = {label: plain_unit(label) for label in column.labels if plain_unit(label) in UNITS}
    if all(label == own for label, own in plain.items()):
        return column
    meant = [plain.get(label, label) for label in column.labels]
    labels = tuple(dict.fromkeys(meant))
    place = {label: i for i, label in enumerate(labels)}
    lookup = np.array([*(place[label] for label in meant), -1], np.int32)
    return TextColumn(lookup[column.codes], labels)


def _read(
    text: CsvText, spec: TableSpec, problems: ProblemList
) -> tuple[NDArray[np.int64], Columns]:
    if len(text.content) <= SMALL:
        return read_slow(text, spec, problems)
    try:
        count, columns = read_fast(text, spec)
    except Suspect:
        return read_slow(text, spec, problems)
    rows = editor_rows(text, count, complete=_ends_full(text, columns))
    return read_slow(text, spec, problems) if rows is None else (rows, columns)


def _ends_full(text: CsvText, columns: Columns) -> bool:
    """Whether the last column has no empty cell: then no row is too short."""
    import numpy as np

    name = text.header[-1]
    if name in columns.numbers:
        return not np.isnan(columns.numbers[name]).any()
    return name in columns.texts and bool((columns.texts[name].codes >= 0).all())


def _check_covariates(table: Table, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
    """Covariates that are texts only because of nan, infinity or the other decimal sign."""
    import numpy as np

    for name in table.covariates:
        column = table.columns.texts.get(name)
        if column is None or not column.labels or spec.kind(name) != "covariate":
            continue
        if not all(numbers_at_all(column.labels, text.decimal)):
            continue
        sign = "comma" if text.decimal == "," else "point"
        expected = f"a finite number with a decimal {sign}, or an empty cell"
        for code, label in enumerate(column.labels):
            unfinite = is_not_finite(label, text.decimal)
            if unfinite or number(label, text.decimal) is None:
                what = "not finite" if unfinite else "not a number as the others are"
                indices = np.flatnonzero(column.codes == code)
                problems.add_cells(table, indices, name, what, [label], expected)


def numbers_at_all(labels: Iterable[str], decimal: Decimal) -> tuple[bool, bool]:
    """Whether any text is a number with one or the other decimal sign, and whether all are, or
    say nan or infinity.
    """
    any_is, all_are = False, True
    for label in labels:
        is_number = any(number(label, sign) is not None for sign in DECIMALS)
        any_is |= is_number
        all_are &= is_number or is_not_finite(label, decimal)
    return any_is, all_are
