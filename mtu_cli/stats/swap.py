"""Do two sets of columns of the same rows scatter alike? A permutation test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

SWAPS = 4999


@dataclass(frozen=True, slots=True, kw_only=True)
class SwapTest:
    """`ratio` of total variances (second over first), two-sided p of no difference."""

    ratio: float
    p: float


def swap_test(first: FloatArray, second: FloatArray, seed: int) -> SwapTest:
    """Compares the scatter of `first` and `second`, (rows, columns) each, nan where missing.

    Under the null that a row's two sides could be exchanged, exchanging them in a random half of
    the rows changes nothing. The statistic is |log| of the ratio of the summed squared
    deviations from the columns' means. Columns may be correlated in any way.
    """
    a, b = _deviations(first), _deviations(second)
    squares = np.column_stack([(a**2).sum(axis=1), (b**2).sum(axis=1)])
    total = squares.sum(axis=0)
    ratio = float(total[1] / total[0]) if total[0] > 0 else float("nan")
    if not (total > 0).all():
        return SwapTest(ratio=ratio, p=1.0)
    rng = np.random.default_rng(seed)
    swapped = rng.random((SWAPS, len(squares))) < 0.5
    change = squares[:, 1] - squares[:, 0]
    up = total[0] + swapped @ change
    statistic = np.abs(np.log((total.sum() - up) / up))
    observed = abs(np.log(ratio))
    hits = int((statistic >= observed * (1 - 1e-12)).sum())
    return SwapTest(ratio=ratio, p=(1 + hits) / (1 + SWAPS))


def _deviations(values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    mean = np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known, values - mean, 0.0)
