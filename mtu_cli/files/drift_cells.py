"""What drift readings must hold beside other readings: a temperature in every sensor's cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.covariates import (
    HOTTEST_DEGC,
    KELVIN,
    all_in_kelvin,
    is_temperature,
    like_kelvin,
)
from mtu_cli.files.sensor_faults import check_sensors
from mtu_cli.files.sensor_names import check_sensor_names
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS, dimension_name

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList, Table

NAMED = 4
"""Sensors that a message names."""
TEMPERATURE_EXPECTED = (
    f"a number in degC, at most {HOTTEST_DEGC:g} in size: leave out the column, or the rows"
)

KELVIN_EXPECTED = f"degC: this looks like kelvin, from which {KELVIN:g} is to be subtracted"


def check_drift(
    table: Table, components: Mapping[str, object] | None, problems: ProblemList
) -> None:
    """Names and cells of the sensors; without a machine also what it would have told of the
    components, that all their readings are of one kind.
    """
    check_sensor_names(table, problems)
    kelvin = _in_kelvin(table)
    if kelvin:
        problems.add(_kelvin_problem(table, kelvin))
    for name, values in table.columns.numbers.items():
        if not is_temperature(name):
            continue
        if _all_within(values, HOTTEST_DEGC):
            check_sensors(table, name, problems)
            continue
        empty = np.flatnonzero(np.isnan(values))
        problems.add_cells(table, empty, name, "empty cell", [""], TEMPERATURE_EXPECTED)
        far = np.flatnonzero(np.abs(values) > HOTTEST_DEGC)
        cells = values[far].tolist()
        if cells and name not in kelvin:
            expected = KELVIN_EXPECTED if all(map(like_kelvin, cells)) else TEMPERATURE_EXPECTED
            problems.add_cells(table, far, name, "no temperature", cells, expected)
    if components is None:
        _check_kinds(table, problems)


def _in_kelvin(table: Table) -> list[str]:
    """The sensors of which many cells are beyond what they read, and all those look like kelvin."""
    found = []
    for name, values in table.columns.numbers.items():
        far = values[np.abs(values) > HOTTEST_DEGC] if is_temperature(name) else values[:0]
        if all_in_kelvin(far.tolist()):
            found.append(name)
    return found


def _kelvin_problem(table: Table, names: Sequence[str]) -> Finding:
    """The one Problem of sensors in kelvin, at the first of their cells."""
    far = np.array([np.abs(table.columns.numbers[name]) > HOTTEST_DEGC for name in names])
    row = int(far.any(axis=0).argmax())
    column = names[int(far[:, row].argmax())]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    what = f"{int(far.sum())} of {far.size} cells of {', '.join(names[:NAMED])}{more} are no "
    what += "temperatures"
    value = float(table.columns.numbers[column][row])
    return table.problem(row, column, what, value, KELVIN_EXPECTED)


def refuse_drift(table: Table) -> None:
    """Raises InputError for a table given as other readings that looks like drift readings: what
    else is wrong with it comes from that, and without a fault drift would count as scatter.
    """
    columns = table.columns
    sensors = [name for name in columns.numbers if is_temperature(name)]
    passes = "pass" in columns.numbers or "direction" in columns.texts
    if table.source.role != DRIFT and sensors and "cycle" in columns.texts and not passes:
        raise InputError(drift_problem(table.source.shown, sensors))


def refuse_as_drift(
    tables: Sequence[Table], components: Mapping[str, object] | None, problems: ProblemList
) -> None:
    """`refuse_drift` of tables with `problems` that are not of single cells."""
    for table in tables:
        if not _of_cells(table, components, problems):
            refuse_drift(table)


def _of_cells(table: Table, components: Mapping[str, object] | None, problems: ProblemList) -> bool:
    """Whether the `problems` of a table are of single cells, while its header and most of its
    components are sound: then it is what it was given as.
    """
    own = [problem for problem in problems.listed if problem.file == table.source.shown]
    column = table.columns.texts["component"]
    known = np.array([components is None or name in components for name in column.labels] + [False])
    header = any(problem.row in (None, table.header_row) for problem in own)
    return not header and 2 * int(known[column.codes].sum()) > len(table)


def drift_problem(file: str, sensors: Sequence[str]) -> Finding:
    """The Problem of drift readings where others are asked for."""
    more = ", ..." if len(sensors) > 1 else ""
    return Problem(
        what=f"this looks like drift readings (columns cycle, {sensors[0]}{more}, but no pass)",
        file=file,
        expected="readings of the machine's components; those of drifts go to thermal-fit "
        "--drift; a column 'cycle' that counts runs through the positions is called 'pass'",
    )


def _all_within(values: NDArray[np.float64], most: float) -> bool:
    """Whether all numbers are at most `most` in size; False where one is nan."""
    return bool(values.min(initial=0.0) >= -most and values.max(initial=0.0) <= most)


def _check_kinds(table: Table, problems: ProblemList) -> None:
    """Units of two dimensions, and positions of some readings only, in one component."""
    column, units = table.columns.texts["component"], table.columns.texts["unit"]
    positions = table.columns.numbers.get("position_mm")
    dimension = np.array([UNITS[u].dimension if u in UNITS else -1 for u in units.labels] + [-1])
    placed = positions is None or not np.isnan(positions.min(initial=0.0))
    if placed and len(set(dimension.tolist()) - {-1}) < 2:
        return
    of_row = dimension[units.codes]
    for code, label in enumerate(column.labels):
        inside = np.flatnonzero(column.codes == code)
        known = inside[of_row[inside] >= 0]
        usual = int(np.bincount(of_row[known]).argmax()) if len(known) else 0
        other = known[of_row[known] != usual]
        cells = [units.labels[units.codes[i]] for i in other]
        if cells:
            expected = f"{dimension_name(usual)}, as in most readings of it"
            what = f"wrong kind of unit for {label!r}"
            problems.add_cells(table, other, "unit", what, cells, expected)
        if positions is None:
            continue
        empty = inside[np.isnan(positions[inside])]
        if 0 < len(empty) < len(inside):
            expected = f"a position in all readings of {label!r}, or in none"
            problems.add_cells(table, empty, "position_mm", "empty cell", [""], expected)
