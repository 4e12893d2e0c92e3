"""The derivative of an equation as an equation."""

from __future__ import annotations

from mtu_cli.language.tree import Call, Node, Number, names

ZERO, ONE, TWO = (Number(value, 0) for value in (0.0, 1.0, 2.0))


def slope(node: Node, name: str) -> Node:
    """The derivative of an equation by one of its names, as a tree; steps have none.

    >>> from mtu_cli.language import parse, to_text
    >>> to_text(slope(parse("sin(2*x)"), "x"))
    'cos(2*x)*2'
    """
    if name not in names(node):
        return ZERO
    if not isinstance(node, Call):
        return ONE
    inner = [slope(item, name) for item in node.arguments]
    first, last = node.arguments[0], node.arguments[-1]
    match node.function:
        case "+" | "-" | "neg":
            return _sum(node.function, inner)
        case "*":
            return _sum("+", [_product(inner[0], last), _product(first, inner[1])])
        case "/":
            top = _sum("-", [_product(inner[0], last), _product(first, inner[1])])
            return _call("/", top, _call("**", last, TWO))
        case "**" if isinstance(last, Number):
            lower = _call("**", first, Number(last.value - 1, 0))
            return _product(_product(last, lower), inner[0])
        case "**":
            # u^v (v' log u + v u'/u)
            base = _call("/", _product(last, inner[0]), first)
            return _product(node, _sum("+", [_product(inner[1], _call("log", first)), base]))
        case "sin":
            return _product(_call("cos", first), inner[0])
        case "cos":
            return _product(_call("neg", _call("sin", first)), inner[0])
        case "exp":
            return _product(node, inner[0])
        case "log":
            return _call("/", inner[0], first)
        case "sqrt":
            return _call("/", inner[0], _product(TWO, node))
        case "abs":
            sign = _call("-", _product(TWO, _call("step", first)), ONE)
            return _product(sign, inner[0])
    return ZERO


def _call(function: str, *arguments: Node) -> Node:
    return Call(function, arguments, 0)


def _sum(sign: str, items: list[Node]) -> Node:
    """A sum, difference or negative without terms that are 0."""
    zero = [isinstance(item, Number) and item.value == 0 for item in items]
    if sign == "neg":
        return items[0] if zero[0] else _call("neg", items[0])
    if zero[1]:
        return items[0]
    if zero[0]:
        return items[1] if sign == "+" else _call("neg", items[1])
    return _call(sign, *items)


def _product(a: Node, b: Node) -> Node:
    """A product without factors of 1."""
    for one, other in ((a, b), (b, a)):
        if isinstance(one, Number) and one.value in (0.0, 1.0):
            return other if one.value == 1.0 else one
    return _call("*", a, b)
