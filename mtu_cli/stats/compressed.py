"""Very many rows through small matrices that hold all that least squares needs of them, and how
residuals of such rows follow each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.stats.least_squares import RANK_TOLERANCE, FloatArray, triangle


@dataclass(frozen=True, slots=True)
class Compressed:
    """n rows Z of k columns, the first of them the constant, in the order in which they were read.

    `factor` (r, k), r <= k, with factor'factor = Z'Z: a triangular factor by orthogonal
    rotations, so that conditioning is that of Z and not its square (Golub & Van Loan, Matrix
    Computations, 5.2). `lag` (k, k) = sum z_i z_(i+1)' over `pairs` consecutive rows, by which
    any residual's autocorrelation follows. `freed`: of how many pieces the mean was taken out.
    """

    factor: FloatArray
    n: int
    lag: FloatArray
    pairs: int
    freed: int = 0

    @property
    def levels(self) -> int:
        """Levels that a fit takes of the rows: one, or that of every piece freed of its mean."""
        return max(self.freed, 1)

    def mean(self, columns: Sequence[int]) -> FloatArray:
        """Means (l,) of some columns."""
        return np.asarray(self.factor[0, columns] / self.factor[0, 0])

    def inner(self, columns: Sequence[int]) -> FloatArray:
        """The factor (r - 1, l) of some columns about their means; 0 where only rounding is."""
        chosen = self.factor[:, columns]
        known = np.linalg.norm(chosen[1:], axis=0) > RANK_TOLERANCE * np.linalg.norm(chosen, axis=0)
        return np.where(known, chosen[1:], 0.0)

    def only(self, columns: Sequence[int]) -> Compressed:
        """Some of the columns."""
        lag = self.lag[np.ix_(columns, columns)]
        return replace(self, factor=self.factor[:, columns], lag=lag)

    def about_mean(self) -> Compressed:
        """All columns but the constant less their means."""
        T = np.eye(self.factor.shape[1])
        T[0, 1:] = -self.factor[0, 1:] / self.factor[0, 0]
        return replace(self, factor=self.factor @ T, lag=T.T @ self.lag @ T, freed=1)


def compress(Z: FloatArray) -> Compressed:
    """Rows Z (n, k) compressed; n may be any number above 0."""
    return Compressed(triangle(Z), len(Z), Z[:-1].T @ Z[1:], len(Z) - 1)


def together(items: Sequence[Compressed]) -> Compressed:
    """All rows of several pieces; no pair of consecutive rows spans two of them."""
    return Compressed(
        factor=triangle(np.vstack([item.factor for item in items])),
        n=sum(item.n for item in items),
        lag=np.sum([item.lag for item in items], axis=0),
        pairs=sum(item.pairs for item in items),
        freed=sum(item.freed for item in items),
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
