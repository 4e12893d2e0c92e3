"""Vectors and constructions of many trials at once: arrays (3, m), one row a coordinate.

A construction takes the arrays of its input places and gives those of its outputs; lines and planes
are (2, 3, m): a point and a unit vector. Rows of a coordinate are contiguous, so that every
operation runs at the speed of the cache. The tests at the end see nominal places (.., ), where a
construction determines nothing if they pass.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-6
"""Angle in rad, or share of a length, below which nominals count as parallel or the same:
they are written with a few decimals.
"""


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """a.b over the first axis: (m,) of vectors (3, m); of points (d, n, m) with vectors (d, 1, m)
    or each other, (n, m).
    """
    total: FloatArray = a[0] * b[0]
    part = np.empty_like(total)
    for left, right in zip(a[1:], b[1:], strict=True):
        np.multiply(left, right, out=part)
        total += part
    return total


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, (3, m)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    part = np.empty(out.shape[1:])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        np.multiply(a[j], b[k], out=out[i])
        np.multiply(a[k], b[j], out=part)
        out[i] -= part
    return out


def norm(a: FloatArray) -> FloatArray:
    """|a|, (m,)."""
    square = dot(a, a)
    return np.sqrt(square, out=square)


def unit(a: FloatArray) -> FloatArray:
    """a/|a|, (3, m)."""
    found: FloatArray = a / norm(a)
    return found


def across(a: FloatArray, direction: FloatArray) -> FloatArray:
    """The part of a across a unit vector: a - (a.d) d, (3, m)."""
    out = dot(a, direction) * direction
    return np.subtract(a, out, out=out)


def tangents(n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3, m) across unit vectors n (3, m) and each other."""
    # The axis that stands most across.
    axis = (np.argmin(np.abs(n), axis=0) == np.arange(3)[:, None]).astype(np.float64)
    first = unit(cross(n, axis))
    return first, cross(n, first)


def middle(first: FloatArray, second: FloatArray) -> FloatArray:
    total = first + second
    total *= 0.5
    return total


def between(first: FloatArray, second: FloatArray) -> FloatArray:
    return second - first


def unit_between(first: FloatArray, second: FloatArray) -> FloatArray:
    return unit(second - first)


def distance(first: FloatArray, second: FloatArray) -> FloatArray:
    return norm(second - first)


def hole(
    x1: FloatArray, x2: FloatArray, y1: FloatArray, y2: FloatArray, *z: FloatArray
) -> FloatArray:
    out = np.empty((3, len(x1)))
    np.add(x1, x2, out=out[0])
    np.add(y1, y2, out=out[1])
    out[:2] *= 0.5
    out[2] = z[0] if z else 0.0
    return out


def ball(*places: FloatArray) -> FloatArray:
    """((x1 + x2)/2, (y1 + y2)/2, z1 - r): Stryczek, Figures 5 and 6."""
    out = hole(*places[:5])
    out[2] -= places[5]
    return out


def line_through(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.stack([first, unit(second - first)])


def meet(first: FloatArray, second: FloatArray) -> FloatArray:
    """The line of two planes; its point is the one nearest to the first plane's point.

    p = p1 + t (n2 - (n1.n2) n1), which stays in plane 1; t from n2.(p - p2) = 0.
    """
    direction = cross(first[1], second[1])
    inward = across(second[1], first[1])
    share = dot(second[1], second[0] - first[0])
    share /= dot(inward, second[1])
    return np.stack([first[0] + share * inward, unit(direction)])


def along(point: FloatArray, vector: FloatArray) -> FloatArray:
    """A line along a vector; also the plane that has it for its normal."""
    return np.stack([point, unit(vector)])


def three_planes(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """p = p1 + ((n2.d2) n3 x n1 + (n3.d3) n1 x n2) / (n1.(n2 x n3)), d_i = p_i - p1."""
    first = cross(b[1], c[1])
    point = dot(b[1], b[0] - a[0]) * cross(c[1], a[1])
    point += dot(c[1], c[0] - a[0]) * cross(a[1], b[1])
    point /= dot(a[1], first)
    point += a[0]
    return point


def direction(figure: FloatArray) -> FloatArray:
    return np.asarray(figure[1])


def project(point: FloatArray, vector: FloatArray, plane: FloatArray) -> FloatArray:
    """Along the vector onto the plane: p + v (n.(p0 - p)) / (n.v)."""
    share = dot(plane[1], plane[0] - point)
    share /= dot(plane[1], vector)
    return np.asarray(point + share * vector)


def pierce(line: FloatArray, plane: FloatArray) -> FloatArray:
    """The point of a line in a plane: Stryczek, eq. (30)."""
    return project(line[0], line[1], plane)


def foot_in_plane(point: FloatArray, plane: FloatArray) -> FloatArray:
    return np.asarray(point - dot(plane[1], point - plane[0]) * plane[1])


def foot_on_line(point: FloatArray, line: FloatArray) -> FloatArray:
    return np.asarray(line[0] + dot(line[1], point - line[0]) * line[1])


def to_line(point: FloatArray, line: FloatArray) -> FloatArray:
    return norm(across(point - line[0], line[1]))


def to_plane(point: FloatArray, plane: FloatArray) -> FloatArray:
    return np.abs(dot(plane[1], point - plane[0]))


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
    away = point - frame[0]
    return np.stack([dot(frame[i], away) for i in (1, 2, 3)])


def _length_of(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def coincide(first: FloatArray, second: FloatArray) -> bool:
    extent = max(1.0, float(np.abs([first, second]).max()))
    return _length_of(second - first) <= SAME * extent


def no_length(*vectors: FloatArray) -> bool:
    return min(map(_length_of, vectors)) == 0.0


def no_direction(point: FloatArray, vector: FloatArray) -> bool:
    return no_length(vector)


def parallel(first: FloatArray, second: FloatArray, *_: FloatArray) -> bool:
    return _length_of(np.cross(first[1], second[1])) <= SAME


def glancing(point: FloatArray, vector: FloatArray, plane: FloatArray) -> bool:
    return abs(float(vector @ plane[1])) <= SAME * _length_of(vector)


def no_piercing(line: FloatArray, plane: FloatArray) -> bool:
    return glancing(line[0], line[1], plane)


def no_corner(*planes: FloatArray) -> bool:
    return abs(float(np.linalg.det(np.array([plane[1] for plane in planes])))) <= SAME
