"""The derivative of an equation as an equation."""

from __future__ import annotations

from mtu_cli.language.tree import Call, Node, Number, names

ZERO, ONE, TWO, MINUS = (Number(value, 0) for value in (0.0, 1.0, 2.0, -1.0))


def slope(node: Node, name: str) -> Node:
    """The derivative of an equation by one of its names, as a tree; steps have none.

    >>> from mtu_cli.language import parse, to_text
    >>> to_text(slope(parse("sin(2*x)"), "x"))
    'cos(2*x)*2'
    """
    if not isinstance(node, Call):
        return ONE if name in names(node) else ZERO
    total: Node = ZERO
    for outer, argument in zip(_partial(node), node.arguments, strict=True):
        inner = slope(argument, name)
        if ZERO not in (outer, inner):
            term = outer if inner == ONE else inner if outer == ONE else _call("*", outer, inner)
            total = term if total == ZERO else _call("+", total, term)
    return total


def _partial(node: Call) -> tuple[Node, ...]:
    """The derivatives of a function by its arguments."""
    first, last = node.arguments[0], node.arguments[-1]
    match node.function:
        case "+":
            return ONE, ONE
        case "-":
            return ONE, MINUS
        case "*":
            return last, first
        case "/":
            return _call("/", ONE, last), _call("neg", _call("/", node, last))
        case "**":
            less: Node = _call("-", last, ONE)
            if isinstance(last, Number):
                less = Number(last.value - 1, 0)
            power = _call("*", last, _call("**", first, less))
            return power, _call("*", node, _call("log", first))
    return ({
        "neg": MINUS,
        "sin": _call("cos", first),
        "cos": _call("neg", _call("sin", first)),
        "exp": node,
        "log": _call("/", ONE, first),
        "sqrt": _call("/", ONE, _call("*", TWO, node)),
        "abs": _call("-", _call("*", TWO, _call("step", first)), ONE),
        "step": ZERO,
    }[node.function],)  # fmt: skip


def _call(function: str, *arguments: Node) -> Node:
    return Call(function, arguments, 0)
