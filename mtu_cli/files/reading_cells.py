"""The cells of components' readings, and the largest that they are on any machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.csv_table import Table
from mtu_cli.files.reading_lines import SCATTER_MM
from mtu_cli.files.reading_mistakes import SHORTEST_BAR_MM
from mtu_cli.files.source import DRIFT
from mtu_cli.units import ANGLE, LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import ComponentLike

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]

Travels = Mapping[str, tuple[float, float]]
"""Lowest and highest coordinate of each axis, mm, as the machine file states them."""

LARGEST = {LENGTH: 1.0, ANGLE: 0.05}
"""Errors of machines, routers made of wood among them, are typically smaller, mm and rad ..."""
STEEPEST = 0.01
"""... but for what grows along an axis: a scale, or the slope to which a laser was aligned ..."""
OFF_LINE = 1e-3
"""... off which they are no larger, again in proportion."""
WAY = "the distance to 0 or to the farthest place read"
LARGE = {LENGTH: 0.2, ANGLE: 0.002}
"""Typical errors from which on it is asked about their unit, mm and rad ..."""
POOR = 0.01
"""... and where they are more than this share of the largest errors: 100 um/m is a poor scale."""
FARTHEST_MM = 1e5
"""Nor is its position, where no travel is stated: 100 m."""
MOST_FROM_ZERO = 3.0
"""A frame may lie anywhere on the machine: so many times its largest coordinate or travel are not
reached from there. More than `extents.MOST_APART`, as where the frame lies does not cancel.
"""
NARROW = {"m": (1000.0, 0.0), "inch": (25.4, 0.5)}
"""What positions may be written in by mistake, in mm, and the share of a travel from which on they
are asked about: a thousandth of it is measured by nobody, a twenty-fifth now and then."""
ROUND = 1e-6
GRIDS = (0.1, 0.125)
"""What positions are typed by, in mm or in inches; converted ones lie on neither ..."""
WHOLE, BEYOND_MM = 0.9, 1.0
"""... and those on one are inches where these are at least this share of a travel, and do not go
beyond it: 0 to 20 mm of 500 are one turn of its screw, as 20 inches are more than the axis has."""
WIDE = 1.02
"""Times its travel that positions of an axis may span: ends are stated to a few mm."""
FEWEST_OF_A_CYCLE = 4
"""Readings of a place in a cycle from which on the probe may have been set anew for it."""
MOST, MOST_OF_DRIFT = 0.5, 0.25
"""Share of a component's errors that is more than some odd rows; a drift begins at 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """A component's cells of a `column` in `rows` (n,): `values` and `most` (n,) in mm or rad.

    `units` are those the cells are written in and `groups` have what would explain them in
    common, both by `code` (n,). `what` is said of a slip. Of lengths along an axis, `near` (n,) is
    how far off a line they are at most, by `positions` and `passes` (n,) where they have them.
    `sizes` (n,) are what is compared with `most`: of a drift not where its probe was zeroed. More
    than a `share` of them are no odd rows. `way` says what the largest error is a share of.
    """

    name: str
    column: str
    what: str
    rows: Rows
    values: Floats
    sizes: Floats
    most: Floats
    code: NDArray[np.integer]
    units: Sequence[str]
    groups: Sequence[str]
    near: Floats | None = None
    positions: Floats | None = None
    passes: Floats | None = None
    share: float = MOST
    way: str = ""


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


def largest_shown(dimension: int, way: str, *, off: bool) -> str:
    """The same in words, of what the share is of (`Cells.way`); `off` a line."""
    if dimension == ANGLE:
        return "0.05 rad"
    if off:
        line = "a line as steep as their own (1 % at most) that is 0 somewhere on the axis"
        return f"1 mm, or 0.1 % of {way}, off {line}"
    return f"1 mm, or 1 % of {way}" if way else "1 mm"


def look_large(errors: Floats, most: Floats, dimension: int) -> bool:
    """Whether the sizes `errors` (n,) of a component, mm or rad, make one ask about their unit;
    `most` (n,) are the `largest_errors` at their places.
    """
    asked = max(LARGE[dimension], POOR * float(most.max()))
    return bool(np.median(errors) > asked or (errors > most).any())


def errors_of(table: Table, of: tuple[str, str | None], inside: Rows, travels: Travels) -> Cells:
    """The errors of a component, grouped by their unit."""
    name, axis = of
    units = table.columns.texts["unit"]
    code = units.codes[inside]
    factor = np.array([UNITS[unit].to_internal for unit in units.labels])[code]
    dimension = UNITS[units.labels[code[0]]].dimension
    positions, near = np.full(len(inside), np.nan), None
    way = "the longest travel" if travels else ""
    if axis is not None:
        way = WAY
        positions = table.columns.numbers["position_mm"][inside]
        if dimension == LENGTH:
            near = largest_errors(dimension, positions, travels, OFF_LINE)
    passes = table.columns.numbers.get("pass")
    values = table.columns.numbers["error"][inside] * factor
    drift = table.source.role == DRIFT
    cycles = table.columns.texts.get("cycle")
    cycle = np.zeros(len(inside), int) if cycles is None else cycles.codes[inside]
    return Cells(
        name=name,
        column="error",
        what=f"does not fit the other readings of {name!r}",
        rows=inside,
        values=values,
        sizes=_moved(values, positions, cycle) if drift and dimension == LENGTH else np.abs(values),
        most=largest_errors(dimension, positions, travels),
        code=code,
        units=units.labels,
        groups=units.labels,
        near=near,
        positions=positions,
        passes=None if passes is None else passes[inside],
        share=MOST_OF_DRIFT if drift else MOST,
        way=way,
    )


def _moved(values: Floats, positions: Floats, cycle: NDArray[np.integer]) -> Floats:
    """Sizes (n,) of drifts in mm; from the middle of a place, or of a `cycle` (n,) there, where
    that is how far a probe stood off, and most readings differ little from it.
    """
    sizes = np.abs(values)
    place = np.unique(positions, return_inverse=True)[1].reshape(-1)
    for number in range(int(place.max(initial=-1)) + 1):
        rows = np.flatnonzero(place == number)
        of = [rows[cycle[rows] == own] for own in np.unique(cycle[rows])]
        # One that was broken off does not make the others one.
        fine = of if np.median([len(own) for own in of]) >= FEWEST_OF_A_CYCLE else [rows]
        for groups in ([rows], fine):
            middle = np.empty(len(values))
            for own in groups:
                middle[own] = np.median(values[own])
            away = np.abs(values[rows] - middle[rows])
            near = np.abs(middle[rows]).max() <= SHORTEST_BAR_MM
            if near and float(np.median(away)) < SCATTER_MM:
                sizes[rows] = np.minimum(sizes[rows], away)
    return sizes


def positions_of(table: Table, of: tuple[str, str], inside: Rows, travels: Travels) -> Cells:
    """The positions of a component, of one group."""
    name, axis = of
    values = table.columns.numbers["position_mm"][inside]
    return Cells(
        name=name,
        column="position_mm",
        what=f"does not fit the other positions of {name!r}",
        rows=inside,
        values=values,
        sizes=np.abs(values),
        most=np.full(len(inside), reach(travels, axis)),
        code=np.zeros(len(inside), int),
        units=["mm"],
        groups=[axis],
    )


def narrow_unit(positions: Floats, travels: Travels, axis: str | None) -> str | None:
    """The unit, `m` or `inch`, in which `positions` (n,) of an axis cover most of its travel, where
    they cover next to nothing of it in mm; None where they may well be mm.
    """
    given = positions[np.isfinite(positions)]
    if axis is None or axis not in travels or not len(given):
        return None
    span, travel = float(np.ptp(given)), abs(travels[axis][1] - travels[axis][0])
    # A few mm far from the zero, as where one turn of a screw is measured, are no inches.
    far, reached = float(np.abs(given).max()), max(travel, *map(abs, travels[axis]))
    fit = (
        unit
        for unit, (size, least) in NARROW.items()
        if span > 0 and least * travel <= size * span <= WIDE * travel
        if size * far <= MOST_FROM_ZERO * reached
    )
    return next(fit, None)


def seems_narrow(positions: Floats, travels: Travels, axis: str | None) -> str | None:
    """The same where nothing but the positions tells it: those that are round as they stand are
    inches only where they cover the travel from end to end.
    """
    unit = narrow_unit(positions, travels, axis)
    if unit != "inch" or axis is None:
        return unit
    given = positions[np.isfinite(positions)]
    steps = [given / grid for grid in GRIDS]
    round_ = any(np.abs(step - np.round(step)).max() < ROUND for step in steps)
    moved = NARROW[unit][0] * float(np.ptp(given))
    travel = abs(travels[axis][1] - travels[axis][0])
    return unit if not round_ or WHOLE * travel <= moved <= travel + BEYOND_MM else None


def may_be_narrow(positions: Floats, travels: Travels, axis: str | None, unit: str) -> bool:
    """Whether `positions` (n,) of an axis may be in the `unit`: it travels as far."""
    given = positions[np.isfinite(positions)]
    if axis is None or axis not in travels or not len(given):
        return True
    travel = abs(travels[axis][1] - travels[axis][0])
    return bool(NARROW[unit][0] * float(np.ptp(given)) <= WIDE * travel)


def axis_of(
    table: Table, components: Mapping[str, ComponentLike] | None, name: str, inside: Rows
) -> str | None:
    """The axis of a component; without a machine "" where its rows `inside` have positions."""
    if components is not None:
        return components[name].of
    positions = table.columns.numbers.get("position_mm")
    return None if positions is None or np.isnan(positions[inside[0]]) else ""


def reach(travels: Travels, axis: str) -> float:
    """How far from 0 positions along an axis are at most, mm."""
    if axis not in travels:
        return FARTHEST_MM
    low, high = sorted(travels[axis])
    return MOST_FROM_ZERO * max(abs(low), abs(high), high - low)
