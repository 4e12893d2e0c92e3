"""What columns of measured points hold beside covariates: errors again, texts, rounded values."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mtu_cli.files.csv_table import DECIMALS, number
from mtu_cli.files.points import Points
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import axes_of
from mtu_cli.stats.least_squares import FloatArray
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
    tested = {
        name: column.astype(np.float64)
        for name, column in points.covariates.items()
        if name not in needed and column.dtype != object
    }
    written = list(_written(points)) if tested else []
    held: dict[str, tuple[bool, str]] = {}
    for name, column in tested.items():
        step = display_step(column)
        same = next((s for item in written if (s := _held(item, column, step))), None)
        if same is not None:
            held[name] = same
    warnings = []
    for nominal, what in ((False, "what was measured"), (True, "the nominal place")):
        items = [f"{name!r} ({words})" for name, (own, words) in held.items() if own == nominal]
        if items:
            facts = {"items": items, "reason": f"they repeat {what}"}
            warnings.append(finding("not-tested", what="effects", **facts))
    left = {name: column for name, column in points.covariates.items() if name not in held}
    return replace(points, covariates=left) if held else points, tuple(warnings)


class _Written(NamedTuple):
    """What CMMs write of points: in words, values (n,) in mm and what their last digit is worth."""

    words: str
    values: FloatArray
    digit: float
    nominal: bool = False


def _held(item: _Written, column: FloatArray, step: float) -> tuple[bool, str] | None:
    """Whether a column (n,) of last digit `step` has a thing written, and this in words."""
    both = np.isfinite(column) & np.isfinite(item.values)
    if both.sum() < FEWEST:
        return None
    for unit, scale in SCALES.items():
        # Of drawn places the least distance is no last digit.
        last = min(step, scale * DRAWN_MM) if item.nominal else step
        most = 0.51 * (last + scale * item.digit)
        own = scale * item.values[both]
        if float(own.std()) > CLEAR * most and (np.abs(column[both] - own) <= most).all():
            return item.nominal, f"{item.words}, {unit}"
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


FEW = 0.1
"""Share of the cells that are texts up to which the others are what the column holds."""


def is_name(cell: str) -> bool:
    """Whether a cell is no number, with a decimal point or with a comma."""
    return all(number(cell, sign) is None for sign in DECIMALS)


def text_warnings(measured: Points | Readings) -> list[Finding]:
    """One warning of all columns that are texts by more than a few of their cells, with the texts
    that such a column has beside numbers: these may be meant.
    """
    texts = []
    for name, column in measured.covariates.items():
        if column.dtype != object:
            continue
        cells = {i: text for i, text in enumerate(map(str, column)) if text}
        own = [i for i, text in cells.items() if is_name(text)]
        if len(own) <= FEW * len(cells):
            continue
        texts.append(repr(name))
        if len(own) < len(cells):
            source = measured.sources[measured.file_index[own[0]]]
            first = f"{cells[own[0]]!r} in {source.shown}, row {measured.row[own[0]]}"
            count = f"texts in {len(own)} of {len(cells)} cells"
            meant = "where that means not known, leave it empty"
            texts[-1] += f" ({count}, the first {first}; {meant})"
    facts = {"what": "effects", "items": texts, "reason": "text, not numbers"}
    return [finding("not-tested", **facts)] if texts else []


STEPS_MM = (1e-3, 5e-4, 1e-4, 5e-5, 1e-5)
"""Steps that measuring programs round to; who rounds to more than 1 um has at least that."""
WHOLE = 1e-6
"""How far a multiple may be from a whole number, by rounding of the arithmetic."""
ROUNDED = 1e-9
"""Share of the largest value below which two differ by rounding alone."""


def resolution(values: FloatArray) -> float:
    """The largest of `STEPS_MM` that all `values` (n,) mm are multiples of; 0 without one."""
    for step in STEPS_MM:
        count = values / step
        if (np.abs(count - np.round(count)) < WHOLE).all():
            return step
    return 0.0


def display_step(values: FloatArray, rounding: float = 0.0) -> float:
    """What values (n,) were rounded to, as far as they tell: the least that two of them differ by;
    not by `rounding` or less. 0 where all are equal.
    """
    steps = np.unique(values)
    apart = np.diff(steps)
    # Each gap beside its own two values: one that is far off says nothing of the others.
    least = np.maximum(rounding, ROUNDED * np.maximum(np.abs(steps[1:]), np.abs(steps[:-1])))
    return float(apart[apart > least].min(initial=np.inf)) if (apart > least).any() else 0.0
