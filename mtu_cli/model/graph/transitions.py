"""The transitions: one entry of a registry for every use of one.

A place is an array of m trials: a coordinate or constant (m,), a point or vector (3, m), a line or
plane (2, 3, m), a frame (4, 3, m) of its origin and its axes. What an entry computes takes the
arrays of its inputs in the order of the file and gives those of its outputs.
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
from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph import constructions as make
from mtu_cli.model.graph.constructions import cross, dot, norm, unit
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PLAIN, internal

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
    nominal inputs, where it starts. `unit` of what it makes: "same" as its first input, a "product"
    of both, or that of a "formula". `guard`: a test of nominal inputs (.., ), and what is wrong
    where they pass it: they determine nothing.
    """

    takes: str
    makes: str
    construct: Callable[..., Any] | None = None
    unit: str = "mm"
    guard: tuple[Callable[..., Any], str] | None = None
    fit: Callable[[Sequence[FloatArray]], make.Construction] | None = None


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
PARALLEL_PLANES = (parallel, "the planes are parallel")
PARALLEL_LINES = (parallel, "the lines are parallel")
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
            lambda x1, x2, y1, y2, z1, r: make.hole(x1, x2, y1, y2, z1 - r),
        ),
    ),
    "hole": (Use("2 coordinate x, 2 coordinate y, optional constant", "point", make.hole),),
    "circle": (Use("3 or more of point", "point, optional constant", fit=make.circle_through),),
    "sphere": (
        Use("4 or more of point", "point, optional constant", fit=make.sphere_through),
        Use("4 or more of point, constant", "point", fit=make.sphere_of_radius_through),
    ),
    "line": (
        Use("point, point", "line", lambda p, q: make.along(p, q - p), guard=ONE_POINT),
        Use("plane, plane", "line", make.meet, guard=PARALLEL_PLANES),
    ),
    "aline": (Use("point, vector", "line", make.along, guard=AIMLESS),),
    "plane": (
        Use("3 or more of point", "plane", fit=make.plane_through),
        Use("point, vector", "plane", make.along, guard=AIMLESS),
    ),
    "point": (
        # Stryczek, eq. (30).
        Use("line, plane", "point", lambda g, e: make.project(g[0], g[1], e), guard=NO_PIERCING),
        Use("plane, plane, plane", "point", make.three_planes, guard=NO_CORNER),
    ),
    "normal": (Use("plane", "vector", lambda plane: plane[1], unit="1"),),
    "direction": (Use("line", "vector", lambda line: line[1], unit="1"),),
    "project": (Use("point, vector, plane", "point", make.project, guard=GLANCING),),
    "per_proj": (
        Use("point, plane", "point", lambda p, e: p - dot(e[1], p - e[0]) * e[1]),
        Use("point, line", "point", lambda p, g: g[0] + dot(g[1], p - g[0]) * g[1]),
    ),
    "distance": (
        Use("point, point", "constant", lambda p, q: norm(q - p)),
        Use("point, line", "constant", lambda p, g: norm(make.across(p - g[0], g[1]))),
        Use("point, plane", "constant", lambda p, e: np.abs(dot(e[1], p - e[0]))),
        Use("line, line", "constant", make.between_lines, guard=PARALLEL_LINES),
    ),
    "angle": (Use("vector, vector", "constant", make.angle, unit="rad", guard=SHORT),),
    "frame": (Use("plane, line, point", "frame", make.frame, guard=UPRIGHT),),
    "transform": (Use("frame, point", "point", make.transform),),
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
        self.construct = use.construct if use.fit is None else use.fit(inputs)
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
