"""Several tests or estimates at once: family-wise adjustment, and whether all are 0 together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

FAMILY_RATE = 0.05
"""False alarms of all tests of one kind together."""
Key = TypeVar("Key")


def significant(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """The significant ones among all tests of their kind, at the family-wise rate (Bonferroni;
    Dunn, J. Am. Stat. Assoc. 56 (1961) 52).
    """
    return {key: p for key, p in p_values.items() if p * len(p_values) <= FAMILY_RATE}


def holm(p: FloatArray) -> FloatArray:
    """Holm's adjusted p values (Scand. J. Statist. 6 (1979) 65) over all known of `p` (m,).

    A test that was not made has p = nan; it stays nan and does not count.
    """
    adjusted = np.full(len(p), np.nan)
    valid = np.flatnonzero(np.isfinite(p))
    order = valid[np.argsort(p[valid], kind="stable")]
    steps = len(valid) - np.arange(len(valid))
    adjusted[order] = np.maximum.accumulate(np.minimum(p[order] * steps, 1.0))
    return adjusted


ENDLESS = 1e9
"""Degrees of freedom beyond which F is chi^2 / k."""


def hotelling_p(square: float, k: int, dof: float) -> float:
    """p of T^2 of k estimates that are all 0 whose covariance is estimated entry by entry, with
    `dof` nu degrees of freedom: (nu - k + 1) T^2 / (nu k) is F(k, nu - k + 1); 1 where that is 0
    (Hotelling, Ann. Math. Stat. 2 (1931) 360).
    """
    from scipy.special import fdtrc

    nu = min(dof, ENDLESS)
    df2 = nu - k + 1
    return float(fdtrc(k, df2, square * df2 / (nu * k))) if df2 > 0 else 1.0
