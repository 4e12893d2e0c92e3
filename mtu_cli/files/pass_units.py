"""Passes of readings that are in another unit than the other passes of their components."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isclose, log
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice, Problem
from mtu_cli.files.csv_table import ProblemList, Table
from mtu_cli.files.joined import labelled
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS, Unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import Readings

    Rows = NDArray[np.int64]
    Floats = NDArray[np.float64]

INCH = 25.4
LEAST = 20.0
"""Units whose sizes are nearer to each other (urad and arcsec) are told apart by nothing: a pass
may well scatter a fifth of the others."""
SURE = 100.0
"""From so many times on a pass is refused, as no machine explains it; else it is asked about."""
FEWEST = {True: 5, False: 12}
"""Bends (see `_bends`) of a pass from which its scatter is known well enough, by whether the
factor is a SURE one ..."""
ALIKE = {True: 5.0, False: 2.0}
"""... and how many times more or less than the others' it may be, in the unit it is meant in."""
AS_FAR = 10.0
"""The same of how far the readings are from 0, which drifts from pass to pass as well."""
MOST_PASSES = 500
"""More are a count of something else, or no slip of one of them matters; each is compared with all
others."""
NAMED = 6


@dataclass(frozen=True, slots=True)
class _Pass:
    """`rows` (n,) of a pass of a component, all in `unit`, the median size of its `bends` (of
    `count`), and `far`, the median size of its readings, mm or rad.
    """

    rows: Rows
    unit: Unit
    bends: float
    count: int
    far: float


@dataclass(frozen=True, slots=True)
class _Odd:
    """A pass of the component `name`, which is as the others where it looks as it is `meant`."""

    name: str
    rows: Rows
    unit: Unit
    meant: str
    sure: bool


def pass_units(
    readings: Readings, tables: Sequence[Table], problems: ProblemList
) -> tuple[Finding, ...]:
    """Problems of passes that scatter a hundredth of the other passes of their component and by one
    instrument, or a hundred times as much, where another unit of reading makes them as the others;
    Notices of those where that is about a twenty-fifth (inches).

    Scatter and distance from 0 are taken by medians, so that single slips are none of it. Which of
    two passes is right nobody knows: the later one is told, and that it may be the others.
    """
    labels, codes = labelled(tables, "unit")
    found: dict[tuple[int, int, str, str], list[_Odd]] = {}
    for code, name in enumerate(readings.components):
        inside = np.flatnonzero((readings.code == code) & readings.has_pass)
        for role in dict.fromkeys(readings.roles):
            files = [i for i, own in enumerate(readings.roles) if own == role != DRIFT]
            rows = inside[np.isin(readings.file_index[inside], files)]
            passes = [
                _measured(readings, own, UNITS[labels[codes[own[0]]]])
                for own in _by_pass(readings, rows)
                if not np.ptp(codes[own])
            ]
            for odd in _odd_passes(name, passes):
                first = odd.rows[0]
                key = (int(readings.file_index[first]), int(readings.pass_number[first]))
                found.setdefault((*key, odd.unit.name, odd.meant), []).append(odd)
    notes = []
    for group in found.values():
        problem = _problem(readings, group)
        if group[0].sure:
            problems.add(problem)
        else:
            notes.append(Notice(code="pass-unit", message=str(problem)))
    return tuple(notes)


def alike(*keys: NDArray[np.integer]) -> Rows:
    """Numbers (n,) from 0, without a gap, of the rows whose `keys` (n,) are alike. One key after
    the other: numpy sorts rows of several keys ten times as slowly.
    """
    found = np.zeros(len(keys[0]), np.int64)
    for key in keys:
        own = np.unique(key, return_inverse=True)[1].reshape(-1)
        joint = found * (int(own.max(initial=0)) + 1) + own
        found = np.unique(joint, return_inverse=True)[1].reshape(-1)
    return found


def _by_pass(readings: Readings, inside: Rows) -> list[Rows]:
    """The rows of each pass of each file among those `inside` (n,); none of too many."""
    group = alike(readings.file_index[inside], readings.pass_number[inside])
    order = np.argsort(group, kind="stable")
    ends = np.flatnonzero(np.diff(group[order])) + 1
    if len(ends) >= MOST_PASSES:
        return []
    return [rows for rows in np.split(inside[order], ends) if len(rows)]


def _measured(readings: Readings, rows: Rows, unit: Unit) -> _Pass:
    error = readings.error[rows]
    # What has no axis is compared with the readings beside it.
    position = np.nan_to_num(readings.position_mm[rows])
    bends = _bends(position, readings.direction[rows], error)
    typical = float(np.median(bends)) if len(bends) else 0.0
    return _Pass(rows, unit, typical, len(bends), float(np.median(np.abs(error))))


def _odd_passes(name: str, passes: list[_Pass]) -> list[_Odd]:
    """The passes of a component by one instrument that another unit would explain."""
    # A display that moves by no digit tells no unit.
    passes = [own for own in passes if own.bends > 0]
    found = []
    for own in passes:
        others = [other for other in passes if other is not own]
        meant = _meant(own, others) if others else None
        if meant is not None:
            found.append(_Odd(name, own.rows, own.unit, *meant))
    return found[-1:] if len(passes) == 2 else found


def _bends(position: Floats, direction: NDArray[np.int8], error: Floats) -> Floats:
    """How far each reading `error` (n,) is from the line between its two neighbours in position and
    of its direction: repeatability and shape, without the level, the slope or the reversal.
    """
    found = [np.zeros(0)]
    for way in np.unique(direction):
        rows = np.flatnonzero(direction == way)
        rows = rows[np.argsort(position[rows], kind="stable")]
        if len(rows) < 3:
            continue
        before, at, after = (position[rows][i : len(rows) - 2 + i] for i in range(3))
        span = after - before
        share = np.where(span > 0, (at - before) / np.where(span > 0, span, 1.0), 0.5)
        low, own, high = (error[rows][i : len(rows) - 2 + i] for i in range(3))
        found.append(np.abs(own - low - share * (high - low)))
    return np.concatenate(found)


def _meant(own: _Pass, others: list[_Pass]) -> tuple[str, bool] | None:
    """What a pass looks like, and whether it is sure; None where it is as the others, or
    nothing makes it so.
    """
    typical = float(np.median([other.bends for other in others]))
    fars = [other.far for other in others]
    best, nearest = None, float("inf")
    for words, factor in _factors(own.unit).items():
        sure = not 1 / SURE < factor < SURE
        off = abs(log(own.bends * factor / typical))
        likely = min(fars) / AS_FAR <= own.far * factor <= max(fars) * AS_FAR
        fits = own.count >= FEWEST[sure] and off <= log(ALIKE[sure]) and likely
        if fits and off < nearest:
            best, nearest = (words, sure), off
    return best


def _factors(unit: Unit) -> dict[str, float]:
    """What makes readings in `unit` of those in another, by what they look like."""
    found = {}
    for other in UNITS.values():
        factor = other.to_internal / unit.to_internal
        if other.dimension == unit.dimension and not 1 / LEAST < factor < LEAST:
            found[f"like {other.name} in a column of {unit.name}"] = factor
    if unit.name in ("mm", "um"):
        inches = "inches" if unit.name == "mm" else "thousandths of an inch"
        found[f"like {inches} in a column of {unit.name}"] = INCH
    for words, factor in (("1000 times too small", 1e3), ("1000 times too large", 1e-3)):
        if not any(isclose(factor, known) for known in found.values()):
            found[words] = factor
    return found


def _problem(readings: Readings, group: list[_Odd]) -> Finding:
    """The problem of a pass of some components, at the first of its rows."""
    row = min(int(odd.rows.min()) for odd in group)
    unit = group[0].unit
    names = ", ".join(odd.name for odd in group[:NAMED])
    more = f" and {len(group) - NAMED} more" if len(group) > NAMED else ""
    return Problem(
        what=f"pass {readings.pass_number[row]} of {names}{more} is of another size than the other "
        "passes",
        file=readings.sources[readings.file_index[row]].shown,
        row=int(readings.row[row]),
        column="error",
        value=f"{readings.error[row] / unit.to_internal:.6g} {unit.name}",
        expected=f"errors as in the other passes: these look {group[0].meant}, "
        f"or the others are in the wrong unit",
    )
