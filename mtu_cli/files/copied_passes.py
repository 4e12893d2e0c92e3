"""Passes of readings that are copies of others: all their values agree, to the last digit."""

from __future__ import annotations

from itertools import combinations, islice
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList
    from mtu_cli.files.readings import Readings

    Rows = NDArray[np.int64]
    FloatArray = NDArray[np.float64]

FEWEST = 4
"""Fewer equal readings than this are no reason to speak."""
CHANCE = 1e-3
"""Passes are refused where chance alone would make an equal pair less often than this."""
FEW_GROUPS = 2
DECIMALS = 12
"""Of mm or rad: no instrument shows as many, and differences of equal digits are equal to them."""
MOST_COMPARED = 20
"""Different passes from which it is known how often two readings of one place agree."""


def check_copied_passes(readings: Readings, problems: ProblemList) -> None:
    """A problem of every pass of a component that has the readings of an earlier one, place by
    place: pasted again and numbered on, they would say that the machine does not drift.

    Two readings of a place agree as often as those of other passes do, or do but for a level of
    each pass, by the last digit of the instrument. Where all passes fall into one or two groups of
    equal ones (two ways that no `direction` tells apart) nothing tells that, and nothing is said.
    """
    for code, name in enumerate(readings.components):
        inside = np.flatnonzero((readings.code == code) & readings.has_pass)
        runs = _runs(readings, inside)
        groups: dict[bytes, list[Rows]] = {}
        for rows in runs:
            groups.setdefault(_mark(readings, rows), []).append(rows)
        if len(groups) == len(runs):
            continue
        if len(groups) <= FEW_GROUPS and all(len(own) > 1 for own in groups.values()):
            continue
        agree = _agreement(readings, [own[0] for own in groups.values()])
        for first, *copies in groups.values():
            pairs = len(runs) * (len(runs) - 1) / 2
            if len(first) < FEWEST or agree is None or pairs * agree ** len(first) >= CHANCE:
                continue
            for rows in copies:
                problems.add(_problem(readings, name, rows, first))


def _problem(readings: Readings, name: str, rows: Rows, first: Rows) -> Finding:
    own, other = (int(readings.pass_number[item[0]]) for item in (rows, first))
    files = [readings.file_index[item[0]] for item in (rows, first)]
    of = "" if files[0] == files[1] else f" of {readings.sources[files[1]].shown}"
    return Problem(
        what=f"pass {own} of {name!r} has the same readings as pass {other}{of}, to the last digit",
        file=readings.sources[readings.file_index[rows[0]]].shown,
        row=int(readings.row[rows].min()),
        column="pass",
        expected="each pass once",
    )


def _runs(readings: Readings, inside: Rows) -> list[Rows]:
    """The rows of each pass of each file, by place."""
    key = (
        readings.error[inside],
        readings.direction[inside],
        np.nan_to_num(readings.position_mm[inside]),
        readings.pass_number[inside],
        readings.file_index[inside],
    )
    order = np.lexsort(key)
    numbers = np.column_stack([key[4][order], key[3][order]])
    ends = np.flatnonzero((np.diff(numbers, axis=0) != 0).any(axis=1)) + 1
    return [rows for rows in np.split(inside[order], ends) if len(rows)]


def _mark(readings: Readings, rows: Rows) -> bytes:
    """What equal passes share; -0.0 is 0.0."""
    return _places(readings, rows) + (readings.error[rows] + 0.0).tobytes()


def _places(readings: Readings, rows: Rows) -> bytes:
    position = np.nan_to_num(readings.position_mm[rows]) + 0.0
    return position.tobytes() + readings.direction[rows].tobytes()


def _agreement(readings: Readings, passes: list[Rows]) -> float | None:
    """How often two readings of a place agree in different passes through the same places, at
    least once in so many; None where no two are through the same.

    A machine that drifts by more than it scatters has passes that agree nowhere, and passes that
    agree nearly everywhere: so often as two do whose levels are brought together counts as well.
    """
    alike: dict[bytes, list[Rows]] = {}
    for rows in passes:
        alike.setdefault(_places(readings, rows), []).append(rows)
    same = level = 0.0
    total = 0
    for group in alike.values():
        for one, other in combinations(islice(group, MOST_COMPARED), 2):
            apart = np.round(readings.error[one] - readings.error[other], DECIMALS)
            same += float((apart == 0).sum())
            level += _as_most_others(apart)
            total += len(one)
    return (max(same, level) + 1) / (total + 1) if total else None


def _as_most_others(apart: FloatArray) -> float:
    """How many of differences (n,) agree with the level that most of the others have; of levels
    that are as frequent each counts alike.

    A level that all of them choose agrees with one more by itself, and with two by chance where
    places are few: copies of such passes would pass for honest ones.
    """
    count = np.sort(np.unique(apart, return_counts=True)[1])
    first, others = int(count[-1]), count[:-1]
    second = int(others.max(initial=0))
    if first == 1 or first == second:
        return 0.0
    # Without one of its own the first is one less.
    return first / (1 + int((others == first - 1).sum()))
