"""Ridge regression on standardised columns, for a whole path of penalties at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import RANK_TOLERANCE, FloatArray


@dataclass(frozen=True, slots=True)
class RidgePath:
    """b (l, k) along a path of l penalties: `directions` (k, rank) times `gains` (l, rank) times
    the target's coordinates; `effective` (l,) is the trace of the hat matrix.
    """

    coefficients: FloatArray
    effective: FloatArray
    directions: FloatArray
    gains: FloatArray

    def unit_covariance(self, index: int) -> FloatArray:
        """(X'X + P)^-1 X'X (X'X + P)^-1 (k, k): of b for errors of variance 1, given P."""
        root = self.directions * self.gains[index]
        return root @ root.T


def ridge(X: FloatArray, y: FloatArray, n: int, penalties: FloatArray) -> RidgePath:
    """Minimises |y - X b|^2 / n + penalty * sum (s_j b_j)^2 for each of the penalties.

    X (r, k) and y (r,) are about their means; s_j is the standard deviation of column j, so that
    units do not matter. The r rows may be the compressed ones of n readings. Hoerl & Kennard 1970,
    Technometrics 12, 55-67, by singular values. Penalty 0 is ordinary least squares, of least norm
    where columns depend on each other; a column of zeros gets 0.
    """
    scale = np.linalg.norm(X, axis=0) / np.sqrt(n)
    divisor = np.where(scale > 0, scale, np.inf)
    U, singular, Vt = np.linalg.svd(X / divisor, full_matrices=False)
    kept = singular > RANK_TOLERANCE * singular.max(initial=0.0)
    singular, directions = singular[kept], Vt[kept].T / divisor[:, None]
    gains = singular / (singular**2 + n * np.asarray(penalties, float)[:, None])
    b = (gains * (U[:, kept].T @ y)) @ directions.T
    return RidgePath(b, (gains * singular).sum(axis=1), directions, gains)
