"""Single values that are too far from the others of their sample."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

FEWEST = 3
"""A deviation among fewer values than this says nothing."""


def deviation_p(d: FloatArray, count: FloatArray) -> FloatArray:
    """Two-sided p of deviations `d` = (value - mean)/s, s the sample's own deviation.

    `count` is the sample's size n. For normal values t = d sqrt(n (n - 2)/((n - 1)^2 - n d^2))
    has Student's t with n - 2 degrees of freedom (Grubbs, Technometrics 11 (1969) 1).
    """
    from scipy.special import stdtr

    n = np.maximum(count, float(FEWEST))
    left = (n - 1) ** 2 - n * d**2
    t = np.abs(d) * np.sqrt(n * (n - 2) / np.maximum(left, np.finfo(np.float64).tiny))
    p: FloatArray = np.where(count >= FEWEST, 2 * stdtr(n - 2, -t), 1.0)
    return p


def deviation_limit(count: FloatArray, p: float) -> FloatArray:
    """The deviation (value - mean)/s whose two-sided p is `p`; nan for too few values."""
    from scipy.special import stdtrit

    n = np.maximum(count, float(FEWEST))
    t = stdtrit(n - 2, 1 - p / 2)
    limit = (n - 1) / np.sqrt(n) * np.sqrt(t**2 / (n - 2 + t**2))
    found: FloatArray = np.where(count >= FEWEST, limit, np.nan)
    return found
