"""The scatter of measured points beyond the machine's model, and the form that neither explains.

Corrected coordinates scatter by the probing, too. Its variance s^2 is the unexplained one of

- repeats of one feature of one part about their mean: errors of the manufacture are in all of
  them. Where the machine itself repeated the measurement, its repeatability counts twice, and so
  does the noise of temperature readings: an upper bound;
- form: residuals of circles and spheres, less the shape that the model's covariance gives a ring;
  the rest holds the form error of the ring itself.

With squares S_j of k_j degrees of freedom and modelled variances m_j, E S_j = k_j (m_j + s^2),
the likelihood of normal errors is largest at

    s^2 = sum w_j (S_j - k_j m_j) / sum w_j k_j,    w_j = (m_j + s^2)^-2,

whose variance is 2/sum w_j k_j (Searle, Casella & McCulloch 1992, section 6.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import fdtrc

from mtu_cli.files.points import Points
from mtu_cli.model.geometry import DIMENSIONS
from mtu_cli.model.measured import roundings
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.family import ENDLESS
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.resolution import hidden

Kind = Literal["circle", "sphere", "length"]
Origin = Literal["repeats", "form"]
FEWEST = 3
"""Degrees of freedom from which on repeats are preferred to the form."""
ITERATIONS = 200
NOTHING_MM = 1e-9
"""A scatter below a picometre is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointScatter:
    """Variance of a measured coordinate, mm^2, half the variance of that estimate (`spread`), and
    the degrees of freedom behind it; `rounding`, mm^2, is what the last digit hides of it.
    """

    variance: float
    spread: float
    dof: float
    origin: Origin
    rounding: float = 0.0

    @property
    def s(self) -> float:
        """The standard deviation, mm."""
        return sqrt(self.variance + self.rounding)

    def added(self, u: float, dof: float, sensitivity: float, repeats: int) -> tuple[float, float]:
        """u and effective dof (JCGM 100, eq. (G.2b), never fewer than the least of both) with
        `sensitivity` (s^2/`repeats` + rounding) added to u^2: the sum of the squared gradients in
        the coordinates.
        """
        share = sensitivity / repeats
        total = u**2 + share * self.variance + sensitivity * self.rounding
        if self.variance == 0:
            return sqrt(total), dof
        spread = u**4 / dof + share**2 * self.spread
        return sqrt(total), max(total**2 / spread, min(dof, self.dof))


class Ring(NamedTuple):
    """A circle or sphere in one visit after the correction, the figure `of` (kind, id, operation).

    `residuals` (n,) mm, unit vectors `normals` (n, 3) from the centre, in the plane of a circle,
    modelled covariance `K` (n, n) of the points along them, mm^2, with degrees of freedom
    `dof`.
    """

    of: tuple[Kind, str, str]
    calibrated: bool
    residuals: FloatArray
    normals: FloatArray
    K: FloatArray
    dof: float


class FormTest(NamedTuple):
    """The mean form of a ring over its `visits`: root mean square `rms` of its residuals, and
    `explained`, that of the model's uncertainty and the points' scatter, mm; F, p.
    """

    kind: Kind
    id: str
    operation: str
    calibrated: bool
    visits: int
    rms: float
    explained: float
    F: float
    p: float


def point_scatter(
    points: Points, corrected: FloatArray, rings: Sequence[Ring]
) -> PointScatter | None:
    """The scatter from repeats, where these have `FEWEST` degrees of freedom, else from `rings`:
    of each in the space that the fit leaves, one square a direction of K.
    """
    r = float(roundings(points).max())
    _, operation = operations_of(points)
    cell = (operation.astype(np.int64) * len(points.parts) + points.part) * len(points.features)
    code = np.unique(cell + points.feature, return_inverse=True)[1].reshape(-1)
    squares = []
    for values in corrected.T:
        finite = np.isfinite(values)
        group, value = code[finite], values[finite]
        count = np.bincount(group)
        deviation = value - (np.bincount(group, value) / np.maximum(count, 1))[group]
        repeated = count > 1
        sums = np.bincount(group, deviation**2)[repeated]
        squares.append(np.array([sums, count[repeated] - 1.0, np.zeros(len(sums))]))
    repeats = np.concatenate(squares, axis=1)
    if repeats[1].sum() >= FEWEST:
        return estimate(repeats, "repeats", r)
    squares = [np.zeros((3, 0))]
    for ring in rings:
        Q = ring_space(ring.normals, ring.of[0])
        modelled, vectors = np.linalg.eigh(Q.T @ ring.K @ Q)
        each: FloatArray = (vectors.T @ Q.T @ ring.residuals) ** 2
        squares.append(np.array([each, np.ones(len(each)), np.clip(modelled, 0.0, None)]))
    form = np.concatenate(squares, axis=1)
    return estimate(form, "form", r) if form.size else None


def ring_space(normals: FloatArray, kind: Kind) -> FloatArray:
    """Orthonormal (n, n - d - 1): the directions of n residuals that centre and radius of a circle
    (d = 2) or sphere (3) leave; `normals` (n, 3): see `Ring`.
    """
    # Vectors of a circle lie in its plane: two of the four columns and the ones have rank 3.
    U: FloatArray = np.linalg.svd(np.column_stack([normals, np.ones(len(normals))]))[0]
    return U[:, DIMENSIONS[kind] + 1 :]


def estimate(squares: FloatArray, origin: Origin, r: float = 0.0) -> PointScatter:
    """s^2 of `squares` (3, j): sums of squares mm^2, their degrees of freedom and modelled
    variances; `r` is the variance of a coordinate by its last digit.
    """
    sums, dof, modelled = squares
    least, excess = NOTHING_MM**2, sums - dof * modelled
    variance = max(float(excess.sum() / dof.sum()), 0.0)
    for _ in range(ITERATIONS):
        weights = np.maximum(modelled + variance, least) ** -2
        last, variance = variance, max(float(weights @ excess / (weights @ dof)), 0.0)
        if abs(variance - last) <= 1e-10 * max(variance, least):
            break
    variance = variance if variance > least else 0.0
    return PointScatter(
        variance=variance,
        spread=1.0 / float(np.maximum(modelled + variance, least) ** -2 @ dof),
        dof=float(dof.sum()),
        origin=origin,
        rounding=float(hidden(variance, r)) if r > least else 0.0,
    )


def form_tests(
    rings: Sequence[Ring], scatter: PointScatter | None, r: float = 0.0
) -> tuple[FormTest, ...]:
    """The mean form of every ring against what the model and the scatter of points explain.

    F = |e|^2 / tr V of the mean residuals e (k,) of n visits, V = K + s^2/n, with what the last
    digit hides of s in all of them alike (`r` is the variance of a coordinate by it). What the
    machine did is taken to be in all visits, so that K is that of one. Both mean squares have the
    degrees of freedom of a sum of unequal variances (Box 1954; Welch-Satterthwaite). s is the
    scatter of the repeats or else of the visits about their mean, so that the form itself takes no
    part in it; a ring of one visit without either is not tested.
    """
    result = []
    for of in dict.fromkeys(ring.of for ring in rings):
        visits = [ring for ring in rings if ring.of == of]
        Q = ring_space(np.mean([ring.normals for ring in visits], axis=0), of[0])
        n, k = len(visits), Q.shape[1]
        e = np.array([ring.residuals for ring in visits]) @ Q
        mean = e.mean(axis=0)
        if scatter is not None and scatter.origin == "repeats":
            s2, dof = scatter.variance, scatter.dof
        else:
            dof = (n - 1.0) * k
            s2 = float(((e - mean) ** 2).sum()) / max(dof, 1.0)
        if not k * dof:
            continue
        noise = max(s2 / n + float(hidden(s2, r)), NOTHING_MM**2)
        V = Q.T @ np.mean([ring.K for ring in visits], axis=0) @ Q + noise * np.eye(k)
        total = float(np.trace(V))
        df1 = total**2 / float((V**2).sum())
        parts = np.maximum([total - k * noise, k * noise], 0.0)
        df2 = welch_satterthwaite(parts, np.array([min(ring.dof for ring in visits), dof]))
        F = float(mean @ mean) / total
        p = float(fdtrc(df1, min(max(df2, 1.0), ENDLESS), F))
        sizes = float(np.sqrt(mean @ mean / k)), float(np.sqrt(total / k))
        calibrated = any(ring.calibrated for ring in visits)
        result.append(FormTest(*of, calibrated, n, *sizes, F, p))
    return tuple(result)
