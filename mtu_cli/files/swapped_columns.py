"""Readings whose columns of positions and of errors are each other's."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import fault
from mtu_cli.files.csv_table import Table
from mtu_cli.files.source import DRIFT
from mtu_cli.units import LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

POSITION, ERROR, PASS = "position_mm", "error", "pass"
FEWEST_TARGETS = 3
STEEPER, TRAVEL = 2.0, 20.0
"""Errors span so many um (or of the unit of an angle) per mm of the positions, and in all: no
machine's do, nor does a short stage read by a coarse display.
"""
NEARLY = 0.01
"""Of a step: places that are read back differ by less from pass to pass, errors by more."""
ABOUT, ROUND = 0.05, (1.0, 2.0, 2.5, 5.0)
"""Share of a step by which places set by hand may be off a grid of round numbers, these times a
power of ten. Of errors with three even steps that repeat to a hundredth of them one in a hundred
lies on such a grid by chance (20 000 drawn), of more or uneven ones fewer.
"""
SHOWN = 3


def refuse_swapped(table: Table) -> None:
    """Raises InputError for readings whose errors are the targets of a run, the same ones to the
    last digit in every pass, while their positions are not: errors scatter, targets do not. One
    component whose positions are repeated shows that the columns are what they are called.
    """
    if table.source.role == DRIFT or not {POSITION, ERROR, PASS} <= set(table.columns.numbers):
        return
    # What is too large to be subtracted is told by who reads the cells.
    with np.errstate(over="ignore", invalid="ignore"):
        every = [own for own in _runs(table) if len(own[2]) > 1]
        runs = {name: passes for name, _, passes in every}
        names = [name for name, steep, passes in every if steep and _are_swapped(passes)]
    if not names or any(_repeated([place for _, place in passes]) for passes in runs.values()):
        return
    targets = np.unique(runs[names[0]][0][0])
    shown = ", ".join(f"{value:g}" for value in targets[:SHOWN])
    raise fault(
        f"the columns {ERROR!r} and {POSITION!r} look swapped: the errors of {names[0]} are "
        f"{shown}, ... in every pass, and its positions differ from pass to pass",
        file=table.source.shown,
        row=table.header_row,
        expected=f"targets in {POSITION!r}, what was read there in {ERROR!r}",
    )


def _runs(table: Table) -> Iterator[tuple[str, bool, list[tuple[Floats, Floats]]]]:
    """Of each component whether its errors are far steeper than any machine's, and errors and
    positions of its passes; of none, where no errors are.
    """
    numbers, component = table.columns.numbers, table.columns.texts["component"]
    error, position, number = (numbers[name] for name in (ERROR, POSITION, PASS))
    um = error * _in_um(table)
    given = np.isfinite(error) & np.isfinite(position) & np.isfinite(number)
    of = {
        name: np.flatnonzero(given & (component.codes == code))
        for code, name in enumerate(component.labels)
    }
    of = {name: rows for name, rows in of.items() if len(rows)}
    steep = {name: _steep(um[rows], position[rows]) for name, rows in of.items()}
    if not any(steep.values()):
        return
    for name, rows in of.items():
        order = rows[np.argsort(number[rows], kind="stable")]
        own = np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
        yield name, steep[name], [(error[run], position[run]) for run in own]


def _in_um(table: Table) -> Floats:
    """What makes um of each row's error, where it is a length."""
    column = table.columns.texts["unit"]
    units = [UNITS.get(label) for label in column.labels]
    factors = [
        1e3 * unit.to_internal if unit is not None and unit.dimension == LENGTH else 1.0
        for unit in units
    ]
    return np.array([*factors, 1.0])[column.codes]


def _steep(error: Floats, position: Floats) -> bool:
    span = float(np.ptp(error))
    return span > TRAVEL and span > STEEPER * float(np.ptp(position))


def _are_swapped(passes: list[tuple[Floats, Floats]]) -> bool:
    targets = np.sort(passes[0][0])
    if len(np.unique(targets)) < FEWEST_TARGETS:
        return False
    return all(
        np.array_equal(np.sort(error), targets)
        and _is_run(error)
        and len(np.unique(position)) >= FEWEST_TARGETS
        for error, position in passes
    )


def _repeated(places: list[Floats]) -> bool:
    """Whether half of the places or more stand in every pass; of few, as where each begins at its
    zero, that says nothing. Or whether all do nearly, as places that are read back, or are about
    the same round numbers, as places set by hand.
    """
    if len({len(place) for place in places}) == 1:
        by_size = np.sort(places, axis=1)
        step = np.diff(by_size.mean(axis=0)).min(initial=np.inf)
        nearly = np.ptp(by_size, axis=0).max() < NEARLY * step
        if len(by_size[0]) >= FEWEST_TARGETS and (nearly or _about_round(by_size, step)):
            return True
    own = [set(place.tolist()) for place in places]
    fewest = min(map(len, own))
    return fewest >= FEWEST_TARGETS and 2 * len(set.intersection(*own)) >= fewest


def _about_round(places: Floats, step: float) -> bool:
    """Whether the places (passes, n) of all passes are near the same multiples of a round number
    that is no more than their least `step`, and no less than half of it.
    """
    if not 0 < step < np.inf:
        return False
    power = 10.0 ** math.floor(math.log10(step))
    for grid in (first * power * scale for scale in (0.1, 1.0) for first in ROUND):
        if not 0.5 * step <= grid <= (1 + ABOUT) * step:
            continue
        number = np.round(places / grid)
        near = np.abs(places - grid * number).max() <= ABOUT * step
        if near and (number == number[0]).all() and len(np.unique(number[0])) == len(number[0]):
            return True
    return False


def _is_run(values: Floats) -> bool:
    """Whether values (n,) go one way, or there and back, as targets do in the order of a run."""
    steps = np.sign(np.diff(values))
    steps = steps[steps != 0]
    return int((steps[1:] != steps[:-1]).sum()) <= 1
