"""Marks of rows and of groups of rows, by which equal ones are found without sorting cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_BLOCK = 1 << 15
_ODD = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(29)


def row_marks(columns: Sequence[NDArray[Any]]) -> NDArray[np.uint64]:
    """A mark (n,) of each row over `columns` (n,) of floats or whole numbers.

    Equal rows have equal marks; others agree with probability 2^-64. 0.0 equals -0.0. Works
    block by block: what fits the cache is several times quicker.
    """
    n = len(columns[0])
    marks = np.zeros(n, np.uint64)
    for start in range(0, n, _BLOCK):
        mark = marks[start : start + _BLOCK]
        for column in columns:
            part = column[start : start + _BLOCK]
            if part.dtype == np.float64:
                # Adding 0.0 makes -0.0 the 0.0 that it equals.
                mark ^= (part + 0.0).view(np.uint64)
            else:
                mark ^= part.astype(np.uint64)
            mark *= _ODD
            mark ^= mark >> _SHIFT
    return marks


def all_distinct(columns: Sequence[tuple[NDArray[Any], int]], most: int) -> bool:
    """Whether the rows over `columns` differ from each other, by counting.

    A column is (whole numbers from 0 (n,), how many there may be). False also where that would
    take more than `most` marks: the caller then has to compare in another way.
    """
    size = math.prod(span for _, span in columns)
    if size > most:
        return False
    seen = np.zeros(size, bool)
    n = len(columns[0][0])
    for start in range(0, n, _BLOCK):
        key = np.zeros(min(_BLOCK, n - start), np.int64)
        for column, span in columns:
            key *= span
            key += column[start : start + _BLOCK]
        seen[key] = True
    return int(np.count_nonzero(seen)) == n
