"""Rings that stay oval once the modelled error is taken off.

A squareness or a scale of one axis makes an ellipse of a circle and leaves its diameter. Points
that are strained by a symmetric E (3, 3) lie r u'E u beyond a ring of radius r, u the unit vectors
from its centre. Least squares beside centre and radius gives the strain f (p,) that a ring shows
(2 of a circle, 5 of a sphere) from the residuals in the mean over its parts and repeats, with
covariance V: the machine's model, what points scatter or the ring is out of true otherwise, and a
plane through points of different heights, which cuts a round bore askew. Of no strain, with nu
degrees of freedom of V, T^2 / p, T^2 = f' V^-1 f, is F(p, nu) where these are of the one variance
of points, and (nu - p + 1) T^2 / (nu p) is F(p, nu - p + 1) where they are of the model, which may
have each direction by itself (Hotelling 1931). What the machine did is taken to be in all parts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.correct.quantity import Kind
from mtu_cli.analyses.correct.scatter import (
    NOTHING_MM,
    PointScatter,
    pooled,
    squares_along,
)
from mtu_cli.analyses.correct.strain import Levers, along, contrasts, levers_of, matrix, with_u
from mtu_cli.model.geometry import DIMENSIONS
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.joint_test import hotelling_p, p_of_square, squared_distance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, Unit

TOLD = 0.2
"""Share of a difference of diameters that a ring may not show where it is named."""
MOST = 0.5
"""Share of T^2 that a cause must take away where it is named: what a ring shows of it by chance is
not what makes it oval. Of causes at right angles no other takes more.
"""
PLACE_DIGITS = 2
"""Of a unit vector: points that agree in these stand at one place."""
FEWEST_PLACES = 9
"""Of a sphere: centre, radius and five strains."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A ring, summed over `count` visits of the same points: `radius` mm, `residuals` (n,) mm, unit
    vectors `away` (n, 3) from the centre, in the plane of a circle, modelled covariance `K` (n, n)
    along them, mm^2, with degrees of freedom `dof` (the fewest); the unit vector `bore` (3,) along
    which a circle is taken to be bored (0: not known), and the strain `oblique` (6,) of that where
    the plane of the points cuts it askew. It is `judged` where it is calibrated, and its points
    show a strain: a ring of no calibration may be as oval as it was made.
    """

    kind: Kind
    id: str
    operation: str
    radius: float
    residuals: FloatArray
    away: FloatArray
    K: FloatArray
    dof: float
    bore: FloatArray
    oblique: FloatArray
    judged: bool
    count: int = 1

    def and_another(self, other: Shape) -> Shape:
        """Both together."""
        return replace(
            self,
            radius=self.radius + other.radius,
            residuals=self.residuals + other.residuals,
            away=self.away + other.away,
            K=self.K + other.K,
            dof=min(self.dof, other.dof),
            oblique=self.oblique + other.oblique,
            judged=self.judged or other.judged,
            count=self.count + other.count,
        )

    def mean(self) -> Shape:
        """The mean over the visits."""
        n = self.count
        return replace(
            self,
            radius=self.radius / n,
            residuals=self.residuals / n,
            away=self.away / np.linalg.norm(self.away, axis=1, keepdims=True),
            K=self.K / n,
            oblique=self.oblique / n,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Oval:
    """A ring that is oval beyond its uncertainty: `longer` (mm, of diameters, standard uncertainty
    `u`) along one direction than along another. With a `shear` these are the sum and the difference
    of the two `axes`, the other way round where its `size` (rad) is negative; else the first of
    them and the second. Without `axes` none of these can be told: `longer` is of the longest and
    the shortest.
    """

    kind: Kind
    id: str
    operation: str
    axes: tuple[str, str] | None
    shear: bool
    longer: float
    u: float
    size: float

    @property
    def label(self) -> str:
        """Its name, with that of the operation."""
        return " ".join(filter(None, [self.operation, self.id]))

    @property
    def directions(self) -> tuple[str, str] | None:
        """Along the first it is longer than along the second."""
        if self.axes is None or not self.shear:
            return self.axes
        a, b = self.axes
        plus, minus = f"{a} + {b}", f"{a} - {b}"
        return (plus, minus) if self.size > 0 else (minus, plus)

    @property
    def effect(self) -> str | None:
        """What the model may lack."""
        return None if self.axes is None else "squareness" if self.shear else "scale"

    @property
    def sorted_axes(self) -> tuple[str, ...]:
        """The axes that the effect is of."""
        return tuple(sorted(self.axes or ()))

    @property
    def unit(self) -> Unit:
        """Of the effect."""
        return PARAMETER_UNITS["arcsec" if self.shear else "um/m"]

    @property
    def u_size(self) -> float:
        """Standard uncertainty of `size`, the same share of it as of `longer`."""
        return abs(self.size) * self.u / self.longer if self.longer else 0.0


def ovals(shapes: Iterable[Shape], scatter: PointScatter | None) -> tuple[Oval, ...]:
    """The rings whose strain is told from 0 at 95 % of all together (Bonferroni). Of a ring that
    lacks points in some visits those are taken that most visits have.
    """
    most: dict[tuple[Kind, str, str], Shape] = {}
    for own in (shape for shape in shapes if shape.judged):
        known = most.get((own.kind, own.id, own.operation))
        if known is None or (known.count, len(known.away)) < (own.count, len(own.away)):
            most[own.kind, own.id, own.operation] = own
    alpha = (1 - PROBABILITY) / max(len(most), 1)
    judged = (_judged(own, scatter) for own in most.values())
    return tuple(oval for p, oval in judged if p < alpha)


def _judged(shape: Shape, scatter: PointScatter | None) -> tuple[float, Oval]:
    """p of no strain, and what it is."""
    mean = shape.mean()
    nothing = Oval(
        kind=shape.kind, id=shape.id, operation=shape.operation, axes=None, shear=False,
        longer=0.0, u=0.0, size=0.0,
    )  # fmt: skip
    levers = levers_of(mean.kind, mean.radius, mean.away)
    scattered = None if levers is None else _scatter_of(mean, levers, scatter)
    if levers is None or scattered is None or _is_bare(mean):
        return 1.0, nothing
    variance, scatter_dof = scattered
    B = levers.estimator
    by_points = variance * (B @ B.T)
    oblique = levers.basis.T @ mean.oblique
    by_model = B @ mean.K @ B.T
    f, V = B @ mean.residuals, by_model + by_points + np.outer(oblique, oblique)
    square = squared_distance(f, V)
    if square is None:
        return 1.0, nothing
    of_model = np.maximum(np.diag(by_model), 0.0)
    P = _p(square, of_model, np.diag(by_points), (mean.dof, scatter_dof))
    return P, _named(nothing, mean, levers.basis, f, V)


def _is_bare(mean: Shape) -> bool:
    """Whether the places of a sphere leave nothing beside its strain to tell its form by: what
    nobody can hold it against is named by chance.
    """
    places = len(np.unique(np.round(mean.away, PLACE_DIGITS), axis=0))
    return mean.kind == "sphere" and places <= FEWEST_PLACES


def _p(square: float, model: FloatArray, points: FloatArray, dof: tuple[float, float]) -> float:
    """Of T^2, with the variances (p,) of both kinds and their degrees of freedom."""
    each = [
        welch_satterthwaite(np.array(v), np.array(dof)) for v in zip(model, points, strict=True)
    ]
    least = int(np.argmin(each))
    of_model = model[least] ** 2 / dof[0] > points[least] ** 2 / dof[1]
    return (hotelling_p if of_model else p_of_square)(square, len(model), each[least])


def _scatter_of(
    mean: Shape, levers: Levers, scatter: PointScatter | None
) -> tuple[float, float] | None:
    """Variance of the residuals of a mean over visits beside its strain, mm^2, and its degrees of
    freedom: by what is left of them, or the repeats' scatter where that is more. None where
    nothing tells it.
    """
    found = []
    if levers.rest.shape[1]:
        rest = pooled([squares_along(levers.rest, mean.residuals, mean.K)], "form")
        found.append((rest.variance, rest.dof))
    if scatter is not None and scatter.origin == "repeats":
        found.append((scatter.variance / mean.count, scatter.dof))
    if not found:
        return None
    variance, dof = max(found)
    return max(variance, NOTHING_MM**2), dof


def _named(nothing: Oval, mean: Shape, basis: FloatArray, f: FloatArray, V: FloatArray) -> Oval:
    """The surest of the differences of diameters that the ring shows, and that are most of what
    there is (`MOST`).
    """
    best, found, d = 0.0, None, 2 * mean.radius
    for i, j, shear, contrast in contrasts():
        own = basis.T @ contrast
        if contrast @ contrast - own @ own > TOLD**2 * (contrast @ contrast):
            continue
        size, u = with_u(contrast, basis, f, V)
        if abs(size) > best * u and _share(own, f, V) >= MOST:
            best, found = abs(size) / u, (i, j, shear, size, u)
    if found is None:
        # Of the diameters that there are: a circle's lie in its plane.
        own = np.linalg.svd(mean.away)[2][: DIMENSIONS[mean.kind]]
        e = np.linalg.eigh(own @ matrix(basis @ f) @ own.T)[1].T @ own
        size, u = with_u(along(e[-1]) - along(e[0]), basis, f, V)
        return replace(nothing, longer=d * size, u=d * u)
    i, j, shear, size, u = found
    if size < 0 and not shear:
        i, j, size = j, i, -size
    return replace(
        nothing, axes=(AXES[i], AXES[j]), shear=shear, longer=d * abs(size), u=d * u, size=size,
    )  # fmt: skip


def _share(g: FloatArray, f: FloatArray, V: FloatArray) -> float:
    """Share of T^2 of a strain f (p,) that a multiple of g (p,), which one cause alone makes, takes
    away at most: (g'V^-1 f)^2 / (g'V^-1 g f'V^-1 f).
    """
    # By correlations, as T^2 itself is had (`squared_distance`), which is had of V here.
    unit = np.sqrt(np.diag(V))
    values, vectors = np.linalg.eigh(V / np.outer(unit, unit))
    a, b = (vectors.T @ (x / unit) / np.sqrt(values) for x in (g, f))
    return float((a @ b) ** 2 / ((a @ a) * (b @ b)))
