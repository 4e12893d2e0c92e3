"""Arrays that a Monte Carlo model keeps from block to block, one set for each thread."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Workspace(threading.local):
    """Named scratch arrays, allocated once a thread and shape, then used again.

    A fresh large array costs more in page faults than the arithmetic done on it. A model
    holds one `Workspace`, asks for its arrays by name in every call of `draw`, fills them
    with ``out=`` and may return them: the engine is done with a block's arrays before it
    draws the next block in the same thread.

    ::

        z = self.work.array("z", (inputs, m))
        rng.standard_normal(out=z)
        x = np.matmul(self.factor, z, out=self.work.array("x", (inputs, m)))
    """

    def __init__(self) -> None:
        self._arrays: dict[str, FloatArray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """An uninitialised C-ordered array of `shape`; the same one for the same name and shape.

        A different shape under a known name replaces the array, so that blocks of two lengths
        do not keep two sets.
        """
        known = self._arrays.get(name)
        if known is None or known.shape != shape:
            known = self._arrays[name] = np.empty(shape)
        return known
