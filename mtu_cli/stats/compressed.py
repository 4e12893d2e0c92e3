"""Very many rows through small matrices that hold all that least squares needs of them, and how
residuals of such rows follow each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtrtri

from mtu_cli.stats.least_squares import FloatArray, triangle

_DEPENDENT = 1e-9
"""Ratio of a factor's diagonal below which its inverse is mostly rounding."""
_ALIKE = 1e-6
"""Ratio of squares below which earlier rows are no guide to new ones: digits would be lost."""


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


def compress(Z: FloatArray, like: Compressed | None = None) -> Compressed:
    """Rows Z (n, k) compressed; n may be any number above 0.

    `like` are earlier rows of the same columns: their factor R0 makes W = Z R0^-1 nearly
    orthogonal, whose W'W loses nothing, so that R = chol(W'W) R0 costs a third of rotations.
    """
    factor = None if like is None else _by_earlier(Z, like.factor)
    return Compressed(
        factor=_triangle(Z) if factor is None else factor,
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


def _by_earlier(Z: FloatArray, earlier: FloatArray) -> FloatArray | None:
    """The triangular factor of Z through that of earlier rows; None where they differ too much."""
    k = Z.shape[1]
    diagonal = np.abs(np.diag(earlier))
    if earlier.shape != (k, k) or len(Z) < k or not diagonal.min() > _DEPENDENT * diagonal.max():
        return None
    inverse, info = dtrtri(earlier)
    if info != 0:
        return None
    W = Z @ inverse
    gram = W.T @ W
    scale = np.diag(gram).min()
    if not scale > _ALIKE * np.diag(gram).max():
        return None
    try:
        own = np.linalg.cholesky(gram).T
    except np.linalg.LinAlgError:
        return None
    if not np.abs(np.diag(own)).min() > np.sqrt(_ALIKE) * np.abs(np.diag(own)).max():
        return None
    return np.asarray(own @ earlier, np.float64)


def _triangle(Z: FloatArray) -> FloatArray:
    # As many rows as columns are a factor, but none that `_by_earlier` may invert as a triangle.
    if len(Z) < Z.shape[1]:
        return Z.astype(np.float64)
    return triangle(Z)


_ROUNDING = 1e-24
"""Share of the squares that cancel in residuals below which these are rounding alone."""


def mean_products(pieces: Iterable[tuple[Compressed, FloatArray]]) -> tuple[float, float]:
    """Mean e_i^2 and mean e_i e_(i+1) of the residuals e = Z w of several pieces (Z, w (k,)).

    No product spans two pieces; (0, 0) where the residuals are rounding alone.
    """
    square = product = cancelled = 0.0
    n = pairs = 0
    for rows, weights in pieces:
        square += float(np.sum((rows.factor @ weights) ** 2))
        cancelled += float(np.sum((rows.factor * weights) ** 2))
        product += float(weights @ rows.lag @ weights)
        n, pairs = n + rows.n, pairs + rows.pairs
    if square <= _ROUNDING * cancelled:
        return 0.0, 0.0
    return square / n, product / pairs if pairs else 0.0


def autocorrelation(pieces: Iterable[tuple[Compressed, FloatArray]]) -> float:
    """Lag-1 autocorrelation of the residuals of several pieces; 0 where there is none to tell."""
    square, product = mean_products(pieces)
    return product / square if square > 0 else 0.0


def effective_number(n: int, autocorrelation: float) -> float:
    """n (1 - r)/(1 + r), between 1 and n: a negative autocorrelation gives no credit.

    Bayley & Hammersley 1946, J. R. Stat. Soc. Suppl. 8, 184-197.
    """
    r = min(max(autocorrelation, 0.0), 1.0)
    return max(n * (1 - r) / (1 + r), 1.0)
