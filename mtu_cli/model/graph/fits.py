"""Least-squares planes, circles and spheres of many trials at once.

Distances are orthogonal, as in `mtu_cli.model.geometry`, which fits one set of points. Here
`points` are n arrays (3, m). Iterations start from the figure of the nominal points.

A circle (d = 2) or sphere (d = 3) is P(q) = A |q|^2 + b.q + D = 0 with |b|^2 - 4 A D = 1: its
radius is 1/(2|A|), its centre -b/(2A), and the distance of a point from it is
2P/(1 + sqrt(1 + 4AP)) (Chernov & Lesort 2005, J. Math. Imaging Vision 23, 239-252). Of a short
arc the centre and radius are known badly and together, A, D and the direction of b well and
apart. The origin is the first point, where |b| is close to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.geometry import GeometryError, fit_circle, fit_plane, fit_sphere
from mtu_cli.model.graph.vectors import across, cross, dot, norm, tangents, unit, vector_dot
from mtu_cli.stats.least_squares import FloatArray, batched_least_squares

TURNS = 20
"""Steps after which the normal is taken from singular values: where the points are about as
thick as they are wide, steps hardly lead anywhere.
"""
SLICE = 4096
"""Trials fitted together: few enough for the cache, many enough for what every call costs."""
ITERATIONS = 200
HALVINGS = 12
STEP = 1e-13
"""A step that moves the figure by this share of the points' extent ends the iteration."""
UPHILL = 1e-9
"""Share by which the sum of squares may grow in a step, by rounding."""
LINE = 1e-6
"""Share of the sides of a triangle below which it is a line."""

Points = Sequence[FloatArray]
Nominal = Sequence[FloatArray]
Construction = Callable[..., FloatArray | tuple[FloatArray, ...]]


def plane_through(nominal: Nominal) -> Construction:
    """Exact of three points, their normal being (P2 - P1) x (P3 - P1): Stryczek, eqs. (20)-(27).

    Raises GeometryError, as the others do, for nominal points that do not determine it.
    """
    points = _nominal_points(nominal)
    if len(points) == 3:
        return _plane3
    fit_plane(points)
    normal = _orientation(points)
    return in_slices(lambda *points: (plane(points, normal),))


def circle_through(nominal: Nominal) -> Construction:
    """Centre and radius, exact of three points."""
    points = _nominal_points(nominal)
    if len(points) == 3:
        return circumcircle
    start = circle_start(points, _orientation(points))
    return in_slices(lambda *points: circle(points, start))


def sphere_through(nominal: Nominal) -> Construction:
    """Centre and radius, exact of four points."""
    start = sphere_start(_nominal_points(nominal))
    return in_slices(lambda *points: sphere(points, start))


def sphere_of_radius_through(nominal: Nominal) -> Construction:
    """The centre; the last input is the radius."""
    start = sphere_start(_nominal_points(nominal[:-1]))
    return in_slices(lambda *places: (sphere_of_radius(places[:-1], places[-1], start),))


def _nominal_points(nominal: Nominal) -> FloatArray:
    """Nominal points as (n, 3), of which three are no line."""
    points = np.array([place[:, 0] for place in nominal])
    if len(points) == 3:
        u, v = points[1:] - points[0]
        area, first, second, third = map(np.linalg.norm, (np.cross(u, v), u, v, u - v))
        if area <= LINE * first * second or third <= LINE * first:
            raise GeometryError("the points lie on a line")
    return points


def _orientation(points: FloatArray) -> FloatArray:
    """Unit normal (3,) of the nominal points, on the side of (P2 - P1) x (P3 - P1).

    Where these three lie on a line, the next point that does not decides.
    """
    sides = np.cross((points[1] - points[0])[None], points[2:] - points[0])
    sizes = np.linalg.norm(sides, axis=1)
    side = sides[int(np.argmax(sizes > LINE * sizes.max()))]
    _, _, Vt = np.linalg.svd(points - points.mean(axis=0))
    normal: FloatArray = Vt[2] if Vt[2] @ side >= 0 else -Vt[2]
    return normal


def in_slices(fit: Callable[..., tuple[FloatArray, ...]]) -> Construction:
    """The same fit, a slice of the trials at a time."""

    def sliced(*places: FloatArray) -> tuple[FloatArray, ...]:
        starts = range(0, places[0].shape[-1], SLICE)
        parts = [fit(*(place[..., at : at + SLICE] for place in places)) for at in starts]
        return tuple(np.concatenate(items, axis=-1) for items in zip(*parts, strict=True))

    return sliced


def _plane3(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    return np.stack([first, unit(cross(second - first, third - first))])


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances.

    `reference` (3,) says which of both normals is meant, and is where the iteration starts.
    """
    centre = points[0] + points[1]
    for point in points[2:]:
        centre += point
    centre /= len(points)
    q = np.stack([point - centre for point in points], axis=1)
    return np.stack([centre, _normal(q, reference)])


def _normal(q: FloatArray, reference: FloatArray) -> FloatArray:
    """Unit normal (3, m) of points q (3, n, m) about their centroid: the direction of the least
    sum of squares, by Gauss-Newton, n <- n - t with t across n from t.q = n.q.
    """
    start = np.broadcast_to(reference[:, None], (3, q.shape[2]))
    normal = unit(start)
    active = np.arange(q.shape[2])
    least = (STEP * np.abs(q).max(axis=(0, 1))) ** 2
    for _ in range(TURNS):
        points, now = q[:, :, active], normal[:, active]
        directions = tangents(now)
        X = np.stack([dot(points, item[:, None]) for item in directions])
        angles, explained = batched_least_squares(X, dot(points, now[:, None]))
        normal[:, active] = unit(now - angles[0] * directions[0] - angles[1] * directions[1])
        active = active[~(explained <= least[active])]
        if not len(active):
            break
    else:
        normal[:, active] = _least_direction(q[:, :, active])
    normal *= np.where(dot(normal, start) < 0, -1.0, 1.0)
    return normal


def _least_direction(q: FloatArray) -> FloatArray:
    """The last right singular vector (3, m) of the points q (3, n, m) of every trial."""
    direction = np.full((3, q.shape[2]), np.nan)
    finite = np.isfinite(q).all(axis=(0, 1))
    _, _, Vt = np.linalg.svd(q[:, :, finite].transpose(2, 1, 0), full_matrices=True)
    direction[:, finite] = Vt[:, 2].T
    return direction


@dataclass(frozen=True, slots=True)
class Start:
    """Centre (d,), from the first point, and radius of the figure of the nominal points, mm."""

    centre: FloatArray
    radius: float


@dataclass(frozen=True, slots=True)
class CircleStart(Start):
    """Along `axis` (3,), where the points reach farthest, and across it in their plane of unit
    `normal` (3,).
    """

    normal: FloatArray
    axis: FloatArray


def circle_start(points: FloatArray, normal: FloatArray) -> CircleStart:
    """Of the circle of nominal points (n, 3), whose plane has the unit `normal` (3,)."""
    fit = fit_circle(points)
    _, _, Vt = np.linalg.svd(points - points.mean(axis=0))
    away = fit.centre - points[0]
    centre = np.array([away @ Vt[0], away @ np.cross(normal, Vt[0])])
    return CircleStart(centre, fit.radius, normal, Vt[0])


def sphere_start(points: FloatArray) -> Start:
    """Of the sphere of nominal points (n, 3)."""
    fit = fit_sphere(points)
    return Start(fit.centre - points[0], fit.radius)


def circle(points: Points, start: CircleStart) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the circle of least squared distances.

    It lies in the least-squares plane of the points; distances are those within the plane.
    """
    middle, normal = plane(points, start.normal)
    first = unit(across(np.broadcast_to(start.axis[:, None], normal.shape), normal))
    second = cross(normal, first)
    away = _from_first(points)
    flat = np.stack([dot(away, first[:, None]), dot(away, second[:, None])])
    radius = np.full(flat.shape[2], start.radius)
    figure = round_figure(flat, start.centre, radius, free=True)
    x, y = figure.centre
    height = dot(middle - points[0], normal)
    return points[0] + x * first + y * second + height * normal, figure.radius


def sphere(points: Points, start: Start) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere of least squared distances."""
    if len(points) == 4:
        return circumsphere(*points)
    q = _from_first(points)
    figure = round_figure(q, start.centre, np.full(q.shape[2], start.radius), free=True)
    return points[0] + figure.centre, figure.radius


def sphere_of_radius(points: Points, radius: FloatArray, start: Start) -> FloatArray:
    """Centre (3, m) of the sphere of given radius (m,), by least squared distances."""
    figure = round_figure(_from_first(points), start.centre, radius, free=False)
    return points[0] + figure.centre


def _from_first(points: Points) -> FloatArray:
    """Points (3, n, m) from the first of them."""
    return np.stack([point - points[0] for point in points], axis=1)


def circumcircle(a: FloatArray, b: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the circle through three points.

    With u = b - a, v = c - a and w = u x v the centre is
    a + (|u|^2 v x w + |v|^2 w x u) / (2 |w|^2).
    """
    u, v = b - a, c - a
    w = cross(u, v)
    away = dot(u, u) * cross(v, w) + dot(v, v) * cross(w, u)
    away /= 2.0 * dot(w, w)
    return a + away, norm(away)


def circumsphere(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere through four points.

    With u = b - a, v = c - a, w = d - a the centre is
    a + (|u|^2 v x w + |v|^2 w x u + |w|^2 u x v) / (2 u.(v x w)).
    """
    u, v, w = b - a, c - a, d - a
    first = cross(v, w)
    away = dot(u, u) * first + dot(v, v) * cross(w, u) + dot(w, w) * cross(u, v)
    away /= 2.0 * dot(u, first)
    return a + away, norm(away)


@dataclass(frozen=True, slots=True)
class Figure:
    """`A` (m,), `n` (d, m) the unit vector of b, `D` (m,)."""

    A: FloatArray
    n: FloatArray
    D: FloatArray

    @property
    def size(self) -> FloatArray:
        """|b| (m,): distance of the centre from the origin, over the radius."""
        return np.asarray(np.sqrt(1.0 + 4.0 * self.A * self.D))

    @property
    def radius(self) -> FloatArray:
        """(m,)."""
        return np.asarray(0.5 / np.abs(self.A))

    @property
    def centre(self) -> FloatArray:
        """(d, m)."""
        return np.asarray(-(self.size / (2.0 * self.A)) * self.n)

    def distances(self, q: FloatArray, squares: FloatArray) -> FloatArray:
        """Of points q (d, n, m) of |q|^2 (n, m) from the figure, (n, m); on one side positive."""
        P = self.A * squares
        P += self.D
        P += vector_dot(q, self.size * self.n)
        s = P * (4.0 * self.A)
        s += 1.0
        np.sqrt(s, out=s)
        s += 1.0
        P *= 2.0
        P /= s
        return P

    def moved(self, step: FloatArray) -> Figure:
        """Further by steps (k, m) of D, of the turns of n and, of a free radius, of A."""
        d = len(self.n)
        A = self.A + step[d] if len(step) > d else self.A
        n = self.n + sum(
            angle * direction for angle, direction in zip(step[1:d], tangents(self.n), strict=True)
        )
        return Figure(A, n / np.sqrt(vector_dot(n, n)), self.D + step[0])

    def at(self, members: NDArray[np.bool_]) -> Figure:
        """Of some of the trials."""
        return Figure(self.A[members], self.n[:, members], self.D[members])


def round_figure(q: FloatArray, centre: FloatArray, radius: FloatArray, *, free: bool) -> Figure:
    """The circle or sphere of least squared distances of points q (d, n, m), the first at 0.

    The iteration (Gauss-Newton, with shorter steps where a whole one leads up) starts from
    `centre` (d,) and `radius` (m,), which stays where it is not `free`. Every trial ends by
    itself; one that does not come to an end is nan.
    """
    d, _, m = q.shape
    A = 0.5 / radius
    away = float(np.linalg.norm(centre))
    start = np.broadcast_to((-centre / away)[:, None], (d, m))
    found = Figure(A, start.copy(), A * away**2 - 0.25 / A)
    least = (STEP * np.abs(q).max(axis=(0, 1))) ** 2
    active = np.arange(m)
    now, squares = found, vector_dot(q, q)
    gaps, before = now.distances(q, squares), np.full(m, np.nan)
    for _ in range(ITERATIONS):
        X = _design(q, squares, now, gaps, free=free)
        step, explained = batched_least_squares(X, -gaps)
        now, gaps = _downhill(q, squares, now, step, gaps, least)
        # What the next step would explain, as they become shorter.
        more = explained * np.fmin(explained / before, 1.0) > least
        found.A[active], found.n[:, active], found.D[active] = now.A, now.n, now.D
        if not more.any():
            return found
        if not more.all():
            active, now, gaps, least = active[more], now.at(more), gaps[:, more], least[more]
            q, squares, explained = q[:, :, more], squares[:, more], explained[more]
        before = explained
    found.A[active] = np.nan
    return found


def _design(
    q: FloatArray, squares: FloatArray, at: Figure, gaps: FloatArray, *, free: bool
) -> FloatArray:
    """Derivatives (k, n, m) of the distances by D, by turning n, and by A where it is `free`.

    From P = d + A d^2: with s = 1 + 2 A d, dd/dP = 1/s and dd/dA = (|q|^2 - d^2)/s; the length
    of b follows A and D: d|b| = 2 (A dD + D dA)/|b|.
    """
    size, directions = at.size, tangents(at.n)
    along = vector_dot(q, (2.0 / size) * at.n)
    X = np.empty((len(q) + free, *gaps.shape))
    np.multiply(at.A, along, out=X[0])
    X[0] += 1.0
    for row, direction in zip(X[1:], directions, strict=False):
        vector_dot(q, size * direction, out=row)
    if free:
        np.multiply(gaps, gaps, out=X[-1])
        np.subtract(squares, X[-1], out=X[-1])
        along *= at.D
        X[-1] += along
    s = 2.0 * at.A * gaps
    s += 1.0
    X /= s
    return X


def _downhill(
    q: FloatArray,
    squares: FloatArray,
    at: Figure,
    step: FloatArray,
    gaps: FloatArray,
    rounding: FloatArray,
) -> tuple[Figure, FloatArray]:
    """The figure a step further, and the distances from it. A step that makes their squares
    larger is halved.
    """
    bound = (1.0 + UPHILL) * np.einsum("nm,nm->m", gaps, gaps) + rounding
    for _ in range(HALVINGS):
        after = at.moved(step)
        gaps = after.distances(q, squares)
        steep = ~(np.einsum("nm,nm->m", gaps, gaps) <= bound)
        if not steep.any():
            break
        step[:, steep] *= 0.5
    return after, gaps
