"""Ridge regression on standardised columns, for a whole path of penalties at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtrtrs

from mtu_cli.stats.least_squares import RANK_TOLERANCE, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class RidgePath:
    """Coefficients along a path of penalties.

    `coefficients` (l, k) of the columns and `intercepts` (l, m) of the unpenalised ones,
    `effective` (l,) the trace of the hat matrix of the penalised columns. b = `directions`
    (k, rank) times `gains` (l, rank) times the target's coordinates.
    """

    coefficients: FloatArray
    intercepts: FloatArray
    effective: FloatArray
    directions: FloatArray
    gains: FloatArray

    def unit_covariance(self, index: int) -> FloatArray:
        """(X'X + P)^-1 X'X (X'X + P)^-1 (k, k): of b for errors of variance 1, given P."""
        root = self.directions * self.gains[index]
        return root @ root.T


def ridge(
    free: FloatArray, X: FloatArray, y: FloatArray, n: int, penalties: FloatArray
) -> RidgePath:
    """Minimises |y - F a - X b|^2 / n + penalty * sum (s_j b_j)^2 for each of l penalties.

    `free` F (r, m) are columns without penalty (intercepts), of rank m; X (r, k); s_j is the
    standard deviation of column j about the free ones, so that units do not matter. The r rows
    may be the compressed ones of n readings. Hoerl & Kennard 1970, Technometrics 12, 55-67, by the
    singular values of X freed of F. Penalty 0 is ordinary least squares, of least norm where
    columns depend on each other.
    """
    Q, R = np.linalg.qr(free)
    inside, of_y = Q.T @ X, Q.T @ y
    rest, target = X - Q @ inside, y - Q @ of_y
    scale = np.linalg.norm(rest, axis=0) / np.sqrt(n)
    # A column that only repeats the free ones has no scale of its own.
    own = scale > RANK_TOLERANCE * np.linalg.norm(X, axis=0) / np.sqrt(n)
    divisor = np.where(own, scale, np.inf)
    U, singular, Vt = np.linalg.svd(rest / divisor, full_matrices=False)
    kept = singular > RANK_TOLERANCE * (singular[0] if len(singular) else 0.0)
    U, singular, V = U[:, kept], singular[kept], Vt[kept].T
    gains = singular / (singular**2 + n * np.asarray(penalties, float)[:, None])
    b = (gains * (U.T @ target)) @ (V / divisor[:, None]).T
    a = dtrtrs(R, of_y[:, None] - inside @ b.T)[0].T
    return RidgePath(
        coefficients=b,
        intercepts=a,
        effective=(gains * singular).sum(axis=1),
        directions=V / divisor[:, None],
        gains=gains,
    )
