"""Readings of error components (``--lbb``, ``--laser``, ``--drift``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files import joined
from mtu_cli.files.covariates import (
    SIGN_EXPECTED,
    TEMPERATURE_EXPECTED,
    direction_sign,
    is_temperature,
)
from mtu_cli.files.csv_table import CellFaults, Table, TableSpec
from mtu_cli.files.headers import check_sensor_names
from mtu_cli.files.source import DRIFT, Source
from mtu_cli.findings import Finding, InputError, counted, finding, nearest, suggestion
from mtu_cli.units import UNITS, dimension_name

SPEC = TableSpec(
    required=("component", "error", "unit"),
    numbers=frozenset({"error", "position_mm", "pass", "time_min"}),
    texts=frozenset({"component", "unit", "direction", "cycle"}),
    times=frozenset({"time"}),
    may_be_empty=frozenset({"position_mm", "direction"}),
    exclusive=(("time", "time_min"),),
    units=frozenset({"unit"}),
    says={
        "component": "the name of a component of the machine",
        "unit": f"one of: {', '.join(UNITS)}",
        "cycle": "the name of a warm-up or cool-down in every row, or no column 'cycle'",
    },
)


Travels = Mapping[str, tuple[float, float]]
"""Lowest and highest coordinate of each axis, mm, as the machine file states them."""


class ComponentLike(Protocol):
    """What readings need to know of a component of the machine."""

    @property
    def of(self) -> str | None:
        """Its axis, None for a constant."""

    @property
    def unit(self) -> str:
        """A key of UNITS."""

    @property
    def degree(self) -> int:
        """Degree of its polynomial."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """Readings of all files, end to end; every array has one entry a reading.

    `components[code[i]]` is read; `position_mm` is nan where the component has no axis (a position
    given there has no meaning and is ignored); `error` in mm or rad, read in the `unit`-th of UNITS
    (None where the readings were made, not read), as its `dimension` (the
    exponent of length) says; `pass_number` counts where `has_pass`, else -1; `direction` is +1, -1,
    or 0 where not given; `cycles[cycle[i]]`, -1 where not given; `time_min` in minutes, from the
    earliest time of all files where those are dates, nan where not given; `covariates` are floats
    (nan where not given) or texts ("" where not given); `row` counts as a text editor in the file
    `sources[file_index[i]]`, whose role is `roles[file_index[i]]`. Arrays may be read-only. `notes`
    say what a fit does not use and what looks odd.
    """

    components: tuple[str, ...]
    code: NDArray[np.int64]
    position_mm: NDArray[np.float64]
    error: NDArray[np.float64]
    dimension: NDArray[np.int8]
    pass_number: NDArray[np.int64]
    has_pass: NDArray[np.bool_]
    direction: NDArray[np.int8]
    cycles: tuple[str, ...]
    cycle: NDArray[np.int64]
    time_min: NDArray[np.float64]
    covariates: dict[str, NDArray[np.float64] | NDArray[np.object_]]
    file_index: NDArray[np.int64]
    row: NDArray[np.int64]
    sources: tuple[Source, ...]
    roles: tuple[str, ...]
    notes: tuple[Finding, ...] = ()
    unit: NDArray[np.int8] | None = None

    def __len__(self) -> int:
        return len(self.code)

    def where(self, keep: NDArray[np.bool_]) -> Readings:
        """The readings that are kept; `keep` (n,)."""
        arrays: dict[str, Any] = {
            item.name: value[keep]
            for item in fields(self)
            if isinstance(value := getattr(self, item.name), np.ndarray)
        }
        covariates = {name: column[keep] for name, column in self.covariates.items()}
        return replace(self, covariates=covariates, **arrays)


def read_readings(
    files: Sequence[tuple[Path, str]],
    components: Mapping[str, ComponentLike] | None,
    *,
    for_fit: bool,
) -> Readings:
    """Reads all files of readings; `files` are (path, role).

    `components` are the machine's, by name; without them any name is accepted and positions
    are taken as they stand. `for_fit` asks for degree + 1 distinct positions a component.

    Raises InputError with all problems of all files: of cells first, then of what they mean.
    """
    problems = CellFaults()
    tables = joined.read_tables(files, SPEC, problems)
    for table in tables:
        if for_fit and table.source.role != DRIFT:
            _refuse_drift(table)
        check_cells(table, components, problems)
        joined.check_equal_rows(table, problems)
        if for_fit:
            _check_blank_directions(table, problems)
    if problems.listed:
        joined.integers(tables, "pass", problems)
        problems.raise_if_any()
    readings = assemble(tables, components, problems)
    if for_fit and components is not None and not problems.listed:
        _check_for_fit(readings, components, problems)
    problems.raise_if_any()
    return readings


def check_cells(
    table: Table, components: Mapping[str, ComponentLike] | None, problems: CellFaults
) -> None:
    """Cells that mean nothing: units, directions, components, positions, temperatures."""

    def unit(label: str) -> dict[str, Any] | None:
        return None if label in UNITS else {"what": "unit", **suggestion(label, UNITS)}

    def direction(label: str) -> dict[str, Any] | None:
        near = nearest(label, ("forward", "reverse"))
        return None if direction_sign(label) else {"meant": near, "expected": SIGN_EXPECTED}

    joined.check_labels(table, "unit", "unknown-name", unit, problems)
    joined.check_labels(table, "direction", "not-a-direction", direction, problems)
    for name in ("error", "position_mm"):
        joined.check_magnitude(table, name, problems)
    if table.source.role == DRIFT:
        check_sensor_names(table, problems)
        for name, values in table.columns.numbers.items():
            if is_temperature(name):
                empty = np.flatnonzero(np.isnan(values))
                problems.add_cells(table, empty, name, "empty-cell", [""], TEMPERATURE_EXPECTED)
    joined.check_names(table, ("cycle",), problems)
    joined.check_known(table, "component", components, problems)
    if components is not None:
        _check_machine(table, components, problems)
    elif table.source.role == DRIFT:
        _check_alike(table, problems)


def _check_alike(table: Table, problems: CellFaults) -> None:
    """Without a machine, all readings of a component have one kind of unit, and a position in all
    rows or in none.
    """
    units, names = table.columns.texts["unit"], table.columns.texts["component"]
    kinds = np.array([UNITS[u].dimension if u in UNITS else -1 for u in units.labels] + [-1])
    positions = table.columns.numbers.get("position_mm", np.full(len(table), np.nan))
    for code, label in enumerate(names.labels):
        inside = np.flatnonzero(names.codes == code)
        known = inside[kinds[units.codes[inside]] >= 0]
        usual = int(np.bincount(kinds[units.codes[known]], minlength=1).argmax())
        other = known[kinds[units.codes[known]] != usual]
        expected = f"{dimension_name(usual)}, as in most readings of it"
        cells = [units.labels[i] for i in units.codes[other]]
        problems.add_cells(
            table, other, "unit", "wrong-kind-of-unit", cells, expected, component=label
        )
        empty = inside[np.isnan(positions[inside])]
        if len(empty) < len(inside):
            expected = f"a position in all readings of {label!r}, or in none"
            problems.add_cells(table, empty, "position_mm", "empty-cell", [""], expected)


def _check_machine(
    table: Table, components: Mapping[str, ComponentLike], problems: CellFaults
) -> None:
    """Positions of components with an axis, and units of their kind."""
    column = table.columns.texts["component"]
    units = table.columns.texts["unit"]
    positions = table.columns.numbers.get("position_mm")
    for code, label in enumerate(column.labels):
        component = components.get(label)
        if component is None:
            continue
        inside = column.codes == code
        expected = f"a number: {label} is a function of {component.of}"
        if component.of is not None and positions is None:
            place = {"file": table.source.shown, "row": table.header_row}
            problems.add(
                finding(
                    "missing-column",
                    name="position_mm",
                    expected=f"it, as {label} is a function of {component.of}",
                    **place,
                )
            )
            positions = np.zeros(len(table))
        elif component.of is not None and positions is not None:
            empty = np.flatnonzero(inside & np.isnan(positions))
            problems.add_cells(table, empty, "position_mm", "empty-cell", [""], expected)
        dimension = UNITS[component.unit].dimension
        for unit_code, unit in enumerate(units.labels):
            if unit in UNITS and UNITS[unit].dimension != dimension:
                rows = np.flatnonzero(inside & (units.codes == unit_code))
                expected = f"{dimension_name(dimension)}: the machine gives {label} in "
                expected += component.unit
                problems.add_cells(
                    table, rows, "unit", "wrong-kind-of-unit", [unit], expected, component=label
                )


def _check_blank_directions(table: Table, problems: CellFaults) -> None:
    """A problem for every empty direction of a component whose other rows have one: such a reading
    would be of neither way, and a pass of its own.
    """
    column = table.columns.texts.get("direction")
    if column is None or table.source.role == DRIFT:
        return
    names = table.columns.texts["component"]
    given = np.bincount(names.codes[(column.codes >= 0) & (names.codes >= 0)], minlength=1)
    for code in np.flatnonzero(given).tolist():
        rows = np.flatnonzero((names.codes == code) & (column.codes < 0))
        expected = f"forward or reverse, as in the other rows of {names.labels[code]}"
        problems.add_cells(table, rows, "direction", "empty-cell", [""], expected)


def _refuse_drift(table: Table) -> None:
    """Raises InputError for drift readings given as others: drift would count as scatter."""
    columns = table.columns
    sensors = [name for name in columns.numbers if is_temperature(name)]
    passes = "pass" in columns.numbers or "direction" in columns.texts
    if sensors and "cycle" in columns.texts and not passes:
        raise InputError(drift_problem(table.source.shown, sensors))


def drift_problem(file: str, sensors: Sequence[str]) -> Finding:
    """The fault of drift readings where others are asked for."""
    expected = "readings of components, with 'pass' instead of 'cycle'; drift goes to thermal-fit"
    return finding("drift-readings", file=file, sensors=sensors, expected=expected)


def assemble(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike] | None,
    problems: CellFaults,
) -> Readings:
    """The rows of sound tables as readings."""
    names, code = joined.labelled(tables, "component", tuple(components or ()))
    position = joined.numbers(tables, "position_mm")
    if components is not None:
        axisless = [name in components and components[name].of is None for name in names]
        position = np.where(np.array(axisless, bool)[code], np.nan, position)
    units, unit_code = joined.labelled(tables, "unit")
    factors = np.array([UNITS[unit].to_internal if unit in UNITS else np.nan for unit in units])
    place = {name: i for i, name in enumerate(UNITS)}
    dimensions = np.array([UNITS[unit].dimension if unit in UNITS else -1 for unit in units])
    directions, direction_code = joined.labelled(tables, "direction")
    values = [direction_sign(label) or 0 for label in directions]
    has_pass = ~np.isnan(joined.numbers(tables, "pass"))
    cycles, cycle = joined.labelled(tables, "cycle")
    return Readings(
        components=names,
        code=code,
        position_mm=position,
        error=joined.numbers(tables, "error") * factors[unit_code],
        dimension=dimensions.astype(np.int8)[unit_code],
        unit=np.array([place.get(unit, -1) for unit in units], np.int8)[unit_code],
        pass_number=joined.integers(tables, "pass", problems),
        has_pass=has_pass,
        direction=np.array([*values, 0], np.int8)[direction_code],
        cycles=cycles,
        cycle=cycle,
        time_min=joined.minutes(tables, problems),
        covariates=joined.covariates(tables),
        file_index=joined.file_indices(tables),
        row=np.concatenate([table.rows for table in tables]),
        sources=tuple(table.source for table in tables),
        roles=tuple(table.source.role for table in tables),
    )


def _check_for_fit(
    readings: Readings, components: Mapping[str, ComponentLike], problems: CellFaults
) -> None:
    """Components that are measured at too few positions for their polynomial."""
    for code, name in enumerate(readings.components):
        component = components[name]
        inside = np.flatnonzero(readings.code == code)
        distinct = np.unique(readings.position_mm[inside])
        if component.of is None or len(distinct) > component.degree:
            continue
        first = inside[0]
        shown = ", ".join(f"{value:g}" for value in distinct)
        problems.add(
            finding(
                "too-few-positions",
                file=readings.sources[readings.file_index[first]].shown,
                row=int(readings.row[first]),
                column="position_mm",
                component=name,
                degree=component.degree,
                count=counted(len(distinct), "position"),
                value=f"{shown} mm",
                expected=f"at least {component.degree + 1} positions",
            )
        )
