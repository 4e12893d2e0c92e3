"""The one least-squares routine: singular values with column scaling, rank and null space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

RANK_TOLERANCE = 1e-10
"""Relative size of a singular value of the column-scaled design below which it counts as 0."""
REFINEMENTS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastSquares:
    """An ordinary least-squares fit y = X b + r with n rows and k columns.

    `coefficients` (k,), `unscaled_covariance` (k, k) = (X'X)^-1, `residuals` (n,),
    `rss` the residual sum of squares, `dof` = n - rank, `rank`, `null_space` (k, k - rank):
    directions of b that the rows do not determine.
    """

    coefficients: FloatArray
    unscaled_covariance: FloatArray
    residuals: FloatArray
    rss: float
    dof: int
    rank: int
    null_space: FloatArray

    @property
    def s2(self) -> float:
        """Residual variance rss/(n - rank), eq. (11) of Gilsinn & Ling 2004; nan without dof."""
        return self.rss / self.dof if self.dof > 0 else float("nan")


def least_squares(X: FloatArray, y: FloatArray) -> LeastSquares:
    """Minimises |y - X b|^2; X is (n, k), y is (n,).

    b = (X'X)^-1 X'y (Gilsinn & Ling 2004, eq. (6)), computed from the singular value
    decomposition of X with its columns scaled to unit length, so that columns of very
    different units (1, mm, mm^2) do not cost digits. Where X is rank deficient the
    minimum-norm solution (in the scaled columns) is returned and `null_space` spans what is
    free. Iterative refinement brings residuals and coefficients to working accuracy.
    """
    scale = np.linalg.norm(X, axis=0)
    scale[scale == 0] = 1.0
    U, singular, Vt = np.linalg.svd(X / scale, full_matrices=X.shape[0] < X.shape[1])
    k = X.shape[1]
    largest = singular[0] if singular.size else 0.0
    rank = int(np.sum(singular > RANK_TOLERANCE * largest)) if largest > 0 else 0
    V = Vt[:rank].T / singular[:rank]
    b, residuals = _refine(X, y, U[:, :rank], V, scale)
    return LeastSquares(
        coefficients=b,
        unscaled_covariance=V @ V.T / np.outer(scale, scale),
        residuals=residuals,
        rss=float(residuals @ residuals),
        dof=X.shape[0] - rank,
        rank=rank,
        null_space=Vt[rank:k].T / scale[:, None],
    )


def _refine(
    X: FloatArray, y: FloatArray, U: FloatArray, V: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients (k,) and residuals (n,) of the scaled design S = U V^-T, refined.

    Refines r + S b = y, S'r = 0 together (Bjorck 1967, BIT 7, 257-278): where the residuals
    are large, those of r + S b = y alone leave the error of S'r = 0 in b. Their defects are
    formed in extended precision where the platform has it.
    """
    S = X.astype(np.longdouble) / scale
    target = y.astype(np.longdouble)
    b = (V @ (U.T @ y)).astype(np.longdouble)
    r = target - S @ b
    for _ in range(REFINEMENTS):
        f = (target - r - S @ b).astype(np.float64)
        g = (S.T @ r).astype(np.float64)
        step = V @ (U.T @ f + V.T @ g)
        b = b + step
        r = r + f - S @ step
    return (b / scale).astype(np.float64), (target - S @ b).astype(np.float64)


def batched_least_squares(X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Minimises |y - X b|^2 of m small problems at once; X is (k, n, m), y is (n, m), k <= n.

    Returns b (k, m) and the sum of squares (m,) that X explains, |y|^2 - |y - X b|^2, by modified
    Gram-Schmidt of X with y beside it, which loses no more digits than Householder's (Bjorck 1967,
    BIT 7, 1-21): the condition of X is not squared. Where a problem does not determine its b (to
    `RANK_TOLERANCE` of a column's length) both are nan.
    """
    k, _, m = X.shape
    least = RANK_TOLERANCE * np.linalg.norm(X, axis=1)
    Q, rest = X.copy(), y.copy()
    R, z, b = np.zeros((k, k, m)), np.empty((k, m)), np.empty((k, m))
    for j in range(k):
        norm = np.linalg.norm(Q[j], axis=0)
        R[j, j] = np.where(norm > least[j], norm, np.nan)
        Q[j] /= R[j, j]
        for c in range(j + 1, k):
            R[j, c] = np.einsum("nm,nm->m", Q[j], Q[c])
            Q[c] -= R[j, c] * Q[j]
        z[j] = np.einsum("nm,nm->m", Q[j], rest)
        rest -= z[j] * Q[j]
    for j in reversed(range(k)):
        b[j] = (z[j] - np.einsum("cm,cm->m", R[j, j + 1 :], b[j + 1 :])) / R[j, j]
    return b, np.einsum("km,km->m", z, z)


def polynomial(position: FloatArray, degree: int) -> FloatArray:
    """Design rows [1, p, ..., p^degree], shape (n, degree + 1)."""
    return np.vander(position, degree + 1, increasing=True)


def triangle(Z: FloatArray) -> FloatArray:
    """R (min(n, k), k) upper triangular with R'R = Z'Z, Z (n, k)."""
    return np.asarray(np.linalg.qr(Z, mode="r"))
