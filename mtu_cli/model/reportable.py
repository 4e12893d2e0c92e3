"""Covariances of predicted errors as reports and pictures show them: without a negative part.

A pass-to-pass covariance D that is estimated without bias may have a negative part, and then so
may the covariance of errors. Correlations are those without it, variances the estimated ones.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray

INDEFINITE = 1e-9
"""Of the largest eigenvalue: what is further below 0 is no rounding."""


def reportable(prediction: Prediction, variance: FloatArray) -> FloatArray:
    """The covariance (rows, rows) with the variances (rows,), without negative eigenvalues.

    The prediction's own where it has both already.
    """
    covariance = prediction.covariance
    own = _same(covariance, variance)
    if own and (_nowhere_negative(prediction) or not _indefinite(covariance)):
        return covariance
    return _scaled(prediction.drawable, variance)


def reportable_of_points(prediction: Prediction, variance: FloatArray) -> FloatArray:
    """Covariances (n, a, a) of the errors of each of n points alone, with the variances (n, a).

    Of many points `reportable` would be a matrix of all by all.
    """
    own = prediction.of_points
    if _same(own, variance) and _nowhere_negative(prediction):
        return own
    return _scaled(prediction.drawable_of_points, variance)


def _same(covariance: FloatArray, variance: FloatArray) -> bool:
    return np.allclose(_diagonals(covariance), variance, rtol=1e-9, atol=0.0)


def _scaled(covariance: FloatArray, variance: FloatArray) -> FloatArray:
    """Covariances (..., k, k) with the same correlations and the variances (..., k)."""
    own = _diagonals(covariance)
    ratio = np.sqrt(np.divide(variance, own, out=np.zeros_like(own), where=own > 0))
    found: FloatArray = covariance * ratio[..., :, None] * ratio[..., None, :]
    return found


def _diagonals(matrices: FloatArray) -> FloatArray:
    found: FloatArray = np.einsum("...ii->...i", matrices)
    return found


def _nowhere_negative(prediction: Prediction) -> bool:
    """Whether C + D of every block is a covariance: then so is their sum, however many rows."""
    return not any(_indefinite(block.C + block.D) for block in prediction.blocks)


def _indefinite(matrix: FloatArray) -> bool:
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    return bool(values[0] < -INDEFINITE * abs(values[-1]))
