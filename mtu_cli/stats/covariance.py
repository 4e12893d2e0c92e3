"""Covariance matrices: correlations, roots, and what came out negative of a difference."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, quotient

ROUNDING = 1e-9
"""Difference of two correlations that is 0 but for rounding."""
LIVE = 1e-12
"""Eigenvalue of a correlation matrix above which there is scatter."""
NEGLIGIBLE = 1e-13
"""Share of the largest variance, or value, below which something is rounding."""


def correlation_of(C: FloatArray) -> FloatArray:
    """r_ij = C_ij / sqrt(C_ii C_jj) (k, k); nan beside a variance of 0, 1 on the diagonal."""
    s = np.sqrt(np.diag(C))
    with np.errstate(divide="ignore", invalid="ignore"):
        r = C / np.outer(s, s)
    r = np.asarray(np.clip(r, -1.0, 1.0), dtype=np.float64)
    np.fill_diagonal(r, 1.0)
    return r


def factor_of(C: FloatArray) -> FloatArray:
    """F (k, rank) with F F' = C, which may be singular (r = 1), and whose units may differ; where C
    is no covariance, that of `as_covariance`.
    """
    s = np.sqrt(np.clip(np.diag(C), 0.0, None))
    divisor = np.where(s > 0, s, np.inf)
    values, vectors = np.linalg.eigh(C / divisor / divisor[:, None])
    positive = values > 1e-14 * values.max(initial=np.finfo(np.float64).eps)
    root = vectors[:, positive] * np.sqrt(values[positive])
    size = np.sqrt(np.sum(root**2, axis=1))
    return np.ascontiguousarray(quotient(s, size, 0.0)[:, None] * root)


def reduced_factor(factor: FloatArray) -> FloatArray:
    """The same covariances F F' with as few columns as they have directions, F (P, ..., R); P is 1
    where all parts have the same but for rounding.
    """
    if not factor.size:
        return factor[:1, ..., :0]
    tolerance = NEGLIGIBLE * np.abs(factor).max()
    factor = factor[:1] if (np.abs(factor - factor[:1]) <= tolerance).all() else factor
    flat = factor.reshape(-1, factor.shape[-1])
    size, vectors = np.linalg.eigh(flat.T @ flat)
    nonzero = size > NEGLIGIBLE * max(float(size[-1]), 0.0)
    return (flat @ vectors[:, nonzero]).reshape(*factor.shape[:-1], int(nonzero.sum()))


def covariance_root(C: FloatArray) -> FloatArray:
    """F (k, k) with F F' = C, C symmetric; negative eigenvalues, of rounding, count as 0.

    Products F F' keep their variances from turning negative, and F z with standard normal z has
    the covariance C, which may be singular.
    """
    values, vectors = np.linalg.eigh((C + C.T) / 2)
    return vectors * np.sqrt(np.clip(values, 0.0, None))


def relative(S: FloatArray, metric: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues l (r,) of S (q, q) in units of a `metric` (q, q), and B (q, r) with S = B diag(l)
    B', metric = B B'; nothing of what the metric does not scatter in.
    """
    scale = np.sqrt(np.diag(metric))
    scale[scale == 0] = 1.0
    values, vectors = np.linalg.eigh(metric / np.outer(scale, scale))
    live = values > LIVE
    root = scale[:, None] * vectors[:, live] * np.sqrt(values[live])
    inverse = (vectors[:, live] / np.sqrt(values[live])).T / scale
    white = inverse @ S @ inverse.T
    values, vectors = np.linalg.eigh((white + white.T) / 2)
    return values, root @ vectors


def positive_part(S: FloatArray, metric: FloatArray | None = None, less: float = 0.0) -> FloatArray:
    """D = S - less * metric, a negative part of it set to zero; all (q, q) and symmetric.

    Measured in units of `metric`, which is positive definite (None: the identity), S has the
    eigenvalues l; D keeps max(l - less, 0) on the same eigenvectors. With a metric that scales
    as S does, the result does not depend on the units of the q quantities. S may be a
    between-pass mean square and `less` * `metric` what repeatability alone gives of it (Amemiya,
    Am. Stat. 39 (1985) 112).
    """
    metric = np.eye(len(S)) if metric is None else metric
    values, basis = relative(S, metric)
    if values.min(initial=less) >= less:
        return S - less * metric
    D: FloatArray = (basis * np.clip(values - less, 0.0, None)) @ basis.T
    return (D + D.T) / 2


def drawable_passes(D: FloatArray, C: FloatArray) -> FloatArray:
    """D (k, k) without its negative part, measured in the standard uncertainties of C.

    Level and slope differ in unit: without a measure the result would depend on them. One without
    uncertainty, or with an unknown one (nan), has the measure 1.
    """
    return positive_part(D, np.diag(np.where(np.diag(C) > 0, np.diag(C), 1.0)))


def bounded(K: FloatArray, S: FloatArray) -> FloatArray:
    """K (q, q) cut to lie between -S and S; 0 in what S does not scatter in."""
    values, basis = relative(K, S)
    result: FloatArray = (basis * values.clip(-1.0, 1.0)) @ basis.T
    return (result + result.T) / 2


def as_covariance(C: FloatArray) -> FloatArray:
    """C (k, k) where it is a covariance; else the one of the same variances whose correlations are
    C's, their negative part set to zero and scaled to unit variance again: for covariances put
    together from separate estimates. What has no variance has no covariance; what is not known
    (nan) stays as it is.
    """
    if not np.isfinite(C).all():
        return C
    s = np.sqrt(np.clip(np.diag(C), 0.0, None))
    units = np.outer(s, s)
    C = np.where(units > 0, (C + C.T) / 2, 0.0)
    F = factor_of(C)
    D = F @ F.T
    return C if np.all(np.abs(D - C) <= ROUNDING * units) else D
