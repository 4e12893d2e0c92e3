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
        self._beyond = np.empty((2, 0), bool)

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
        if self._beyond.shape[1] != m:
            self._beyond = np.empty((2, m), bool)
        for row, low, high, (below, above) in zip(values, lower, upper, cuts, strict=True):
            beyond, lows, highs = self._ordered_beyond(row, below, above)
            few = np.sort(np.partition(row, tail - 1)[:tail]) if lows < tail else beyond[:tail]
            top = np.sort(np.partition(row, m - tail)[m - tail :]) if highs < tail else beyond
            low[:], high[:] = few, top[::-1][:tail]
        inner = tail - 1 - int(MARGIN * tail)
        self._cuts = np.stack(
            [2.0 * end[:, -1] - end[:, inner] for end in (lower, upper)],
            axis=1,
        )
        return lower, upper

    def _ordered_beyond(
        self, row: FloatArray, below: float, above: float
    ) -> tuple[FloatArray, int, int]:
        """The values of a row (m,) beyond either cut, in order, and how many are beyond each."""
        one, other = self._beyond
        np.less(row, below, out=one)
        np.greater(row, above, out=other)
        lows, highs = int(np.count_nonzero(one)), int(np.count_nonzero(other))
        np.logical_or(one, other, out=one)
        # Three times as quick as row[one].
        found: FloatArray = row.take(np.flatnonzero(one))
        found.sort()
        return found, lows, highs
