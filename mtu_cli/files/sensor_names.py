"""Columns of numbers that only their names keep from being sensors: their values would be lost."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from mtu_cli.errors import Problem
from mtu_cli.files.contracts import Notice
from mtu_cli.files.covariates import as_temperature, looks_like_temperature

if TYPE_CHECKING:
    from mtu_cli.files.csv_table import ProblemList, Table

_SURE = re.compile(
    r"(?:deg[\W_]*[ckf]|celsius|kelvin|fahrenheit|(?<=[\W_])(?<!^T_)[ckf])\W*$"
    r"|^temp(?:erature?)?[\W_]*\d*\W*$",
    re.IGNORECASE,
)


def check_sensor_names(table: Table, problems: ProblemList) -> None:
    """A problem for every column that seems to hold temperatures under a name that is none of a
    sensor's; columns of texts are left alone.
    """
    for name in _like_sensors(table):
        problems.add(_no_sensor(table, name))


def check_temperature_names(table: Table, problems: ProblemList) -> None:
    """The same of columns that can be nothing else: in points T_12 may be a tool."""
    for name in filter(_is_sure, _like_sensors(table)):
        problems.add(_no_sensor(table, name))


def sensor_name_notes(tables: Sequence[Table]) -> Iterator[Notice]:
    """Of columns of points that seem to be sensors and may be none, one a file."""
    for table in tables:
        names = [name for name in _like_sensors(table) if not _is_sure(name)]
        if names:
            several = len(names) > 1
            message = (
                f"{table.source.shown}: column{'s' if several else ''} "
                f"{', '.join(map(repr, names))} {'are' if several else 'is'} not used as "
                f"temperature{'s' if several else ''}: a temperature is T_<sensor>_degC"
            )
            yield Notice(code="not-a-temperature", message=message)


def _like_sensors(table: Table) -> Iterator[str]:
    for name in table.header:
        column = table.columns.texts.get(name)
        if looks_like_temperature(name) and (column is None or not column.labels):
            yield name


def _is_sure(name: str) -> bool:
    """Whether a name that looks like a temperature's states its unit, or is no more than that
    word, with a number at most.
    """
    return _SURE.search(name.replace("\u00b0", "deg")) is not None


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
