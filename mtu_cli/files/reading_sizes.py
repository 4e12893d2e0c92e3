"""Readings and positions that no machine has: units, scales and rows that are mistaken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.contract_errors import PLAIN, unit_expectation
from mtu_cli.files.csv_table import ProblemList, Table, cell_text
from mtu_cli.files.reading_lines import off_lines
from mtu_cli.files.reading_mistakes import explained
from mtu_cli.units import ANGLE, LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import ComponentLike

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]
    Bools = NDArray[np.bool_]

Travels = Mapping[str, tuple[float, float]]
"""Lowest and highest coordinate of each axis, mm, as the machine file states them."""

LARGEST = {LENGTH: 1.0, ANGLE: 0.05}
"""Errors of machines, routers made of wood among them, are typically smaller, mm and rad ..."""
STEEPEST = 0.01
"""... but for what grows along an axis: a scale, or the slope to which a laser was aligned ..."""
OFF_LINE = 1e-3
"""... off which they are no larger, again in proportion."""
LARGEST_SHOWN = {LENGTH: "1 mm, or 1 % of the distance moved", ANGLE: "0.05 rad"}
OFF_SHOWN = "1 mm, or 0.1 % of the distance moved, off a straight line that is 0 on the axis"
FARTHEST_MM = 1e5
"""Nor is its position, where no travel is stated: 100 m."""
BEYOND = 3.0
"""A part's frame may lie anywhere on the machine: so many times its largest coordinate or travel
are not reached from there."""
FEWEST = 5
"""Cells of a component up to which they are slips of single rows, where most are sound."""
APART = 3.0
"""Slips are so many times the largest of the others."""
NAMED = 6


def check_units(table: Table, problems: ProblemList) -> None:
    """Cells that are no unit; a sign for micro, which is the same in all of them, is told once."""
    column = table.columns.texts["unit"]
    for code, label in enumerate(column.labels):
        if label in UNITS:
            continue
        rows = np.flatnonzero(column.codes == code)
        expected = unit_expectation(label)
        if not label.isascii() and expected.endswith(PLAIN):
            expected += f" ({len(rows)} such cells)" if len(rows) > 1 else ""
            rows = rows[:1]
        problems.add_cells(table, rows, "unit", "unknown unit", [label], expected)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cells:
    """A component's cells of a `column` in `rows` (n,): `values` and `most` (n,) in mm or rad.

    `units` are those the cells are written in and `groups` have what would explain them in
    common, both by `code` (n,). `what` is said of a slip. Of lengths along an axis, `near` (n,) is
    how far off a line they are at most, by `positions` and `passes` (n,) where they have them.
    """

    name: str
    column: str
    what: str
    rows: Rows
    values: Floats
    most: Floats
    code: NDArray[np.integer]
    units: Sequence[str]
    groups: Sequence[str]
    near: Floats | None = None
    positions: Floats | None = None
    passes: Floats | None = None


@dataclass(frozen=True, slots=True)
class _Far:
    """Rows (n,) of the component `name` that are beyond `most` (n,), in mm or rad, of so many, or
    `off` all lines.
    """

    name: str
    rows: Rows
    most: Floats
    of: int
    off: bool


Groups = dict[tuple[str, str], list[_Far]]
"""By column and unit or axis."""


def largest_errors(
    dimension: int, positions: Floats, travels: Travels, share: float = STEEPEST
) -> Floats:
    """The largest errors of a machine at `positions` (n,) in mm, mm or rad, (n,).

    Along an axis it is the distance to the farthest place measured that counts, as a scale and a
    laser may have their zero at any of them; without an axis (nan) the longest travel does.
    """
    if dimension != LENGTH:
        return np.full(len(positions), LARGEST[dimension])
    known = positions[np.isfinite(positions)]
    longest = max((abs(high - low) for low, high in travels.values()), default=0.0)
    moved = np.full(len(positions), longest)
    if len(known):
        moved = np.maximum(positions - known.min(), known.max() - positions)
        moved = np.fmax(moved, np.abs(positions))
    return np.fmax(LARGEST[dimension], share * moved)


def check_sizes(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike],
    travels: Travels,
    problems: ProblemList,
) -> None:
    """Problems of readings beyond `largest_errors`, or off all lines, where another unit explains
    most of a component, and of positions that the machine does not reach.

    Where it is a matter of many rows of some components, one problem tells it with what would
    explain it; where single rows do not fit the others, each of them is told. Large errors that
    nothing explains are the machine's.
    """
    for table in tables:
        column = table.columns.texts["component"]
        groups: Groups = {}
        for code, name in enumerate(column.labels):
            inside = np.flatnonzero(column.codes == code)
            axis = components[name].of
            found = [_errors(table, (name, axis), inside, travels)]
            if axis is not None:
                found.append(_positions(table, (name, axis), inside, travels))
            for cells in found:
                _check_cells(table, cells, groups, problems)
        for (field, own), many in groups.items():
            if field == "error":
                _add_errors(table, many, own, problems)
                continue
            rows = np.concatenate([far.rows for far in many])
            expected = _positions_expected(table, rows, travels, own)
            what = "farther than the machine goes"
            problems.add(_of_many(table, field, many, what, expected))


def _errors(table: Table, of: tuple[str, str | None], inside: Rows, travels: Travels) -> _Cells:
    """The errors of a component, grouped by their unit."""
    name, axis = of
    units = table.columns.texts["unit"]
    code = units.codes[inside]
    factor = np.array([UNITS[unit].to_internal for unit in units.labels])[code]
    dimension = UNITS[units.labels[code[0]]].dimension
    positions, near = np.full(len(inside), np.nan), None
    if axis is not None:
        positions = table.columns.numbers["position_mm"][inside]
        if dimension == LENGTH:
            near = largest_errors(dimension, positions, travels, OFF_LINE)
    passes = table.columns.numbers.get("pass")
    return _Cells(
        name=name,
        column="error",
        what=f"does not fit the other readings of {name!r}",
        rows=inside,
        values=table.columns.numbers["error"][inside] * factor,
        most=largest_errors(dimension, positions, travels),
        code=code,
        units=units.labels,
        groups=units.labels,
        near=near,
        positions=positions,
        passes=None if passes is None else passes[inside],
    )


def _positions(table: Table, of: tuple[str, str], inside: Rows, travels: Travels) -> _Cells:
    """The positions of a component, of one group."""
    name, axis = of
    return _Cells(
        name=name,
        column="position_mm",
        what=f"does not fit the other positions of {name!r}",
        rows=inside,
        values=table.columns.numbers["position_mm"][inside],
        most=np.full(len(inside), _reach(travels, axis)),
        code=np.zeros(len(inside), int),
        units=["mm"],
        groups=[axis],
    )


def _check_cells(table: Table, cells: _Cells, groups: Groups, problems: ProblemList) -> None:
    """Cells beyond what is likely: problems of slips, the others into their group."""
    far = np.abs(cells.values) > cells.most
    if far.any() and _slips(np.abs(cells.values), far):
        for i in np.flatnonzero(far):
            _slip(table, cells, int(i), cells.values[~far], problems)
        return
    for code in np.flatnonzero(np.bincount(cells.code)).tolist():
        inside = np.flatnonzero(cells.code == code)
        beyond = far[inside]
        off = np.zeros_like(beyond) if 2 * beyond.sum() > len(inside) else _off(cells, inside)
        rows = inside[beyond | off]
        if len(rows):
            own, most = cells.rows[rows], cells.most[rows]
            found = _Far(cells.name, own, most, len(inside), bool(off.any()))
            groups.setdefault((cells.column, cells.groups[code]), []).append(found)


def _off(cells: _Cells, inside: Rows) -> Bools:
    """Which of the cells `inside` (n,) are off all lines, where most are and are large."""
    values, positions, near = cells.values[inside], cells.positions, cells.near
    if near is None or positions is None or np.median(np.abs(values)) <= LARGEST[LENGTH]:
        return np.zeros(len(inside), bool)
    passes = None if cells.passes is None else cells.passes[inside]
    return off_lines(positions[inside], values, passes, near[inside], STEEPEST)


def _add_errors(table: Table, found: list[_Far], unit: str, problems: ProblemList) -> None:
    """The problem of errors in `unit`, if most of a component's are too large and another unit
    explains them: what is explained so in one component is in the others too.
    """
    for far in found:
        if 2 * len(far.rows) <= far.of:
            continue
        numbers = table.columns.numbers
        places = numbers["position_mm"][far.rows] if "position_mm" in numbers else None
        why = explained(numbers["error"][far.rows], places, far.most, unit)
        if why:
            most = OFF_SHOWN if far.off else LARGEST_SHOWN[UNITS[unit].dimension]
            expected = f"errors of at most {most}: {why}"
            what = "larger than any machine's error"
            problems.add(_of_many(table, "error", found, what, expected))
            return


def _slips(sizes: Floats, far: Bools) -> bool:
    """Whether few of the `sizes` (n,) are `far`, and are so far beyond the others."""
    few = far.sum() <= FEWEST and 2 * far.sum() < len(far)
    return bool(few and sizes[far].min() > APART * sizes[~far].max(initial=0.0))


def _slip(table: Table, cells: _Cells, i: int, others: Floats, problems: ProblemList) -> None:
    """The problem of cell `i`, which the values of the `others` show to be a slip."""
    unit, row = cells.units[cells.code[i]], int(cells.rows[i])
    near = others / UNITS[unit].to_internal
    expected = f"what the others have, {near.min():.6g} to {near.max():.6g} {unit}"
    value = float(table.columns.numbers[cells.column][row])
    problems.add(table.problem(row, cells.column, cells.what, value, expected))


def _reach(travels: Travels, axis: str) -> float:
    if axis not in travels:
        return FARTHEST_MM
    low, high = sorted(travels[axis])
    return BEYOND * max(abs(low), abs(high), high - low)


def _positions_expected(table: Table, rows: Rows, travels: Travels, axis: str) -> str:
    expected = "positions in mm"
    if axis in travels:
        low, high = sorted(travels[axis])
        expected += f" ({axis} travels from {low:g} to {high:g} mm)"
    typical = float(np.median(np.abs(table.columns.numbers["position_mm"][rows])))
    if typical / 1000 > _reach(travels, axis):
        return expected
    return f"{expected}: these look like um in a column of mm"


def _of_many(table: Table, column: str, found: list[_Far], what: str, expected: str) -> Problem:
    """One problem of many rows, at the first of them."""
    row = min(int(far.rows[0]) for far in found)
    names = [far.name for far in found]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    count, of = sum(len(far.rows) for far in found), sum(far.of for far in found)
    value = cell_text(float(table.columns.numbers[column][row]))
    if column == "error":
        units = table.columns.texts["unit"]
        value += f" {units.labels[units.codes[row]]}"
    return Problem(
        what=f"{count} of {of} cells of {', '.join(names[:NAMED])}{more} are {what}",
        file=table.source.shown,
        row=int(table.rows[row]),
        column=column,
        value=value,
        expected=expected,
    )
