"""Columns of numbers that only their names keep from being sensors: their values would be lost."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice, Problem
from mtu_cli.files.covariates import (
    KELVIN,
    as_temperature,
    is_bare,
    is_covariate,
    is_temperature,
    looks_like_temperature,
)
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import Readings

    Floats = NDArray[np.float64]

    from mtu_cli.files.csv_table import ProblemList, Table
    from mtu_cli.files.csv_text import CsvText

_SURE = re.compile(
    r"(?:deg[\W_]*[ckf]|celsius|kelvin|fahrenheit|(?<=[\W_])(?<!^T_)[ckf])\W*$"
    r"|^temp(?:erature?)?[\W_]*\d*\W*$",
    re.IGNORECASE,
)
_TOOL = re.compile(r"[Tt][\W_]*[0-9]+\W*")
_UNIT = re.compile(
    r"(?:deg[\W_]*(?=[kf]\W*$)|(?=kelvin|fahrenheit)|(?<=[\W_])(?=[kf]\W*$))([kf])", re.IGNORECASE
)
CONVERTED = {
    "k": f"; values in kelvin become degC: value - {KELVIN:g}",
    "f": "; values in Fahrenheit become degC: (value - 32) / 1.8",
}
_OTHER = re.compile(
    r"_(?:k?W|m?A|k?V|k?Hz|m?bar|k?Pa|[mu]m|k?N|Nm|min|s|h|(?i:pct|percent|rpm|rh))$"
)
"""Of another unit than a temperature's: a load, a current, a humidity."""
_SENSOR = re.compile(
    r"sensor|thermo|ntc|rtd|ds18|pt[\W_]*1000?(?!\d)|f(?:\u00fc|ue)hler|probe"
    r"|^(?:ch|kanal|channel|tc|ai)[\W_]*\d+\W*$",
    re.IGNORECASE,
)
COLDEST_DEGC, WARMEST_DEGC = -20.0, 120.0
LEAST_MOVE_K = 0.5
"""What numbers are that may be temperatures of a machine in a test of its drift."""
EXAMPLES = ("T_spindle_degC", "T_air_degC", "T_table_degC")
"""Names for what is called a temperature alone."""
TOGETHER = 0.8
"""Correlation with a sensor from which on a column may well be another."""


def check_sensor_names(table: Table, problems: ProblemList) -> None:
    """A problem for every column that seems to hold temperatures under a name that is none of a
    sensor's; columns of texts are left alone.
    """
    _refuse(table, problems, list(_like_sensors(table)))


def check_temperature_names(table: Table, problems: ProblemList) -> None:
    """The same of columns that can be nothing else: in points T_12 may be a tool."""
    _refuse(table, problems, list(filter(_is_sure, _like_sensors(table))))


def _refuse(table: Table, problems: ProblemList, names: Sequence[str]) -> None:
    header = frozenset(table.header)
    for name in names:
        problems.add(no_sensor(table, name, header))


def sensor_name_notes(tables: Sequence[Table]) -> Iterator[Finding]:
    """Of columns of points that seem to be sensors and may be none, one a file."""
    for table in tables:
        names = [name for name in _like_sensors(table) if not _is_sure(name)]
        if names:
            several = len(names) > 1
            # T may be a tool, of what ends in a temperature only the form is wrong.
            sure = (as_temperature(name) for name in names if not name.casefold().startswith("t"))
            better = next((own for own in sure if own and own not in table.header), None)
            such = f", such as {better}" if better else ""
            message = (
                f"{table.source.shown}: column{'s' if several else ''} "
                f"{', '.join(map(repr, names))} {'are' if several else 'is'} not used as "
                f"temperature{'s' if several else ''}: a temperature is T_<sensor>_degC{such}"
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


def may_be_tool(name: str) -> bool:
    """Whether a name that looks like a temperature's is as likely that of a tool: `T_12`."""
    return _TOOL.fullmatch(name) is not None


def no_sensor(table: Table | CsvText, name: str, header: Container[str]) -> Finding:
    """The Problem of a column that seems to hold temperatures; `header` as a set, for a table of
    thousands of them.
    """
    better = as_temperature(name)
    unit = _UNIT.search(name.replace("\u00b0", "deg"))
    converted = "" if unit is None else CONVERTED[unit[1].casefold()]
    form = "T_<sensor>_degC"
    otherwise = ", or, where it is no temperature, a name that does not look like one"
    if better is not None and better not in header:
        otherwise = (
            f": rename {name!r} to {better!r} (in degC), or, where it is none, to a name that does "
            f"not look like one{converted}"
        )
    elif is_bare(name):
        otherwise += converted
        free = (example for example in EXAMPLES if example not in header)
        form += "".join(f", such as {example} (in degC)," for example in islice(free, 1))
    return Problem(
        what="not the name of a temperature",
        file=table.source.shown,
        row=table.header_row,
        column=name,
        expected=f"{form} with letters a to z, digits and _ alone{otherwise}",
    )


def unused_sensor_notes(readings: Readings) -> Iterator[Finding]:
    """Of columns of drift readings that no name makes sensors, but whose numbers move like
    temperatures: with a sensor that is one, or under a name that only sensors have.
    """
    given = readings.covariates.items()
    numbers = {n: c.astype(np.float64, copy=False) for n, c in given if c.dtype != object}
    columns = {n: c for n, c in numbers.items() if np.isfinite(c).all()}
    sensors = [_moves(c) for n, c in columns.items() if is_temperature(n)]
    for name, values in columns.items():
        if is_covariate(name) or not _like_temperatures(values):
            continue
        own = _moves(values)
        together = any(abs(float(own @ other)) > TOGETHER for other in sensors)
        if _SENSOR.search(name) or (together and not _OTHER.search(name)):
            better = as_temperature(name)
            rename = "" if better is None else f", such as {better}"
            message = (
                f"column {name!r} is not used, though its numbers move like temperatures: a "
                f"temperature is T_<sensor>_degC{rename}"
            )
            yield Notice(code="not-a-temperature", message=message)


def _like_temperatures(values: Floats) -> bool:
    """Whether numbers (n,) are in the range of a machine's sensors, broken, and move."""
    low, high = float(values.min()), float(values.max())
    broken = bool((values != np.round(values)).any())
    return low > COLDEST_DEGC and high < WARMEST_DEGC and high - low > LEAST_MOVE_K and broken


def _moves(values: Floats) -> Floats:
    """Values (n,) about their mean, of length 1; 0 where they do not move, or are not known."""
    away = values - values.mean()
    length = float(np.sqrt(away @ away))
    found: Floats = away / length if 0.0 < length < np.inf else np.zeros(len(values))
    return found
