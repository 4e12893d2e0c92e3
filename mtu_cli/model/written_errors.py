"""Columns of points that are no covariates but the errors, or the nominal places, again, as CMMs
print them beside.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import axes_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import display_step
from mtu_cli.units import UM

FEWEST = 8
"""Points that must agree."""
CLEAR = 3.0
"""Standard deviation of the errors over what rounding may make of them, from which on agreement at
every point is no chance: about one in four at each (2/3 of the density of a normal law, 0.4).
"""
DRAWN_MM = 0.1
"""The coarsest digit that a nominal place is written to."""
SCALES = {"mm": 1.0, "um": 1 / UM}


def without_written_errors(
    points: Points, needed: Collection[str]
) -> tuple[Points, tuple[Finding, ...]]:
    """The points without the columns that hold their errors or nominal places, and warnings of
    these: an effect proportional to errors would explain everything and mean nothing, one to a
    nominal coordinate is the scale or squareness that is tested by itself. Columns that the model's
    equations need are left.
    """
    found: dict[str, _Written] = {}
    tested = {
        name: column.astype(np.float64)
        for name, column in points.covariates.items()
        if name not in needed and column.dtype != object
    }
    written = list(_written(points)) if tested else []
    for name, column in tested.items():
        held = _held(written, column)
        if held is not None:
            found[name] = held
    if not found:
        return points, ()
    left = {name: column for name, column in points.covariates.items() if name not in found}
    return replace(points, covariates=left), tuple(_warnings(found))


def _warnings(found: Mapping[str, _Written]) -> Iterator[Finding]:
    for nominal, what in ((False, "what was measured"), (True, "the nominal place")):
        own = [
            f"{name!r} ({held.words})" for name, held in found.items() if held.nominal == nominal
        ]
        if own:
            yield finding("not-tested", what="effects", items=own, reason=f"they repeat {what}")


class _Written(NamedTuple):
    """What CMMs write of points: in words, values (n,) in mm and what their last digit is worth."""

    words: str
    values: FloatArray
    digit: float
    nominal: bool = False


def _held(written: Sequence[_Written], column: FloatArray) -> _Written | None:
    """What a column (n,) has of the points; None for any other."""
    step = display_step(column)
    for item in written:
        values, digit = item.values, item.digit
        both = np.isfinite(column) & np.isfinite(values)
        if both.sum() < FEWEST:
            continue
        for unit, scale in SCALES.items():
            # Of drawn places the least distance is no last digit.
            last = min(step, scale * DRAWN_MM) if item.nominal else step
            most = 0.51 * (last + scale * digit)
            own = scale * values[both]
            clear = float(own.std()) > CLEAR * most
            if clear and (np.abs(column[both] - own) <= most).all():
                return item._replace(words=f"{item.words}, {unit}")
    return None


def _written(points: Points) -> Iterator[_Written]:
    axes = axes_of(points)
    errors = points.measured[:, axes] - points.nominal[:, axes]
    digit = max((display_step(points.measured[:, axis], 1e-9) for axis in axes), default=0.0)
    for axis in axes:
        # Before the coordinate as measured, which is near it.
        yield _Written(f"the nominal {AXES[axis]}", points.nominal[:, axis], 0.0, nominal=True)
    for k, axis in enumerate(axes):
        name = AXES[axis]
        yield _Written(f"the error along {name}", errors[:, k], digit)
        yield _Written(f"the error along {name} with the other sign", -errors[:, k], digit)
        yield _Written(f"the coordinate {name}", points.measured[:, axis], digit)
    for count in range(2, len(axes) + 1):
        length = np.sqrt((errors[:, :count] ** 2).sum(axis=1))
        yield _Written("the length of the error", length, count * digit)
        yield _Written("the position by its diameter", 2 * length, 2 * count * digit)
