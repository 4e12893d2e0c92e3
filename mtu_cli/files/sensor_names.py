"""Columns of numbers that only their names keep from being sensors: their values would be lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mtu_cli.errors import Problem
from mtu_cli.files.covariates import as_temperature, looks_like_temperature

if TYPE_CHECKING:
    from mtu_cli.files.csv_table import ProblemList, Table


def check_sensor_names(table: Table, problems: ProblemList) -> None:
    """A problem for every column that seems to hold temperatures under a name that is none of a
    sensor's; columns of texts are left alone.
    """
    for name in table.header:
        column = table.columns.texts.get(name)
        if looks_like_temperature(name) and (column is None or not column.labels):
            problems.add(_no_sensor(table, name))


def _no_sensor(table: Table, name: str) -> Problem:
    better = as_temperature(name)
    rename = (
        ""
        if better is None or better in table.header
        else f": rename {name!r} to {better!r} (in degC)"
    )
    return Problem(
        what="not the name of a temperature",
        file=table.source.shown,
        row=table.header_row,
        column=name,
        expected=f"T_<sensor>_degC with letters a to z, digits and _ alone{rename}, or, where it "
        "is none, to a name that does not look like one",
    )
