"""The smallest and largest values of a block in order, without ordering the rest."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MARGIN = 0.15
"""Share of a tail by which a cut is set further in: four standard deviations of the count of
values beyond it where a tail has 700, fewer in shorter ones."""
WORTH_IT = 1000
"""Trials from which on a cut is quicker than to order the block."""


class OrderedTails(threading.local):
    """Finds the tails of block after block of the same outputs; one in each thread.

    Where the last block's tail ended the next one's does too, or nearly so: only the values
    beyond are taken and ordered. Where they turn out to be too few the block is partitioned.
    So what is returned never depends on the cuts.
    """

    def __init__(self) -> None:
        self._cuts: FloatArray | None = None
        self._beyond = np.empty(0, bool)

    def of(self, values: FloatArray, tail: int) -> tuple[FloatArray, FloatArray]:
        """The `tail` lowest values from the lowest up and the highest from the highest down.

        `values` (outputs, m) -> (outputs, tail) each; `values` stay as they are.
        """
        outputs, m = values.shape
        if m < WORTH_IT or 2 * tail >= m:
            ordered = np.sort(values, axis=1)
            return ordered[:, :tail].copy(), ordered[:, ::-1][:, :tail].copy()
        known = self._cuts is not None and len(self._cuts) == outputs
        cuts = self._cuts if known and self._cuts is not None else np.full((outputs, 2), np.nan)
        lower, upper = np.empty((outputs, tail)), np.empty((outputs, tail))
        if len(self._beyond) != m:
            self._beyond = np.empty(m, bool)
        beyond = self._beyond
        for row, low, high, (below, above) in zip(values, lower, upper, cuts, strict=True):
            low[:] = _lowest(row, row[np.less(row, below, out=beyond)], tail)
            high[:] = _highest(row, row[np.greater(row, above, out=beyond)], tail)
        inner = tail - 1 - int(MARGIN * tail)
        self._cuts = np.stack(
            [2.0 * end[:, -1] - end[:, inner] for end in (lower, upper)],
            axis=1,
        )
        return lower, upper


def _highest(row: FloatArray, beyond: FloatArray, tail: int) -> FloatArray:
    if len(beyond) < tail:
        beyond = np.partition(row, len(row) - tail)[len(row) - tail :]
    beyond.sort()
    return beyond[::-1][:tail]


def _lowest(row: FloatArray, beyond: FloatArray, tail: int) -> FloatArray:
    if len(beyond) < tail:
        beyond = np.partition(row, tail - 1)[:tail]
    beyond.sort()
    return beyond[:tail]
