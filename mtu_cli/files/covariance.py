"""Whether a matrix that a file states can be a covariance."""

from __future__ import annotations

from collections.abc import Sequence

ROUNDING = 1e-6
"""Relative to the standard deviations: what printed digits may leave of an asymmetry."""
INDEFINITE = 1e-8
"""Negative eigenvalue of the correlation matrix that is rounding: more makes variances negative."""


def covariance_fault(
    rows: Sequence[Sequence[float]], size: int, *, difference: bool = False
) -> str | None:
    """Why a matrix can be no covariance (size, size), but for rounding; None where it can.

    A `difference` of two, as a moment estimate is, has to be symmetric alone. Where entries are
    not known (nan), pairs and variances are all that can be judged.
    """
    import numpy as np

    if len(rows) != size or any(len(row) != size for row in rows):
        return f"not {size} x {size}"
    C = np.array(rows, dtype=np.float64).reshape(size, size)
    if np.isinf(C).any():
        return "not finite"
    variances = np.diagonal(C)
    if not difference and (variances < 0).any():
        return "a variance is negative"
    s = np.sqrt(np.abs(variances))
    with np.errstate(over="ignore"):
        apart, scale = np.abs(C - C.T), np.outer(s, s) + np.maximum(np.abs(C), np.abs(C.T))
    if (apart > ROUNDING * scale).any() or (np.isnan(C) != np.isnan(C.T)).any():
        return "not symmetric"
    if difference or not size or np.isnan(C).any():
        return None
    # Coefficients differ by powers of mm: only scaled to correlations are they comparable. One
    # after the other: the product of two small deviations may be zero.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        R = np.where(C == 0.0, 0.0, C / s / s[:, None])
    if not np.isfinite(R).all():
        return "not positive semidefinite: a covariance is far beyond its variances"
    if np.linalg.eigvalsh((R + R.T) / 2)[0] < -INDEFINITE * size:
        return "not positive semidefinite: a combination has a negative variance"
    return None
