"""Whether several estimates are all 0 together, by their covariance (Wald's test, as F)."""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from mtu_cli.stats.least_squares import FloatArray

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
    if square is None:
        return None
    return float(fdtrc(len(b), min(max(dof, 1.0), ENDLESS), square / len(b)))
