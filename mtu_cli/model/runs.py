"""Runs there and back: which passes of an axis are one run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


def ways(code: IntArray, sign: IntArray, count: int) -> IntArray | None:
    """The direction (m,) of each pass; None where one runs both ways, or in none that is told."""
    least, most = np.full(count, 2), np.full(count, -2)
    np.minimum.at(least, code, sign)
    np.maximum.at(most, code, sign)
    return least if (least == most).all() and least.all() else None


def runs_of(keys: IntArray, order: IntArray, way: IntArray | None) -> IntArray:
    """The run (m,) of each pass (file, number) in `keys` (m, 2), in their `order` in time.

    A pass that runs both ways is one. Where every pass runs one way only (`way`, see `ways`), the
    n-th there and the n-th back of a file are one run: what differs between the directions could
    not be told from what differs between passes.
    """
    first = np.empty(len(keys), np.int64)
    first[order] = np.arange(len(keys))
    if way is not None:
        for file in np.unique(keys[:, 0]):
            own = [i for i in order if keys[i, 0] == file]
            there, back = ([i for i in own if way[i] == sign] for sign in (1, -1))
            for a, b in zip(there, back, strict=False):
                first[a] = first[b] = min(first[a], first[b])
    return np.unique(first, return_inverse=True)[1].reshape(-1)
