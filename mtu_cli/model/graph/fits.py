"""Planes, circles and spheres of many trials at once: exact, or of least squared distances.

Distances are orthogonal, as in `mtu_cli.model.geometry`, which fits one set of points: the nominal
ones, where the iteration for circles and spheres starts. Here `points` are n arrays (3, m).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.model.geometry import fit_circle, fit_plane, fit_sphere, round_figure
from mtu_cli.model.graph.constructions import along, cross, dot, norm, tangents
from mtu_cli.stats.least_squares import FloatArray

LINE = 1e-6
"""Share of the longest of several triangles' areas below which one is a line."""

Points = Sequence[FloatArray]
Construction = Callable[..., FloatArray | tuple[FloatArray, ...]]


def plane_through(nominal: Points) -> Construction:
    """Exact of three points, their normal being (P2 - P1) x (P3 - P1): Stryczek, eqs. (20)-(27).

    Raises GeometryError, as the others do, for nominal points that do not determine it.
    """
    normal = _orientation(_stacked(nominal))
    if len(nominal) == 3:
        return lambda a, b, c: along(a, cross(b - a, c - a))
    return lambda *points: plane(points, normal)


def circle_through(nominal: Points) -> Construction:
    """Centre and radius, exact of three points."""
    points = _stacked(nominal)
    normal, start = _orientation(points), fit_circle(points)
    if len(points) == 3:
        return circumcircle
    return lambda *points: circle(points, normal, start.centre, start.radius)


def sphere_through(nominal: Points) -> Construction:
    """Centre and radius."""
    start = fit_sphere(_stacked(nominal))
    return lambda *points: sphere(points, start.centre, start.radius)


def sphere_of_radius_through(nominal: Points) -> Construction:
    """The centre; the last input is the radius."""
    centre = fit_sphere(_stacked(nominal[:-1])).centre
    return lambda *places: sphere(places[:-1], centre, places[-1], free=False)[0]


def _stacked(nominal: Points) -> FloatArray:
    """Nominal points as (n, 3)."""
    return np.array([place[:, 0] for place in nominal])


def _orientation(points: FloatArray) -> FloatArray:
    """Unit normal (3,) of the nominal points, on the side of (P2 - P1) x (P3 - P1).

    Where these three lie on a line, the next point that does not decides.
    """
    normal = fit_plane(points).normal
    sides = np.cross((points[1] - points[0])[None], points[2:] - points[0])
    sizes = np.linalg.norm(sides, axis=1)
    side = sides[int(np.argmax(sizes > LINE * sizes.max()))]
    return normal if normal @ side >= 0 else -normal


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances; `reference` (3,)
    says which of both normals is meant.
    """
    q = np.stack(points, axis=1)
    centre = q.mean(axis=1)
    away = (q - centre[:, None]).transpose(2, 1, 0)
    normal = np.linalg.svd(away, full_matrices=False)[2][:, 2].T
    return np.stack([centre, np.where(reference @ normal < 0, -normal, normal)])


def circle(
    points: Points, reference: FloatArray, centre: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the circle of least squared distances, from a nominal
    normal (3,), `centre` (3,) and `radius`.

    It lies in the least-squares plane of the points; distances are those within the plane.
    """
    middle, normal = plane(points, reference)
    first, second = tangents(normal)
    q = np.stack([point - middle for point in points], axis=1)
    flat = np.stack([dot(q, first[:, None]), dot(q, second[:, None])])
    away = centre[:, None] - middle
    start = np.stack([dot(away, first), dot(away, second)])
    (x, y), result = round_figure(flat, start, radius, free=True)
    return middle + x * first + y * second, result


def sphere(
    points: Points, centre: FloatArray, radius: float | FloatArray, *, free: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere of least squared distances, from a nominal
    `centre` (3,) and a `radius`, which stays where it is not `free`.
    """
    q = np.stack([point - points[0] for point in points], axis=1)
    result, radius = round_figure(q, centre[:, None] - points[0], radius, free=free)
    return points[0] + result, radius


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
