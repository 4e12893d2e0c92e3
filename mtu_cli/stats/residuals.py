"""What residuals and regressors tell about a fit: normality, collinearity."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtrc

from mtu_cli.stats.least_squares import FloatArray

FEWEST_FOR_NORMALITY = 20
DEPENDENT = 1e-12
"""Share of the largest singular value below which only rounding is left."""


def normality_p(values: FloatArray, effective: float | None = None) -> float | None:
    """p of D'Agostino & Pearson's K^2 test of normality (1973, Biometrika 60, 613-622).

    `effective` stands for n where the values are not independent. None below 20 values, where
    the approximation does not hold, and for values that are all equal. Skewness by
    D'Agostino's, kurtosis by Anscombe & Glynn's transformation to a normal deviate.
    """
    n = float(len(values)) if effective is None else min(effective, len(values))
    centred = values - values.mean()
    m2 = float(np.mean(centred**2))
    if n < FEWEST_FOR_NORMALITY or m2 <= 0:
        return None
    skewness = float(np.mean(centred**3)) / m2**1.5
    kurtosis = float(np.mean(centred**4)) / m2**2
    return float(chdtrc(2, _of_skewness(skewness, n) ** 2 + _of_kurtosis(kurtosis, n) ** 2))


def _of_skewness(skewness: float, n: float) -> float:
    """Z(sqrt(b1)), D'Agostino 1970, Biometrika 57, 679-681."""
    y = skewness * math.sqrt((n + 1) * (n + 3) / (6 * (n - 2)))
    beta = 3 * (n**2 + 27 * n - 70) * (n + 1) * (n + 3)
    beta /= (n - 2) * (n + 5) * (n + 7) * (n + 9)
    w2 = math.sqrt(2 * (beta - 1)) - 1
    delta = 1 / math.sqrt(0.5 * math.log(w2))
    alpha = math.sqrt(2 / (w2 - 1))
    return delta * math.asinh(y / alpha)


def _of_kurtosis(kurtosis: float, n: float) -> float:
    """Z(b2), Anscombe & Glynn 1983, Biometrika 70, 227-234."""
    mean = 3 * (n - 1) / (n + 1)
    variance = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    x = (kurtosis - mean) / math.sqrt(variance)
    root = 6 * (n**2 - 5 * n + 2) / ((n + 7) * (n + 9))
    root *= math.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    a = 6 + 8 / root * (2 / root + math.sqrt(1 + 4 / root**2))
    ratio = (1 - 2 / a) / (1 + x * math.sqrt(2 / (a - 4)))
    cube = math.copysign(abs(ratio) ** (1 / 3), ratio)
    return (1 - 2 / (9 * a) - cube) / math.sqrt(2 / (9 * a))


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
