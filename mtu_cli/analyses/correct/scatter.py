"""The scatter of the measured points themselves, beyond what the machine's model accounts for.

Corrected coordinates scatter by the probing, too. Its variance s^2 is what the model leaves of

- repeats: those of one feature of one part about their mean. What the machine did to a part is in
  every repeat (as in `mean_size`): of the model only the noise of the temperature readings, which
  every row has its own of, is taken off. Where the machine itself repeated the measurement, its
  repeatability counts twice: an upper bound;
- form: the residuals of circles and spheres. Of these the model accounts for all the shape that
  its covariance gives a ring; what is left holds the form error of the ring itself.

With squares S_j of k_j degrees of freedom and modelled variances m_j, E S_j = k_j (m_j + s^2),
the likelihood of normal errors is largest at

    s^2 = sum w_j (S_j - k_j m_j) / sum w_j k_j,    w_j = (m_j + s^2)^-2,

whose variance is 2/sum w_j k_j (Searle, Casella & McCulloch 1992, section 6.2). With equal m_j it
is the observed less the modelled mean square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.measured import operations_of
from mtu_cli.stats.least_squares import FloatArray

Origin = Literal["repeats", "form"]
FEWEST = 3
"""Degrees of freedom from which on repeats are preferred to the form."""
ITERATIONS = 200
NOTHING_MM = 1e-9
"""A scatter below a picometre is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Squares:
    """Sums of squares (j,) mm^2 with degrees of freedom (j,) and modelled variances (j,)."""

    sums: FloatArray
    dof: FloatArray
    modelled: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PointScatter:
    """Variance of a measured coordinate, mm^2, half the variance of that estimate, mm^4, and
    the degrees of freedom of the pooled squares behind it.
    """

    variance: float
    spread: float
    dof: float
    origin: Origin

    @property
    def s(self) -> float:
        """The standard deviation, mm."""
        return float(np.sqrt(self.variance))

    def added(
        self, u: FloatArray, dof: FloatArray, sensitivity: FloatArray | float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """u and effective degrees of freedom (n,) with `sensitivity` s^2 added to u^2.

        Welch-Satterthwaite (JCGM 100, eq. (G.2b)) and never fewer than the least of both;
        `sensitivity` is the sum of the squared gradients in the coordinates.
        """
        if self.variance == 0:
            return u, dof
        total = u**2 + sensitivity * self.variance
        spread = u**4 / dof + np.square(sensitivity) * self.spread
        return np.sqrt(total), np.maximum(total**2 / spread, np.minimum(dof, self.dof))


def point_scatter(
    points: Points, corrected: FloatArray, sensors: FloatArray, rings: Sequence[Squares]
) -> PointScatter | None:
    """The scatter from repeats, where these have `FEWEST` degrees of freedom, else from `rings`.

    `sensors` (n, 3): variance by the noise of each point's own temperature readings, mm^2.
    """
    repeats = repeat_squares(points, corrected, sensors)
    if repeats.dof.sum() >= FEWEST:
        return _estimate(repeats, "repeats")
    if not rings:
        return None
    return pooled(rings, "form")


def pooled(squares: Sequence[Squares], origin: Origin) -> PointScatter:
    """The scatter that all these squares tell together."""
    return _estimate(
        Squares(
            sums=np.concatenate([own.sums for own in squares]),
            dof=np.concatenate([own.dof for own in squares]),
            modelled=np.concatenate([own.modelled for own in squares]),
        ),
        origin,
    )


def repeat_squares(points: Points, corrected: FloatArray, sensors: FloatArray) -> Squares:
    """Squares about the mean of every feature of every part and operation, along each axis."""
    _, operation = operations_of(points)
    cell = (operation.astype(np.int64) * len(points.parts) + points.part) * len(points.features)
    _, code = np.unique(cell + points.feature, return_inverse=True)
    sums, dof, modelled = [], [], []
    for axis in range(3):
        known = np.isfinite(corrected[:, axis])
        own, value = code.reshape(-1)[known], corrected[known, axis]
        count = np.bincount(own)
        divisor = np.maximum(count, 1)
        mean = np.bincount(own, value) / divisor
        kept = count > 1
        sums.append(np.bincount(own, (value - mean[own]) ** 2)[kept])
        dof.append(count[kept] - 1.0)
        modelled.append((np.bincount(own, sensors[known, axis]) / divisor)[kept])
    return Squares(
        sums=np.concatenate(sums), dof=np.concatenate(dof), modelled=np.concatenate(modelled)
    )


def ring_squares(residuals: FloatArray, away: FloatArray, K: FloatArray, d: int) -> Squares | None:
    """Squares of the residuals (n,) of a circle (d = 2) or sphere (3), one a direction of K.

    `away` (n, 3) are unit vectors from the centre, `K` (n, n) the modelled covariance of the
    points along them, mm^2.
    """
    Q = ring_space(away, d)
    return None if Q is None else squares_along(Q, residuals, K)


def ring_space(away: FloatArray, d: int) -> FloatArray | None:
    """Orthonormal (n, n - d - 1): the directions of n residuals that centre and radius of a circle
    (d = 2) or sphere (3) leave; None where they leave none. `away` (n, 3): see `ring_squares`.
    """
    n = len(away)
    if n <= d + 1:
        return None
    # Of a circle the vectors lie in its plane: two of the four columns and the ones tell.
    found: FloatArray = np.linalg.svd(np.column_stack([away, np.ones(n)]))[0][:, d + 1 :]
    return found


def squares_along(Q: FloatArray, residuals: FloatArray, K: FloatArray) -> Squares:
    """Squares of the residuals (n,) in the space of orthonormal Q (n, m), one a direction of K."""
    values, vectors = np.linalg.eigh(Q.T @ K @ Q)
    return Squares(
        sums=(vectors.T @ Q.T @ residuals) ** 2,
        dof=np.ones(len(values)),
        modelled=np.clip(values, 0.0, None),
    )


def _estimate(squares: Squares, origin: Origin) -> PointScatter:
    least = NOTHING_MM**2
    excess = squares.sums - squares.dof * squares.modelled
    variance = max(float(excess.sum() / squares.dof.sum()), 0.0)
    for _ in range(ITERATIONS):
        weights = np.maximum(squares.modelled + variance, least) ** -2
        last, variance = variance, max(float(weights @ excess / (weights @ squares.dof)), 0.0)
        if abs(variance - last) <= 1e-10 * max(variance, least):
            break
    variance = variance if variance > least else 0.0
    weights = np.maximum(squares.modelled + variance, least) ** -2
    return PointScatter(
        variance=variance,
        spread=1.0 / float(weights @ squares.dof),
        dof=float(squares.dof.sum()),
        origin=origin,
    )
