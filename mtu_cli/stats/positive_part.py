"""Covariances that were estimated by a difference, less what came out negative."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def positive_part(S: FloatArray, metric: FloatArray | None = None, less: float = 0.0) -> FloatArray:
    """D = S - less * metric, its negative part set to zero; all (q, q) and symmetric.

    Measured in units of `metric`, which is positive definite (None: the identity), S has the
    eigenvalues l; D keeps max(l - less, 0) on the same eigenvectors. With a metric that scales
    as S does, the result does not depend on the units of the q quantities. S may be a
    between-pass mean square and `less` * `metric` what repeatability alone gives of it.
    """
    L = np.linalg.cholesky(np.eye(len(S)) if metric is None else metric)
    white = np.linalg.solve(L, np.linalg.solve(L, S).T)
    values, vectors = np.linalg.eigh((white + white.T) / 2)
    root = L @ vectors
    whole = (root * np.clip(values - less, 0.0, None)) @ root.T
    D: FloatArray = (whole + whole.T) / 2
    return D


def covariance_root(C: FloatArray) -> FloatArray:
    """F (k, k) with F F' = C, C symmetric; negative eigenvalues, of rounding, count as 0.

    Products F F' keep their variances from turning negative, and F z with standard normal z has
    the covariance C, which may be singular.
    """
    values, vectors = np.linalg.eigh((C + C.T) / 2)
    root: FloatArray = vectors * np.sqrt(np.clip(values, 0.0, None))
    return root
