"""Rows that stand twice, in tables that tell repeats apart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.csv_table import ProblemList, Table
from mtu_cli.files.row_marks import all_distinct, row_marks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[Any]
    Texts = NDArray[np.object_]


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


def check_doubled_rows(table: Table, problems: ProblemList) -> None:
    """Rows equal to an earlier one in every column, for tables that tell repeats apart."""
    if not table.sound:
        # Cells that differ may look alike by what stands for them.
        return
    columns = table.columns
    keys: list[NDArray[Any]] = list(columns.numbers.values())
    keys += [text.codes for text in columns.texts.values()]
    keys += [time.microseconds for time in columns.times.values()]
    mixed = row_marks(keys)
    ordered = np.sort(mixed)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(repeated):
        return
    suspects = np.flatnonzero(np.isin(mixed, repeated))
    first: dict[tuple[object, ...], int] = {}
    for index in suspects.tolist():
        cells = tuple(None if key[index] != key[index] else key[index].item() for key in keys)
        earlier = first.setdefault(cells, index)
        if earlier != index:
            problems.add(
                Problem(
                    what=f"the same as row {table.rows[earlier]} in every column",
                    file=table.source.shown,
                    row=int(table.rows[index]),
                    expected="each reading once",
                )
            )
