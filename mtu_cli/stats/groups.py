"""Values in groups: which values there are, and means, least values and counts of each group; and
tables of groups by rows and columns in which some cells are missing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray, quotient


def distinct(codes: NDArray[Any]) -> tuple[NDArray[Any], IntArray]:
    """The different codes (n,) in order, and which of them each one is; small whole numbers are
    counted, several times quicker than sorted.

    >>> [array.tolist() for array in distinct(np.array([7, 3, 7]))]
    [[3, 7], [1, 0, 1]]
    """
    whole = len(codes) > 0 and codes.dtype.kind in "iu"
    if not whole or codes.min() < 0 or codes.max() > 4 * len(codes):
        values, index = np.unique(codes, return_inverse=True)
        return values, index.reshape(-1).astype(np.int64)
    present = np.bincount(codes) > 0
    return np.flatnonzero(present), (np.cumsum(present) - 1)[codes]


def occurrence(codes: IntArray) -> IntArray:
    """How often the code of each entry occurs before it: 0, 1, 2, ..."""
    import pandas as pd

    return np.asarray(pd.Series(codes).groupby(codes).cumcount(), np.int64)


def group_least(values: FloatArray | IntArray, code: IntArray, count: int) -> FloatArray:
    """Least of the values (n,) of each code (n,), nan where one of them is, infinite of none."""
    result = np.full(count, np.inf)
    with np.errstate(invalid="ignore"):
        np.minimum.at(result, code, values)
    return result


def group_means(values: FloatArray, code: IntArray, count: int) -> FloatArray:
    """Means (count, ...) of the values (n, ...) of each code (n,), nan of none.

    They are taken about the first value of each, so that equal values keep their digits:

    >>> group_means(np.array([0.1, 7.0, 0.1, 0.1]), np.array([1, 0, 1, 1]), 3).tolist()
    [7.0, 0.1, nan]
    """
    first = np.full((count, *values.shape[1:]), np.nan)
    first[code[::-1]] = values[::-1]
    away = np.zeros_like(first)
    np.add.at(away, code, values - first[code])
    size = np.maximum(np.bincount(code, minlength=count), 1)
    return np.asarray(first + away / size.reshape(-1, *(1,) * (values.ndim - 1)))


def known_mean(values: FloatArray, axis: int = -1) -> FloatArray:
    """Mean of the known values along an axis; nan of none."""
    return quotient(np.nansum(values, axis=axis), np.isfinite(values).sum(axis=axis))


def filled_table(table: FloatArray, there: BoolArray) -> FloatArray:
    """A table (P, H, ...) whose missing cells hold the mean of their column, or of their part
    where the column has none. Means of equal values keep their digits.
    """
    if there.all():
        return table
    mask = there.reshape(*there.shape, *(1,) * (table.ndim - 2))
    part, column = np.nonzero(there)
    of_part = group_means(table[there], part, len(there))[:, None]
    of_column = group_means(table[there], column, there.shape[1])[None]
    return np.where(mask, table, np.where(np.isnan(of_column), of_part, of_column))
