"""The test that several estimates are all 0."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.family import ENDLESS
from mtu_cli.stats.least_squares import FloatArray

SINGULAR = 1e-12
"""Smallest eigenvalue of a matrix of correlations that estimates can be held against."""


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
