"""What readings and points have in common: checks of columns, and files put end to end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_table import LARGEST_INTEGER, CellFaults, Table, TableSpec, cell_text
from mtu_cli.files.names import EXPECTED, is_name
from mtu_cli.files.row_marks import row_marks
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError, finding, suggestion

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MINUTE = 60_000_000
LARGEST_READING = 1e12
"""Beyond it no cell is a measurement, and squares would overflow."""
COUNTS = ("pass", "repeat")
"""Columns of whole numbers from 0 on."""
LONGEST_MIN = 5.3e7
"""A century; minutes since 1970 are fewer, seconds more."""


def read_tables(
    files: Sequence[tuple[Path, str]], spec: TableSpec, problems: CellFaults
) -> list[Table]:
    """The tables of all (path, role), of which there is at least one.

    Problems of all files go to `problems`; a table whose header is sound is returned even if its
    cells are not. A file that is given twice would count every row twice: a problem, too.
    """
    if not files:
        raise ValueError("no files to read")
    tables: list[Table] = []
    first: dict[str, Source] = {}
    for path, role in files:
        try:
            table = read_table(path, role, spec, problems)
        except InputError as error:
            for problem in error.findings:
                problems.add(problem)
            continue
        tables.append(table)
        other = first.setdefault(table.source.sha256, table.source)
        if other is not table.source:
            facts = {"other": other.shown, "expected": "each file once"}
            problems.add(finding("same-file", file=table.source.shown, **facts))
    return tables


# Checks of single columns.


def check_magnitude(table: Table, name: str, problems: CellFaults) -> None:
    """Cells of a column that are no measurement: their squares would overflow."""
    values = table.columns.numbers.get(name)
    if values is not None:
        large = np.flatnonzero(np.abs(values) > LARGEST_READING)
        expected = f"at most {LARGEST_READING:g} in size"
        problems.add_cells(table, large, name, "too-large", values[large].tolist(), expected)


def check_labels(
    table: Table,
    name: str,
    code: str,
    expectation: Callable[[str], dict[str, Any] | None],
    problems: CellFaults,
) -> None:
    """A problem for every cell of a text column for which `expectation` gives fields of one."""
    column = table.columns.texts.get(name)
    for i, label in enumerate(column.labels if column else ()):
        fields = expectation(label)
        if column is not None and fields is not None:
            rows = np.flatnonzero(column.codes == i)
            problems.add_cells(table, rows, name, code, [label], **fields)


def check_known(table: Table, name: str, known: Any, problems: CellFaults) -> None:
    """Labels of a column that are none of the `known` names; any printable one without those."""

    def expectation(label: str) -> dict[str, Any] | None:
        return None if label in known else {"what": name, **suggestion(label, known)}

    if known is None:
        check_names(table, (name,), problems)
    else:
        check_labels(table, name, "unknown-name", expectation, problems)


def check_names(table: Table, columns: Sequence[str], problems: CellFaults) -> None:
    """A problem for every cell of these text columns that is no name for a table."""
    for name in columns:
        check_labels(
            table, name, "not-printable",
            lambda label: None if is_name(label) else {"expected": EXPECTED}, problems,
        )  # fmt: skip


def check_equal_rows(table: Table, problems: CellFaults) -> None:
    """Rows equal to an earlier one in every column, where a pass, a repeat or a time is given:
    without those repeated values are legitimate.

    Rows are compared by 64-bit marks first, and cell by cell where these agree.
    """
    given = {*table.columns.numbers, *table.columns.times}
    if not table.sound or given.isdisjoint(("pass", "repeat", "time", "time_min")):
        return
    keys = [_key(table, name) for name in table.header]
    marks = row_marks(keys)
    ordered = np.sort(marks)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    first: dict[tuple[object, ...], int] = {}
    for i in np.flatnonzero(np.isin(marks, twice)).tolist() if len(twice) else ():
        cells = tuple(None if key[i] != key[i] else key[i].item() for key in keys)
        earlier = first.setdefault(cells, i)
        if earlier != i:
            place = {"file": table.source.shown, "row": int(table.rows[i])}
            facts = {"other": int(table.rows[earlier]), "expected": "each row once"}
            problems.add(finding("equal-row", **place, **facts))


def _key(table: Table, name: str) -> NDArray[Any]:
    columns = table.columns
    if name in columns.numbers:
        return columns.numbers[name]
    return columns.texts[name].codes if name in columns.texts else columns.times[name].microseconds


# Columns of all files end to end.


def end_to_end(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays of all files as one; that of a single file itself, not to be written to."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def file_indices(tables: Sequence[Table]) -> Ints:
    """The index of each row's file."""
    return np.repeat(np.arange(len(tables)), [len(table) for table in tables])


def numbers(tables: Sequence[Table], name: str) -> Floats:
    """A numeric column, nan where a file lacks it; not to be written to."""
    return end_to_end(
        [
            table.columns.numbers[name]
            if name in table.columns.numbers
            else np.broadcast_to(np.nan, len(table))
            for table in tables
        ]
    )


def columns_of(tables: Sequence[Table], names: Sequence[str]) -> Floats:
    """Numeric columns side by side, (n, k); each is contiguous in memory."""
    found = np.empty((sum(map(len, tables)), len(names)), order="F")
    for index, name in enumerate(names):
        found[:, index] = numbers(tables, name)
    return found


def integers(tables: Sequence[Table], name: str, problems: CellFaults) -> Ints:
    """A column of whole numbers, -1 where none is given; COUNTS are not negative."""
    parts = [np.zeros(0, np.int64)] if not tables else []
    for table in tables:
        values = table.columns.numbers.get(name)
        if values is None:
            parts.append(np.full(len(table), -1))
            continue
        faulty = (values != np.floor(values)) & ~np.isnan(values)
        faulty |= np.abs(values) > LARGEST_INTEGER
        low = ~faulty & (values < 0) if name in COUNTS else np.zeros(len(table), bool)
        for code, odd, expected in (
            ("not-a-whole-number", np.flatnonzero(faulty), "a whole number"),
            ("out-of-range", np.flatnonzero(low), "a whole number from 0 on"),
        ):
            problems.add_cells(table, odd, name, code, values[odd].tolist(), expected)
        parts.append(np.where(faulty | np.isnan(values), -1.0, values).astype(np.int64))
    return end_to_end(parts)


def labelled(
    tables: Sequence[Table], name: str, known: Sequence[str] = ()
) -> tuple[tuple[str, ...], Ints]:
    """Labels and each row's code; -1 where empty or where a file lacks the column.

    Labels in the order of `known`, then of appearance; those that no row has are left out.
    """
    index = {label: code for code, label in enumerate(known)}
    parts: list[Ints] = []
    for table in tables:
        column = table.columns.texts.get(name)
        if column is None:
            parts.append(np.full(len(table), -1))
        else:
            lookup = [index.setdefault(label, len(index)) for label in column.labels]
            parts.append(np.array([*lookup, -1], np.int64)[column.codes])
    codes = end_to_end(parts)
    used = np.zeros(len(index) + 1, bool)
    used[codes] = True
    renumbered = np.append(np.cumsum(used[:-1]) - 1, -1)
    labels = tuple(label for label, keep in zip(index, used, strict=False) if keep)
    return labels, renumbered[codes]


def minutes(tables: Sequence[Table], problems: CellFaults) -> Floats:
    """Minutes of each row: `time_min` as given, `time` from the earliest of all files."""
    dated = [table for table in tables if "time" in table.columns.times]
    plain = [table for table in tables if "time_min" in table.columns.numbers]
    for table in plain:
        values = table.columns.numbers["time_min"]
        far = np.flatnonzero(np.abs(values) > LONGEST_MIN)
        expected = f"minutes, at most a century ({LONGEST_MIN:g}) from the start"
        problems.add_cells(table, far, "time_min", "out-of-range", values[far].tolist(), expected)
    if not dated:
        return numbers(tables, "time_min")
    for table in plain[:1]:
        facts = {"first": "time", "second": "time_min", "expected": "one of them in all files"}
        problems.add(finding("exclusive-columns", file=table.source.shown, **facts))
    aware = dated[0].columns.times["time"].aware
    for table in dated[1:]:
        if table.columns.times["time"].aware != aware:
            expected = f"as in {dated[0].source.shown}: all with an offset, or none"
            place = {"file": table.source.shown, "column": "time"}
            problems.add(finding("times-mixed", **place, expected=expected))
    known = [
        table.columns.times["time"].microseconds if table in dated else None for table in tables
    ]
    earliest = min(int(own.min()) for own in known if own is not None)
    return end_to_end(
        [
            np.full(len(table), np.nan) if own is None else (own - earliest) / MINUTE
            for table, own in zip(tables, known, strict=True)
        ]
    )


def covariates(tables: Sequence[Table]) -> dict[str, Floats | NDArray[np.object_]]:
    """Every covariate: floats with nan, or texts with "", where not given.

    A covariate that is a number in one file and a text in another is a text in all.
    """
    found: dict[str, Floats | NDArray[np.object_]] = {}
    for name in dict.fromkeys(name for table in tables for name in table.covariates):
        if any(name in table.columns.texts for table in tables):
            found[name] = np.concatenate([_texts(table, name) for table in tables])
        else:
            found[name] = numbers(tables, name)
    return found


def _texts(table: Table, name: str) -> NDArray[np.object_]:
    if name in table.columns.texts:
        column = table.columns.texts[name]
        return np.array([*column.labels, ""], dtype=object)[column.codes]
    values = numbers([table], name).tolist()
    return np.array(["" if v != v else cell_text(v) for v in values], dtype=object)
