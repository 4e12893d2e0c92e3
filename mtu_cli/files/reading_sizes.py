"""Readings and positions that no machine has: units, scales and rows that are mistaken."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem, did_you_mean
from mtu_cli.files.csv_table import ProblemList, Table, cell_text
from mtu_cli.files.reading_cells import (
    FARTHEST_MM,
    LARGEST,
    NARROW,
    STEEPEST,
    Cells,
    Travels,
    axis_of,
    errors_of,
    largest_shown,
    narrow_unit,
    positions_of,
    reach,
)
from mtu_cli.files.reading_lines import off_lines
from mtu_cli.files.reading_mistakes import explained
from mtu_cli.findings import Finding
from mtu_cli.units import LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import ComponentLike

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]
    Bools = NDArray[np.bool_]

FEWEST = 5
"""Cells of a component up to which they are slips of single rows, where most are sound."""
APART = 3.0
"""Slips are so many times the largest of the others."""
NAMED = 6
SHORTEST_TRAVEL_MM = 10.0
"""A shorter travel is likely one in m."""
NEAR = 50.0
"""Travels from 0 up to which positions beyond them are as likely mm beside a travel in inches."""


def check_units(table: Table, problems: ProblemList) -> None:
    """Cells that are no unit."""
    column = table.columns.texts["unit"]
    for code, label in enumerate(column.labels):
        if label in UNITS:
            continue
        rows = np.flatnonzero(column.codes == code)
        problems.add_cells(table, rows, "unit", "unknown unit", [label], did_you_mean(label, UNITS))


@dataclass(frozen=True, slots=True)
class _Far:
    """Rows (n,) of the component `name` that are beyond `most` (n,), in mm or rad, of so many, or
    `off` their line; `many` where they are no odd ones. `shown` is the row to tell, `way` what
    `most` is a share of, `places` (n,) where they are along the axis, if they have one.
    """

    name: str
    rows: Rows
    most: Floats
    of: int
    off: bool
    many: bool
    shown: int
    way: str
    places: Floats | None


Groups = dict[tuple[str, str], list[_Far]]
"""By column and unit or axis."""


def check_sizes(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike] | None,
    travels: Travels,
    problems: ProblemList,
) -> None:
    """Problems of readings beyond `largest_errors`, or off all lines, where another unit explains
    most of a component, and of positions that the machine does not reach.

    Where it is a matter of many rows of some components, one problem tells it with what would
    explain it; where single rows do not fit the others, each of them is told. Large errors that
    nothing explains are the machine's. Of drift readings the machine may be unknown.
    """
    for table in tables:
        groups: Groups = {}
        for cells in _cells(table, components, travels):
            _check_cells(table, cells, groups, problems)
        for (field, own), many in groups.items():
            if field == "error":
                narrow = _narrow(table, many, components, travels)
                _add_errors(table, many, own, narrow, problems)
                continue
            rows = np.concatenate([far.rows for far in many])
            expected = _positions_expected(table, rows, travels, own)
            what = "farther than the machine goes"
            first = min(int(far.rows[0]) for far in many)
            problems.add(_of_many(table, field, many, first, (what, expected)))


def may_be_mistaken(
    table: Table, components: Mapping[str, ComponentLike] | None, travels: Travels
) -> bool:
    """Whether `check_sizes` may have a problem of a table of which these are some rows."""
    numbers, units = table.columns.numbers, table.columns.texts["unit"]
    largest = [LARGEST[UNITS[unit].dimension] / UNITS[unit].to_internal for unit in units.labels]
    farthest = min((reach(travels, axis) for axis in travels), default=FARTHEST_MM)
    near = bool((np.abs(numbers["error"]) < 0.999 * np.array(largest)[units.codes]).all())
    near = near and not bool((np.abs(numbers.get("position_mm", np.zeros(0))) > farthest).any())
    # A glance is enough for most tables; a large machine takes more.
    return not near and any(
        bool((sizes > cells.most).any())
        or (cells.near is not None and (sizes > cells.near).sum() > cells.share * len(sizes))
        for cells in _cells(table, components, travels)
        for sizes in [np.abs(cells.values)]
    )


def _cells(
    table: Table, components: Mapping[str, ComponentLike] | None, travels: Travels
) -> Iterator[Cells]:
    """Errors and positions of each component."""
    column = table.columns.texts["component"]
    for code, name in enumerate(column.labels):
        inside = np.flatnonzero(column.codes == code)
        if not len(inside):
            continue
        axis = axis_of(table, components, name, inside)
        yield errors_of(table, (name, axis), inside, travels)
        if axis is not None:
            yield positions_of(table, (name, axis), inside, travels)


def _check_cells(table: Table, cells: Cells, groups: Groups, problems: ProblemList) -> None:
    """Cells beyond what is likely: problems of slips, the others into their group."""
    far = cells.sizes > cells.most
    if far.any() and _slips(cells.sizes, far):
        for i in np.flatnonzero(far):
            _slip(table, cells, int(i), cells.values[~far], problems)
        return
    places = cells.positions if cells.near is not None else None
    for code in np.flatnonzero(np.bincount(cells.code)).tolist():
        inside = np.flatnonzero(cells.code == code)
        beyond = far[inside]
        many = bool(beyond.sum() > cells.share * len(inside))
        off = np.zeros_like(beyond) if many else _off(cells, inside)
        rows = inside[beyond | off]
        if len(rows):
            own, most = cells.rows[rows], cells.most[rows]
            many = len(rows) > cells.share * len(inside)
            found = _Far(
                name=cells.name,
                rows=own,
                most=most,
                of=len(inside),
                off=bool(off.any()),
                many=many,
                shown=_shown(cells, inside[off]) if off.any() else int(own[0]),
                way=cells.way,
                places=None if places is None else places[rows],
            )
            groups.setdefault((cells.column, cells.groups[code]), []).append(found)


def _shown(cells: Cells, rows: Rows) -> int:
    """The largest of the `rows` (n,) that are off a line: what is farthest off may be hardly any
    error.
    """
    return int(cells.rows[rows[np.argmax(np.abs(cells.values[rows]))]])


def _off(cells: Cells, inside: Rows) -> Bools:
    """Which of the cells `inside` (n,) are off all lines, where most are and are large."""
    values, positions, near = cells.values[inside], cells.positions, cells.near
    if near is None or positions is None or np.median(cells.sizes[inside]) <= LARGEST[LENGTH]:
        return np.zeros(len(inside), bool)
    passes = None if cells.passes is None else cells.passes[inside]
    return off_lines(positions[inside], values, passes, near[inside], STEEPEST)


def _narrow(
    table: Table,
    found: list[_Far],
    components: Mapping[str, ComponentLike] | None,
    travels: Travels,
) -> str:
    """What is expected of positions, where another unit of them makes all the errors likely."""
    expected = ""
    column, units = table.columns.texts["component"], table.columns.texts["unit"]
    sizes = np.array([UNITS[label].to_internal for label in units.labels])
    for far in found:
        inside = np.flatnonzero(column.codes == column.labels.index(far.name))
        axis = axis_of(table, components, far.name, inside)
        positions = table.columns.numbers.get("position_mm", np.zeros(len(table)))[inside]
        unit = narrow_unit(positions, travels, axis)
        if unit is None or axis is None:
            return ""
        likely = STEEPEST * float(np.ptp(positions)) * NARROW[unit][0]
        errors = table.columns.numbers["error"][far.rows] * sizes[units.codes[far.rows]]
        if (np.abs(errors) > np.fmax(likely, far.most)).any():
            return ""
        low, high = sorted(travels[axis])
        expected = f"positions in mm ({axis} travels from {low:g} to {high:g} mm): "
        expected += f"these look like {unit} in a column of mm"
    return expected


def _add_errors(
    table: Table, found: list[_Far], unit: str, narrow: str, problems: ProblemList
) -> None:
    """The problem of errors in `unit`, if many of a component's are too large and another unit
    explains them: what is explained so in one component is in the others too. Of positions in
    another unit, where it may be theirs as well: `narrow` is what is expected of them.
    """
    for far in found:
        if not far.many:
            continue
        raw = table.columns.numbers["error"][far.rows]
        why = explained(raw, far.places, far.most, unit)
        if why:
            most = largest_shown(UNITS[unit].dimension, far.way, off=far.off)
            expected = f"errors of at most {most}"
            if narrow:
                what = "too near to each other for their errors"
                expected = f"{narrow}; or else {expected}: {why}"
                problems.add(_of_many(table, "position_mm", found, far.shown, (what, expected)))
                return
            what = f"larger than any machine's error ({why})"
            problems.add(_of_many(table, "error", found, far.shown, (what, expected)))
            return


def _slips(sizes: Floats, far: Bools) -> bool:
    """Whether few of the `sizes` (n,) are `far`, and are so far beyond the others."""
    few = far.sum() <= FEWEST and 2 * far.sum() < len(far)
    return bool(few and sizes[far].min() > APART * sizes[~far].max(initial=0.0))


def _slip(table: Table, cells: Cells, i: int, others: Floats, problems: ProblemList) -> None:
    """The problem of cell `i`, which the values of the `others` show to be a slip."""
    unit, row = cells.units[cells.code[i]], int(cells.rows[i])
    near = others / UNITS[unit].to_internal
    expected = f"what the others have, {near.min():.6g} to {near.max():.6g} {unit}"
    value = float(table.columns.numbers[cells.column][row])
    problems.add(table.problem(row, cells.column, cells.what, value, expected))


def _positions_expected(table: Table, rows: Rows, travels: Travels, axis: str) -> str:
    expected = "positions in mm"
    if axis in travels:
        low, high = sorted(travels[axis])
        expected += f" ({axis} travels from {low:g} to {high:g} mm)"
        if high - low < SHORTEST_TRAVEL_MM:
            return f"{expected}: is travel_mm of the machine file in mm?"
    typical = float(np.median(np.abs(table.columns.numbers["position_mm"][rows])))
    if typical / 1000 > reach(travels, axis):
        return expected
    if axis in travels and typical < NEAR * max(abs(low), abs(high), high - low):
        return f"{expected}: are these, and travel_mm of the machine file, in mm?"
    return f"{expected}: these look like um in a column of mm"


def _of_many(
    table: Table, column: str, found: list[_Far], row: int, words: tuple[str, str]
) -> Finding:
    """One problem of many rows, at one of them; `words` say what they are and what is expected."""
    what, expected = words
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
