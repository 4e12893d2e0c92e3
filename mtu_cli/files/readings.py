"""Measured tables from all files of a call at once: readings of error components (``--lbb``,
``--laser``, ``--drift``), points (``--cmm``), and traces of a circular test (ISO 230-4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.covariates import POSITIONS as AXES
from mtu_cli.files.covariates import TEMPERATURE_EXPECTED, is_temperature
from mtu_cli.files.csv_file import Convert, read_tables
from mtu_cli.files.headers import (
    PASS,
    POINTS,
    READINGS,
    CellFaults,
    Column,
    Flags,
    Floats,
    Ints,
    Measured,
    Table,
    TableSpec,
    cell_text,
)
from mtu_cli.files.part import Place
from mtu_cli.files.source import DRIFT, Source
from mtu_cli.findings import Finding, InputError, counted, error, finding, listed, nearest
from mtu_cli.units import UM, UNITS, internal

UNKNOWN = -9
"""For the dimension of a unit that is none."""
Components = Mapping[str, Any]
"""Components of a machine by name, of which readings need `of`, `unit` and `degree`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings(Measured):
    """Measured readings of all files.

    `components[code[i]]` is read; `position_mm` is nan where the component has no axis (a position
    given there has no meaning and is ignored); `error` in mm or rad, read in the `unit`-th of
    UNITS, as its `dimension` (the exponent of length) says; `pass_number` counts where `has_pass`,
    else -1; `direction` is +1, -1, or 0 where not given; `cycles[cycle[i]]`, -1 where not given.
    """

    components: tuple[str, ...]
    code: Ints
    position_mm: Floats
    error: Floats
    unit: NDArray[np.int8]
    dimension: NDArray[np.int8]
    pass_number: Ints
    has_pass: Flags
    direction: NDArray[np.int8]
    cycles: tuple[str, ...]
    cycle: Ints


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
            positions = np.unique(table.number("position_mm")[inside])
            is_placed = sound and isinstance(degree, int) and not np.isnan(positions).any()
            if is_placed and len(positions) <= degree:
                count = counted(len(positions), "position")
                facts = {
                    "what": f"{label!r} of degree {degree} is measured at {count} only",
                    "value": ", ".join(f"{value:g}" for value in positions) + " mm",
                    "expected": f"at least {degree + 1} positions",
                }
                place = table.place(int(np.flatnonzero(inside)[0]), "position_mm")
                faults.add(finding("too-little-data", **place, **facts))
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
    without a machine they have to be alike.
    """
    units, kinds, has_column = table.texts["unit"], _dimensions(table), table.has("position_mm")
    empty = np.isnan(table.number("position_mm"))
    if component is None:
        kind = int(np.bincount(kinds[inside & (kinds != UNKNOWN)], minlength=1).argmax())
        why, placed = f"as most readings of {label}", bool((inside & ~empty).any())
        expected = f"a position in all readings of {label!r}, or in none"
    else:
        kind, placed = UNITS[component.unit].dimension, component.of is not None
        why = f"the machine gives {label} in {component.unit}"
        expected = f"a number: {label} is a function of {component.of}"

    def of_row(i: int) -> dict[str, Any]:
        unit = units.labels[units.codes[i]]
        return {"unit": internal(kinds[i]).text(), "value": unit}

    dimension = internal(kind).text()
    facts = {"of": f"the unit of {label}", "wanted": dimension, "expected": f"{dimension}: {why}"}
    bad = inside & (kinds != kind) & (kinds != UNKNOWN)
    faults.cells(table, bad, "unit", of_row, code="wrong-unit", **facts)
    unplaced = inside & empty & placed
    for i in np.unique(table.file_index[unplaced & ~has_column]).tolist():
        meant = nearest("position_mm", table.files[i].header)
        hint = f"{meant[0]!r} renamed to 'position_mm'" if meant else expected
        place = {**table.files[i].place, "column": "position_mm", "expected": hint}
        faults.add(finding("missing-column", **place))
    faults.cells(table, unplaced & has_column, "position_mm", code="empty-cell", expected=expected)


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
        **table.fields(READINGS),
    )


SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Points(Measured):
    """Measured points of all files.

    `parts[part[i]]`, `features[feature[i]]`, `operations[operation[i]]` (-1: not given);
    `measured` and `nominal` (n, 3) mm, nan where z is not given; `repeat` -1 where not given;
    `sequence` the order of manufacture, as given or counted from 1 in the order in which parts
    first appear; `direction` (n, 3) -1, +1, or nan where not given.
    """

    parts: tuple[str, ...]
    part: Ints
    features: tuple[str, ...]
    feature: Ints
    operations: tuple[str, ...]
    operation: Ints
    measured: Floats
    nominal: Floats
    repeat: Ints
    sequence: Ints
    direction: Floats


def read_points(
    files: Sequence[tuple[Path, str]],
    features: Mapping[str, Place] | None,
    convert: Convert | None = None,
) -> Points:
    """Reads all files of measured points; `files` are (path, role).

    `features` are the part file's nominal places; without them the files must give
    nominal_x_mm, nominal_y_mm. Where both do, they must agree within 1e-6 mm.

    Raises InputError with all problems of all files: of headers and of every cell first,
    then, where those are sound, of the rows as a whole.
    """
    faults = CellFaults()
    table = read_tables(files, POINTS.with_texts("feature", features), faults, convert)
    faults.raise_if_any()
    nominal, sequence = _nominal(table, features, faults), _sequence(table, faults)
    faults.raise_if_any()
    parts, part = table.labelled("part")
    names, feature = table.labelled("feature", tuple(features or ()))
    operations, operation = table.labelled("operation")
    return Points(
        parts=parts,
        part=part,
        features=names,
        feature=feature,
        operations=operations,
        operation=operation,
        measured=_side_by_side(table, "{}_mm"),
        nominal=nominal,
        repeat=table.whole("repeat"),
        sequence=sequence,
        direction=_side_by_side(table, "dir_{}"),
        **table.fields(POINTS),
    )


def _side_by_side(table: Table, name: str) -> Floats:
    """The columns of x, y and z (n, 3), each contiguous in memory; not to be written to."""
    names = [name.format(axis) for axis in AXES]
    if not any(column in table.numbers for column in names):
        return np.broadcast_to(np.nan, (len(table), len(AXES)))
    return np.array([table.number(column) for column in names]).T


def _sequence(table: Table, faults: CellFaults) -> Ints:
    """The order of manufacture (n,) as stated, one a part and operation, or of first appearance."""
    parts, part = table.labelled("part")
    ordered_files = [file for file in table.files if "sequence" in file.header]
    if not ordered_files:
        return part + 1
    expected = f"it in all files, or in none: {ordered_files[0].source.shown} has it"
    for file in table.files:
        if file not in ordered_files:
            place = {**file.place, "column": "sequence", "expected": expected}
            faults.add(finding("missing-column", **place))
    sequence, operation = table.whole("sequence"), table.labelled("operation")[1]
    run = part * (operation.max() + 2) + operation + 1
    _, first, code = np.unique(run, return_index=True, return_inverse=True)
    before = sequence[first][code.reshape(-1)]

    def of_row(i: int) -> dict[str, str]:
        name = f"part {parts[part[i]]!r}"
        expected = f"{before[i]}, as before of {name}: a part is made once"
        return {"value": str(sequence[i]), "expected": expected}

    bad = table.has("sequence") & (sequence != before)
    faults.cells(table, bad, "sequence", of_row, code="out-of-range")
    return sequence


def _nominal(table: Table, features: Mapping[str, Place] | None, faults: CellFaults) -> Floats:
    """Nominal places (n, 3) of the part file, or else of the columns; both must agree."""
    nominal = _side_by_side(table, "nominal_{}_mm")
    column = table.texts["feature"]
    if features is None:
        bad = np.isnan(nominal[:, 0] + nominal[:, 1])
        expected = "it in a part file (--part), or nominal_x_mm and nominal_y_mm"
        facts: dict[str, Any] = {"what": "the nominal place", "expected": expected}
        faults.cells(table, bad, "feature", code="missing-input", **facts)
        return nominal
    places = np.array([features[name] for name in column.labels], np.float64).reshape(-1, 3)
    reference = places[column.codes]
    for axis, letter in enumerate(AXES):

        def of_row(i: int, axis: int = axis) -> dict[str, str]:
            other = f"the nominal place of {column.labels[column.codes[i]]!r}"
            expected = f"{reference[i, axis]:.9g}, as in the part file"
            return {"other": other, "value": cell_text(nominal[i, axis]), "expected": expected}

        bad = np.abs(nominal[:, axis] - reference[:, axis]) > SAME_MM
        faults.cells(table, bad, f"nominal_{letter}_mm", of_row, code="contradicts")
    return np.where(np.isnan(reference), nominal, reference)


WAYS = {"ccw": 1, "cw": -1}
PLANES = ("XY", "YZ", "ZX")
"""First and second axis: counter-clockwise turns from the first to the second."""
FEWEST = 24
"""Samples of a trace: fewer do not separate its terms."""
TRACES = TableSpec(
    holds="traces of a circular test",
    option="mtu circular",
    columns={
        "angle_deg": Column(required=True, largest=36_000.0),
        "deviation_um": Column(required=True, largest=1e5),
        "direction": Column("text", texts=tuple(WAYS)),
        "radius_mm": Column(largest=1e5),
        "feed_mm_min": Column(largest=1e7, may_be_empty=True),
        "plane": Column("text", texts=PLANES),
        "pass": PASS,
    },
)
"""One row a sample; the angle counts from the first axis to the second, for cw, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A trace of radial deviations (n,) in mm at angles (n,) in rad, of `sign` +1 (ccw) or -1;
    `feed` in mm/min, nan where unknown.
    """

    file: str
    number: int | None
    direction: str
    feed: float
    angle: Floats
    deviation: Floats

    @property
    def sign(self) -> int:
        """The sense of rotation."""
        return WAYS[self.direction]


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """All traces of one plane (None: not stated) and one nominal radius, mm."""

    traces: tuple[Trace, ...]
    plane: str | None
    radius: float
    sources: tuple[Source, ...]


def read_traces(
    files: Sequence[Path],
    *,
    direction: Sequence[str] = (),
    feed: Sequence[float] = (),
    radius: Sequence[float] = (),
    plane: Sequence[str] = (),
) -> Traces:
    """Reads all files; what no column says the options do, each of all files or of each in turn.

    Raises InputError with all bad cells, or for what is not stated, or not alike in all traces.
    """
    faults = CellFaults()
    table = read_tables([(path, "traces") for path in files], TRACES, faults)
    faults.raise_if_any()
    ways = _filled(table, "direction", "--direction", direction)
    feeds = _filled(table, "feed_mm_min", "--feed", feed).astype(float)
    if (bad := np.flatnonzero(feeds <= 0)).size:
        place = table.place(int(bad[0]), "feed_mm_min") | {"value": f"{feeds[bad[0]]:g}"}
        raise error("out-of-range", expected="mm/min above 0, or empty", **place)
    radii = _filled(table, "radius_mm", "--radius", radius)
    planes = _filled(table, "plane", "--plane", plane)
    if not all(x and x > 0 for x in radii):
        place = {"path": "--radius", "expected": "--radius MM above 0, or a column radius_mm"}
        raise error("missing-input", what="the nominal radius", **place)
    for name, column in (("radius_mm", radii), ("plane", planes)):
        if (conflicts := np.flatnonzero(column != column[0])).size:
            value = ", ".join(f"{column[i]}" for i in (0, conflicts[0]))
            place = table.place(int(conflicts[0]), name) | {"value": value}
            raise error("contradicts", other="another trace", expected="one in all traces", **place)
    traces, number = [], table.whole("pass")
    # Rows of one file, pass, direction and feed are a trace.
    keys = zip(table.file_index.tolist(), number.tolist(), ways, np.nan_to_num(feeds), strict=True)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for i, key in enumerate(keys):
        groups.setdefault(key, []).append(i)
    for rows in groups.values():
        first = rows[0]
        place = table.place(first)
        if ways[first] is None:
            del place["row"]
            place["expected"] = "--direction cw or ccw, or a column 'direction'"
            faults.add(finding("missing-input", what="the direction", **place))
        elif len(rows) < FEWEST:
            what = f"a trace of {len(rows)} samples"
            place["expected"] = f"{FEWEST} or more around the circle"
            faults.add(finding("too-little-data", what=what, **place))
        else:
            traces.append(
                Trace(
                    file=str(place["file"]),
                    number=int(number[first]) if number[first] >= 0 else None,
                    direction=ways[first],
                    feed=float(feeds[first]),
                    angle=np.radians(table.number("angle_deg")[rows]),
                    deviation=table.number("deviation_um")[rows] * UM,
                )
            )
    faults.raise_if_any()
    return Traces(traces=tuple(traces), plane=planes[0], radius=radii[0], sources=table.sources)


def _filled(table: Table, name: str, option: str, values: Sequence[Any]) -> NDArray[Any]:
    """A column (n,), with the value of an option where the file has none: one for all files, or one
    for each; None where neither states it. Raises InputError where both do, and differ.
    """
    files = len(table.files)
    if values and len(values) not in (1, files):
        expected = f"one for all files, or {files} with commas"
        raise error("wrong-count", path=option, found=f"{len(values)} values", expected=expected)
    defaults = np.array([values[i % len(values)] if values else None for i in range(files)], object)
    cells = table.number(name).astype(object)
    if name in table.texts:
        labels, codes = table.labelled(name)
        cells = np.array([*labels, None], object)[codes]
    options = defaults[table.file_index]
    has_cell = [x is not None and x == x for x in cells]
    rows = np.flatnonzero(has_cell & (options != None) & (options != cells))  # noqa: E711  # (n,)
    if rows.size:
        place = table.place(int(rows[0]), name) | {"value": f"{cells[rows[0]]}"}
        raise error("contradicts", other=f"{option} {options[rows[0]]}", **place)
    return np.where(table.has(name), cells, options)
