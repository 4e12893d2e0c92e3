"""Readings without a direction among others of their component that have one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.source import DRIFT

if TYPE_CHECKING:
    from mtu_cli.files.csv_table import ProblemList, Table


def check_blank_directions(table: Table, problems: ProblemList) -> None:
    """A problem for every empty direction of a component whose other rows have one: such a reading
    would be of neither way, and a pass of its own. Components read one way alone may do without;
    of drifts nobody asks for a direction.
    """
    column = table.columns.texts.get("direction")
    if column is None or table.source.role == DRIFT:
        return
    names = table.columns.texts["component"]
    given = np.bincount(names.codes[(column.codes >= 0) & (names.codes >= 0)], minlength=1)
    for code in np.flatnonzero(given).tolist():
        rows = np.flatnonzero((names.codes == code) & (column.codes < 0))
        expected = f"forward or reverse, as in the other rows of {names.labels[code]}"
        problems.add_cells(table, rows, "direction", "empty cell", [""], expected)
