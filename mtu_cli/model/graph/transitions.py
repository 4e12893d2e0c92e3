"""The transitions: one entry of a registry for every use of one, and the constructions behind them,
of many trials at once.

A place is an array of m trials: a coordinate or constant (m,), a point or vector (3, m), a line or
plane (2, 3, m) of a point and a unit vector, a frame (4, 3, m) of its origin and its axes; lengths
in mm, angles in rad. What an entry computes takes the arrays of its inputs in the order of the file
and gives those of its outputs.

Fits are of least squared orthogonal distances, as in `mtu_cli.model.geometry`, which fits one set
of points: the nominal ones, where the iteration for circles and spheres starts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from mtu_cli.findings import InputError
from mtu_cli.language import Node, evaluate, names
from mtu_cli.language.tree import Call, Name
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.model.geometry import GeometryError, fit_circle, fit_plane, fit_round, round_figure
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PLAIN, internal


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


def plane_through(nominal: FloatArray) -> Construction:
    """Exact of three points, their normal being (P2 - P1) x (P3 - P1): Stryczek, eqs. (20)-(27).

    Raises GeometryError, as the others do, for `nominal` points (n, 3) that do not determine it.
    """
    normal = _orientation(nominal)
    if len(nominal) == 3:
        return lambda a, b, c: along(a, cross(b - a, c - a))
    return lambda *points: plane(points, normal)


def circle_through(nominal: FloatArray) -> Construction:
    """Centre (3, m) and radius (m,), exact of three points.

    That of least squared distances lies in the least-squares plane of the points; distances are
    those within the plane.
    """
    reference, start = _orientation(nominal), fit_circle(nominal)

    def circle(*points: FloatArray) -> tuple[FloatArray, FloatArray]:
        middle, normal = plane(points, reference)
        first, second = tangents(normal)
        q = np.stack([point - middle for point in points], axis=1)
        flat = np.stack([dot(q, first[:, None]), dot(q, second[:, None])])
        away = start.centre[:, None] - middle
        inside = np.stack([dot(away, first), dot(away, second)])
        (x, y), radius = round_figure(flat, inside, start.radius, free=True)
        return middle + x * first + y * second, radius

    return circumcircle if len(nominal) == 3 else circle


def sphere_through(nominal: FloatArray) -> Construction:
    """Centre and radius."""
    start = fit_round(nominal)
    return lambda *points: sphere(points, start.centre, start.radius)


def sphere_of_radius_through(nominal: FloatArray) -> Construction:
    """The centre; the last input is the radius."""
    centre = fit_round(nominal).centre
    return lambda *places: sphere(places[:-1], centre, places[-1], free=False)[0]


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


Values = dict[str, FloatArray]
Unit = str | None
SAME = 1e-6
"""Angle in rad, or share of a length, below which nominals count as parallel or the same:
they are written with a few decimals.
"""
INVERSE = ("asin", "acos", "atan", "atan2")
_SLOT = re.compile(r"(?:(\d) or more of |(\d) |(optional) )?([a-z ]+?)(?: ([xyz]))?(?:, |$)")


@dataclass(frozen=True, slots=True)
class Use:
    """One use of a transition.

    `takes`, `makes`: its places in their order, as people read it: ``2 coordinate x, optional
    constant``. `construct`: the arrays of its outputs from those of its inputs; of a `fit` from the
    nominal points (n, 3), where it starts. `unit` of what it makes: "same" as its first input, a
    "product" of both, or that of a "formula". `guard`: a test of nominal inputs (.., ), and what is
    wrong where they pass it: they determine nothing.
    """

    takes: str
    makes: str
    construct: Callable[..., Any] | None = None
    unit: str = "mm"
    guard: tuple[Callable[..., Any], str] | None = None
    fit: Callable[[FloatArray], Construction] | None = None


def described(kind: str, axis: str | None) -> str:
    """A place in words: ``a coordinate x``."""
    return f"a {kind} {axis}" if axis else f"a {kind}"


def matches(side: str, places: Sequence[str]) -> bool:
    """Whether places, as `described`, are those that a use takes or makes.

    >>> matches("3 or more of point", ["a point"] * 4), matches("line or plane", ["a point"])
    (True, False)
    """
    return _pattern(side).fullmatch("".join(f"{place};" for place in places)) is not None


@cache
def _pattern(side: str) -> re.Pattern[str]:
    parts = []
    for least, count, optional, kinds, axis in _SLOT.findall(side):
        times = "?" if optional else f"{{{least},}}" if least else f"{{{count or 1}}}"
        kind = kinds.replace(" or ", "|")
        parts.append(rf"(?:a (?:{kind})(?: {axis or '[xyz]'})?;){times}")
    return re.compile("".join(parts))


def parallel(first: FloatArray, second: FloatArray, *_: FloatArray) -> bool:
    """Whether two lines or planes are, or one is perpendicular to the other."""
    return bool(norm(cross(first[1], second[1])) <= SAME)


def glancing(point: FloatArray, vector: FloatArray, plane: FloatArray) -> bool:
    """Whether a vector stays within a plane."""
    return bool(abs(dot(vector, plane[1])) <= SAME * norm(vector))


SHORT = (lambda *v: min(map(norm, v)) == 0.0, "a vector has no length")
AIMLESS = (lambda point, v: norm(v) == 0.0, "a vector has no length")
ONE_POINT = (
    lambda p, q: norm(q - p) <= SAME * max(1.0, np.abs([p, q]).max()),
    "the two points coincide",
)
UPRIGHT = (parallel, "the line is perpendicular to the plane")
NO_PIERCING = (lambda g, e: glancing(g[0], g[1], e), "the line is parallel to the plane")
GLANCING = (glancing, "the vector is parallel to the plane")
NO_CORNER = (
    lambda a, b, c: abs(dot(a[1], cross(b[1], c[1]))) <= SAME,
    "the three planes meet in no single point",
)

TRANSITIONS: dict[str, tuple[Use, ...]] = {
    "meas": (Use("", "coordinate"), Use("", "point")),
    "displace": (
        *(Use(f"coordinate {a}, constant", f"coordinate {a}", np.add) for a in "xyz"),
        Use("point, vector", "point", np.add),
    ),
    "middle": (Use("point, point", "point", lambda p, q: 0.5 * (p + q)),),
    "vector": (Use("point, point", "vector", lambda p, q: q - p),),
    "unit_v": (
        Use("vector", "vector", unit, unit="1", guard=SHORT),
        Use("point, point", "vector", lambda p, q: unit(q - p), unit="1", guard=ONE_POINT),
    ),
    "ratio": (
        Use("vector, constant", "vector", np.multiply, unit="product"),
        Use("constant, constant", "constant", np.multiply, unit="product"),
    ),
    "length": (
        Use("vector", "constant", norm, unit="same"),
        Use("point, point", "constant", lambda p, q: norm(q - p)),
    ),
    # Stryczek, Figures 5 and 6.
    "ball": (
        Use(
            "2 coordinate x, 2 coordinate y, coordinate z, constant",
            "point",
            lambda x1, x2, y1, y2, z1, r: hole(x1, x2, y1, y2, z1 - r),
        ),
    ),
    "hole": (Use("2 coordinate x, 2 coordinate y, optional constant", "point", hole),),
    "circle": (Use("3 or more of point", "point, optional constant", fit=circle_through),),
    "sphere": (
        Use("4 or more of point", "point, optional constant", fit=sphere_through),
        Use("4 or more of point, constant", "point", fit=sphere_of_radius_through),
    ),
    "line": (
        Use("point, point", "line", lambda p, q: along(p, q - p), guard=ONE_POINT),
        Use("plane, plane", "line", meet, guard=(parallel, "the planes are parallel")),
    ),
    "aline": (Use("point, vector", "line", along, guard=AIMLESS),),
    "plane": (
        Use("3 or more of point", "plane", fit=plane_through),
        Use("point, vector", "plane", along, guard=AIMLESS),
    ),
    "point": (
        # Stryczek, eq. (30).
        Use("line, plane", "point", lambda g, e: project(g[0], g[1], e), guard=NO_PIERCING),
        Use("plane, plane, plane", "point", three_planes, guard=NO_CORNER),
    ),
    "normal": (Use("plane", "vector", lambda plane: plane[1], unit="1"),),
    "direction": (Use("line", "vector", lambda line: line[1], unit="1"),),
    "project": (Use("point, vector, plane", "point", project, guard=GLANCING),),
    "per_proj": (
        Use("point, plane", "point", lambda p, e: p - dot(e[1], p - e[0]) * e[1]),
        Use("point, line", "point", lambda p, g: g[0] + dot(g[1], p - g[0]) * g[1]),
    ),
    "distance": (
        Use("point, point", "constant", lambda p, q: norm(q - p)),
        Use("point, line", "constant", lambda p, g: norm(across(p - g[0], g[1]))),
        Use("point, plane", "constant", lambda p, e: np.abs(dot(e[1], p - e[0]))),
        Use("line, line", "constant", between_lines, guard=(parallel, "the lines are parallel")),
    ),
    "angle": (Use("vector, vector", "constant", angle, unit="rad", guard=SHORT),),
    "frame": (Use("plane, line, point", "frame", frame, guard=UPRIGHT),),
    "transform": (Use("frame, point", "point", transform),),
    "compute": (
        Use("1 or more of constant or coordinate or point or vector", "constant", unit="formula"),
    ),
}


@dataclass(slots=True, kw_only=True)
class Step:
    """A transition of a graph whose places are known and of the right kinds.

    `index` in the file; `use` of those of its transition, `formula` that of compute. `construct`:
    what it computes, once it is `ready`.
    """

    index: int
    do: str
    use: Use
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    formula: Node | None = None
    construct: Callable[..., Any] | None = None

    def unit(self, units: dict[str, Unit]) -> Unit:
        """The unit of its output, by those of its inputs; None where they do not determine it.

        Raises InputError where dimensions of a formula do not agree.
        """
        if self.use.unit not in ("formula", "product"):
            return units[self.inputs[0]] if self.use.unit == "same" else self.use.unit
        product = Call("*", tuple(Name(name, 0) for name in self.inputs), 0)
        node = self.formula or product
        return formula_unit(node, {name: units[place_of(name)] for name in names(node)})

    def ready(self, nominal: Values) -> None:
        """Sets what it computes, with fits that start from, and are oriented as, the `nominal`
        inputs; adds its outputs at nominal to them.

        Raises GeometryError for nominal inputs that do not determine it.
        """
        use, inputs = self.use, [nominal[name] for name in self.inputs]
        if use.guard is not None and use.guard[0](*(place[..., 0] for place in inputs)):
            raise GeometryError(use.guard[1])
        self.construct = use.construct
        if use.fit is not None:
            self.construct = use.fit(np.array([place[:, 0] for place in inputs if place.ndim == 2]))
        made = {name: nominal[name] for name in self.inputs}
        with np.errstate(all="ignore"):
            self.run(made)
        if not all(np.isfinite(made[name]).all() for name in self.outputs):
            raise GeometryError("it is infinite or undefined")
        nominal.update({name: made[name] for name in self.outputs})

    def run(self, values: Values) -> None:
        """Adds the outputs to the inputs in `values`."""
        if self.formula is not None:
            m = values[self.inputs[0]].shape[-1]
            value = evaluate(self.formula, {x: _read(values, x) for x in names(self.formula)})
            values[self.outputs[0]] = np.broadcast_to(np.asarray(value, dtype=np.float64), m)
        elif self.construct is not None:
            made = self.construct(*(values[name] for name in self.inputs))
            outputs = made if isinstance(made, tuple) else (made,)
            values.update(zip(self.outputs, outputs, strict=False))


def place_of(name: str) -> str:
    """The place of a name in a formula: H1 of ``H1.x``."""
    return name.partition(".")[0]


def _read(values: Values, name: str) -> FloatArray:
    """The value of ``H1.x`` in a formula, or of the name of a whole place."""
    place, _, coordinate = name.partition(".")
    return values[place]["xyzijk".index(coordinate) % 3] if coordinate else values[place]


def formula_unit(node: Node, units: Mapping[str, Unit]) -> Unit:
    """The unit of a formula's value, or None where the units of its inputs do not determine it.

    Raises InputError where dimensions do not agree.
    """
    powers = {"mm": 1, "rad": 0, "1": 0}
    dimensions = {
        name: internal(powers[unit] if unit in powers else int(unit.removeprefix("mm^")))
        for name, unit in units.items()
        if unit is not None
    }
    algebra = Algebra(units=dimensions, factor=PLAIN)
    result = algebra.of(node)
    if algebra.faults:
        raise InputError(algebra.faults)
    if not result.known:
        return None
    exponent = int(result.exponents[0])
    if exponent:
        return "mm" if exponent == 1 else f"mm^{exponent}"
    circular = isinstance(node, Call) and node.function in INVERSE
    return "rad" if circular or {"rad"} <= {*units.values()} <= {"rad", "1"} else "1"
