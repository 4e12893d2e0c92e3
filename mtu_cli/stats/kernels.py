"""Kernels of random functions: the integrated Wiener process, and interpolation with it.

f is a straight line, which is left free, plus tau times an integrated Wiener process: what has a
generalised covariance of tau^2 |h|^3/12. Given its values at T knots, the expected f in between is
the natural cubic spline through them, and a straight line beyond (Wahba, Spline Models for
Observational Data (1990), ch. 1; kriging: Cressie, Statistics for Spatial Data (1993), 3.4.5).
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


def wiener(a: FloatArray, b: FloatArray) -> FloatArray:
    """|h|^3/12 (n, m) of all distances h from `a` (n,) to `b` (m,), for tau = 1."""
    return np.abs(np.subtract.outer(a, b)) ** 3 / 12


def line(position: FloatArray, center: float) -> FloatArray:
    """Columns (n, 2) of a straight line: 1 and position - center."""
    return np.column_stack([np.ones(len(position)), position - center])


def weights(knots: FloatArray, position: FloatArray) -> FloatArray:
    """W (n, T): W f(knots) is the natural cubic spline at `position`, beyond the knots a line.

    >>> knots = np.array([0.0, 1.0, 2.0, 4.0])
    >>> W = weights(knots, np.array([1.0, 3.0, 6.0]))
    >>> np.round(W @ (2 + 3 * knots), 9).tolist()
    [5.0, 11.0, 20.0]
    """
    center, half = _scale(knots)
    a, b = (knots - center) / half, (position - center) / half
    fixed = line(a, 0.0)
    lhs = np.block([[wiener(a, a), fixed], [fixed.T, np.zeros((2, 2))]])
    rhs = np.vstack([wiener(a, b), line(b, 0.0).T])
    result: FloatArray = np.linalg.solve(lhs, rhs)[: len(knots)].T
    # At a knot the value itself, without rounding.
    at = np.minimum(np.searchsorted(knots, position), len(knots) - 1)
    at_knots = knots[at] == position
    result[at_knots] = np.eye(len(knots))[at[at_knots]]
    return result


def interpolation_covariance(knots: FloatArray, position: FloatArray) -> FloatArray:
    """Covariance (n, n) of f - W f(knots), the error of the interpolation, for tau = 1."""
    center, half = _scale(knots)
    positions = (np.concatenate([knots, position]) - center) / half
    difference = np.hstack([-weights(knots, position), np.eye(len(position))])
    K = difference @ wiener(positions, positions) @ difference.T * half**3
    at_knots = np.isin(position, knots)
    K[at_knots] = K[:, at_knots] = 0.0
    return (K + K.T) / 2


def smooth_root(knots: FloatArray) -> FloatArray:
    """B (T, T - 2): f(knots) is a line plus tau B u, u standard normal, B without a line."""
    center, half = _scale(knots)
    a = (knots - center) / half
    H = np.linalg.qr(line(a, 0.0), mode="complete")[0][:, 2:]
    return H @ np.linalg.cholesky(H.T @ wiener(a, a) @ H) * half**1.5


def _scale(knots: FloatArray) -> tuple[float, float]:
    """Middle and half of the range: cubes of numbers of order 1 lose no digits."""
    return float(knots[0] + knots[-1]) / 2, float(knots[-1] - knots[0]) / 2
