"""What readings and points have in common: columns of several files put end to end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.contracts import LEAST
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_table import LARGEST_INTEGER, ProblemList, Table, TableSpec, cell_text
from mtu_cli.files.csv_table import LARGEST_READING as LARGEST_READING
from mtu_cli.files.names import EXPECTED, NO_NAME, is_name
from mtu_cli.files.source import Source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[Any]
    Texts = NDArray[np.object_]

MINUTE = 60_000_000
SMALL_INTEGER = 1e6
FEW = 30_000
"""Codes and whole numbers up to these have 4 bytes, and products of two of them still fit."""
LONGEST_MIN = 5.3e7
"""A century; minutes since 1970 are fewer, seconds more."""
IN_MINUTES = f"minutes, at most a century ({LONGEST_MIN:g}) from the start; seconds divided by 60"


def read_tables(
    files: Sequence[tuple[Path, str]], spec: TableSpec, problems: ProblemList
) -> list[Table]:
    """The tables of all (path, role), of which there is at least one.

    Problems of all files go to `problems`; those whose header is sound are among the tables
    nevertheless. A file that is given twice would count every row twice: a problem, too.
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
            what = f"the same bytes as {other.shown!r}: its rows would count twice"
            problems.add(Problem(what=what, file=table.source.shown, expected="each file once"))
    return tables


def numbers(tables: Sequence[Table], name: str) -> Floats:
    """A numeric column over all files, nan where a file lacks it; not to be written to."""
    if not any(name in table.columns.numbers for table in tables):
        # One number seen n times: a column that nobody gave takes no memory.
        return np.broadcast_to(np.float64(np.nan), sum(len(table) for table in tables))
    return end_to_end(
        [table.columns.numbers.get(name, np.full(len(table), np.nan)) for table in tables]
    )


def columns_of(tables: Sequence[Table], names: Sequence[str]) -> Floats:
    """Numeric columns side by side, (n, k)."""
    n = sum(map(len, tables))
    if not any(name in table.columns.numbers for table in tables for name in names):
        return np.broadcast_to(np.float64(np.nan), (n, len(names)))
    if len(tables) == 1 and tuple(names) in tables[0].columns.vectors:
        return tables[0].columns.vectors[tuple(names)]
    # Column by column in memory: each is written, and later read, in one go.
    found = np.empty((n, len(names)), order="F")
    for index, name in enumerate(names):
        found[:, index] = numbers(tables, name)
    return found


def end_to_end(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays of all files as one; that of a single file itself, not to be written to."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def file_indices(tables: Sequence[Table]) -> Ints:
    """The index of each row's file."""
    if len(tables) == 1:
        return np.broadcast_to(np.int64(0), len(tables[0]))
    return np.repeat(np.arange(len(tables)), [len(table) for table in tables])


def integers(tables: Sequence[Table], name: str, problems: ProblemList) -> Ints:
    """A column of whole numbers, none below its least; -1 where none is given. Not to be written
    to.
    """
    if not any(name in table.columns.numbers for table in tables):
        return np.broadcast_to(np.int64(-1), sum(len(table) for table in tables))
    values = numbers(tables, name)
    least, lesser, wanted = LEAST.get(name, (-LARGEST_INTEGER, "", ""))
    if values.min() >= max(0, least) and values.max() <= LARGEST_INTEGER:
        whole = values.astype(np.int32 if values.max() <= SMALL_INTEGER else np.int64)
        if np.array_equal(whole, values):
            return whole
    faulty = (values != np.floor(values)) | (np.abs(values) > LARGEST_INTEGER)
    faulty &= ~np.isnan(values)
    _by_table(tables, faulty, name, "not a whole number", values, "a whole number", problems)
    _by_table(tables, ~faulty & (values < least), name, lesser, values, wanted, problems)
    return np.where(faulty | np.isnan(values), -1.0, values).astype(np.int64)


def check_magnitude(table: Table, name: str, problems: ProblemList) -> None:
    """Cells of a column that are no measurement: their squares would overflow."""
    values = table.columns.numbers.get(name)
    if values is None:
        return
    large = np.flatnonzero(np.abs(values) > LARGEST_READING)
    cells = values[large].tolist()
    expected = f"at most {LARGEST_READING:g} in size"
    if len(large):
        problems.add_cells(table, large, name, "too large", cells, expected)


def _by_table(
    tables: Sequence[Table],
    faulty: NDArray[np.bool_],
    name: str,
    what: str,
    values: Floats,
    expected: str,
    problems: ProblemList,
) -> None:
    start = 0
    for table in tables:
        inside = np.flatnonzero(faulty[start : start + len(table)])
        if len(inside):
            cells = values[start + inside].tolist()
            problems.add_cells(table, inside, name, what, cells, expected)
        start += len(table)


def labelled(
    tables: Sequence[Table], name: str, known: Sequence[str] = ()
) -> tuple[tuple[str, ...], Ints]:
    """Labels over all files and each row's code; -1 where empty or where a file lacks it.

    Labels in the order of `known`, then of appearance; those that no row has are left out.
    """
    if not any(name in table.columns.texts for table in tables):
        return (), np.broadcast_to(np.int64(-1), sum(len(table) for table in tables))
    index = {label: code for code, label in enumerate(known)}
    parts: list[Ints] = []
    for table in tables:
        column = table.columns.texts.get(name)
        if column is None:
            parts.append(np.full(len(table), -1, np.int64))
            continue
        lookup = [index.setdefault(label, len(index)) for label in column.labels]
        if len(tables) == 1 and len(lookup) <= FEW and lookup == list(range(len(lookup))):
            # The codes are those of the only file, in half the memory.
            parts.append(column.codes)
        else:
            parts.append(np.array([*lookup, -1], np.int64)[column.codes])
    codes = end_to_end(parts)
    if len(index) == 1 and not codes.any():
        # One label seen n times takes no memory.
        return tuple(index), np.broadcast_to(np.int64(0), len(codes))
    used = np.zeros(len(index) + 1, bool)
    used[codes] = True
    used = used[:-1]
    if used.all():
        return tuple(index), codes
    renumbered = np.append(np.cumsum(used) - 1, -1)
    labels = tuple(label for label, keep in zip(index, used, strict=True) if keep)
    return labels, renumbered[codes]


def minutes(tables: Sequence[Table], problems: ProblemList) -> Floats:
    """Minutes of each row: `time_min` as given, `time` from the earliest of all files."""
    dated = [table for table in tables if "time" in table.columns.times]
    plain = [table for table in tables if "time_min" in table.columns.numbers]
    for table in plain:
        values = table.columns.numbers["time_min"]
        far = np.flatnonzero(np.abs(values) > LONGEST_MIN)
        problems.add_cells(table, far, "time_min", "no time", values[far].tolist(), IN_MINUTES)
    if not dated:
        return numbers(tables, "time_min")
    for table in plain[:1]:
        what = f"'time_min' here, but 'time' in {dated[0].source.shown}"
        problems.add(
            Problem(what=what, file=table.source.shown, expected="one of them in all files")
        )
    aware = dated[0].columns.times["time"].aware
    for table in dated[1:]:
        if table.columns.times["time"].aware != aware:
            what = f"times {'without' if aware else 'with'} an offset from UTC, unlike those of "
            what += dated[0].source.shown
            problems.add(Problem(what=what, file=table.source.shown, column="time"))
    earliest = min(int(table.columns.times["time"].microseconds.min()) for table in dated)
    parts = []
    for table in tables:
        column = table.columns.times.get("time")
        if column is None:
            parts.append(np.full(len(table), np.nan))
        else:
            parts.append((column.microseconds - earliest) / MINUTE)
    return end_to_end(parts)


def covariates(
    tables: Sequence[Table], also: Sequence[str] = (), texts: Collection[str] = ()
) -> dict[str, Floats | Texts]:
    """Every covariate over all files: floats with nan, or texts with "", where not given.

    A covariate that is a number in one file and a text in another is a text in all. `also`
    are the covariates of tables elsewhere, in their order, `texts` those that are texts there.
    """
    names = dict.fromkeys((*also, *(name for table in tables for name in table.covariates)))
    found: dict[str, Floats | Texts] = {}
    for name in names:
        if name in texts or any(name in table.columns.texts for table in tables):
            found[name] = np.concatenate([_texts(table, name) for table in tables])
        else:
            found[name] = numbers(tables, name)
    return found


def _texts(table: Table, name: str) -> Texts:
    if name in table.columns.texts:
        column = table.columns.texts[name]
        return np.array([*column.labels, ""], dtype=object)[column.codes]
    if name in table.columns.numbers:
        values = table.columns.numbers[name].tolist()
        return np.array(["" if v != v else cell_text(v) for v in values], dtype=object)
    return np.full(len(table), "", dtype=object)


def check_labels(
    table: Table,
    name: str,
    what: str,
    expected: Callable[[str], str | None],
    problems: ProblemList,
) -> None:
    """A problem for every cell of a text column for which `expected` has something to say."""
    column = table.columns.texts.get(name)
    if column is None:
        return
    for code, label in enumerate(column.labels):
        hint = expected(label)
        if hint is not None:
            indices = np.flatnonzero(column.codes == code)
            problems.add_cells(table, indices, name, what, [label], hint)


def check_names(table: Table, columns: Sequence[str], problems: ProblemList) -> None:
    """A problem for every cell of these text columns that is no name for a table."""
    for name in columns:
        check_labels(
            table, name, NO_NAME, lambda label: None if is_name(label) else EXPECTED, problems
        )
