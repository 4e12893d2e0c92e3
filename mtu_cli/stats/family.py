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


SINGULAR = 1e-12
"""Smallest eigenvalue of a matrix of correlations that estimates can be held against."""

ENDLESS = 1e9
"""Degrees of freedom beyond which F is chi^2 / k."""


def squared_distance(b: FloatArray, V: FloatArray) -> float | None:
    """T^2 = b' V^-1 b of estimates b (k,) with covariance V (k, k); None where V is singular.

    In any units: V is brought to correlations first.
    """
    u = np.sqrt(np.maximum(np.diag(V), 0.0))
    if not (u > 0).all():
        return None
    values, vectors = np.linalg.eigh(V / np.outer(u, u))
    if values[0] <= SINGULAR:
        return None
    return float(((vectors.T @ (b / u)) ** 2 / values).sum())


def p_of_none(b: FloatArray, V: FloatArray, dof: float) -> float | None:
    """p = P(F(k, dof) > T^2 / k) that all of b are 0; None where V is singular.

    V holds one estimated variance with `dof` degrees of freedom, 1 where there are fewer: of
    k = 1 the square of Student's t. Exact of ordinary least squares (Rao 1973, 4b.2).
    """
    square = squared_distance(b, V)
    return None if square is None else p_of_square(square, len(b), dof)


def p_of_square(square: float, k: int, dof: float) -> float:
    """The same of their T^2."""
    from scipy.special import fdtrc

    return float(fdtrc(k, min(max(dof, 1.0), ENDLESS), square / k))


def hotelling_p(square: float, k: int, dof: float) -> float:
    """p of T^2 of k estimates that are all 0 whose covariance is estimated entry by entry, with
    `dof` nu degrees of freedom: (nu - k + 1) T^2 / (nu k) is F(k, nu - k + 1); 1 without any left
    (Hotelling, Ann. Math. Stat. 2 (1931) 360).
    """
    from scipy.special import fdtrc

    nu = min(dof, ENDLESS)
    left = nu - k + 1
    return float(fdtrc(k, left, square * left / (nu * k))) if left > 0 else 1.0
