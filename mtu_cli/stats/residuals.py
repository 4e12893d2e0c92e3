"""What residuals and regressors tell about a fit: normality, collinearity."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

FEWEST_FOR_NORMALITY = 20
DEPENDENT = 1e-12
"""Share of the largest singular value below which only rounding is left."""


def normality_p(values: FloatArray, effective: float | None = None) -> float | None:
    """p of D'Agostino & Pearson's K^2 test of normality (1973, Biometrika 60, 613-622).

    `effective`: how many of the values, which follow each other, count as independent; about
    so many, evenly spaced, are tested. None below 20 of them, where the approximation does not
    hold, and for values that are all equal.
    """
    from scipy.stats import normaltest

    step = 1 if effective is None else max(1, round(len(values) / effective))
    values = values[::step]
    if len(values) < FEWEST_FOR_NORMALITY or np.ptp(values) == 0:
        return None
    return float(normaltest(values).pvalue)


def condition_number(columns: FloatArray) -> float:
    """Largest over smallest singular value of columns (r, k) scaled to unit length.

    Belsley, Kuh & Welsch, Regression Diagnostics, 1980, ch. 3; infinite where columns depend,
    as more columns than rows do.
    """
    singular, _ = _of_unit_columns(columns)
    if singular[-1] <= DEPENDENT * singular[0]:
        return math.inf
    return float(singular[0] / singular[-1])


def variance_inflation(columns: FloatArray) -> FloatArray:
    """VIF_j = 1/(1 - R_j^2) of centred columns (r, k), each against all others.

    The diagonal of the inverse correlation matrix (Marquardt 1970, Technometrics 12, 591-612),
    by singular values; infinite where a column depends on the others.
    """
    singular, Vt = _of_unit_columns(columns)
    tiny = singular <= DEPENDENT * singular[0]
    result = ((Vt[~tiny].T / singular[~tiny]) ** 2).sum(axis=1)
    dependent = (Vt[tiny] ** 2).sum(axis=0) > DEPENDENT
    return np.where(dependent, np.inf, result)


def _of_unit_columns(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All k singular values and right vectors of the columns scaled to unit length."""
    length = np.linalg.norm(columns, axis=0)
    # Rows of zeros change nothing, and give the columns a singular value each.
    rows = np.zeros((max(columns.shape), columns.shape[1]))
    rows[: len(columns)] = columns / np.where(length > 0, length, 1.0)
    _, singular, Vt = np.linalg.svd(rows, full_matrices=False)
    return singular, Vt
