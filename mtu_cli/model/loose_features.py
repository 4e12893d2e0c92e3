"""Features that scatter from part to part by more than all others do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.place_lines import smooth_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.loose_columns import Loose, loose_columns
from mtu_cli.units import p_text, um_text

CODE = "feature-scatters"
ROUNDING = 1e-12
"""Of the mean square of the errors: what scatters less does not."""
BEYOND = 0.1
"""Of the largest range of the other features."""
MOST_COLUMNS = 300
"""Features that are looked at: of more the others are not known better, and time grows."""


def loose_of_tables(tables: MeasuredTables, points: Points) -> list[Finding]:
    """Of measured features, means of their repeats."""
    axes = list(dict.fromkeys(label[2] for label in tables.labels))
    by_axis = [[i for i, own in enumerate(tables.labels) if own[2] == axis] for axis in axes]
    names = [[tables.labels[i][:2] for i in own] for own in by_axis]
    if not names or any(own != names[0] for own in names):
        return []
    mean = np.stack([tables.cells.mean[own].T for own in by_axis], axis=2)
    there = (tables.cells.n[by_axis[0]] > 0).T
    nominal = np.full((len(points.features), 3), np.nan)
    nominal[points.feature] = points.nominal
    index = {name: i for i, name in enumerate(points.features)}
    places = nominal[[index[name] for _, name in names[0]]]
    columns = [" ".join(filter(None, own)) for own in names[0]]
    return loose_features(mean, there, places, columns, axes)


def loose_features(
    errors: FloatArray,
    there: NDArray[np.bool_],
    places: FloatArray,
    columns: Sequence[str],
    axes: Sequence[str],
) -> list[Finding]:
    """A warning on each of the loosest `columns` of errors (P, H, A), mm, that are `there` (P, H),
    features at `places` (H, 3), mm.
    """
    if len(columns) > MOST_COLUMNS:
        return []
    known = np.where(there[:, :, None], errors, 0.0)
    least = ROUNDING * float(np.mean(known**2))
    smooth = smooth_of(places)
    found = [
        own
        for own in loose_columns(known, there, smooth)
        if own.s**2 > least and not _stands_apart(places, smooth, own.column)
    ]
    if found:
        without = _without_farthest(known, there, found)
        still = {(own.column, own.axis) for own in loose_columns(known, without, smooth)}
        found = [own for own in found if (own.column, own.axis) in still]
    warnings = []
    for column in dict.fromkeys(own.column for own in found):
        each = [own for own in found if own.column == column]
        sizes = ", ".join(f"{axes[own.axis]} {um_text(own.s)}" for own in each)
        others = ", ".join(f"{axes[own.axis]} {um_text(own.others)}" for own in each)
        p = max(own.p for own in each)
        warnings.append(finding(CODE, feature=columns[column], s=sizes, others=others, p=p_text(p)))
    return warnings


def _without_farthest(
    errors: FloatArray, there: NDArray[np.bool_], found: Sequence[Loose]
) -> NDArray[np.bool_]:
    """`there` (P, H) less the entry of each loose column that is farthest off its median: of one
    that a single slip makes loose nothing is left.
    """
    kept = there.copy()
    for own in found:
        parts = np.flatnonzero(there[:, own.column])
        values = errors[parts, own.column, own.axis]
        kept[parts[np.argmax(np.abs(values - np.median(values)))], own.column] = False
    return kept


def _stands_apart(places: FloatArray, smooth: FloatArray, column: int) -> bool:
    """Whether one of so few features that parts have no lines lies beyond all others: a machine or
    a part that turns from part to part moves it more than them.
    """
    if smooth.shape[1] > 1:
        return False
    others = np.delete(places, column, axis=0)
    low, high = others.min(axis=0), others.max(axis=0)
    margin = BEYOND * float(np.max(high - low))
    return bool(((places[column] < low - margin) | (places[column] > high + margin)).any())
