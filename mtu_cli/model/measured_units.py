"""Parts in another unit than the others, and errors that stand where coordinates belong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

UNITS = {
    "inches taken for mm": 25.4,
    "mm taken for inches": 1 / 25.4,
    "um taken for mm": 1e-3,
    "metres taken for mm": 1e3,
}
"""What brings coordinates in another unit back to mm."""
EXPLAINS = 0.1
"""A mistake is named if undoing it leaves less than this share of the error."""
NAMED = 3
RELATED = 0.99
"""Correlation with a nominal coordinate that every measured one has, whatever its unit."""
SMALL = 0.5
"""Share of the nominal coordinates that errors, in mm or um, stay below."""


def parts_of_other_units(
    points: Points, far: np.ndarray, axes: tuple[int, ...], limit: float, free: bool
) -> Iterator[Finding]:
    """A Problem for each file and unit of parts that the unit explains: `far` (n,) are the points
    more than `limit` mm off. `free`: parts lie as they were put down, wherever that is.
    """
    if not far.any():
        return
    keys = points.part * len(points.sources) + points.file_index
    rows = np.flatnonzero(np.isin(keys, np.unique(keys[far])))
    rows = rows[np.argsort(keys[rows], kind="stable")]
    found: dict[tuple[int, str], list[int]] = {}
    for own in np.split(rows, np.flatnonzero(np.diff(keys[rows])) + 1) if len(rows) else ():
        own.sort()
        unit = _unit(points.measured[own][:, axes], points.nominal[own][:, axes], limit, free)
        if unit:
            found.setdefault((int(points.file_index[own[0]]), unit), []).append(int(own[0]))
    for (file, unit), first in found.items():
        yield _problem(points, axes, file, unit, sorted(first))


def _problem(
    points: Points, axes: tuple[int, ...], file: int, unit: str, first: list[int]
) -> Finding:
    names = [repr(points.parts[points.part[i]]) for i in first]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    i = first[0]
    axis = max(axes, key=lambda axis: abs(points.measured[i, axis] - points.nominal[i, axis]))
    fit, whose = ("do", "parts") if len(names) > 1 else ("does", "part")
    return Problem(
        what=f"{whose} {', '.join(names[:NAMED])}{more} {fit} not fit the other parts, of which "
        f"there are {len(points.parts) - len(names)}",
        file=points.sources[file].shown,
        row=int(points.row[i]),
        column=f"{AXES[axis]}_mm",
        value=f"{points.measured[i, axis]:.9g}",
        expected=f"about {points.nominal[i, axis]:.9g}: this looks like {unit}",
    )


def _unit(measured: FloatArray, nominal: FloatArray, limit: float, free: bool) -> str:
    """The mistake of units that explains a part's points (k, axes), "" where none does: it may
    be one of one axis alone.
    """
    found = set()
    for i in range(measured.shape[1]):
        own, place = measured[:, i : i + 1], nominal[:, i : i + 1]
        now = _left(own - place, free)
        if now <= limit:
            continue
        left = {unit: _left(own * factor - place, free) for unit, factor in UNITS.items()}
        best = min(left, key=lambda unit: left[unit])
        if not left[best] < min(EXPLAINS * now, limit):
            return ""
        found.add(best)
    return found.pop() if len(found) == 1 else ""


def _left(errors: FloatArray, free: bool) -> float:
    own = errors - np.median(errors, axis=0) if free else errors
    return float(np.median(np.abs(own).max(axis=1)))


def look_like_errors(measured: FloatArray, nominal: FloatArray) -> bool:
    """Whether measured values (n, axes) are errors, in mm or um, not the coordinates that they are
    errors of: much smaller than those, and not in their order.
    """
    if not _left(measured, False) < SMALL * _left(nominal, False):
        return False
    return all(
        _related(measured[:, i], nominal[:, j]) < RELATED
        for i in range(measured.shape[1])
        for j in range(nominal.shape[1])
    )


def _related(one: FloatArray, other: FloatArray) -> float:
    """The size of the correlation of two columns (n,), 0 where one does not vary."""
    a, b = one - one.mean(), other - other.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return abs(float(a @ b)) / size if size else 0.0
