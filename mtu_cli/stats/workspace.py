"""Arrays that a Monte Carlo model keeps from block to block, one set for each thread."""

from __future__ import annotations

import math
import threading

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


class Workspace(threading.local):
    """Named scratch arrays, allocated once a thread and shape, then used again.

    A fresh large array costs more in page faults than the arithmetic done on it. A model
    holds one `Workspace`, asks for its arrays by name in every call of `draw`, fills them
    with ``out=`` and may return them: the engine is done with a block's arrays before it
    draws the next block in the same thread.
    """

    def __init__(self) -> None:
        self._arrays: dict[str, FloatArray] = {}
        self._memory: dict[str, FloatArray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """An uninitialised C-ordered array of `shape`; the same one for the same name and shape.

        A different shape under a known name takes the same memory where that is enough, so that
        blocks of two lengths do not keep two sets nor make new ones in turn.
        """
        result = self._arrays.get(name)
        if result is None or result.shape != shape:
            size = math.prod(shape)
            memory = self._memory.get(name)
            if memory is None or len(memory) < size:
                memory = self._memory[name] = np.empty(size)
            result = self._arrays[name] = memory[:size].reshape(shape)
        return result
