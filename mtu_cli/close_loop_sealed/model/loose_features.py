"""Features that scatter more than the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.loose_columns import loose_columns
from mtu_cli.findings import Finding, finding
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import p_text, um_text

FEWEST_LINES = 6
"""Features from which on parts may turn and grow for themselves."""


def smooth_of(places: FloatArray) -> FloatArray:
    """A constant and, of enough features, the slopes along each axis that they differ along, all in
    one unit of length.
    """
    ones = np.ones((len(places), 1))
    if len(places) < FEWEST_LINES:
        return ones
    known = np.isfinite(places).all(axis=0) & (np.ptp(places, axis=0) > 0)
    slopes = places[:, known] - places[:, known].mean(axis=0)
    reach = float(np.abs(slopes).max(initial=1e-300))
    return np.concatenate([ones, slopes / reach], axis=1)


CODE = "feature-scatters"

ROUNDING = 1e-12
"""Of the mean square of the errors: what scatters less does not."""

BEYOND = 0.1
"""Of the largest range of the other features."""

MOST_COLUMNS = 300
"""Features that are looked at: of more the others are not known better, and time grows."""


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
    # Of a column that a single slip makes loose nothing is left without the entry farthest off its
    # median.
    kept = there.copy()
    for own in found:
        parts = np.flatnonzero(there[:, own.column])
        values = errors[parts, own.column, own.axis]
        kept[parts[np.argmax(np.abs(values - np.median(values)))], own.column] = False
    again = loose_columns(known, kept, smooth) if found else []
    still = {(own.column, own.axis) for own in again}
    found = [own for own in found if (own.column, own.axis) in still]
    warnings = []
    for column in dict.fromkeys(own.column for own in found):
        each = [own for own in found if own.column == column]
        sizes = ", ".join(f"{axes[own.axis]} {um_text(own.s)}" for own in each)
        others = ", ".join(f"{axes[own.axis]} {um_text(own.others)}" for own in each)
        p = max(own.p for own in each)
        warnings.append(finding(CODE, feature=columns[column], s=sizes, others=others, p=p_text(p)))
    return warnings


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
