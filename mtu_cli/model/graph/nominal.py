"""The graph at nominal: every transition made ready for many trials, faults found on the way."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.graph import Rounds, Step, place_of
from mtu_cli.files.graph_contract import Graph, Place
from mtu_cli.files.graph_kinds import COORDINATES, NAMED_BY_COORDINATE
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.language import Node, evaluate, names, to_text
from mtu_cli.language.tree import Call, children, walk
from mtu_cli.model.graph import fits
from mtu_cli.model.graph.constructions import CONSTRUCTIONS, Construction, Outputs
from mtu_cli.model.graph.degenerate import degenerate
from mtu_cli.stats.least_squares import FloatArray

Values = dict[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """A computing transition, ready to run on arrays of trials."""

    step: Step
    construct: Construction

    def run(self, values: Values) -> None:
        """Puts the outputs beside the inputs in `values`."""
        made = self.construct(*(values[name] for name in self.step.inputs))
        for name, value in zip(self.step.outputs, made, strict=False):
            values[name] = value


def start_value(place: Place) -> FloatArray:
    """Nominal of a measured place, or value of a constant, for one trial: (1,) or (3, 1)."""
    if place.nominal_mm is not None:
        found = np.array(place.nominal_mm)
        return found[:, None] if len(found) == 3 else found
    return np.array([np.nan if place.value is None else place.value])


def nominal_values(
    places: Mapping[str, Place], rounds: Rounds
) -> tuple[Values, list[Computed], list[tuple[int, Finding]]]:
    """Values of all places at nominal (m = 1), the computing transitions in firing order, and
    the faults found: (index of the transition, what is wrong). What depends on a fault is
    left out.
    """
    values = {name: start_value(place) for name, place in places.items() if place.marked}
    computed: list[Computed] = []
    faults: list[tuple[int, Finding]] = []
    for step in (step for fired in rounds for step in fired):
        if step.do == "meas":
            place = places[step.outputs[0]]
            # A point of other than three coordinates is a fault of its own, told elsewhere.
            if place.nominal_mm is not None and (
                place.kind != "point" or len(place.nominal_mm) == 3
            ):
                values[step.outputs[0]] = start_value(place)
            continue
        if not all(name in values for name in step.inputs):
            continue
        wrong = _prepare(step, values, computed)
        if wrong is not None:
            what = f"{step.do} of {listed(step.outputs)}"
            own = finding("no-finite-value", what=what, where=f" at nominal: {wrong}")
            faults.append((step.index, own))
    return values, computed, faults


def _prepare(step: Step, values: Values, computed: list[Computed]) -> str | None:
    inputs = [values[name] for name in step.inputs]
    wrong = degenerate(step.do, step.variant, inputs)
    if wrong is not None:
        return wrong
    ready = Computed(step=step, construct=construction(step, inputs))
    found: Values = dict(zip(step.inputs, inputs, strict=True))
    with np.errstate(all="ignore"):
        ready.run(found)
    if not all(np.isfinite(found[name]).all() for name in step.outputs):
        if step.formula is not None:
            return not_finite(step.formula, named_scalars(step.formula, found))
        return "no finite value at nominal"
    values.update({name: found[name] for name in step.outputs})
    computed.append(ready)
    return None


def construction(step: Step, nominal: Sequence[FloatArray]) -> Construction:
    """What a step computes; a fit starts from, and is oriented as, its `nominal` inputs."""
    if step.formula is not None:
        return _formula(step.formula, step.inputs)
    if step.do in ("plane", "circle", "sphere") and step.variant != "vector":
        return _fit(step, nominal)
    return CONSTRUCTIONS[step.do, step.variant]


def _fit(step: Step, nominal: Sequence[FloatArray]) -> Construction:
    if step.do == "sphere":
        free = step.variant == "free"
        start = fits.sphere_start(_points(nominal if free else nominal[:-1]))
        if free:
            return fits.in_slices(lambda *points: fits.sphere(points, start))
        return fits.in_slices(
            lambda *places: (fits.sphere_of_radius(places[:-1], places[-1], start),)
        )
    if len(nominal) == 3:
        return CONSTRUCTIONS[step.do, step.variant]
    reference = _orientation(nominal)
    if step.do == "plane":
        return fits.in_slices(lambda *points: (fits.plane(points, reference),))
    circle = fits.circle_start(_points(nominal), reference)
    return fits.in_slices(lambda *points: fits.circle(points, circle))


def _points(nominal: Sequence[FloatArray]) -> FloatArray:
    """Nominal points as (n, 3)."""
    return np.array([place[:, 0] for place in nominal])


def _formula(node: Node, inputs: Sequence[str]) -> Construction:
    at = {name: (inputs.index(place_of(name)), _row(name)) for name in names(node)}

    def compute(*places: FloatArray) -> Outputs:
        given = {
            name: places[i] if row is None else places[i][row] for name, (i, row) in at.items()
        }
        value = evaluate(node, given)
        return (np.broadcast_to(np.asarray(value, dtype=np.float64), places[0].shape[-1:]),)

    return compute


def _row(name: str) -> int | None:
    """The coordinate that a formula means by ``H1.x``; None where it names the whole place."""
    coordinate = name.partition(".")[2]
    known = (COORDINATES[kind] for kind in NAMED_BY_COORDINATE)
    return next((item.index(coordinate) for item in known if coordinate in item), None)


def named_scalars(node: Node, values: Mapping[str, FloatArray], trial: int = 0) -> dict[str, float]:
    """The names of a formula with their values in one of the trials of `values`."""
    found = {}
    for name in names(node):
        value, row = values[place_of(name)], _row(name)
        found[name] = float((value if row is None else value[row])[trial])
    return found


def not_finite(formula: Node, values: Mapping[str, float]) -> str:
    """What in a formula has no finite value for these names, and at which of its characters."""
    for node in walk(formula):
        finite = (math.isfinite(_value(item, values)) for item in children(node))
        if not math.isfinite(_value(node, values)) and all(finite):
            return f"{_fault(node, values)}, at column {node.column} of the formula"
    return f"it is {_value(formula, values):g}"


def _value(node: Node, values: Mapping[str, float]) -> float:
    return float(evaluate(node, values))


def _fault(node: Node, values: Mapping[str, float]) -> str:
    match node:
        case Call("/", (_, right)) if _value(right, values) == 0:
            return f"division by zero: {to_text(right)} is 0"
        case Call("**", (left, right)) if _value(left, values) == 0 and _value(right, values) < 0:
            return f"division by zero: {to_text(left)} is 0 in {to_text(node)}"
        case Call(function, (argument,)):
            given = _value(argument, values)
            return f"no finite {function}: {to_text(argument)} is {given:g}"
    return f"no finite value of {to_text(node)}"


def _orientation(nominal: Sequence[FloatArray]) -> FloatArray:
    """Unit normal (3,) of the nominal points, on the side of (P2 - P1) x (P3 - P1).

    Where these three lie on a line, the next point that does not decides.
    """
    points = _points(nominal)
    sides = np.cross((points[1] - points[0])[None], points[2:] - points[0])
    sizes = np.linalg.norm(sides, axis=1)
    side = sides[int(np.argmax(sizes > 1e-6 * sizes.max()))]
    _, _, Vt = np.linalg.svd(points - points.mean(axis=0))
    normal: FloatArray = Vt[2] if Vt[2] @ side >= 0 else -Vt[2]
    return normal


def correlation_matrix(graph: Graph, names: Sequence[str]) -> FloatArray:
    """Correlations (n, n) of some constants; those with others leave these as they are."""
    at = {name: i for i, name in enumerate(names)}
    found = np.eye(len(names))
    for first, second, r in graph.correlations:
        if first not in at or second not in at:
            continue
        found[at[first], at[second]] = found[at[second], at[first]] = r
    return found
