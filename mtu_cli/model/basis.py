"""What the coefficients of a component multiply along its axis: powers, or a table's weights.

A component is linear in its coefficients whatever its shape. A table leaves something open between
its positions, which adds to the variance of what is predicted there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.kernels import interpolation_covariance, line, smooth_root, weights
from mtu_cli.stats.least_squares import FloatArray, polynomial


@dataclass(frozen=True, slots=True)
class Powers:
    """1, p, p^2, ... of the position p; of degree 0 the constant alone."""

    degree: int

    def columns(self, position: FloatArray) -> FloatArray:
        """The columns (n, degree + 1) at n positions, mm."""
        return polynomial(position, self.degree)

    def of_line(self, center: float, q: int) -> FloatArray:
        """T (k, q) from (intercept at the centre, slope) to coefficients."""
        T = np.zeros((self.degree + 1, q))
        T[0, 0] = 1.0
        if q == 2:
            T[0, 1], T[1, 1] = -center, 1.0
        return T

    def at_centre(self, center: float) -> FloatArray:
        """T (q, k) from coefficients to level and slope at the centre."""
        k = np.arange(self.degree + 1)
        T = np.zeros((min(2, len(k)), len(k)))
        T[0] = center**k
        if len(k) > 1:
            T[1] = k * center ** np.maximum(k - 1, 0)
        return T


AT_MM = 1e-3
"""Distance up to which a point is at a position of a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableShape:
    """Values at the positions `at` (T,), mm, rising, with natural cubic interpolation.

    `roughness` is the variance tau^2 of the integrated Wiener process that the interpolation leaves
    open, `own` that of a run's own bend, of future readings only, with `own_dof` degrees of
    freedom; both in mm or rad squared per mm^3. `between` is a variance added off the positions.
    """

    at: FloatArray
    roughness: float = 0.0
    between: float = 0.0
    own: float = 0.0
    own_dof: float = np.inf

    def columns(self, position: FloatArray) -> FloatArray:
        """Weights (n, T) of the values at n positions, mm; beyond the table a straight line."""
        return weights(self.at, position)

    def of_line(self, center: float, q: int) -> FloatArray:
        """T (k, q) from (intercept at the centre, slope) to values."""
        return line(self.at, center)[:, :q]

    def at_centre(self, center: float) -> FloatArray:
        """T (2, k) from values to level and slope of the least-squares line at the centre."""
        return np.asarray(np.linalg.pinv(line(self.at, center)), np.float64)

    def interpolation_covariance(self, position: FloatArray) -> FloatArray:
        """Covariance (n, n) of what the values leave open, the same for all parts."""
        off = np.abs(position[:, None] - self.at).min(axis=1) > AT_MM
        return self.roughness * interpolation_covariance(self.at, position) + np.diag(
            off * self.between
        )

    def of_runs(self, position: FloatArray) -> FloatArray:
        """Covariance (n, n) of the bend of one run, its line left out."""
        W = weights(self.at, position) @ smooth_root(self.at)
        return self.own * (W @ W.T + interpolation_covariance(self.at, position))


Shape = Powers | TableShape
