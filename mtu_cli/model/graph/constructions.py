"""Vectors and constructions of many trials at once: arrays (3, m), one row a coordinate.

A construction takes the arrays of its input places and gives those of its outputs; lines and planes
are (2, 3, m): a point and a unit vector. Single operations stand in the registry itself.
Fits are of least squared orthogonal distances, as in `mtu_cli.model.geometry`, which fits one set
of points: the nominal ones, where the iteration for circles and spheres starts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.model.geometry import fit_circle, fit_plane, fit_sphere, round_figure
from mtu_cli.stats.least_squares import FloatArray


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """a.b over the first axis: (m,) of vectors (3, m); of points (d, n, m) with vectors (d, 1, m)
    or each other, (n, m).
    """
    total: FloatArray = a[0] * b[0]
    for left, right in zip(a[1:], b[1:], strict=True):
        total += left * right
    return total


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, (3, m)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i, ...])
    return out


def norm(a: FloatArray) -> FloatArray:
    """|a|, (m,)."""
    return np.sqrt(dot(a, a))


def unit(a: FloatArray) -> FloatArray:
    """a/|a|, (3, m)."""
    return a / norm(a)


def across(a: FloatArray, direction: FloatArray) -> FloatArray:
    """The part of a across a unit vector: a - (a.d) d, (3, m)."""
    return a - dot(a, direction) * direction


def tangents(n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3, m) across unit vectors n (3, m) and each other."""
    # The axis that stands most across.
    axis = (np.argmin(np.abs(n), axis=0) == np.arange(3)[:, None]).astype(np.float64)
    first = unit(cross(n, axis))
    return first, cross(n, first)


def hole(
    x1: FloatArray, x2: FloatArray, y1: FloatArray, y2: FloatArray, *z: FloatArray
) -> FloatArray:
    """((x1 + x2)/2, (y1 + y2)/2, z or 0)."""
    out = np.empty((3, len(x1)))
    np.add(x1, x2, out=out[0])
    np.add(y1, y2, out=out[1])
    out[:2] *= 0.5
    out[2] = z[0] if z else 0.0
    return out


def meet(first: FloatArray, second: FloatArray) -> FloatArray:
    """The line of two planes; its point is the one nearest to the first plane's point.

    p = p1 + t (n2 - (n1.n2) n1), which stays in plane 1; t from n2.(p - p2) = 0.
    """
    inward = across(second[1], first[1])
    share = dot(second[1], second[0] - first[0]) / dot(inward, second[1])
    return np.stack([first[0] + share * inward, unit(cross(first[1], second[1]))])


def along(point: FloatArray, vector: FloatArray) -> FloatArray:
    """A line along a vector; also the plane that has it for its normal."""
    return np.stack([point, unit(vector)])


def three_planes(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """p = p1 + ((n2.d2) n3 x n1 + (n3.d3) n1 x n2) / (n1.(n2 x n3)), d_i = p_i - p1."""
    point = dot(b[1], b[0] - a[0]) * cross(c[1], a[1])
    point += dot(c[1], c[0] - a[0]) * cross(a[1], b[1])
    return point / dot(a[1], cross(b[1], c[1])) + a[0]


def project(point: FloatArray, vector: FloatArray, plane: FloatArray) -> FloatArray:
    """Along the vector onto the plane: p + v (n.(p0 - p)) / (n.v)."""
    share = dot(plane[1], plane[0] - point) / dot(plane[1], vector)
    return point + share * vector


def between_lines(first: FloatArray, second: FloatArray) -> FloatArray:
    """Along the common perpendicular: |(p2 - p1).(d1 x d2)| / |d1 x d2|."""
    return np.abs(dot(second[0] - first[0], unit(cross(first[1], second[1]))))


def angle(first: FloatArray, second: FloatArray) -> FloatArray:
    """atan2(|a x b|, a.b), which keeps its digits near 0 and pi."""
    return np.arctan2(norm(cross(first, second)), dot(first, second))


def frame(plane: FloatArray, line: FloatArray, point: FloatArray) -> FloatArray:
    """z along the plane's normal, x along the line's projection, origin at the point."""
    z = plane[1]
    x = unit(across(line[1], z))
    return np.stack([point, x, cross(z, x), z])


def transform(frame: FloatArray, point: FloatArray) -> FloatArray:
    return np.stack([dot(axis, point - frame[0]) for axis in frame[1:]])


def rotation(frame: FloatArray, nominal: FloatArray) -> FloatArray:
    """Rotation (3, m) rad of a frame about its nominal axes: (1/2) sum a_i x b_i of nominal axes
    a_i and actual ones b_i, which is the axis times the sine of the angle.
    """
    axes = np.broadcast_to(nominal[1:], (3, 3, frame.shape[-1]))
    total = cross(axes[0], frame[1]) + cross(axes[1], frame[2]) + cross(axes[2], frame[3])
    return np.stack([dot(axis, 0.5 * total) for axis in axes])


# Planes, circles and spheres through n points, arrays (3, m) each: exact, or fitted.

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
    """Centre (3, m) and radius (m,), exact of three points.

    That of least squared distances lies in the least-squares plane of the points; distances are
    those within the plane.
    """
    places = _stacked(nominal)
    reference, start = _orientation(places), fit_circle(places)

    def circle(*points: FloatArray) -> tuple[FloatArray, FloatArray]:
        middle, normal = plane(points, reference)
        first, second = tangents(normal)
        q = np.stack([point - middle for point in points], axis=1)
        flat = np.stack([dot(q, first[:, None]), dot(q, second[:, None])])
        away = start.centre[:, None] - middle
        inside = np.stack([dot(away, first), dot(away, second)])
        (x, y), radius = round_figure(flat, inside, start.radius, free=True)
        return middle + x * first + y * second, radius

    return circumcircle if len(places) == 3 else circle


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
    _, normal, _ = fit_plane(points)
    sides = np.cross((points[1] - points[0])[None], points[2:] - points[0])
    sizes = np.linalg.norm(sides, axis=1)
    side = sides[int(np.argmax(sizes > LINE * sizes.max()))]
    return normal if normal @ side >= 0 else -normal


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances; `reference` (3,)
    selects one of both normals.
    """
    q = np.stack(points, axis=1)
    centre = q.mean(axis=1)
    away = (q - centre[:, None]).transpose(2, 1, 0)
    normal = np.linalg.svd(away, full_matrices=False)[2][:, 2].T
    return np.stack([centre, np.where(reference @ normal < 0, -normal, normal)])


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
