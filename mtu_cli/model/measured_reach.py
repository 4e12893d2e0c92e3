"""Single readings that are farther from their place than the part is large: no measurements."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured_rows import LARGEST_MM
from mtu_cli.stats.least_squares import FloatArray

LEAST_MM = 10.0
"""Nor is a reading so far from its place that of a smaller part."""
FEWEST_ROWS = 3
"""Readings of a part from which on they tell where it lies; of fewer all parts do."""
PLACES = range(-3, 7)
"""By which a decimal point is looked for elsewhere; by 3 it may be um, too."""
THOUSAND = 3
SAME_MM, SAME = 0.5, 1e-3
"""How near a slip that is undone comes to the nominal, mm or in proportion."""


def reach_problems(points: Points, axes: tuple[int, ...], near: float) -> Iterator[Finding]:
    """A Problem for each cell farther from its nominal than the features of the part are from
    each other, in the order of the rows; `near` as in `_out_of_reach`.
    """
    most = _largest_error(points, axes)
    for i, k in np.argwhere(_out_of_reach(points, axes, most, near)).tolist():
        axis = axes[k]
        value, place = float(points.measured[i, axis]), float(points.nominal[i, axis])
        yield Problem(
            what=f"feature {points.features[points.feature[i]]!r} of part "
            f"{points.parts[points.part[i]]!r} is farther from its nominal than the part is large",
            file=points.sources[points.file_index[i]].shown,
            row=int(points.row[i]),
            column=f"{AXES[axis]}_mm",
            value=f"{value:.9g}",
            expected=f"about {place:.9g}, not {most:.4g} mm or more from it{_slip(value, place)}",
        )


def _out_of_reach(points: Points, axes: tuple[int, ...], most: float, near: float) -> np.ndarray:
    """Which cells (n, axes) are more than `most`, mm, from their nominal.

    Parts may lie anywhere: errors are taken about the median of their part's, and are judged
    only where more than half of them are within `near`, mm, of it: then it is known where the
    part lies, and a reading so far away is not on it.
    """
    found = np.zeros((len(points), len(axes)), bool)
    for k, axis in enumerate(axes):
        errors = points.measured[:, axis] - points.nominal[:, axis]
        if errors.max() - errors.min() <= most:
            continue
        for rows, centre in _parts(points, errors):
            away = np.abs(errors[rows] - centre)
            if 2 * np.count_nonzero(away <= near) > len(rows):
                found[rows, k] = away > most
        # Told by `check_rows`.
        found[np.abs(points.measured[:, axis]) > LARGEST_MM, k] = False
    return found


def _largest_error(points: Points, axes: tuple[int, ...]) -> float:
    """As far as the nominal features are apart, corner to corner, mm; LEAST_MM at least."""
    nominal = points.nominal
    size = [float(nominal[:, axis].max() - nominal[:, axis].min()) for axis in axes]
    return max(float(np.hypot.reduce(size)) if size else 0.0, LEAST_MM)


def _parts(points: Points, errors: FloatArray) -> Iterator[tuple[np.ndarray, float]]:
    """The rows of each part and the median of its errors; together those of too few rows."""
    order = np.argsort(points.part, kind="stable")
    few: list[np.ndarray] = []
    for rows in np.split(order, np.flatnonzero(np.diff(points.part[order])) + 1):
        if len(rows) < FEWEST_ROWS:
            few.append(rows)
        else:
            yield rows, float(np.median(errors[rows]))
    if few:
        yield np.concatenate(few), float(np.median(errors))


def _slip(value: float, place: float) -> str:
    """The slip that explains a cell, in words."""
    if abs(value + place) < max(SAME_MM, SAME * abs(place)):
        return ": is its sign right?"
    for digits in PLACES:
        if abs(value / 10.0**digits - place) < max(SAME_MM, SAME * abs(place)) and digits:
            if digits == THOUSAND:
                return ": um taken for mm, or a decimal point left out?"
            return ": is its decimal point in its place?"
    return ""
