"""Least-squares planes, circles and spheres of many trials at once.

Distances are orthogonal, as in `mtu_cli.model.geometry`, which fits one set of points. Here
`points` are n arrays (3, m). Iterations start from the figure of the nominal points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.geometry import fit_circle, fit_sphere
from mtu_cli.model.graph.round_fits import STEP, round_figure
from mtu_cli.model.graph.vectors import across, cross, dot, norm, tangents, unit
from mtu_cli.stats.least_squares import FloatArray, batched_least_squares

TURNS = 20
"""Steps after which the normal is taken from singular values: where the points are about as
thick as they are wide, steps hardly lead anywhere.
"""

SLICE = 4096
"""Trials fitted together: few enough for the cache, many enough for what every call costs."""

Points = Sequence[FloatArray]
Fit = Callable[..., tuple[FloatArray, ...]]


def in_slices(fit: Fit) -> Fit:
    """The same fit, a slice of the trials at a time."""

    def sliced(*places: FloatArray) -> tuple[FloatArray, ...]:
        starts = range(0, places[0].shape[-1], SLICE)
        parts = [fit(*(place[..., at : at + SLICE] for place in places)) for at in starts]
        return tuple(np.concatenate(items, axis=-1) for items in zip(*parts, strict=True))

    return sliced


def centroid(points: Points) -> FloatArray:
    """Mean of the points, (3, m)."""
    total = points[0] + points[1]
    for point in points[2:]:
        total += point
    total /= len(points)
    return total


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances.

    `reference` (3,) says which of both normals is meant, and is where the iteration starts.
    """
    centre = centroid(points)
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
    found = np.full((3, q.shape[2]), np.nan)
    finite = np.isfinite(q).all(axis=(0, 1))
    _, _, Vt = np.linalg.svd(q[:, :, finite].transpose(2, 1, 0), full_matrices=True)
    found[:, finite] = Vt[:, 2].T
    return found


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
    away = np.stack([point - points[0] for point in points], axis=1)
    flat = np.stack([dot(away, first[:, None]), dot(away, second[:, None])])
    radius = np.full(flat.shape[2], start.radius)
    found = round_figure(flat, start.centre, radius, free=True)
    x, y = found.centre()
    height = dot(middle - points[0], normal)
    return points[0] + x * first + y * second + height * normal, found.radius


def sphere(points: Points, start: Start) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere of least squared distances."""
    if len(points) == 4:
        return circumsphere(*points)
    q = np.stack([point - points[0] for point in points], axis=1)
    found = round_figure(q, start.centre, np.full(q.shape[2], start.radius), free=True)
    return points[0] + found.centre(), found.radius


def sphere_of_radius(points: Points, radius: FloatArray, start: Start) -> FloatArray:
    """Centre (3, m) of the sphere of given radius (m,), by least squared distances."""
    q = np.stack([point - points[0] for point in points], axis=1)
    return points[0] + round_figure(q, start.centre, radius, free=False).centre()


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
