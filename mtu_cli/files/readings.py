"""Readings of error components (``--lbb``, ``--laser``, ``--drift``) from all files at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.covariates import TEMPERATURE_EXPECTED, is_temperature
from mtu_cli.files.csv_file import Convert, read_tables
from mtu_cli.files.csv_table import CellFaults, Flags, Floats, Ints, Measured, Table
from mtu_cli.files.headers import READINGS
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding, InputError, counted, finding, listed, nearest
from mtu_cli.units import UNITS, dimension_name

UNKNOWN = -9
"""For the dimension of a unit that is none."""
Components = Mapping[str, Any]
"""Components of a machine by name, of which readings need `of`, `unit` and `degree`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings(Measured):
    """Measured readings of all files.

    `components[code[i]]` is read; `position_mm` is nan where the component has no axis (a position
    given there has no meaning and is ignored); `error` in mm or rad, read in the `unit`-th of UNITS
    (None where the readings were made, not read), as its `dimension` (the exponent of length) says;
    `pass_number` counts where `has_pass`, else -1; `direction` is +1, -1, or 0 where not given;
    `cycles[cycle[i]]`, -1 where not given; `roles[file_index[i]]` is the role of its file.
    """

    components: tuple[str, ...]
    code: Ints
    position_mm: Floats
    error: Floats
    dimension: NDArray[np.int8]
    pass_number: Ints
    has_pass: Flags
    direction: NDArray[np.int8]
    cycles: tuple[str, ...]
    cycle: Ints
    roles: tuple[str, ...]
    unit: NDArray[np.int8] | None = None

    def __len__(self) -> int:
        return len(self.code)

    def where(self, keep: Flags) -> Readings:
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
    components: Components | None,
    *,
    for_fit: bool,
    convert: Convert | None = None,
) -> Readings:
    """Reads all files of readings; `files` are (path, role).

    `components` are the machine's, by name; without them any name is accepted and positions
    are taken as they stand. `for_fit` asks for degree + 1 distinct positions a component;
    `convert` makes the contract's CSV of instruments' files.

    Raises InputError with all problems of all files: of cells first, then of what they mean.
    """
    faults = CellFaults()
    table = read_tables(files, READINGS.with_texts("component", components), faults, convert)
    _check_drift(table, faults, for_fit)
    sound = not faults.listed
    for code, label in enumerate(table.texts["component"].labels):
        inside = table.texts["component"].codes == code
        component = None if components is None else components.get(label)
        if components is None or component is not None:
            _check_component(table, label, inside, component, faults)
        if for_fit:
            # A direction in all rows or in none: a blank one would be of neither way.
            judged = table.of_files(lambda f: f.source.role != DRIFT and "direction" in f.header)
            judged &= inside
            blank = judged & np.isnan(table.number("direction"))
            if blank.sum() < judged.sum():
                expected = f"forward or reverse, as in the other rows of {label}"
                faults.cells(table, blank, "direction", code="empty-cell", expected=expected)
            degree = 0 if component is None or component.of is None else component.degree
            if sound and isinstance(degree, int) and degree:
                _count_positions(table, label, inside, degree, faults)
    faults.raise_if_any()
    return _readings(table, components)


def _check_drift(table: Table, faults: CellFaults, for_fit: bool) -> None:
    """No cell of drift readings without a temperature; raises InputError where others are drift."""
    for i, file in enumerate(table.files):
        sensors = [name for name in file.header if is_temperature(name) and name in table.numbers]
        if file.source.role == DRIFT:
            for name in sensors:
                empty = (table.file_index == i) & np.isnan(table.numbers[name])
                faults.cells(table, empty, name, code="empty-cell", expected=TEMPERATURE_EXPECTED)
        elif for_fit and sensors and {"cycle", "pass", "direction"} & {*file.header} == {"cycle"}:
            raise InputError(drift_problem(file.source.shown, sensors))


def drift_problem(file: str, sensors: Sequence[str]) -> Finding:
    """The fault of drift readings where others are asked for."""
    kind = f"drift readings, as it seems: cycles and {listed(sensors)}, no passes"
    expected = "readings of components, with 'pass' instead of 'cycle'; drift goes to thermal-fit"
    return finding("other-table", file=file, kind=kind, expected=expected)


def _check_component(
    table: Table, label: str, inside: Flags, component: Any, faults: CellFaults
) -> None:
    """One kind of unit in the rows `inside` (n,), and a position or none, as the machine has them;
    without a machine drift readings have to be alike.
    """
    units, kinds, has_column = table.texts["unit"], _dimensions(table), table.has("position_mm")
    empty = np.isnan(table.number("position_mm"))
    if component is None:
        inside = inside & table.of_files(lambda file: file.source.role == DRIFT)
        kind = int(np.bincount(kinds[inside & (kinds != UNKNOWN)], minlength=1).argmax())
        why, placed = f"as most readings of {label}", bool((inside & ~empty).any())
        expected = f"a position in all readings of {label!r}, or in none"
    else:
        kind, placed = UNITS[component.unit].dimension, component.of is not None
        why = f"the machine gives {label} in {component.unit}"
        expected = f"a number: {label} is a function of {component.of}"

    def of_row(i: int) -> dict[str, Any]:
        unit = units.labels[units.codes[i]]
        return {"unit": dimension_name(kinds[i]), "value": unit}

    dimension = dimension_name(kind)
    facts = {"of": label, "wanted": dimension, "expected": f"{dimension}: {why}"}
    bad = inside & (kinds != kind) & (kinds != UNKNOWN)
    faults.cells(table, bad, "unit", of_row, code="wrong-unit", **facts)
    unplaced = inside & empty & placed
    for i in np.unique(table.file_index[unplaced & ~has_column]).tolist():
        place = {**table.files[i].place, "column": "position_mm", "expected": expected}
        meant = nearest("position_mm", table.files[i].header)
        faults.add(finding("missing-column", **place, meant=meant))
    faults.cells(table, unplaced & has_column, "position_mm", code="empty-cell", expected=expected)


def _count_positions(
    table: Table, label: str, inside: Flags, degree: int, faults: CellFaults
) -> None:
    """Whether there are enough positions for a polynomial."""
    positions = table.number("position_mm")[inside]
    distinct = np.unique(positions)
    if len(distinct) > degree or np.isnan(positions).any():
        return
    count = counted(len(distinct), "position")
    facts = {
        "what": f"{label!r} of degree {degree} is measured at {count} only",
        "value": ", ".join(f"{value:g}" for value in distinct) + " mm",
        "expected": f"at least {degree + 1} positions",
    }
    place = table.place(int(np.flatnonzero(inside)[0]), "position_mm")
    faults.add(finding("too-little-data", **place, **facts))


def _dimensions(table: Table) -> Ints:
    """The exponent of length of each row's unit (n,); UNKNOWN where it has none."""
    units = table.texts["unit"]
    dimensions = [UNITS[unit].dimension if unit in UNITS else UNKNOWN for unit in units.labels]
    return np.array([*dimensions, UNKNOWN], np.int64)[units.codes]


def _readings(table: Table, components: Components | None) -> Readings:
    """The rows of a sound table as readings."""
    names, code = table.labelled("component", tuple(components or ()))
    position = table.number("position_mm")
    if components is not None:
        axisless = np.array([components[name].of is None for name in names])
        position = np.where(axisless[code], np.nan, position)
    units, unit = table.labelled("unit", tuple(UNITS))
    cycles, cycle = table.labelled("cycle")
    return Readings(
        components=names,
        code=code,
        position_mm=position,
        error=table.number("error") * np.array([UNITS[name].to_internal for name in units])[unit],
        dimension=_dimensions(table).astype(np.int8),
        unit=np.array([[*UNITS].index(name) for name in units], np.int8)[unit],
        pass_number=table.whole("pass"),
        has_pass=~np.isnan(table.number("pass")),
        direction=np.nan_to_num(table.number("direction")).astype(np.int8),
        cycles=cycles,
        cycle=cycle,
        roles=tuple(source.role for source in table.sources),
        **table.fields(READINGS),
    )
