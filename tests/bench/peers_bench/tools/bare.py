"""Only the random numbers: one thread of numpy (SFC64) into an array that stays in cache."""

from __future__ import annotations

import math

import numpy as np

from peers_bench.problem import Found, Inputs
from peers_bench.tools import FirstOrder, MonteCarlo

CHUNK = 8192


def normals(inputs: Inputs, trials: int, seed: int, threads: int | None) -> Found:
    """As many normals as the trials need, and nothing made of them."""
    rng = np.random.Generator(np.random.SFC64(seed))
    block = np.empty((len(inputs.mean), CHUNK))
    for _ in range(trials // CHUNK):
        rng.standard_normal(out=block)
    rng.standard_normal(size=(len(inputs.mean), trials % CHUNK))
    return Found(math.nan, math.nan, math.nan)


MONTE_CARLO: dict[str, MonteCarlo] = {"": normals}
FIRST_ORDER: dict[str, FirstOrder] = {}
