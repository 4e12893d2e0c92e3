"""Do two sets of columns of the same rows scatter alike? A permutation test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

SWAPS = 4999
BLOCKS = 1000
"""Of more rows than this, neighbours are exchanged together: the test stays exact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SwapTest:
    """`ratio` of total variances (second over first, nan if the first has none), two-sided `p`
    of no difference (nan if neither scatters).
    """

    ratio: float
    p: float


def swap_test(first: FloatArray, second: FloatArray, seed: int) -> SwapTest:
    """Compares the scatter of `first` and `second`, (rows, columns) each, nan where missing.

    Under the null that a row's two sides could be exchanged, exchanging them in a random half of
    the rows changes nothing. The statistic is the absolute difference of the summed squared
    deviations from the columns' means; their sum does not change, so it orders as the ratio.
    Columns may be correlated in any way.
    """
    squares = np.column_stack([_squares(first), _squares(second)])
    total = squares.sum(axis=0)
    if not total.any():
        return SwapTest(ratio=float("nan"), p=float("nan"))
    ratio = float(total[1] / total[0]) if total[0] > 0 else float("nan")
    change = squares[:, 1] - squares[:, 0]
    if len(change) > BLOCKS:
        edges = np.linspace(0, len(change), BLOCKS, endpoint=False).astype(np.int64)
        change = np.add.reduceat(change, edges)
    rng = np.random.default_rng(seed)
    signs = rng.choice(np.array([-1.0, 1.0]), (SWAPS, len(change)))
    observed = abs(float(change.sum()))
    hits = int((np.abs(signs @ change) >= observed * (1 - 1e-12)).sum())
    return SwapTest(ratio=ratio, p=(1 + hits) / (1 + SWAPS))


def _squares(values: FloatArray) -> FloatArray:
    """Summed squared deviations (rows,) from the columns' means."""
    known = np.isfinite(values)
    mean = np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    away = np.where(known, values - mean, 0.0)
    squares: FloatArray = np.einsum("ij,ij->i", away, away)
    return squares
