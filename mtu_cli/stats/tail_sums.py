"""Ordered values of blocks, averaged; each rank with the control that belongs to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.block_plan import LEAST_BLOCKS

FloatArray = NDArray[np.float64]


class _Sums(NamedTuple):
    """Each (outputs, tail); values about those of the first block, lest squares cancel."""

    value: FloatArray
    control: FloatArray
    control_squared: FloatArray
    product: FloatArray


class TailSums:
    """Running sums over blocks of the ordered values at one end, from the outermost inwards.

    `control`: the ordered values of the first-order form less their expectation. A rank takes
    the slope of its own: where an output runs as an exponential, a tenth of the slope that its
    97.5 % quantile has is that of another rank, and the wrong slope is worse than none.
    """

    def __init__(self, values: FloatArray) -> None:
        self._origin = values
        self._sums = _Sums(*np.zeros((4, *values.shape)))

    def add(self, values: FloatArray, control: FloatArray | None) -> None:
        """One block's ordered values and control (outputs, tail)."""
        away = values - self._origin
        self._sums.value[:] += away
        if control is not None:
            self._sums.control[:] += control
            self._sums.control_squared[:] += control * control
            self._sums.product[:] += away * control

    def averages(self, blocks: int) -> FloatArray:
        """Averages (outputs, tail) over `blocks`, less the slope times the control's average.

        The slope is that of least squares over the blocks, S_vc/S_cc; 0 with fewer than
        `LEAST_BLOCKS`.
        """
        value, control, control_squared, product = self._sums
        spread = control_squared - control**2 / blocks
        usable = (spread > 0.0) & (blocks >= LEAST_BLOCKS)
        slope = np.divide(
            product - value * control / blocks, spread, out=np.zeros_like(value), where=usable
        )
        return np.asarray(self._origin + (value - slope * control) / blocks)
