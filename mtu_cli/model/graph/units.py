"""Units of places: what transitions tell of them, and where a length must stand."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from mtu_cli.files.graph import Step, place_of
from mtu_cli.files.graph_contract import Graph
from mtu_cli.findings import InputError
from mtu_cli.language import Node, names
from mtu_cli.language.tree import Call
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.units import PLAIN, internal

INVERSE = ("asin", "acos", "atan", "atan2")
LENGTHS = {
    ("displace", "coordinate"): 1,
    ("displace", "point"): 1,
    ("ball", ""): 5,
    ("hole", ""): 4,
    ("sphere", "radius"): -1,
}
"""Which input of a transition is a length, of those that may hold something else."""
Unit = str | None
Faults = list[tuple[Step, InputError]]


def place_units(
    graph: Graph, steps: Iterable[Step], faults: Faults | None = None
) -> dict[str, str]:
    """The unit of every place: mm, rad, 1 (or mm^n of a product); mm where nothing tells it.

    A formula that adds a length to an angle goes to `faults`, with its transition.
    """
    return {name: unit or "mm" for name, unit in _told(graph, steps, faults).items()}


def not_lengths(graph: Graph, steps: Iterable[Step]) -> Iterator[tuple[Step, int, str]]:
    """Inputs that must be lengths and are something else: transition, number of the input, unit.

    An input of which nothing tells the unit counts as a length.
    """
    steps = list(steps)
    units = _told(graph, steps, None)
    for step in steps:
        at = LENGTHS.get((step.do, step.variant))
        if at is None or at >= len(step.inputs):
            continue
        unit = units[step.inputs[at]]
        if unit not in (None, "mm"):
            yield step, at % len(step.inputs), unit


def _told(graph: Graph, steps: Iterable[Step], faults: Faults | None) -> dict[str, Unit]:
    units: dict[str, Unit] = {
        name: place.unit if place.kind == "constant" else "mm"
        for name, place in graph.places.items()
    }
    for step in steps:
        for name in step.outputs:
            if units[name] is None or graph.places[name].kind == "vector":
                try:
                    units[name] = _unit(step, units)
                except InputError as error:
                    if faults is not None:
                        faults.append((step, error))
    return units


def _unit(step: Step, units: Mapping[str, Unit]) -> Unit:
    match step.do:
        case "unit_v" | "normal" | "direction":
            return "1"
        case "angle":
            return "rad"
        case "ratio":
            return _product(units[step.inputs[0]], units[step.inputs[1]])
        case "length" if step.variant == "vector":
            return units[step.inputs[0]]
        case "compute" if step.formula is not None:
            known = {name: units[place_of(name)] for name in names(step.formula)}
            return formula_unit(step.formula, known)
    return "mm"


def _product(first: Unit, second: Unit) -> Unit:
    one, other = _exponent(first), _exponent(second)
    if one is None or other is None:
        return None
    return _named(one + other, angle="rad" in (first, second))


def _exponent(unit: Unit) -> int | None:
    """Of length in mm, mm^n, rad (0) or 1 (0); None where the unit is not known."""
    if unit is None or unit in ("1", "rad"):
        return None if unit is None else 0
    return 1 if unit == "mm" else int(unit.removeprefix("mm^"))


def _named(exponent: int, *, angle: bool) -> str:
    if exponent == 0:
        return "rad" if angle else "1"
    return "mm" if exponent == 1 else f"mm^{exponent}"


def formula_unit(node: Node, units: Mapping[str, Unit]) -> Unit:
    """The unit of a formula's value, or None where the units of its inputs do not tell it.

    Raises InputError where dimensions do not agree.
    """
    known = {name: _exponent(unit) for name, unit in units.items()}
    lengths = {name: internal(own) for name, own in known.items() if own is not None}
    algebra = Algebra(units=lengths, factor=PLAIN)
    found = algebra.of(node)
    if algebra.faults:
        raise InputError(algebra.faults)
    if not found.known:
        return None
    circular = isinstance(node, Call) and node.function in INVERSE
    return _named(int(found.exponents[0]), angle=circular or set(units.values()) == {"rad"})
