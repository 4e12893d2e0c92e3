"""The transitions: from the arrays of their input places to those of their outputs.

Each takes the inputs in the order of the file and returns all that the transition can put out;
a place is (m,), (3, m), (2, 3, m) or (4, 3, m), see the package.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mtu_cli.model.graph import fits
from mtu_cli.model.graph.vectors import across, cross, dot, norm, unit
from mtu_cli.stats.least_squares import FloatArray

Outputs = tuple[FloatArray, ...]
Construction = Callable[..., Outputs]


def _displace(start: FloatArray, by: FloatArray) -> Outputs:
    return (start + by,)


def _middle(first: FloatArray, second: FloatArray) -> Outputs:
    found = first + second
    found *= 0.5
    return (found,)


def _vector(first: FloatArray, second: FloatArray) -> Outputs:
    return (second - first,)


def _unit_vector(vector: FloatArray) -> Outputs:
    return (unit(vector),)


def _unit_between(first: FloatArray, second: FloatArray) -> Outputs:
    return (unit(second - first),)


def _ratio(value: FloatArray, factor: FloatArray) -> Outputs:
    return (value * factor,)


def _length(vector: FloatArray) -> Outputs:
    return (norm(vector),)


def _between(first: FloatArray, second: FloatArray) -> Outputs:
    return (norm(second - first),)


def _ball(
    x1: FloatArray, x2: FloatArray, y1: FloatArray, y2: FloatArray, z1: FloatArray, r: FloatArray
) -> Outputs:
    """((x1 + x2)/2, (y1 + y2)/2, z1 - r): Stryczek, Figures 5 and 6."""
    out = np.empty((3, len(x1)))
    np.add(x1, x2, out=out[0])
    np.add(y1, y2, out=out[1])
    out[:2] *= 0.5
    np.subtract(z1, r, out=out[2])
    return (out,)


def _hole(
    x1: FloatArray, x2: FloatArray, y1: FloatArray, y2: FloatArray, *z: FloatArray
) -> Outputs:
    out = np.empty((3, len(x1)))
    np.add(x1, x2, out=out[0])
    np.add(y1, y2, out=out[1])
    out[:2] *= 0.5
    out[2] = z[0] if z else 0.0
    return (out,)


def _line_through(first: FloatArray, second: FloatArray) -> Outputs:
    return (np.stack([first, unit(second - first)]),)


def _meet(first: FloatArray, second: FloatArray) -> Outputs:
    """The line of two planes; its point is the one nearest to the first plane's point.

    p = p1 + t (n2 - (n1.n2) n1), which stays in plane 1; t from n2.(p - p2) = 0.
    """
    direction = cross(first[1], second[1])
    inward = across(second[1], first[1])
    share = dot(second[1], second[0] - first[0])
    share /= dot(inward, second[1])
    return (np.stack([first[0] + share * inward, unit(direction)]),)


def _along(point: FloatArray, vector: FloatArray) -> Outputs:
    """A line along a vector; also the plane that has it for its normal."""
    return (np.stack([point, unit(vector)]),)


def _plane3(first: FloatArray, second: FloatArray, third: FloatArray) -> Outputs:
    """Normal (P2 - P1) x (P3 - P1): Stryczek, eqs. (20)-(27)."""
    return (np.stack([first, unit(cross(second - first, third - first))]),)


def _pierce(line: FloatArray, plane: FloatArray) -> Outputs:
    """The point of a line in a plane: Stryczek, eq. (30)."""
    return _project(line[0], line[1], plane)


def _three_planes(a: FloatArray, b: FloatArray, c: FloatArray) -> Outputs:
    """p = p1 + ((n2.d2) n3 x n1 + (n3.d3) n1 x n2) / (n1.(n2 x n3)), d_i = p_i - p1."""
    first = cross(b[1], c[1])
    found = dot(b[1], b[0] - a[0]) * cross(c[1], a[1])
    found += dot(c[1], c[0] - a[0]) * cross(a[1], b[1])
    found /= dot(a[1], first)
    found += a[0]
    return (found,)


def _direction(figure: FloatArray) -> Outputs:
    return (figure[1],)


def _project(point: FloatArray, vector: FloatArray, plane: FloatArray) -> Outputs:
    """Along the vector onto the plane: p + v (n.(p0 - p)) / (n.v)."""
    share = dot(plane[1], plane[0] - point)
    share /= dot(plane[1], vector)
    return (point + share * vector,)


def _foot_in_plane(point: FloatArray, plane: FloatArray) -> Outputs:
    height = dot(plane[1], point - plane[0])
    return (point - height * plane[1],)


def _foot_on_line(point: FloatArray, line: FloatArray) -> Outputs:
    along = dot(line[1], point - line[0])
    return (line[0] + along * line[1],)


def _to_line(point: FloatArray, line: FloatArray) -> Outputs:
    return (norm(across(point - line[0], line[1])),)


def _to_plane(point: FloatArray, plane: FloatArray) -> Outputs:
    height = dot(plane[1], point - plane[0])
    return (np.abs(height, out=height),)


def _between_lines(first: FloatArray, second: FloatArray) -> Outputs:
    """Along the common perpendicular: |(p2 - p1).(d1 x d2)| / |d1 x d2|."""
    normal = unit(cross(first[1], second[1]))
    gap = dot(second[0] - first[0], normal)
    return (np.abs(gap, out=gap),)


def _angle(first: FloatArray, second: FloatArray) -> Outputs:
    """atan2(|a x b|, a.b), which keeps its digits near 0 and pi."""
    return (np.arctan2(norm(cross(first, second)), dot(first, second)),)


def _frame(plane: FloatArray, line: FloatArray, point: FloatArray) -> Outputs:
    """z along the plane's normal, x along the line's projection, origin at the point."""
    z = plane[1]
    x = unit(across(line[1], z))
    return (np.stack([point, x, cross(z, x), z]),)


def _transform(frame: FloatArray, point: FloatArray) -> Outputs:
    away = point - frame[0]
    return (np.stack([dot(frame[i], away) for i in (1, 2, 3)]),)


def _circle3(*points: FloatArray) -> Outputs:
    return fits.circumcircle(*points)


CONSTRUCTIONS: dict[tuple[str, str], Construction] = {
    ("displace", "coordinate"): _displace,
    ("displace", "point"): _displace,
    ("middle", ""): _middle,
    ("vector", ""): _vector,
    ("unit_v", "vector"): _unit_vector,
    ("unit_v", "points"): _unit_between,
    ("ratio", "vector"): _ratio,
    ("ratio", "constant"): _ratio,
    ("length", "vector"): _length,
    ("length", "points"): _between,
    ("ball", ""): _ball,
    ("hole", ""): _hole,
    ("circle", ""): _circle3,
    ("line", "points"): _line_through,
    ("line", "planes"): _meet,
    ("aline", ""): _along,
    ("plane", "points"): _plane3,
    ("plane", "vector"): _along,
    ("point", "line"): _pierce,
    ("point", "planes"): _three_planes,
    ("normal", ""): _direction,
    ("direction", ""): _direction,
    ("project", ""): _project,
    ("per_proj", "plane"): _foot_in_plane,
    ("per_proj", "line"): _foot_on_line,
    ("distance", "points"): _between,
    ("distance", "line"): _to_line,
    ("distance", "plane"): _to_plane,
    ("distance", "lines"): _between_lines,
    ("angle", ""): _angle,
    ("frame", ""): _frame,
    ("transform", ""): _transform,
}
"""By transition and variant; `compute` and the fits that need a nominal are made per step."""
