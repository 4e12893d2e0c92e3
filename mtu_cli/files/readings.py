"""Readings of error components (``--lbb``, ``--laser``, ``--drift``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mtu_cli.errors import Problem, did_you_mean
from mtu_cli.files import doubled, joined
from mtu_cli.files.blank_directions import check_blank_directions
from mtu_cli.files.column_twins import column_twins
from mtu_cli.files.copied_files import check_copied_files
from mtu_cli.files.copied_passes import check_copied_passes
from mtu_cli.files.csv_missing import missing_column
from mtu_cli.files.csv_table import ProblemList, Table, TableSpec
from mtu_cli.files.drift_cells import check_drift, refuse_as_drift, refuse_drift
from mtu_cli.files.drift_notes import drift_notes
from mtu_cli.files.lone_positions import lone_positions
from mtu_cli.files.mixed_cells import mixed_cells
from mtu_cli.files.mixed_units import mixed_units
from mtu_cli.files.pass_units import pass_units
from mtu_cli.files.reading_cells import Travels
from mtu_cli.files.reading_sizes import check_sizes, check_units
from mtu_cli.files.run_signs import run_signs
from mtu_cli.files.sign_words import direction_hint, direction_sign
from mtu_cli.files.small_readings import small_readings
from mtu_cli.files.source import DRIFT, Source
from mtu_cli.files.swapped_columns import refuse_swapped
from mtu_cli.files.unused_positions import unused_positions
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS, dimension_name

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    given there has no meaning and is ignored); `error` in mm or rad, as its `dimension` (the
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

    def __len__(self) -> int:
        return len(self.code)


def read_readings(
    files: Sequence[tuple[Path, str]],
    components: Mapping[str, ComponentLike] | None,
    *,
    for_fit: bool,
    travels: Travels | None = None,
) -> Readings:
    """Reads all files of readings; `files` are (path, role).

    `components` are the machine's, by name; without them any name is accepted and positions
    are taken as they stand. `for_fit` asks for degree + 1 distinct positions a component, and for
    errors and positions of a machine, whose `travels` are known in part, the latter of drifts too.

    Raises InputError with all problems of all files: of cells first, then of what they mean.
    """
    problems = ProblemList()
    tables = joined.read_tables(files, SPEC, problems)
    for table in tables:
        check_cells(table, components, problems)
    equal = [doubled.check_equal_readings(table, problems) for table in tables]
    if problems.listed:
        refuse_as_drift(tables, components, problems)
        joined.integers(tables, "pass", problems)
        problems.raise_if_any()
    readings = assemble(tables, components, problems)
    if len(tables) > 1 and not problems.listed:
        check_copied_files(readings, problems)
    known = components if for_fit else None
    if known is not None and not problems.listed:
        _check_for_fit(readings, known, travels or {}, problems)
        for table in tables:
            refuse_drift(table)
    if not problems.listed:
        sized = [table for table in tables if known is not None or table.source.role == DRIFT]
        check_sizes(sized, components, travels or {}, problems)
    problems.raise_if_any()
    notes = [*readings.notes, *_notes_of_all(tables), *doubled.equal_notes(tables, equal)]
    if known is not None:
        notes += _notes_for_fit(readings, tables, known)
    return replace(readings, notes=(*notes, *(run_signs(readings) if for_fit else ())))


def _notes_of_all(tables: Sequence[Table]) -> tuple[Finding, ...]:
    """What no block of the rows tells by itself."""
    return (*mixed_units(tables), *small_readings(tables), *mixed_cells(tables, SPEC))


def _notes_for_fit(
    readings: Readings,
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike],
) -> list[Finding]:
    """What looks odd among readings of sound sizes. Raises InputError for passes whose unit is sure
    to be another one, and for directions that are missing.
    """
    problems = ProblemList()
    for table in tables:
        check_blank_directions(table, problems)
    found = [*unused_positions(tables, components), *lone_positions(readings, components)]
    found += pass_units(readings, tables, problems)
    problems.raise_if_any()
    return found


def check_cells(
    table: Table, components: Mapping[str, ComponentLike] | None, problems: ProblemList
) -> None:
    """Cells that mean nothing: units, directions, components, positions, sizes."""
    refuse_swapped(table)
    check_units(table, problems)
    joined.check_labels(table, "direction", "unknown direction", direction_hint, problems)
    for name in ("error", "position_mm"):
        joined.check_magnitude(table, name, problems)
    if table.source.role == DRIFT:
        check_drift(table, components, problems)
    joined.check_names(table, ("cycle",), problems)
    if components is None:
        joined.check_names(table, ("component",), problems)
    else:
        joined.check_labels(
            table, "component", "unknown component",
            lambda label: None if label in components else did_you_mean(label, components),
            problems,
        )  # fmt: skip
        _check_machine(table, components, problems)


def _check_machine(
    table: Table, components: Mapping[str, ComponentLike], problems: ProblemList
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
        if component.of is not None and positions is None:
            place = (table.source.shown, table.header_row, table.header)
            problems.add(missing_column("position_mm", *place, SPEC))
            positions = np.zeros(len(table))
        elif component.of is not None and positions is not None:
            empty = np.flatnonzero(inside & np.isnan(positions))
            expected = f"a number: {label} is a function of {component.of}"
            problems.add_cells(table, empty, "position_mm", "empty cell", [""], expected)
        dimension = UNITS[component.unit].dimension
        for unit_code, unit in enumerate(units.labels):
            if unit in UNITS and UNITS[unit].dimension != dimension:
                rows = np.flatnonzero(inside & (units.codes == unit_code))
                expected = f"{dimension_name(dimension)}: the machine gives {label} in "
                expected += component.unit
                what = f"wrong kind of unit for {label!r}"
                problems.add_cells(table, rows, "unit", what, [unit], expected)


def assemble(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike] | None,
    problems: ProblemList,
) -> Readings:
    """The rows of sound tables as readings."""
    names, code = joined.labelled(tables, "component", tuple(components or ()))
    position = joined.numbers(tables, "position_mm")
    if components is not None:
        axisless = [name in components and components[name].of is None for name in names]
        position = np.where(np.array(axisless, bool)[code], np.nan, position)
    units, unit_code = joined.labelled(tables, "unit")
    factors = np.array([UNITS[unit].to_internal if unit in UNITS else np.nan for unit in units])
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
        notes=(*column_twins(tables, SPEC), *drift_notes(tables)),
    )


def _check_for_fit(
    readings: Readings,
    components: Mapping[str, ComponentLike],
    travels: Travels,
    problems: ProblemList,
) -> None:
    check_copied_passes(readings, problems)
    for code, name in enumerate(readings.components):
        component = components[name]
        inside = np.flatnonzero(readings.code == code)
        distinct = np.unique(readings.position_mm[inside])
        if component.of is None or len(distinct) > component.degree:
            continue
        first = inside[0]
        shown = ", ".join(f"{value:g}" for value in distinct)
        length = float(np.ptp(travels.get(component.of, (0.0, np.inf))))
        far = np.abs(distinct).max() > length
        travel = f"; {component.of} travels {length:g} mm" if far else ""
        plural = "one position only" if len(distinct) == 1 else f"{len(distinct)} positions only"
        problems.add(
            Problem(
                what=f"{name!r} of degree {component.degree} is measured at {plural}",
                file=readings.sources[readings.file_index[first]].shown,
                row=int(readings.row[first]),
                column="position_mm",
                value=f"{shown} mm",
                expected=f"at least {component.degree + 1} positions{travel}",
            )
        )
