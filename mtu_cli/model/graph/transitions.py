"""The transitions: one rule for every use of one, and what a graph's steps make at nominal.

A construction takes the arrays of its input places in the order of the file and gives those of
its outputs; a place is (m,), (3, m), (2, 3, m) or (4, 3, m), see the package. The signatures stand
in `files.graph_kinds`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.graph import Rounds, Step, place_of
from mtu_cli.files.graph_contract import Place
from mtu_cli.files.graph_kinds import COORDINATES, NAMED_BY_COORDINATE
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.language import Node, evaluate, names, to_text
from mtu_cli.language.derivative import derivatives
from mtu_cli.language.tree import Call, Name, rewritten, walk
from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph import fits
from mtu_cli.model.graph.fits import Construction, Nominal
from mtu_cli.model.graph.vectors import across, cross, dot, norm, unit
from mtu_cli.stats.least_squares import FloatArray

Values = dict[str, FloatArray]
Guard = tuple[str, Callable[..., bool]]

SAME = 1e-6
"""Angle in rad, or share of a length, below which nominals count as parallel or the same:
they are written with a few decimals.
"""
MOST_SWITCHES = 10
"""Steps of one formula whose combinations are all tried."""


def _middle(first: FloatArray, second: FloatArray) -> FloatArray:
    total = first + second
    total *= 0.5
    return total


def _vector(first: FloatArray, second: FloatArray) -> FloatArray:
    return second - first


def _unit_between(first: FloatArray, second: FloatArray) -> FloatArray:
    return unit(second - first)


def _distance(first: FloatArray, second: FloatArray) -> FloatArray:
    return norm(second - first)


def _hole(
    x1: FloatArray, x2: FloatArray, y1: FloatArray, y2: FloatArray, *z: FloatArray
) -> FloatArray:
    out = np.empty((3, len(x1)))
    np.add(x1, x2, out=out[0])
    np.add(y1, y2, out=out[1])
    out[:2] *= 0.5
    out[2] = z[0] if z else 0.0
    return out


def _ball(*places: FloatArray) -> FloatArray:
    """((x1 + x2)/2, (y1 + y2)/2, z1 - r): Stryczek, Figures 5 and 6."""
    out = _hole(*places[:5])
    out[2] -= places[5]
    return out


def _line_through(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.stack([first, unit(second - first)])


def _meet(first: FloatArray, second: FloatArray) -> FloatArray:
    """The line of two planes; its point is the one nearest to the first plane's point.

    p = p1 + t (n2 - (n1.n2) n1), which stays in plane 1; t from n2.(p - p2) = 0.
    """
    direction = cross(first[1], second[1])
    inward = across(second[1], first[1])
    share = dot(second[1], second[0] - first[0])
    share /= dot(inward, second[1])
    return np.stack([first[0] + share * inward, unit(direction)])


def _along(point: FloatArray, vector: FloatArray) -> FloatArray:
    """A line along a vector; also the plane that has it for its normal."""
    return np.stack([point, unit(vector)])


def _three_planes(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """p = p1 + ((n2.d2) n3 x n1 + (n3.d3) n1 x n2) / (n1.(n2 x n3)), d_i = p_i - p1."""
    first = cross(b[1], c[1])
    point = dot(b[1], b[0] - a[0]) * cross(c[1], a[1])
    point += dot(c[1], c[0] - a[0]) * cross(a[1], b[1])
    point /= dot(a[1], first)
    point += a[0]
    return point


def _direction(figure: FloatArray) -> FloatArray:
    return np.asarray(figure[1])


def _project(point: FloatArray, vector: FloatArray, plane: FloatArray) -> FloatArray:
    """Along the vector onto the plane: p + v (n.(p0 - p)) / (n.v)."""
    share = dot(plane[1], plane[0] - point)
    share /= dot(plane[1], vector)
    return np.asarray(point + share * vector)


def _pierce(line: FloatArray, plane: FloatArray) -> FloatArray:
    """The point of a line in a plane: Stryczek, eq. (30)."""
    return _project(line[0], line[1], plane)


def _foot_in_plane(point: FloatArray, plane: FloatArray) -> FloatArray:
    return np.asarray(point - dot(plane[1], point - plane[0]) * plane[1])


def _foot_on_line(point: FloatArray, line: FloatArray) -> FloatArray:
    return np.asarray(line[0] + dot(line[1], point - line[0]) * line[1])


def _to_line(point: FloatArray, line: FloatArray) -> FloatArray:
    return norm(across(point - line[0], line[1]))


def _to_plane(point: FloatArray, plane: FloatArray) -> FloatArray:
    return np.abs(dot(plane[1], point - plane[0]))


def _between_lines(first: FloatArray, second: FloatArray) -> FloatArray:
    """Along the common perpendicular: |(p2 - p1).(d1 x d2)| / |d1 x d2|."""
    return np.abs(dot(second[0] - first[0], unit(cross(first[1], second[1]))))


def _angle(first: FloatArray, second: FloatArray) -> FloatArray:
    """atan2(|a x b|, a.b), which keeps its digits near 0 and pi."""
    return np.arctan2(norm(cross(first, second)), dot(first, second))


def _frame(plane: FloatArray, line: FloatArray, point: FloatArray) -> FloatArray:
    """z along the plane's normal, x along the line's projection, origin at the point."""
    z = plane[1]
    x = unit(across(line[1], z))
    return np.stack([point, x, cross(z, x), z])


def _transform(frame: FloatArray, point: FloatArray) -> FloatArray:
    away = point - frame[0]
    return np.stack([dot(frame[i], away) for i in (1, 2, 3)])


def _length_of(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def _coincide(first: FloatArray, second: FloatArray) -> bool:
    extent = max(1.0, float(np.abs([first, second]).max()))
    return _length_of(second - first) <= SAME * extent


def _no_length(*vectors: FloatArray) -> bool:
    return min(map(_length_of, vectors)) == 0.0


def _no_direction(point: FloatArray, vector: FloatArray) -> bool:
    return _no_length(vector)


def _parallel(first: FloatArray, second: FloatArray, *_: FloatArray) -> bool:
    return _length_of(np.cross(first[1], second[1])) <= SAME


def _glancing(point: FloatArray, vector: FloatArray, plane: FloatArray) -> bool:
    return abs(float(vector @ plane[1])) <= SAME * _length_of(vector)


def _no_corner(*planes: FloatArray) -> bool:
    return abs(float(np.linalg.det(np.array([plane[1] for plane in planes])))) <= SAME


@dataclass(frozen=True, slots=True)
class Rule:
    """One use of a transition.

    `construct`: the arrays of its outputs from those of its inputs; of a `fit` from the nominal
    inputs, where it starts. `unit` of what it makes: "same" as its first input, a "product" of
    both, or that of a "formula". `length`: number of the input that must be a length. `guard`: what
    is wrong where nominal inputs (.., ) pass its test: they determine nothing.
    """

    construct: Construction | None = None
    fit: Callable[[Nominal], Construction] | None = None
    unit: str = "mm"
    length: int | None = None
    guard: Guard | None = None


_SHORT: Guard = ("a vector has no length", _no_length)
_AIMLESS: Guard = ("a vector has no length", _no_direction)
_ONE_POINT: Guard = ("the two points coincide", _coincide)
RULES: dict[tuple[str, str], Rule] = {
    ("displace", "coordinate"): Rule(np.add, length=1),
    ("displace", "point"): Rule(np.add, length=1),
    ("middle", ""): Rule(_middle),
    ("vector", ""): Rule(_vector),
    ("unit_v", "vector"): Rule(unit, unit="1", guard=_SHORT),
    ("unit_v", "points"): Rule(_unit_between, unit="1", guard=_ONE_POINT),
    ("ratio", "vector"): Rule(np.multiply, unit="product"),
    ("ratio", "constant"): Rule(np.multiply, unit="product"),
    ("length", "vector"): Rule(norm, unit="same"),
    ("length", "points"): Rule(_distance),
    ("ball", ""): Rule(_ball, length=5),
    ("hole", ""): Rule(_hole, length=4),
    ("circle", ""): Rule(fit=fits.circle_through),
    ("sphere", "free"): Rule(fit=fits.sphere_through),
    ("sphere", "radius"): Rule(fit=fits.sphere_of_radius_through, length=-1),
    ("line", "points"): Rule(_line_through, guard=_ONE_POINT),
    ("line", "planes"): Rule(_meet, guard=("the planes are parallel", _parallel)),
    ("aline", ""): Rule(_along, guard=_AIMLESS),
    ("plane", "points"): Rule(fit=fits.plane_through),
    ("plane", "vector"): Rule(_along, guard=_AIMLESS),
    ("point", "line"): Rule(
        _pierce,
        guard=(
            "the line is parallel to the plane",
            lambda line, plane: _glancing(line[0], line[1], plane),
        ),
    ),
    ("point", "planes"): Rule(
        _three_planes, guard=("the three planes meet in no single point", _no_corner)
    ),
    ("normal", ""): Rule(_direction, unit="1"),
    ("direction", ""): Rule(_direction, unit="1"),
    ("project", ""): Rule(_project, guard=("the vector is parallel to the plane", _glancing)),
    ("per_proj", "plane"): Rule(_foot_in_plane),
    ("per_proj", "line"): Rule(_foot_on_line),
    ("distance", "points"): Rule(_distance),
    ("distance", "line"): Rule(_to_line),
    ("distance", "plane"): Rule(_to_plane),
    ("distance", "lines"): Rule(_between_lines, guard=("the lines are parallel", _parallel)),
    ("angle", ""): Rule(_angle, unit="rad", guard=_SHORT),
    ("frame", ""): Rule(_frame, guard=("the line is perpendicular to the plane", _parallel)),
    ("transform", ""): Rule(_transform),
    ("compute", ""): Rule(unit="formula"),
}
"""By transition and variant; `meas` makes nothing from other places."""


def construction(step: Step, nominal: Nominal) -> Construction:
    """What a step computes; a fit starts from, and is oriented as, its `nominal` inputs.

    Raises GeometryError for nominal inputs that do not determine it.
    """
    if step.formula is not None:
        return _formula(step.formula, step.inputs)
    rule = RULES[step.do, step.variant]
    if rule.guard is not None and rule.guard[1](*(place[..., 0] for place in nominal)):
        raise GeometryError(rule.guard[0])
    made = rule.construct if rule.fit is None else rule.fit(nominal)
    assert made is not None
    return made


def _formula(node: Node, inputs: Sequence[str]) -> Construction:
    at = {name: (inputs.index(place_of(name)), _row(name)) for name in names(node)}

    def compute(*places: FloatArray) -> FloatArray:
        given = {
            name: places[i] if row is None else places[i][row] for name, (i, row) in at.items()
        }
        value = evaluate(node, given)
        return np.broadcast_to(np.asarray(value, dtype=np.float64), places[0].shape[-1:])

    return compute


def _row(name: str) -> int | None:
    """The coordinate that a formula means by ``H1.x``; None where it names the whole place."""
    coordinate = name.partition(".")[2]
    known = (COORDINATES[kind] for kind in NAMED_BY_COORDINATE)
    return next((item.index(coordinate) for item in known if coordinate in item), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """A computing transition, ready to run on arrays of trials."""

    step: Step
    construct: Construction

    def run(self, values: Values) -> None:
        """Puts the outputs beside the inputs in `values`."""
        made = self.construct(*(values[name] for name in self.step.inputs))
        for name, value in zip(
            self.step.outputs, made if isinstance(made, tuple) else (made,), strict=False
        ):
            values[name] = value

    def why_not_finite(self, values: Values, trial: int = 0) -> str:
        """What in its formula has no finite value in a trial, and where in the formula."""
        formula = self.step.formula
        if formula is None:
            return ""
        at = {}
        for name in names(formula):
            value, row = values[place_of(name)], _row(name)
            at[name] = float((value if row is None else value[row])[trial])
        faults = derivatives(formula, at, ()).faults
        if not faults:
            return f": it is {float(evaluate(formula, at)):g}"
        facts = faults[0].facts
        return (
            f": no finite {facts['what']}{facts['where']}, column {faults[0].column} of the formula"
        )


def start_value(place: Place) -> FloatArray:
    """Nominal of a measured place, or value of a constant, for one trial: (1,) or (3, 1)."""
    if place.nominal_mm is not None:
        nominal = np.array(place.nominal_mm)
        return nominal[:, None] if len(nominal) == 3 else nominal
    return np.array([math.nan if place.value is None else place.value])


def nominal_values(
    places: Mapping[str, Place], rounds: Rounds
) -> tuple[Values, list[Computed], list[tuple[int, Finding]]]:
    """Values of all places at nominal (m = 1), the computing transitions in firing order, and
    the faults: (index of the transition, what is wrong). What depends on a fault is left out.
    """
    values = {name: start_value(place) for name, place in places.items() if place.marked}
    computed: list[Computed] = []
    faults: list[tuple[int, Finding]] = []
    for step in itertools.chain.from_iterable(rounds):
        if step.do == "meas":
            place = places[step.outputs[0]]
            # That a point has other than three coordinates is reported elsewhere.
            if place.nominal_mm is not None and (place.kind, len(place.nominal_mm)) != ("point", 1):
                values[step.outputs[0]] = start_value(place)
        elif all(name in values for name in step.inputs):
            try:
                ready = _ready(step, values)
            except GeometryError as error:
                what = f"{step.do} of {listed(step.outputs)}"
                fault = finding("no-finite-value", what=what, where=f" at nominal: {error}")
                faults.append((step.index, fault))
            else:
                computed.append(ready)
    return values, computed, faults


def _ready(step: Step, values: Values) -> Computed:
    """A step with its outputs at nominal in `values`."""
    given = {name: values[name] for name in step.inputs}
    nominal = [values[name] for name in step.inputs]
    ready = Computed(step=step, construct=construction(step, nominal))
    with np.errstate(all="ignore"):
        ready.run(given)
    if not all(np.isfinite(given[name]).all() for name in step.outputs):
        raise GeometryError(ready.why_not_finite(given).removeprefix(": ") or "it is not finite")
    values.update({name: given[name] for name in step.outputs})
    return ready


def may_jump(steps: Iterable[Step]) -> bool:
    """Whether a formula of `steps` has a step, so that few trials may see no change at all."""
    return any(
        _is_step(node) for step in steps if step.formula is not None for node in walk(step.formula)
    )


def chance_places(steps: Iterable[Step]) -> set[str]:
    """Places that hold 0 or 1 in every trial, of `steps` in firing order: their mean is a chance.

    Those are the formulas of `step()` alone and of other such places (a product is "and",
    a + b - a*b is "or", 1 - a is "not") that give 0 or 1 whichever of them are 0 or 1.
    """
    chances: set[str] = set()
    for step in steps:
        if step.formula is not None and _is_chance(step.formula, chances):
            chances.update(step.outputs)
    return chances


def _is_step(node: Node) -> bool:
    return isinstance(node, Call) and node.function == "step"


def _is_chance(formula: Node, chances: Collection[str]) -> bool:
    switches: dict[str, str] = {}

    def switched(node: Node) -> Node:
        known = isinstance(node, Name) and node.name in chances
        if not (known or _is_step(node)):
            return node
        # No place has such a name.
        name = switches.setdefault(to_text(node), f"?{len(switches)}")
        return Name(name, node.column)

    tree = rewritten(formula, switched)
    if not switches or len(switches) > MOST_SWITCHES or {*names(tree)} - {*switches.values()}:
        return False
    table = np.array(list(itertools.product((0.0, 1.0), repeat=len(switches)))).T
    values = np.asarray(evaluate(tree, dict(zip(switches.values(), table, strict=True))))
    return bool(np.all((values == 0.0) | (values == 1.0)))
