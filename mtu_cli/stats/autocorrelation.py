"""How residuals of compressed rows follow each other, and what their number is then worth."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mtu_cli.stats.compressed import Compressed
from mtu_cli.stats.least_squares import FloatArray

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
