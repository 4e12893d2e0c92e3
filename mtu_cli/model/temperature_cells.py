"""Cells of sensors' columns that hold no temperature of a machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.covariates import (
    HOTTEST_DEGC,
    all_in_kelvin,
    expected_temperature,
    is_temperature,
)
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.basis import TIME
from mtu_cli.model.measured import MOST_TOLD
from mtu_cli.model.residual_cells import IntArray

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings


def check_temperatures(measured: Points | Readings) -> None:
    """Raises InputError for cells in any sensor's column that no sensor of a machine reads."""
    problems = [
        problem
        for name, column in measured.covariates.items()
        for problem in no_temperatures(measured, name, column)
    ]
    if problems:
        raise InputError(problems)


def no_temperatures(
    measured: Points | Readings, name: str, column: np.ndarray, rows: IntArray | None = None
) -> list[Finding]:
    """Cells of `rows` (all of them unless given) in a sensor's column (n,) that are none; texts are
    told elsewhere.
    """
    if not is_temperature(name) or column.dtype == object:
        return []
    values = column.astype(np.float64)
    rows = np.arange(len(values)) if rows is None else rows
    far = rows[np.isfinite(values[rows]) & (np.abs(values[rows]) > HOTTEST_DEGC)]
    what = "no temperature"
    if all_in_kelvin(values[far].tolist()):
        # A whole column in kelvin is one fault, though each cell has its own value.
        what, far = f"{len(far)} of {len(rows)} cells are no temperatures", far[:1]
    return [
        cell_problem(measured, i, name, what, f"{values[i]:g}", expected_temperature(values[i]))
        for i in far[:MOST_TOLD].tolist()
    ]


def cell_problem(
    measured: Points | Readings, i: int, name: str, what: str, value: str | None, expected: str
) -> Finding:
    """What is wrong with the cell of row i."""
    return Problem(
        what=what,
        file=measured.sources[measured.file_index[i]].shown,
        row=int(measured.row[i]),
        column="time" if name == TIME else name,
        value=value,
        expected=expected,
    )
