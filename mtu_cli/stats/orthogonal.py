"""Orthogonal factors of many small matrices: LAPACK's own, without what np.linalg.qr adds.

LAPACK is imported where it is used: that takes a tenth of a second, and most short commands never
come here.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BLOCK = 32
"""Columns that LAPACK works on at once, as np.linalg.qr lets it: bytes depend on it."""


def triangle(Z: FloatArray) -> FloatArray:
    """R (min(n, k), k) upper triangular with R'R = Z'Z, Z (n, k)."""
    if not Z.size:
        # LAPACK has no room to work in of none, and says so on standard output.
        return np.zeros((min(Z.shape), Z.shape[1]))
    from scipy.linalg.lapack import dgeqrf

    reflected = dgeqrf(Z, lwork=_BLOCK * Z.shape[1])[0]
    return _upper(reflected[: Z.shape[1]])


def shortened(rows: FloatArray) -> FloatArray:
    """As many rows as columns at most, with the same squares and cross products."""
    if len(rows) <= rows.shape[1]:
        return rows
    return triangle(rows)


def orthonormal(Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q (n, k) with Q'Q = I and R (k, k), upper triangular, of Z = Q R (n, k), n >= k > 0."""
    from scipy.linalg.lapack import dgeqrf, dorgqr

    k = Z.shape[1]
    reflected, tau, _, _ = dgeqrf(Z, lwork=_BLOCK * k)
    R = _upper(reflected[:k])
    Q: FloatArray = dorgqr(reflected, tau, lwork=_BLOCK * k, overwrite_a=True)[0]
    return Q, R


def _upper(factor: FloatArray) -> FloatArray:
    R = np.ascontiguousarray(factor)
    return np.where(_below(*R.shape), 0.0, R)


@cache
def _below(n: int, k: int) -> NDArray[np.bool_]:
    return np.tri(n, k, -1, dtype=bool)
