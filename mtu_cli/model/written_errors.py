"""Columns of points that are no covariates but the errors again, as CMMs print them beside."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.settings import Warned
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
SCALES = {"mm": 1.0, "um": 1 / UM}


def without_written_errors(
    points: Points, needed: Collection[str]
) -> tuple[Points, tuple[Warned, ...]]:
    """The points without the columns that hold their errors, and a warning of these: an effect
    proportional to them would explain everything and mean nothing. Columns that the model's
    equations need are left.
    """
    found = {}
    for name, column in points.covariates.items():
        if name not in needed and column.dtype != object:
            words = _holds(points, column.astype(np.float64))
            if words is not None:
                found[name] = words
    if not found:
        return points, ()
    told = ", ".join(f"{name!r} ({words})" for name, words in found.items())
    text = (
        f"column{'s' if len(found) > 1 else ''} {told}: what was measured, and no cause of it: not "
        "tested as an effect"
    )
    left = {name: column for name, column in points.covariates.items() if name not in found}
    warned = Warned(code="covariate-is-error", message=text)
    return replace(points, covariates=left), (warned,)


def _holds(points: Points, column: FloatArray) -> str | None:
    """What a column (n,) has of the measured points, in words; None for any other."""
    step = display_step(column)
    for words, values, digit in _written(points):
        both = np.isfinite(column) & np.isfinite(values)
        if both.sum() < FEWEST:
            continue
        for unit, scale in SCALES.items():
            most = 0.51 * (step + scale * digit)
            own = scale * values[both]
            clear = float(own.std()) > CLEAR * most
            if clear and (np.abs(column[both] - own) <= most).all():
                return f"{words}, {unit}"
    return None


def _written(points: Points) -> Iterator[tuple[str, FloatArray, float]]:
    """What CMMs write of points: words, values (n,) in mm and what their last digit is worth."""
    axes = axes_of(points)
    errors = points.measured[:, axes] - points.nominal[:, axes]
    digit = max((display_step(points.measured[:, axis], 1e-9) for axis in axes), default=0.0)
    for k, axis in enumerate(axes):
        name = AXES[axis]
        yield f"the error along {name}", errors[:, k], digit
        yield f"the error along {name} with the other sign", -errors[:, k], digit
        yield f"the coordinate {name}", points.measured[:, axis], digit
    for count in range(2, len(axes) + 1):
        length = np.sqrt((errors[:, :count] ** 2).sum(axis=1))
        yield "the length of the error", length, count * digit
        yield "the position by its diameter", 2 * length, 2 * count * digit
