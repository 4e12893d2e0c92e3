"""Readings and positions that no machine has: units, scales and rows that are mistaken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.contract_errors import PLAIN, unit_expectation
from mtu_cli.files.contracts import Notice
from mtu_cli.files.csv_table import ProblemList, Table, cell_text
from mtu_cli.units import ANGLE, LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import ComponentLike

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]

Travels = Mapping[str, tuple[float, float]]
"""Lowest and highest coordinate of each axis, mm, as the machine file states them."""

LARGEST = {LENGTH: 1.0, ANGLE: 0.01}
"""No error of a machine tool or CMM is as large, mm and rad (1 mm in 100 mm)."""
LARGEST_SHOWN = {LENGTH: "1 mm", ANGLE: "0.01 rad"}
FARTHEST_MM = 1e5
"""Nor is its position, where no travel is stated: 100 m."""
BEYOND = 3.0
"""A part's frame may lie anywhere on the machine: so many times its largest coordinate or travel
are not reached from there."""
FEWEST = 5
"""Cells of a component up to which they are slips of single rows, where most are sound."""
APART = 3.0
"""Slips are so many times the largest of the others."""
TYPICAL = 0.1
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


Groups = dict[tuple[str, str], list[tuple[str, "Rows", int]]]
"""By column and unit or axis: components with their faulty rows and how many they have."""


def check_sizes(
    tables: Sequence[Table],
    components: Mapping[str, ComponentLike],
    travels: Travels,
    problems: ProblemList,
) -> None:
    """Problems of readings beyond `LARGEST` and of positions that the machine does not reach.

    Where it is a matter of many rows of some components, one problem tells it with what would
    explain it; where single rows do not fit the others, each of them is told.
    """
    for table in tables:
        column = table.columns.texts["component"]
        groups: Groups = {}
        for code, name in enumerate(column.labels):
            inside = np.flatnonzero(column.codes == code)
            axis = components[name].of
            _check_errors(table, name, inside, groups, problems)
            if axis is not None:
                _check_positions(table, (name, axis), inside, travels, groups, problems)
        for (field, own), found in groups.items():
            rows = np.concatenate([rows for _, rows, _ in found])
            if field == "error":
                words = "larger than any machine's error", _errors_expected(table, rows, own)
            else:
                words = (
                    "farther than the machine goes",
                    _positions_expected(table, rows, travels, own),
                )
            problems.add(_of_many(table, field, found, *words))


def _check_errors(
    table: Table, name: str, inside: Rows, groups: Groups, problems: ProblemList
) -> None:
    units = table.columns.texts["unit"]
    code = units.codes[inside]
    factor = np.array([UNITS[unit].to_internal for unit in units.labels])[code]
    dimension = UNITS[units.labels[code[0]]].dimension
    errors = table.columns.numbers["error"][inside]
    far = np.abs(errors * factor) > LARGEST[dimension]
    if not far.any():
        return
    if _slips(np.abs(errors * factor), LARGEST[dimension]):
        what = f"does not fit the other readings of {name!r}"
        for row in inside[far]:
            unit = units.labels[units.codes[row]]
            near = errors[~far] * factor[~far] / UNITS[unit].to_internal
            _slip(table, int(row), "error", what, (near, unit), problems)
        return
    for unit_code in np.unique(code[far]):
        rows = inside[far & (code == unit_code)]
        own = units.labels[unit_code]
        groups.setdefault(("error", own), []).append((name, rows, len(inside)))


def _slips(sizes: Floats, most: float) -> bool:
    """Whether few of the `sizes` (n,) are beyond `most`, and are so far beyond the others."""
    far = sizes > most
    few = far.sum() <= FEWEST and 2 * far.sum() < len(far)
    return bool(few and sizes[far].min() > APART * sizes[~far].max(initial=0.0))


def _slip(
    table: Table,
    row: int,
    column: str,
    what: str,
    near: tuple[Floats, str],
    problems: ProblemList,
) -> None:
    """The problem of one cell; `near` are the others' values, in a unit."""
    others, unit = near
    expected = f"what the others have, {others.min():.6g} to {others.max():.6g} {unit}"
    value = float(table.columns.numbers[column][row])
    problems.add(table.problem(row, column, what, value, expected))


def _errors_expected(table: Table, rows: Rows, unit: str) -> str:
    """What was expected of errors in `unit`, and what would explain those of `rows` (n,)."""
    own, raw = UNITS[unit], table.columns.numbers["error"][rows]
    errors, largest = raw * own.to_internal, LARGEST[own.dimension]
    expected = f"errors of at most {LARGEST_SHOWN[own.dimension]}"
    middle, typical = float(np.median(errors)), float(np.median(np.abs(raw)))
    places = table.columns.numbers.get("position_mm")
    if own.dimension == LENGTH:
        if places is not None and float(np.median(np.abs(errors - places[rows]))) < largest:
            return f"{expected}: these look like the positions that were reached, not their errors"
        if middle > SHORTEST_BAR_MM and float(np.median(np.abs(errors - middle))) < largest:
            return f"{expected}: these look like lengths of a bar of {middle:.6g} mm, not errors"
    fit = [
        other
        for other in UNITS.values()
        if (other.dimension, other.name == "um/m") == (own.dimension, False)
        and other.to_internal < own.to_internal
        and typical * other.to_internal <= TYPICAL * largest
    ]
    largest_fit = max((other.to_internal for other in fit), default=0.0)
    names = [other.name for other in fit if other.to_internal > 0.1 * largest_fit]
    if names:
        return f"{expected}: these look like {' or '.join(names)} in a column of {unit}"
    if typical * own.to_internal / 1000 <= TYPICAL * largest:
        return f"{expected}: these look 1000 times too large"
    return expected


def _check_positions(
    table: Table,
    of: tuple[str, str],
    inside: Rows,
    travels: Travels,
    groups: Groups,
    problems: ProblemList,
) -> None:
    name, axis = of
    positions = table.columns.numbers["position_mm"][inside]
    far = np.abs(positions) > _reach(travels, axis)
    if not far.any():
        return
    if not _slips(np.abs(positions), _reach(travels, axis)):
        groups.setdefault(("position_mm", axis), []).append((name, inside[far], len(inside)))
        return
    what = f"does not fit the other positions of {name!r}"
    for row in inside[far]:
        _slip(table, int(row), "position_mm", what, (positions[~far], "mm"), problems)


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


def _of_many(
    table: Table, column: str, found: list[tuple[str, Rows, int]], what: str, expected: str
) -> Problem:
    """One problem of many rows, at the first of them."""
    row = min(int(rows[0]) for _, rows, _ in found)
    names = [name for name, _, _ in found]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    count, of = sum(len(rows) for _, rows, _ in found), sum(n for _, _, n in found)
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


def unused_positions(
    tables: Sequence[Table], components: Mapping[str, ComponentLike]
) -> tuple[Notice, ...]:
    """Positions that are given for components without an axis: they mean nothing, and 0 is what
    some programs write there.
    """
    found = []
    for table in tables:
        positions = table.columns.numbers.get("position_mm")
        column = table.columns.texts["component"]
        names = [name for name in column.labels if components[name].of is None]
        if positions is None or not names:
            continue
        codes = [column.labels.index(name) for name in names]
        given = np.nan_to_num(positions) != 0
        rows = np.flatnonzero(given & np.isin(column.codes, codes))
        if len(rows):
            first = column.labels[column.codes[rows[0]]]
            text = (
                f"{table.source.shown}, row {table.rows[rows[0]]}, column 'position_mm': "
                f"{positions[rows[0]]:g} mm of {first}, to which the machine file gives no axis: "
                f"positions of such components are not used ({len(rows)} rows); where they matter, "
                "'of' in the machine file names their axis"
            )
            found.append(Notice(code="position-not-used", message=text))
    return tuple(found)
