"""Least-squares planes, circles and spheres of many trials at once.

Distances are orthogonal, as in `mtu_cli.model.geometry`, which fits one set of points. Here
`points` are n arrays (3, m). Gauss-Newton starts from the figure of the nominal points: every step
is one linear least-squares problem for each trial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.model.geometry import GeometryError, fit_circle, fit_plane, fit_sphere
from mtu_cli.model.graph.constructions import cross, dot, norm, tangents, unit
from mtu_cli.stats.least_squares import FloatArray, batched_least_squares

TURNS = 20
"""Steps after which the normal is taken from singular values: where the points are about as
thick as they are wide, steps hardly lead anywhere.
"""
ITERATIONS = 100
HALVINGS = 12
STEP = 1e-13
"""A step that moves the figure by this share of the points' extent ends the iteration."""
UPHILL = 1e-9
"""Share by which the sum of squares may grow in a step, by rounding."""
LINE = 1e-6
"""Share of the sides of a triangle below which it is a line."""

Points = Sequence[FloatArray]
Construction = Callable[..., FloatArray | tuple[FloatArray, ...]]


def plane_through(nominal: Points) -> Construction:
    """Exact of three points, their normal being (P2 - P1) x (P3 - P1): Stryczek, eqs. (20)-(27).

    Raises GeometryError, as the others do, for nominal points that do not determine it.
    """
    points = _nominal_points(nominal)
    if len(points) == 3:
        return _plane3
    fit_plane(points)
    normal = _orientation(points)
    return lambda *points: plane(points, normal)


def circle_through(nominal: Points) -> Construction:
    """Centre and radius, exact of three points."""
    points = _nominal_points(nominal)
    if len(points) == 3:
        return circumcircle
    normal, start = _orientation(points), fit_circle(points)
    return lambda *points: circle(points, normal, start.centre, _of_all(points[0], start.radius))


def sphere_through(nominal: Points) -> Construction:
    """Centre and radius, exact of four points."""
    start = fit_sphere(_nominal_points(nominal))
    if len(nominal) == 4:
        return circumsphere
    return lambda *points: sphere(points, start.centre, _of_all(points[0], start.radius))


def sphere_of_radius_through(nominal: Points) -> Construction:
    """The centre; the last input is the radius."""
    centre = fit_sphere(_nominal_points(nominal[:-1])).centre
    return lambda *places: sphere(places[:-1], centre, places[-1], free=False)[0]


def _of_all(point: FloatArray, radius: float) -> FloatArray:
    return np.full(point.shape[1:], radius)


def _nominal_points(nominal: Points) -> FloatArray:
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


def _plane3(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    return np.stack([first, unit(cross(second - first, third - first))])


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances.

    `reference` (3,) says which of both normals is meant, and is where the iteration starts:
    n <- n - t, with t across n from t.q = n.q of the points q about their centroid.
    """
    centre = points[0] + points[1]
    for point in points[2:]:
        centre += point
    centre /= len(points)
    q = np.stack([point - centre for point in points], axis=1)
    start = np.broadcast_to(reference[:, None], centre.shape)
    normal, least = unit(start), (STEP * np.abs(q).max(axis=(0, 1))) ** 2
    for _ in range(TURNS):
        first, second = tangents(normal)
        X = np.stack([dot(q, first[:, None]), dot(q, second[:, None])])
        angles, explained = batched_least_squares(X, dot(q, normal[:, None]))
        normal = unit(normal - angles[0] * first - angles[1] * second)
        turns = explained > least
        if not turns.any():
            break
    else:
        normal[:, turns] = np.linalg.svd(q[:, :, turns].transpose(2, 1, 0))[2][:, 2].T
    normal *= np.where(dot(normal, start) < 0, -1.0, 1.0)
    return np.stack([centre, normal])


def circle(
    points: Points, reference: FloatArray, centre: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the circle of least squared distances, from a nominal
    normal (3,), `centre` (3,) and `radius` (m,).

    It lies in the least-squares plane of the points; distances are those within the plane.
    """
    middle, normal = plane(points, reference)
    first, second = tangents(normal)
    q = np.stack([point - middle for point in points], axis=1)
    flat = np.stack([dot(q, first[:, None]), dot(q, second[:, None])])
    away = centre[:, None] - middle
    start = np.stack([dot(away, first), dot(away, second)])
    (x, y), radius = round_figure(flat, start, radius, free=True)
    return middle + x * first + y * second, radius


def sphere(
    points: Points, centre: FloatArray, radius: FloatArray, *, free: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere of least squared distances, from a nominal
    `centre` (3,) and a `radius` (m,), which stays where it is not `free`.
    """
    q = np.stack([point - points[0] for point in points], axis=1)
    found, radius = round_figure(q, centre[:, None] - points[0], radius, free=free)
    return points[0] + found, radius


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


def round_figure(
    q: FloatArray, centre: FloatArray, radius: FloatArray, *, free: bool
) -> tuple[FloatArray, FloatArray]:
    """Centre (d, m) and radius (m,) of least squared distances |q - c| - r of points q (d, n, m).

    Gauss-Newton from `centre` (d, m) and `radius` (m,), with shorter steps where a whole one leads
    up; the radius stays where it is not `free`. A trial that does not come to an end is nan.
    """
    d, n, m = q.shape
    X = np.ones((d + free, n, m))
    least = (STEP * np.ptp(q, axis=1).max(axis=0)) ** 2
    away = q - centre[:, None]
    far = np.sqrt(dot(away, away))
    moves = np.ones(m, bool)
    for _ in range(ITERATIONS):
        X[:d] = away / far
        step, explained = batched_least_squares(X, far - radius)
        bound = (1.0 + UPHILL) * np.einsum("nm,nm->m", far - radius, far - radius) + least
        for _ in range(HALVINGS):
            after = centre + step[:d], radius + step[d] if free else radius
            away = q - after[0][:, None]
            far = np.sqrt(dot(away, away))
            uphill = ~(np.einsum("nm,nm->m", far - after[1], far - after[1]) <= bound)
            if not uphill.any():
                break
            step[:, uphill] *= 0.5
        centre, radius = after
        moves = explained > least
        if not moves.any():
            break
    return np.where(moves, np.nan, centre), np.where(moves, np.nan, radius)
