"""Very many rows through small matrices that hold all that least squares needs of them, and how
residuals of such rows follow each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, triangle


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
    return Compressed(factor=triangle(Z), n=len(Z), lag=Z[:-1].T @ Z[1:], pairs=len(Z) - 1)


def together(items: Sequence[Compressed]) -> Compressed:
    """All rows of several pieces; no pair of consecutive rows spans two of them."""
    return Compressed(
        factor=triangle(np.vstack([item.factor for item in items])),
        n=sum(item.n for item in items),
        lag=np.sum([item.lag for item in items], axis=0),
        pairs=sum(item.pairs for item in items),
    )


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
