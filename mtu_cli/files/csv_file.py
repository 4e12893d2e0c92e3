"""The one CSV reader: header checked, cells typed, every fault with its row and column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mtu_cli.errors import InputError, Problem, closest, fault
from mtu_cli.files.csv_cells import is_not_finite, number
from mtu_cli.files.csv_fast import read_fast
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_rows import editor_rows
from mtu_cli.files.csv_slow import read_slow
from mtu_cli.files.csv_table import Columns, ProblemList, Table, TableSpec
from mtu_cli.files.csv_text import CsvText, read_csv_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def read_table(
    path: Path, role: str, spec: TableSpec, problems: ProblemList | None = None
) -> Table:
    """A CSV table whose columns are those of `spec` and covariates.

    Sound tables go through pandas' C engine; where anything is amiss, the table is read
    again cell by cell, so that every fault is told with the row of a text editor.

    Raises InputError with all problems of the header or, with a sound one, of all rows; with
    `problems` those of rows are added there, and the table holds what stands for them.
    """
    found = ProblemList()
    text = read_csv_text(path, role)
    _check_header(text, spec)
    rows, columns = _read(text, spec, found)
    if not len(rows):
        found.raise_if_any()
        raise fault("holds a header but no rows", file=text.source.shown, expected="readings")
    table = Table(
        source=replace(text.source, rows=len(rows), sha256=text.digest.hexadecimal()),
        header=text.header,
        header_row=text.header_row,
        rows=rows,
        columns=columns,
        covariates=tuple(name for name in text.header if not spec.named(name)),
        sound=not found.listed,
    )
    _check_covariates(table, text, spec, found)
    if problems is None:
        found.raise_if_any()
    else:
        problems.extend(found)
    return table


def _read(
    text: CsvText, spec: TableSpec, problems: ProblemList
) -> tuple[NDArray[np.int64], Columns]:
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


def _check_header(text: CsvText, spec: TableSpec) -> None:
    shown, row, header = text.source.shown, text.header_row, text.header
    problems = []
    for index, name in enumerate(header):
        if not name:
            what = f"column {index + 1} has no name"
            problems.append(Problem(what=what, file=shown, row=row, expected="a name"))
        elif name in header[:index]:
            what = f"the column stands twice, as column {header.index(name) + 1} and {index + 1}"
            problems.append(Problem(what=what, file=shown, row=row, column=name))
    wanted = list(spec.required)
    wanted += [b for a, b in spec.together if a in header]
    wanted += [a for a, b in spec.together if b in header]
    problems += [
        missing_column(name, shown, row, header, spec)
        for name in dict.fromkeys(wanted)
        if name not in header
    ]
    for first, second in spec.exclusive:
        if first in header and second in header:
            what = f"both {first!r} and {second!r} are given"
            problems.append(Problem(what=what, file=shown, row=row, expected="one of them"))
    if problems:
        raise InputError(problems)


def missing_column(
    name: str, shown: str, row: int, header: tuple[str, ...], spec: TableSpec
) -> Problem:
    """The Problem of a column that is not there, with the one that was probably meant."""
    near = closest(name, [other for other in header if other and not spec.named(other)])
    hint = f"rename {near!r} to {name!r}" if near else f"a column {name!r} in {', '.join(header)}"
    return Problem(what=f"the column {name!r} is missing", file=shown, row=row, expected=hint)


def _check_covariates(table: Table, text: CsvText, spec: TableSpec, problems: ProblemList) -> None:
    """Covariates that are texts only because of nan, infinity or the other decimal sign."""
    for name in table.covariates:
        column = table.columns.texts.get(name)
        if column is None or not column.labels or spec.kind(name) != "covariate":
            continue
        other = [number(label, "," if text.decimal == "." else ".") for label in column.labels]
        own = [number(label, text.decimal) for label in column.labels]
        unfinite = [is_not_finite(label, text.decimal) for label in column.labels]
        for index, code in enumerate(column.codes if _nearly(own, other, unfinite) else ()):
            if code >= 0 and (own[code] is None or unfinite[code]):
                what = "not finite" if unfinite[code] else "not a number as the others are"
                sign = "comma" if text.decimal == "," else "point"
                expected = f"a finite number with a decimal {sign}, or an empty cell"
                problems.add(table.problem(index, name, what, column.labels[code], expected))


def _nearly(own: list[float | None], other: list[float | None], unfinite: list[bool]) -> bool:
    cells = list(zip(own, other, unfinite, strict=True))
    return any(o is not None or p is not None for o, p, _ in cells) and all(
        o is not None or p is not None or bad for o, p, bad in cells
    )
