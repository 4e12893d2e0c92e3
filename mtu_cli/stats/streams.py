"""An independent stream of random numbers for every quantity that is simulated."""

from __future__ import annotations

import numpy as np


def stream(seed: int, *key: int) -> np.random.Generator:
    """A generator that depends on `seed` and `key` alone, so that no draw moves another."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
