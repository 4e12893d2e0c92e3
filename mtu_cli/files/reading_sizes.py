"""Readings and positions that no machine has: units, scales and rows that are mistaken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.contract_errors import PLAIN, unit_expectation
from mtu_cli.files.csv_table import ProblemList, Table, cell_text
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
"""... but for what grows along an axis: a scale, or the slope to which a laser was aligned."""
LARGEST_SHOWN = {LENGTH: "1 mm, or 1 % of the distance moved", ANGLE: "0.05 rad"}
FARTHEST_MM = 1e5
"""Nor is its position, where no travel is stated: 100 m."""
BEYOND = 3.0
"""A part's frame may lie anywhere on the machine: so many times its largest coordinate or travel
are not reached from there."""
FEWEST = 5
"""Cells of a component up to which they are slips of single rows, where most are sound."""
APART = 3.0
"""Slips are so many times the largest of the others."""
TYPICAL = {LENGTH: 0.1, ANGLE: 0.02}
"""Share of the largest error that a component typically has at most, in the unit it is meant in."""
SHORTEST_BAR_MM = 20.0
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
    common, both by `code` (n,). `what` is said of a slip.
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


@dataclass(frozen=True, slots=True)
class _Far:
    """Rows (n,) of the component `name` that are beyond `most` (n,), in mm or rad, of so many."""

    name: str
    rows: Rows
    most: Floats
    of: int


Groups = dict[tuple[str, str], list[_Far]]
"""By column and unit or axis."""


def largest_errors(dimension: int, positions: Floats, travels: Travels) -> Floats:
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
    return np.fmax(LARGEST[dimension], STEEPEST * moved)


def check_sizes(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike],
    travels: Travels,
    problems: ProblemList,
) -> None:
    """Problems of readings beyond `largest_errors`, where another unit explains most of a
    component, and of positions that the machine does not reach.

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
    positions = np.full(len(inside), np.nan)
    if axis is not None:
        positions = table.columns.numbers["position_mm"][inside]
    return _Cells(
        name=name,
        column="error",
        what=f"does not fit the other readings of {name!r}",
        rows=inside,
        values=table.columns.numbers["error"][inside] * factor,
        most=largest_errors(UNITS[units.labels[code[0]]].dimension, positions, travels),
        code=code,
        units=units.labels,
        groups=units.labels,
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
    if not far.any():
        return
    if _slips(np.abs(cells.values), far):
        for i in np.flatnonzero(far):
            _slip(table, cells, int(i), cells.values[~far], problems)
        return
    for code in np.unique(cells.code[far]):
        of = cells.code == code
        found = _Far(cells.name, cells.rows[far & of], cells.most[far & of], int(of.sum()))
        groups.setdefault((cells.column, cells.groups[code]), []).append(found)


def _add_errors(table: Table, found: list[_Far], unit: str, problems: ProblemList) -> None:
    """The problem of errors in `unit`, if most of a component's are too large and another unit
    explains them: what is explained so in one component is in the others too.
    """
    for far in found:
        why = _explained(table, far, unit) if 2 * len(far.rows) > far.of else ""
        if why:
            expected = f"errors of at most {LARGEST_SHOWN[UNITS[unit].dimension]}: {why}"
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


def _explained(table: Table, far: _Far, unit: str) -> str:
    """What would explain the errors of a component in `unit`, in words; "" where nothing does."""
    own, raw = UNITS[unit], table.columns.numbers["error"][far.rows]
    errors, most = raw * own.to_internal, float(np.median(far.most))
    middle, typical = float(np.median(errors)), float(np.median(np.abs(raw)))
    places = table.columns.numbers.get("position_mm")
    if own.dimension == LENGTH:
        if places is not None and float(np.median(np.abs(errors - places[far.rows]))) < most:
            return "these look like the positions that were reached, not their errors"
        if middle > SHORTEST_BAR_MM and float(np.median(np.abs(errors - middle))) < most:
            return f"these look like lengths of a bar of {middle:.6g} mm, not errors"
    plausible = TYPICAL[own.dimension] * most
    fit = [
        other
        for other in UNITS.values()
        if (other.dimension, other.name == "um/m") == (own.dimension, False)
        and other.to_internal < own.to_internal
        and typical * other.to_internal <= plausible
    ]
    largest_fit = max((other.to_internal for other in fit), default=0.0)
    names = [other.name for other in fit if other.to_internal > 0.1 * largest_fit]
    if names:
        return f"these look like {' or '.join(names)} in a column of {unit}"
    thousand = typical * own.to_internal / 1000 <= plausible
    return "these look 1000 times too large" if thousand else ""


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
