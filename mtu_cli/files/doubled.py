"""Rows that stand twice, in tables that tell repeats apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import Notice, Problem
from mtu_cli.files.csv_table import ProblemList, Table
from mtu_cli.files.row_marks import all_distinct, row_marks
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[Any]
    Texts = NDArray[np.object_]

_BLOCK = 1 << 16
FEWEST_PASTED = 8
"""Of fewer readings of a component each may have come twice by chance."""
FEWEST_DIFFERENT = 4
"""Of fewer different ones, too."""
PASTED = 0.5
"""Share of repeated readings that are equal from which on they may have been pasted."""
FEWEST_ERRORS = 8
"""Different errors of a component without passes: equal readings of two runs are no slip there."""


def told_apart(table: Table, number: str) -> bool:
    """Whether the texts and the whole numbers of a column already differ from row to row.

    A quick answer that saves comparing all cells; False where it would not be quick.
    """
    values = table.columns.numbers.get(number)
    if values is None or not table.sound:
        return False
    low = values.min()
    span = float(values.max() - low) + 1
    if not span <= 2 * len(table):
        return False
    whole = (values - low).astype(np.int32)
    if (whole != values - low).any():
        return False
    texts = [(text.codes, len(text.labels)) for text in table.columns.texts.values()]
    if any((codes < 0).any() for codes, _ in texts):
        return False
    return all_distinct([(whole, int(span)), *texts], 4 * len(table) + 1000)


def tells_repeats_apart(table: Table) -> bool:
    """Whether equal rows of a table are one row twice: passes, repeats or times are given."""
    names = {*table.columns.numbers, *table.columns.times}
    return not names.isdisjoint(("pass", "repeat", "time", "time_min"))


def _key(table: Table, name: str) -> NDArray[Any]:
    columns = table.columns
    if name in columns.numbers:
        return columns.numbers[name]
    return columns.texts[name].codes if name in columns.texts else columns.times[name].microseconds


def lasting_marks(table: Table) -> NDArray[np.uint64]:
    """Marks (n,) of the rows that those of other blocks of the same file can be held against.

    Codes of texts count from the first of a block; the texts themselves do not.
    """
    keys = []
    for name in table.header:
        text = table.columns.texts.get(name)
        if text is None:
            keys.append(_key(table, name))
        else:
            keys.append(np.array([*map(hash, text.labels), 0], np.int64)[text.codes])
    return row_marks(keys)


def copied_files(marks: Sequence[NDArray[np.uint64]], fewest: int) -> list[tuple[int, list[int]]]:
    """(file, earlier files) of each file all of whose rows stand in earlier ones.

    `marks` (n,) of the rows of each file, in ascending order; files of fewer rows than
    `fewest` may agree by chance.
    """
    found = []
    for file, own in enumerate(marks):
        earlier: set[int] = set()
        for start in range(0, len(own), _BLOCK):
            rest = own[start : start + _BLOCK]
            for other in reversed(range(file)):
                place = np.searchsorted(marks[other], rest)
                known = marks[other][np.minimum(place, len(marks[other]) - 1)] == rest
                if known.any():
                    earlier.add(other)
                rest = rest[~known]
            if len(rest):
                break
        else:
            if len(own) >= fewest:
                found.append((file, sorted(earlier)))
    return found


def equal_rows(table: Table) -> list[tuple[int, int]]:
    """(row, earlier) of each row equal to an earlier one in every column, the first of its kind;
    both count from 0.
    """
    if not table.sound:
        # Cells that differ may look alike by what stands for them.
        return []
    keys = [_key(table, name) for name in table.header]
    mixed = row_marks(keys)
    ordered = np.sort(mixed)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(repeated):
        return []
    found = []
    first: dict[tuple[object, ...], int] = {}
    for index in np.flatnonzero(np.isin(mixed, repeated)).tolist():
        cells = tuple(None if key[index] != key[index] else key[index].item() for key in keys)
        earlier = first.setdefault(cells, index)
        if earlier != index:
            found.append((index, earlier))
    return found


def check_doubled_rows(table: Table, problems: ProblemList) -> None:
    """Rows equal to an earlier one in every column, for tables that tell repeats apart."""
    _refuse(table, equal_rows(table), problems)


def check_equal_readings(table: Table, problems: ProblemList) -> list[tuple[int, int]]:
    """The `equal_rows` of readings that tell repeats apart: instruments with a coarse display give
    them honestly, but not twice in one instant, nor of a whole component in one file. Where none
    tells repeats apart the latter alone is looked for.
    """
    equal = equal_rows(table)
    if not tells_repeats_apart(table):
        if equal:
            _refuse_pasted(table, np.array(equal), problems, FEWEST_ERRORS)
        return []
    if not {*table.columns.numbers, *table.columns.times}.isdisjoint(("time", "time_min")):
        _refuse(table, equal, problems)
    elif equal:
        _refuse_pasted(table, np.array(equal), problems)
    return equal if len(equal) >= PASTED * _repeated(table) else []


def _repeated(table: Table) -> int:
    """How many rows repeat an earlier one in all but the reading."""
    marks = row_marks([_key(table, name) for name in table.header if name != "error"])
    return len(marks) - len(np.unique(marks))


def equal_notes(
    tables: Sequence[Table], equal: Sequence[Sequence[tuple[int, int]]]
) -> tuple[Finding, ...]:
    """The one warning of the `equal` rows of all tables that were read nevertheless."""
    found = [(table, own) for table, own in zip(tables, equal, strict=True) if own]
    if not found:
        return ()
    table, ((later, earlier), *_) = found[0]
    number = sum(len(own) for _, own in found)
    what = "1 reading is" if number == 1 else f"{number} readings are"
    text = (
        f"{table.source.shown}, row {table.rows[later]}: the same as row {table.rows[earlier]} in "
        f"every column; {what} equal to an earlier one of the same file: read as repeats; remove "
        "them where they were pasted twice"
    )
    return (Notice(code="readings-equal", message=text),)


def _refuse(table: Table, equal: Sequence[tuple[int, int]], problems: ProblemList) -> None:
    for index, earlier in equal:
        problems.add(
            Problem(
                what=f"the same as row {table.rows[earlier]} in every column",
                file=table.source.shown,
                row=int(table.rows[index]),
                expected="each reading once",
            )
        )


def _refuse_pasted(table: Table, equal: Ints, problems: ProblemList, errors: int = 0) -> None:
    """A problem of every component all of whose rows stand equally often, more than once, the
    later behind the first of them all: two at each dwell of a coarse display are neighbours.
    Fewer different `errors` may come again by chance.
    """
    error = table.columns.numbers["error"]
    column = table.columns.texts["component"]
    times = np.ones(len(table), np.int64)
    np.add.at(times, equal[:, 1], 1)
    times[equal[:, 0]] = 0
    behind = equal[:, 0] - equal[:, 1]
    for code, label in enumerate(column.labels):
        rows = np.flatnonzero(column.codes == code)
        counts = times[rows][times[rows] > 0]
        often = int(counts.min(initial=len(table)))
        # Some values that come again and again are those of a coarse display.
        few = len(rows) < FEWEST_PASTED or len(counts) < FEWEST_DIFFERENT
        if few or often < 2 or (counts != often).any():
            continue
        if len(np.unique(error[rows])) < errors:
            continue
        stand = "stands twice" if often == 2 else f"stands {often} times"
        which = f"each of the {len(counts)} readings"
        own = np.isin(equal[:, 0], rows)
        if behind[own].min() < len(counts):
            continue
        later = equal[own, 0].min()
        problems.add(
            Problem(
                what=f"{which} of {label!r} {stand}, as in a table that was pasted again",
                file=table.source.shown,
                row=int(table.rows[later]),
                expected="each reading once",
            )
        )
