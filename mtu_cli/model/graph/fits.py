"""Least-squares planes, circles and spheres of many trials at once.

Distances are orthogonal, as in `mtu_cli.model.geometry`, which fits one set of points. Here
`points` are n arrays (3, m). Every sum runs over the few points, every array over the trials.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from mtu_cli.model.graph.vectors import across, cross, dot, norm, unit
from mtu_cli.stats.least_squares import FloatArray

ITERATIONS = 60
STEP = 1e-13
"""A step of this share of the points' extent ends the iteration."""

Points = Sequence[FloatArray]
Residuals = Callable[[FloatArray], tuple[list[FloatArray], list[FloatArray]]]


def centroid(points: Points) -> FloatArray:
    """Mean of the points, (3, m)."""
    total = points[0] + points[1]
    for point in points[2:]:
        total += point
    total /= len(points)
    return total


def plane(points: Points, reference: FloatArray) -> FloatArray:
    """Centroid and unit normal (2, 3, m) of the plane of least squared distances.

    The normal spans the smallest principal moment of S = sum q q'. It is found by inverse
    iteration, n <- adj(S) n: the adjugate exists where S^-1 does not (points that lie in one
    plane exactly), and the error falls by the ratio of the two smallest moments a step.
    `reference` (3,) says which of both normals is meant, and is where the iteration starts.
    """
    centre = centroid(points)
    S = _products([point - centre for point in points])
    A = _adjugate(S)
    start = np.broadcast_to(reference[:, None], centre.shape)
    normal = unit(start)
    for _ in range(ITERATIONS):
        turned = unit(_times(A, normal))
        turned *= np.where(dot(turned, start) < 0, -1.0, 1.0)
        step = float(np.max(np.abs(turned - normal), initial=0.0))
        normal = turned
        if not step > STEP:
            break
    else:
        normal[:] = np.nan
    return np.stack([centre, normal])


def circle(points: Points, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the circle of least squared distances.

    It lies in the least-squares plane of the points; distances are those within the plane.
    """
    centre, normal = plane(points, reference)
    first = unit(across(points[0] - centre, normal))
    second = cross(normal, first)
    flat = [np.stack([dot(point - centre, first), dot(point - centre, second)]) for point in points]
    found, radius = _round(flat)
    return centre + found[0] * first + found[1] * second, radius


def sphere(points: Points) -> tuple[FloatArray, FloatArray]:
    """Centre (3, m) and radius (m,) of the sphere of least squared distances."""
    centre = centroid(points)
    found, radius = _round([point - centre for point in points])
    return centre + found, radius


def sphere_of_radius(points: Points, radius: FloatArray) -> FloatArray:
    """Centre (3, m) of the sphere of given radius (m,), by least squared distances."""
    middle = centroid(points)
    q = [point - middle for point in points]
    centre = _algebraic(q)

    def residuals(found: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
        return _from_centre(q, found, radius)

    return middle + _gauss_newton(centre, residuals, _extent(q))


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


def _round(q: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Centre (d, m) and radius (m,) of points (d, m) about their centroid."""
    centre = _algebraic(q)
    mean = _sum(np.sqrt(_square(point - centre)) for point in q) / len(q)
    if len(q) == len(centre) + 1:
        # As many points as unknowns: the algebraic figure goes through all of them.
        return centre, mean

    def residuals(found: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
        rows, gaps = _from_centre(q, found[:-1], found[-1])
        ones = np.ones(gaps[0].shape)
        return [np.vstack([row, ones[None]]) for row in rows], gaps

    found = _gauss_newton(np.vstack([centre, mean[None]]), residuals, _extent(q))
    return found[:-1], found[-1]


def _from_centre(
    q: list[FloatArray], centre: FloatArray, radius: FloatArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Directions (d, m) from the centre to the points and their distances less the radius."""
    rows, gaps = [], []
    for point in q:
        away = point - centre
        distance = np.sqrt(_square(away))
        away /= distance
        distance -= radius
        rows.append(away)
        gaps.append(distance)
    return rows, gaps


def _gauss_newton(start: FloatArray, residuals: Residuals, extent: float) -> FloatArray:
    """The minimum of the summed squares, (k, m); nan where the steps do not end.

    Steps solve the normal equations of all trials at once; their right side is exact, so that
    the minimum is, whatever the steps lose.
    """
    found = start.copy()
    for _ in range(ITERATIONS):
        rows, gaps = residuals(found)
        right = _sum(row * gap for row, gap in zip(rows, gaps, strict=True))
        step = _solve(_products(rows), right)
        found += step
        if not float(np.max(np.abs(step), initial=0.0)) > STEP * extent:
            return found
    found[:] = np.nan
    return found


def _algebraic(q: list[FloatArray]) -> FloatArray:
    """Centre (d, m) of |p|^2 = 2 c.p + const about the centroid (Kasa 1976)."""
    squares = [_square(point) for point in q]
    right = _sum(point * square for point, square in zip(q, squares, strict=True))
    found: FloatArray = 0.5 * _solve(_products(q), right)
    return found


def _sum(arrays: Iterable[FloatArray]) -> FloatArray:
    first, *rest = arrays
    for item in rest:
        first = first + item
    return first


def _square(a: FloatArray) -> FloatArray:
    found: FloatArray = np.einsum("dm,dm->m", a, a)
    return found


def _extent(q: list[FloatArray]) -> float:
    return float(max(np.max(np.abs(point)) for point in q))


def _products(rows: list[FloatArray]) -> FloatArray:
    """sum row row', (k, k, m)."""
    k, m = rows[0].shape
    out = np.zeros((k, k, m))
    for i in range(k):
        for j in range(i, k):
            for row in rows:
                out[i, j] += row[i] * row[j]
            out[j, i] = out[i, j]
    return out


def _solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """x (k, m) of A x = b, A (k, k, m) positive definite: Gauss without pivoting."""
    A, x = A.copy(), np.array(b)
    k = len(x)
    for i in range(k):
        for j in range(i + 1, k):
            share = A[j, i] / A[i, i]
            for c in range(i + 1, k):
                A[j, c] -= share * A[i, c]
            x[j] -= share * x[i]
    for i in reversed(range(k)):
        for j in range(i + 1, k):
            x[i] -= A[i, j] * x[j]
        x[i] /= A[i, i]
    return x


def _adjugate(S: FloatArray) -> FloatArray:
    """adj(S) (3, 3, m) of symmetric S: cross products of its rows."""
    return np.stack([cross(S[1], S[2]), cross(S[2], S[0]), cross(S[0], S[1])])


def _times(A: FloatArray, v: FloatArray) -> FloatArray:
    found: FloatArray = np.einsum("ijm,jm->im", A, v)
    return found
