"""Faults of a graph file that only calculating tells, and the units of its places."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from mtu_cli.files.contract import Faults
from mtu_cli.files.graph import Rounds, Step, place_of
from mtu_cli.files.graph_contract import Graph
from mtu_cli.findings import InputError
from mtu_cli.language import Node, names
from mtu_cli.language.tree import Call
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.model.graph.places import correlation_matrix
from mtu_cli.model.graph.transitions import RULES, nominal_values
from mtu_cli.units import PLAIN, internal

INVERSE = ("asin", "acos", "atan", "atan2")
CONTRADICT = "the correlations contradict each other: their matrix is not positive semi-definite"
ROUNDING = 1e-9
"""An eigenvalue of n correlations below -n times this is no rounding of 0, as in budgets."""
Unit = str | None
Disagreeing = list[tuple[Step, InputError]]


def examine(graph: Graph, rounds: Rounds, faults: Faults) -> None:
    """Adds to `faults` constructions that are degenerate at nominal, formulas whose dimensions
    disagree, and correlations that contradict each other (`files.graph.load_graph`).
    """
    _, _, degenerate = nominal_values(graph.places, rounds)
    for index, fault in degenerate:
        faults.extend(("transitions", index), [fault])
    steps = [step for fired in rounds for step in fired]
    disagreeing: Disagreeing = []
    units = _known_units(graph, steps, disagreeing)
    for step, error in disagreeing:
        faults.extend(("transitions", step.index, "formula"), error)
    for step, at, unit in _not_lengths(steps, units):
        path, kind = ("transitions", step.index, "in", at), f"a length, as {step.do} takes here"
        given = {"value": step.inputs[at], "expected": f"a place in mm, not in {unit}"}
        faults.add(path, "wrong-type", kind=kind, **given)
    _check_correlations(graph, faults)


def _check_correlations(graph: Graph, faults: Faults) -> None:
    """That their matrix is one, where no pair alone is at fault."""
    pairs = [item for item in graph.correlations if item is not None]
    sound = all(abs(r) <= 1 and first != second for first, second, r in pairs)
    if len(pairs) == len(graph.correlations) and sound:
        correlated = list(dict.fromkeys(name for item in pairs for name in item[:2]))
        matrix = correlation_matrix(graph, correlated)
        least = float(np.linalg.eigvalsh(matrix)[0]) if len(matrix) else 0.0
        if least < -ROUNDING * len(matrix):
            expected = f"no eigenvalue below 0; the smallest is {least:.4g}"
            given = {"reason": CONTRADICT, "expected": expected}
            faults.add(("correlations",), "wrong-correlation", **given)


def place_units(graph: Graph, steps: Iterable[Step]) -> dict[str, str]:
    """The unit of every place: mm, rad, 1 (or mm^n of a product); mm where nothing tells it."""
    return {name: unit or "mm" for name, unit in _known_units(graph, steps, []).items()}


def _not_lengths(
    steps: Iterable[Step], units: Mapping[str, Unit]
) -> Iterator[tuple[Step, int, str]]:
    """Inputs that must be lengths and are something else: transition, number of the input, unit.

    An input of which nothing tells the unit counts as a length.
    """
    for step in steps:
        at = RULES[step.do, step.variant].length if step.do != "meas" else None
        if at is not None and at < len(step.inputs):
            unit = units[step.inputs[at]]
            if unit not in (None, "mm"):
                yield step, at % len(step.inputs), unit


def _known_units(graph: Graph, steps: Iterable[Step], disagreeing: Disagreeing) -> dict[str, Unit]:
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
                    disagreeing.append((step, error))
    return units


def _unit(step: Step, units: Mapping[str, Unit]) -> Unit:
    unit = RULES[step.do, step.variant].unit
    if unit == "formula" and step.formula is not None:
        known = {name: units[place_of(name)] for name in names(step.formula)}
        return formula_unit(step.formula, known)
    first, last = (units[step.inputs[at]] for at in (0, -1))
    if unit == "product":
        one, other = _exponent(first), _exponent(last)
        if one is None or other is None:
            return None
        return _named(one + other, angle="rad" in (first, last))
    return first if unit == "same" else unit


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
    lengths = {name: internal(power) for name, power in known.items() if power is not None}
    algebra = Algebra(units=lengths, factor=PLAIN)
    result = algebra.of(node)
    if algebra.faults:
        raise InputError(algebra.faults)
    if not result.known:
        return None
    circular = isinstance(node, Call) and node.function in INVERSE
    return _named(int(result.exponents[0]), angle=circular or set(units.values()) == {"rad"})
