"""Random numbers of their own for every quantity that is simulated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.positive_part import covariance_root

FloatArray = NDArray[np.float64]


def stream(seed: int, *key: int) -> np.random.Generator:
    """A generator that depends on `seed` and `key` alone, so that no draw moves another."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def normal_draw(rng: np.random.Generator, covariance: FloatArray) -> FloatArray:
    """One draw (k,) from N(0, covariance), which may be singular."""
    draw: FloatArray = covariance_root(covariance) @ rng.standard_normal(len(covariance))
    return draw
