"""Directions along which whole parts differ: straight lines, and what the model adds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray, least_squares

MOST_MORE = 3
"""Directions beyond straight lines that the model's own uncertainty may add."""
NOTABLE = 0.1
"""Share of the entries' variance that such a direction must reach by the model."""


SAME_PLACE = 1e-3
"""Share of the travel within which two targets are the same place."""
FEWEST_PAIRS = 3


def smooth_directions(table: ResidualTable) -> FloatArray:
    """(H, k): the coordinates of the columns' places, about their mean, and the largest
    directions of the model's uncertainty that they do not hold.

    Parts turn, grow and shear by fixture and temperature, and the machine's components drift:
    along these directions parts scatter more than single entries do.
    """
    places = table.places.mean(axis=0)
    known = [
        axis
        for axis in range(3)
        if np.isfinite(places[:, axis]).all() and np.ptp(places[:, axis]) > 0
    ]
    lines = places[:, known] - places[:, known].mean(axis=0)
    lines = lines / np.maximum(np.abs(lines).max(axis=0), 1e-300)
    more = _of_model(table, lines)
    return np.concatenate([lines, more], axis=1)


def _of_model(table: ResidualTable, lines: FloatArray) -> FloatArray:
    P, H, _ = table.errors.shape
    factors = [np.sqrt(P) * table.common.mean(axis=0), table.of_part.mean(axis=0)]
    columns = np.concatenate([f.reshape(H, -1) for f in factors], axis=1)
    if not columns.shape[1]:
        return np.zeros((H, 0))
    base = np.concatenate([np.ones((H, 1)), lines], axis=1)
    left = np.column_stack([least_squares(base, column).residuals for column in columns.T])
    U, size, _ = np.linalg.svd(left, full_matrices=False)
    entries = table.errors - np.nanmean(table.errors, axis=0)
    level = float(np.nanmean(entries**2)) if P > 1 else float(np.nanvar(table.errors))
    kept = np.flatnonzero(size**2 > NOTABLE * level)[:MOST_MORE]
    found: FloatArray = U[:, kept]
    return found


def reversal_pairs(table: ResidualTable) -> FloatArray | None:
    """(H, q) orthonormal: for each place that was approached from both directions, the
    difference of its two columns. None where readings have no such pairs.
    """
    if table.component is None:
        return None
    name = f"dir_{table.axes[0]}"
    direction = table.covariates.get(name)
    axis = {"x": 0, "y": 1, "z": 2}.get(table.axes[0])
    if direction is None or axis is None or direction.shape[0] != 1:
        return None
    place = table.places[0, :, axis]
    signs = np.broadcast_to(direction, (1, len(place)))[0]
    order = np.argsort(place, kind="stable")
    slack = SAME_PLACE * max(float(np.ptp(place)), 1e-300)
    found: list[FloatArray] = []
    paired: set[int] = set()
    for i, j in pairwise(order.tolist()):
        near = abs(place[i] - place[j]) <= slack and signs[i] * signs[j] < 0
        if near and i not in paired:
            column = np.zeros(len(place))
            column[i], column[j] = signs[i], signs[j]
            found.append(column / np.sqrt(2))
            paired |= {i, j}
    return np.column_stack(found) if len(found) >= FEWEST_PAIRS else None


def scatter_directions(table: ResidualTable, strata: Strata) -> FloatArray:
    """(2, A, 1 + k): the unit vectors of a rotation about z and of a uniform growth in the
    coordinates of a part (offset first); zeros without x and y.
    """
    A, k = strata.shape[2], strata.lines
    found = np.zeros((2, A, 1 + k))
    if not {"x", "y"} <= set(table.axes):
        return found
    places = table.places.mean(axis=0)
    if not np.isfinite(places[:, :2]).all():
        return found
    x, y = (places[:, i] - places[:, i].mean() for i in (0, 1))
    size = float(np.hypot(np.linalg.norm(x), np.linalg.norm(y)))
    if size == 0:
        return found
    L = strata.columns[:, 1 : 1 + k]
    ix, iy = table.axes.index("x"), table.axes.index("y")
    found[0, ix, 1:], found[0, iy, 1:] = -L.T @ y / size, L.T @ x / size
    found[1, ix, 1:], found[1, iy, 1:] = L.T @ x / size, L.T @ y / size
    return found
