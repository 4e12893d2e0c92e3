"""What many small sets of columns leave of the same data, all fitted at once."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

DEPENDENT = 1e-6
"""Share of the largest column below which nothing is left of one beside those before it."""


def beside(rows: FloatArray, first: int) -> FloatArray:
    """The last columns of `rows` (n, first + k) beside the first ones, as at most k rows: squares
    and products are those of what the first leave of them.
    """
    R = np.asarray(np.linalg.qr(rows, mode="r"), np.float64)
    return R[first:, first:]


def squares_left(B: FloatArray, z: FloatArray) -> FloatArray:
    """min over b of |z - B_g b|^2, (G,), for B (G, n, k) and z (n,), by orthonormal columns.

    Columns of which nothing is left beside those before them explain nothing.
    """
    sizes = np.sqrt(np.einsum("gnk,gnk->gk", B, B))
    largest = float(sizes.max(initial=0.0))
    # Nothing but rounding must not stand first: the others would lose what they share with it.
    order = np.argsort(sizes <= DEPENDENT * largest, axis=1, kind="stable")
    Q, R = np.linalg.qr(np.take_along_axis(B, order[:, None, :], axis=2))
    left = np.abs(np.diagonal(R, axis1=1, axis2=2))
    held = np.where(left > DEPENDENT * largest, np.einsum("gnk,n->gk", Q, z), 0.0)
    found: FloatArray = z @ z - np.einsum("gk,gk->g", held, held)
    return found
