"""Estimates from few trials of a model that is linear but for a little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.pooling import Estimates, Gain, rescaled
from mtu_cli.stats.single_block import single_block_estimates

FloatArray = NDArray[np.float64]

SURE_GAIN = 4.0
"""Gain from which on a control is taken. The scatter of ten blocks tells a variance to a half
only: the lesser of two that differ by less would be stated too small."""

EARLY_GAIN = 100.0
"""Gain from which on a few trials are enough for a count that adapts: to stop where the scatter
of the blocks happens to be small would be to state it too small. Here it plainly is."""


def short_block_estimates(
    pooled: Estimates, values: FloatArray, probability: float, u_exists: NDArray[np.bool_]
) -> Estimates:
    """Each statistic from the blocks where its control gains, else from all `values` together.

    `values` (outputs, M): the whole sample; of it as `single_block_estimates`.
    """
    gain = np.array(pooled.gain)
    taken = gain >= SURE_GAIN
    if np.all(taken):
        return pooled
    whole = single_block_estimates(values, probability, u_exists)
    found = {
        name: np.where(use, getattr(pooled, name), getattr(whole, name))
        for name, use in zip(("mean", "u", "low", "high"), taken, strict=True)
    }
    errors = {
        f"se_{name}": np.where(use, getattr(pooled, f"se_{name}"), getattr(whole, f"se_{name}"))
        for name, use in zip(found, taken, strict=True)
    }
    ends = taken[2] & taken[3]
    return Estimates(
        **found,
        **errors,
        shortest_low=np.where(ends, pooled.shortest_low, whole.shortest_low),
        shortest_high=np.where(ends, pooled.shortest_high, whole.shortest_high),
        covariance=rescaled(whole.covariance, found["u"]),
        gain=Gain(*np.where(taken, gain, 1.0)),
    )


def all_controlled(estimates: Estimates, u_exists: NDArray[np.bool_]) -> bool:
    """Whether the control gains much for every statistic that there is, of every output."""
    gain = np.array(estimates.gain)
    return bool(np.all((gain >= EARLY_GAIN) | ~np.array([u_exists] * 2 + [u_exists | True] * 2)))
