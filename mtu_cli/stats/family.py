"""Tail probabilities of many tests at once, and their family-wise adjustment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

FAMILY_RATE = 0.05
"""False alarms of all tests of one kind together."""
Key = TypeVar("Key")


def significant(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """The tests that hold out among all of their kind, at the family-wise rate (Bonferroni)."""
    return {key: p for key, p in p_values.items() if p * len(p_values) <= FAMILY_RATE}


def holm(p: FloatArray) -> FloatArray:
    """Holm's adjusted p values (Scand. J. Statist. 6 (1979) 65) over all known of `p` (m,).

    A test that was not made has p = nan; it stays nan and does not count.
    """
    adjusted = np.full(len(p), np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    steps = len(known) - np.arange(len(known))
    adjusted[order] = np.maximum.accumulate(np.minimum(p[order] * steps, 1.0))
    return adjusted
