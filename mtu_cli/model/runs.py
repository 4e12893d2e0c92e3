"""Runs there and back: which passes of an axis are one run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


def ways(code: IntArray, sign: IntArray, count: int) -> IntArray:
    """The direction (m,) of each pass; 0 where it runs both ways, or in none that is told."""
    least, most = np.full(count, 2), np.full(count, -2)
    np.minimum.at(least, code, sign)
    np.maximum.at(most, code, sign)
    return np.where(least == most, least, 0)


def one_way_files(file: IntArray, way: IntArray) -> NDArray[np.bool_]:
    """(m,) whether every pass of the pass's file runs in one and the same direction."""
    _, code = np.unique(file, return_inverse=True)
    whole = ways(code.reshape(-1), way, int(code.max(initial=-1)) + 1)
    found: NDArray[np.bool_] = whole[code.reshape(-1)] != 0
    return found


def runs_of(keys: IntArray, order: IntArray, way: IntArray) -> IntArray:
    """The run (m,) of each pass (file, number) in `keys` (m, 2), in their `order` in time.

    A pass that runs both ways is one. Where every pass of a file runs one way only (`way`, see
    `ways`), one there and one back are a run: what differs between the directions could not be
    told from what differs between passes. Files that hold one direction only are read as one:
    one file a pass, or one a direction.
    """
    first = np.empty(len(keys), np.int64)
    first[order] = np.arange(len(keys))
    files = np.where(one_way_files(keys[:, 0], way), -1, keys[:, 0])
    for file in np.unique(files):
        own = order[files[order] == file]
        if way[own].all():
            for a, b in _fellows(way[own]):
                first[own[b]] = first[own[a]]
    return np.unique(first, return_inverse=True)[1].reshape(-1)


def _fellows(way: IntArray) -> list[tuple[int, int]]:
    """Pairs of places (earlier, later) in a sequence of directions: neighbours that go opposite
    ways, so that one that is missing leaves only its fellow alone; of all there before all back
    the n-th of each.
    """
    turns = np.flatnonzero(way[1:] != way[:-1])
    if len(turns) == 1:
        middle = int(turns[0]) + 1
        return [(i, middle + i) for i in range(min(middle, len(way) - middle))]
    found: list[tuple[int, int]] = []
    for i in turns.tolist():
        if not found or found[-1][1] < i:
            found.append((i, i + 1))
    return found
