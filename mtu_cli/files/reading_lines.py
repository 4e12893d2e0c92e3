"""What straight lines in position explain of readings, a scale or the slope of a laser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]
    Bools = NDArray[np.bool_]

SCATTER_MM = 0.2
"""Readings that typically lie nearer to their line are in the unit they state: at worst the
indicator was not set to 0."""
BLOCKS = 40
"""Medians through which a line is laid."""


def off_lines(
    positions: Floats, errors: Floats, passes: Floats | None, most: Floats, steepest: float
) -> Bools:
    """Readings `errors` (n,) at `positions` (n,), in mm, more than `most` (n,) off a line that is
    not steeper than `steepest` and is 0 somewhere between 0 and the places measured; none if they
    are not the most, or if a line for each of the `passes` (n,) leaves few of them.

    The lines are those of Theil 1950 and Sen 1968, through medians of neighbours.
    """
    ends = np.array([min(0.0, positions.min()), max(0.0, positions.max())])
    off = np.zeros(len(errors), bool)
    for groups in _groupings(passes, len(errors)):
        left, at_zero = np.empty(len(errors)), np.empty(len(errors))
        for rows in groups:
            level, slope = _line(positions[rows], errors[rows], steepest)
            left[rows] = errors[rows] - level - slope * positions[rows]
            at_zero[rows] = _nearest_to_zero(level + slope * ends)
        off = np.abs(left + at_zero) > most
        if 2 * off.sum() <= len(off) or float(np.median(np.abs(left))) < SCATTER_MM:
            return np.zeros(len(errors), bool)
    return off


def _groupings(passes: Floats | None, n: int) -> Iterator[list[Rows]]:
    """All rows at once, then those of each pass: a laser may be aligned anew."""
    yield [np.arange(n)]
    if passes is not None:
        number, count = np.unique(passes, return_inverse=True, return_counts=True)[1:]
        yield np.split(np.argsort(number, kind="stable"), np.cumsum(count)[:-1])


def _line(positions: Floats, errors: Floats, steepest: float) -> tuple[float, float]:
    """Level at 0 and slope of the line through readings (n,)."""
    order = np.argsort(positions, kind="stable")
    x, y = positions[order], errors[order]
    if len(order) > BLOCKS:
        x, y = (np.array([np.median(own) for own in np.array_split(of, BLOCKS)]) for of in (x, y))
    i, j = np.triu_indices(len(x), 1)
    apart = x[j] > x[i]
    slopes = (y[j] - y[i])[apart] / (x[j] - x[i])[apart]
    slope = float(np.clip(np.median(slopes), -steepest, steepest)) if len(slopes) else 0.0
    return float(np.median(errors - slope * positions)), slope


def _nearest_to_zero(ends: Floats) -> float:
    """The value nearest to 0 between two ends."""
    return 0.0 if ends[0] * ends[1] <= 0 else float(ends[np.argmin(np.abs(ends))])
