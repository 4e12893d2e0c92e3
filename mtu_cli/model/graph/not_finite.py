"""Where a formula has no finite value, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mtu_cli.language import Node, evaluate, to_text
from mtu_cli.language.tree import Binary, Call, children, walk


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
        case Binary("/", _, right) if _value(right, values) == 0:
            return f"division by zero: {to_text(right)} is 0"
        case Binary("**", left, right) if _value(left, values) == 0 and _value(right, values) < 0:
            return f"division by zero: {to_text(left)} is 0 in {to_text(node)}"
        case Call(function, (argument,)):
            given = _value(argument, values)
            return f"no finite {function}: {to_text(argument)} is {given:g}"
    return f"no finite value of {to_text(node)}"
