"""What parts that shift, turn and grow move features by: lines over their places."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

FEWEST_LINES = 6
"""Features from which on parts may turn and grow for themselves."""


def smooth_of(places: FloatArray) -> FloatArray:
    """A constant and, of enough features, the slopes along each axis that they differ along, all in
    one unit of length.
    """
    ones = np.ones((len(places), 1))
    if len(places) < FEWEST_LINES:
        return ones
    known = np.isfinite(places).all(axis=0) & (np.ptp(places, axis=0) > 0)
    slopes = places[:, known] - places[:, known].mean(axis=0)
    reach = float(np.abs(slopes).max(initial=1e-300))
    return np.concatenate([ones, slopes / reach], axis=1)
