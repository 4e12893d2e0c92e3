"""Constructions that their nominal places do not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.model.geometry import GeometryError, fit_circle, fit_plane, fit_sphere
from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-6
"""Angle in rad, or share of a length, below which nominals count as parallel or the same:
they are written with a few decimals.
"""

Places = Sequence[FloatArray]
Test = Callable[[Places], str | None]


def degenerate(do: str, variant: str, places: Places) -> str | None:
    """What is wrong with a construction at its nominal places, in words; None if it is sound.

    `places`: its inputs with m = 1.
    """
    test = _TESTS.get((do, variant))
    return None if test is None else test([place[..., 0] for place in places])


def _norm(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def _coincide(places: Places) -> str | None:
    first, second = places
    extent = max(1.0, float(np.abs(places).max()))
    return "the two points coincide" if _norm(second - first) <= SAME * extent else None


def _no_vector(at: int) -> Test:
    def test(places: Places) -> str | None:
        return "the vector has no length" if _norm(places[at]) == 0 else None

    return test


def _on_a_line(points: Places) -> str | None:
    u, v = points[1] - points[0], points[2] - points[0]
    if _norm(np.cross(u, v)) <= SAME * _norm(u) * _norm(v) or _norm(u - v) <= SAME * _norm(u):
        return "the points lie on a line"
    return None


def _plane(points: Places) -> str | None:
    if len(points) == 3:
        return _on_a_line(points)
    return _unfit(lambda: fit_plane(np.array(points)))


def _circle(points: Places) -> str | None:
    if len(points) == 3:
        return _on_a_line(points)
    return _unfit(lambda: fit_circle(np.array(points)))


def _sphere(points: Places) -> str | None:
    return _unfit(lambda: fit_sphere(np.array(points)))


def _unfit(fit: Callable[[], object]) -> str | None:
    try:
        fit()
    except GeometryError as error:
        return str(error)
    return None


def _parallel(what: str) -> Test:
    def test(places: Places) -> str | None:
        away = np.cross(places[0][1], places[1][1])
        return f"the {what} are parallel" if _norm(away) <= SAME else None

    return test


def _along_plane(places: Places) -> str | None:
    line, plane = places
    if abs(float(line[1] @ plane[1])) <= SAME:
        return "the line is parallel to the plane"
    return None


def _no_corner(places: Places) -> str | None:
    normals = np.array([place[1] for place in places])
    if abs(float(np.linalg.det(normals))) <= SAME:
        return "the three planes meet in no single point"
    return None


def _glancing(places: Places) -> str | None:
    _, vector, plane = places
    if abs(float(vector @ plane[1])) <= SAME * _norm(vector):
        return "the vector is parallel to the plane"
    return None


def _upright(places: Places) -> str | None:
    plane, line, _ = places
    if _norm(np.cross(plane[1], line[1])) <= SAME:
        return "the line is perpendicular to the plane"
    return None


def _no_angle(places: Places) -> str | None:
    return "a vector has no length" if min(map(_norm, places)) == 0 else None


_TESTS: dict[tuple[str, str], Test] = {
    ("unit_v", "vector"): _no_vector(0),
    ("unit_v", "points"): _coincide,
    ("line", "points"): _coincide,
    ("line", "planes"): _parallel("planes"),
    ("aline", ""): _no_vector(1),
    ("plane", "vector"): _no_vector(1),
    ("plane", "points"): _plane,
    ("circle", ""): _circle,
    ("sphere", "free"): _sphere,
    ("sphere", "radius"): lambda places: _sphere(places[:-1]),
    ("point", "line"): _along_plane,
    ("point", "planes"): _no_corner,
    ("project", ""): _glancing,
    ("distance", "lines"): _parallel("lines"),
    ("angle", ""): _no_angle,
    ("frame", ""): _upright,
}
