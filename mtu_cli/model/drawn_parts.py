"""Parts, or axes, whose measured values are the nominal ones: of the drawing, not measured."""

from __future__ import annotations

import numpy as np

from mtu_cli.errors import InputError, Problem, Warned
from mtu_cli.files.features_alike import SAME_MM
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.copied_parts import CHANCE, FEWEST_COPIED
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.resolution import in_steps
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.least_squares import FloatArray

COARSE_MM = 0.005
"""To such digits a good part may be on its nominal everywhere, whatever the others are."""


def drawn_axes(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """A warning of every axis along which all values of all parts are the nominal ones, to the
    last digit.

    No other value tells whether that is a drawing: a good part to coarse digits is there as well.
    Either way the errors along the axis are none that were seen, and commands would take them for
    a machine's.
    """
    if len(points) < FEWEST_COPIED:
        return []
    return [
        Warned(
            code="axis-on-nominal",
            message=f"{AXES[axis]}_mm is on its nominal in all of {len(points)} values, to the "
            "last digit: was it not measured, or is it shown too coarsely? No error along "
            f"{AXES[axis]} is seen, and what is said of it is not of the machine",
        )
        for axis in axes
        if all_on_nominal(points, axis)
    ]


def all_on_nominal(points: Points, axis: int) -> bool:
    """Whether every value along an axis is the nominal one: of its last digit nothing is known."""
    return bool(_on_nominal(points, axis).all())


def _on_nominal(points: Points, axis: int) -> np.ndarray:
    """Which values along an axis (n,) are the nominal ones."""
    off = np.abs(points.measured[:, axis] - points.nominal[:, axis])
    found: np.ndarray = off <= SAME_MM
    return found


def drawn_parts(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """A warning of parts that are on their nominal in every value, to the last digit, of no more
    digits than `COARSE_MM`, while the errors of all other parts differ from each other so much
    that this is no chance.

    Raises InputError for them where the digits are finer: no part is as good.

    Of coarse digits, or of parts that are good, errors agree by themselves: as often as two
    errors of the other part in which they agree most, in every value of the part. Parts with one
    reading tell nothing of that.
    """
    exact = np.ones(len(points), bool)
    for axis in axes:
        exact &= _on_nominal(points, axis)
    size = np.bincount(points.part, minlength=len(points.parts))
    off = np.bincount(points.part, ~exact, minlength=len(points.parts))
    drawn = np.flatnonzero((off == 0) & (size > 0))
    others = np.flatnonzero((off > 0) & (size > 1))
    if not len(drawn) or not len(others):
        return []
    agree = float(_agreeing(points, axes, size)[others].max())
    problems = []
    for part in drawn.tolist():
        rows = np.flatnonzero(points.part == part)
        values = len(np.unique(points.feature[rows])) * len(axes)
        if values >= FEWEST_COPIED and len(size) * agree**values < CHANCE:
            problems.append(_problem(points, int(rows[0]), values))
    if problems and not _is_coarse(points, axes):
        raise InputError(problems)
    text = "are its places those of the drawing, or is it as good as the digits tell?"
    return [
        Warned(code="part-on-nominal", message=f"{item.file}, row {item.row}: {item.text}: {text}")
        for item in problems
    ]


def _is_coarse(points: Points, axes: tuple[int, ...]) -> bool:
    """Whether coordinates, or deviations, have no finer digits along any axis."""
    measured = points.measured[:, axes]
    return any(
        in_steps(values.ravel(), COARSE_MM)
        for values in (measured, measured - points.nominal[:, axes])
    )


def _agreeing(points: Points, axes: tuple[int, ...], size: IntArray) -> FloatArray:
    """How often two errors of a part along an axis agree (parts,), one pair more than was seen;
    `size` (parts,) are its rows.
    """
    pairs, alike = len(axes) * size * (size - 1) / 2, np.zeros(len(size))
    for axis in axes:
        errors = np.round((points.measured[:, axis] - points.nominal[:, axis]) / SAME_MM)
        _, code = np.unique(errors, return_inverse=True)
        key = code.reshape(-1) * len(size) + points.part
        equal, count = np.unique(key, return_counts=True)
        alike += np.bincount(equal % len(size), count * (count - 1.0) / 2, minlength=len(size))
    return np.asarray((alike + 1) / (pairs + 1), np.float64)


def _problem(points: Points, row: int, values: int) -> Finding:
    return Problem(
        what=f"part {points.parts[points.part[row]]!r} is on its nominal in all of {values} "
        "values, to the last digit, and no other part is",
        file=points.sources[points.file_index[row]].shown,
        row=int(points.row[row]),
        column="part",
        expected="places as measured: these look like those of the drawing",
    )
