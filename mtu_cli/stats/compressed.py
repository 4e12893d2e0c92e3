"""Very many rows through small matrices that hold all that least squares needs of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Compressed:
    """n rows Z of k columns, in the order in which they were read.

    `factor` (r, k), r <= k, with factor'factor = Z'Z: a triangular factor by orthogonal
    rotations, so that conditioning is that of Z and not its square (Golub & Van Loan, Matrix
    Computations, 5.2). `lag` (k, k) = sum z_i z_(i+1)' over `pairs` consecutive rows, by which
    any residual's autocorrelation follows.
    """

    factor: FloatArray
    n: int
    lag: FloatArray
    pairs: int

    def columns(self, transform: FloatArray) -> Compressed:
        """The rows Z transform, transform (k, l)."""
        return Compressed(
            factor=self.factor @ transform,
            n=self.n,
            lag=transform.T @ self.lag @ transform,
            pairs=self.pairs,
        )


def compress(Z: FloatArray) -> Compressed:
    """Rows Z (n, k) compressed; n may be any number above 0."""
    return Compressed(
        factor=_triangle(Z),
        n=len(Z),
        lag=Z[:-1].T @ Z[1:],
        pairs=len(Z) - 1,
    )


def together(items: Sequence[Compressed]) -> Compressed:
    """All rows of several pieces; no pair of consecutive rows spans two of them."""
    return Compressed(
        factor=_triangle(np.vstack([item.factor for item in items])),
        n=sum(item.n for item in items),
        lag=np.sum([item.lag for item in items], axis=0),
        pairs=sum(item.pairs for item in items),
    )


def _triangle(Z: FloatArray) -> FloatArray:
    if len(Z) <= Z.shape[1]:
        return Z.astype(np.float64)
    return np.asarray(np.linalg.qr(Z, mode="r"), np.float64)
