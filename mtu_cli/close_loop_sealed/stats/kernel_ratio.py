"""Is there a smooth random effect? Likelihood ratio of one more variance component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

RATIOS = np.geomspace(0.05, 500.0, 14)
"""Variance of the smooth effect over that of the noise; the profile is taken over these."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kernel:
    """Eigenvectors `V` (n, n) and eigenvalues `d` (n,) >= 0 of a smooth effect's covariance in
    the coordinates of a stratum, scaled to a mean of 1.
    """

    V: FloatArray
    d: FloatArray


def kernel_of(covariance: FloatArray) -> Kernel | None:
    """The kernel of a covariance (n, n); None where it has none."""
    if not covariance.size or np.trace(covariance) <= 0:
        return None
    values, V = np.linalg.eigh(covariance / np.trace(covariance) * len(covariance))
    return Kernel(V=V, d=np.maximum(values, 0.0))


def kernel_ratios(kernel: Kernel, y: FloatArray) -> FloatArray:
    """Likelihood ratios (R, B) of covariance lambda (I + rho K) against lambda I.

    `y` (B, n) the coordinates of a stratum; lambda is profiled out, rho one of `RATIOS`.
    """
    squares = (y @ kernel.V) ** 2
    scale = 1 + np.multiply.outer(RATIOS, kernel.d)
    total = np.maximum(squares.sum(axis=1), 1e-300)
    left = np.maximum((1 / scale) @ squares.T, 1e-300)
    found: FloatArray = y.shape[1] * np.log(total / left) - np.log(scale).sum(axis=1)[:, None]
    return found


def kernel_log_bayes(ratios: FloatArray) -> FloatArray:
    """log Bayes factor (B,) of the smooth effect: the mean over rho, each as likely before."""
    top = ratios.max(axis=0)
    found: FloatArray = 0.5 * top + np.log(np.exp(0.5 * (ratios - top)).mean(axis=0))
    return found
