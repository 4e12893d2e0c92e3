"""Inputs of a budget in degrees Fahrenheit beside others in degC or K: no unit is converted.

An equation may convert them itself, either way: a temperature by 32 taken off or by 1.8, a
difference, and what is per degree the other way round, by 1.8.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from mtu_cli.language import Node
from mtu_cli.language.tree import Binary, Number, names, walk

FREEZING_F, STEP_F = 32.0, 1.8
ROUNDED = 2e-3
"""Relative difference up to which 0.556 is 5/9."""
IN_C = (
    "degC or K: a temperature less 32 and divided by 1.8, a difference and u divided by 1.8; or "
    "an equation that does so"
)
PER_C = "a unit per degC or K: the value and u times 1.8; or an equation that does so"
_FAHRENHEIT = re.compile(r"(?:deg|\u00b0)\s*F(?![a-z])|\u2109|fahrenheit", re.IGNORECASE)
_KELVIN = re.compile(
    r"(?:deg|\u00b0)\s*C(?![a-z])|\u2103|(?<![A-Za-z])m?K(?![A-Za-z])|kelvin|celsius"
)
_INVERSE = re.compile(r"\s*\^?\s*(?:-|\u207b)")


@dataclass(slots=True)
class _Converted:
    """Names in what is divided by 1.8, or 32 taken off, and in what is times 1.8."""

    divided: set[str] = field(default_factory=set)
    times: set[str] = field(default_factory=set)

    def of(self, name: str, below: bool, to_kelvin: bool) -> bool:
        """Whether it holds what brings a name to degC, or to degF; `below`: what is per degree."""
        return name in (self.times if below is to_kelvin else self.divided)


def unconverted(
    units: Mapping[str, str | None], trees: Iterable[Node]
) -> Iterator[tuple[str, str]]:
    """Names of inputs in degF where others are in degC or K and no equation converts either, each
    with what is expected instead. F alone is a farad.
    """
    ours = {name: below for name, text in units.items() if (below := _per(_FAHRENHEIT, text))}
    others = {name: below for name, text in units.items() if (below := _per(_KELVIN, text))}
    if not ours or not others:
        return
    done = _Converted()
    for tree in trees:
        _find(tree, done)
    if all(done.of(name, below == "below", False) for name, below in others.items()):
        return
    for name, below in ours.items():
        if not done.of(name, below == "below", True):
            yield name, PER_C if below == "below" else IN_C


def _per(degrees: re.Pattern[str], unit: str | None) -> str | None:
    """Whether such degrees are in a unit: `above` or `below` its line."""
    found = degrees.search(unit or "")
    if found is None or unit is None:
        return None
    below = "/" in unit[: found.start()] or _INVERSE.match(unit[found.end() :])
    return "below" if below else "above"


def _find(tree: Node, found: _Converted) -> None:
    for item in walk(tree):
        if not isinstance(item, Binary):
            continue
        right = item.right
        if item.operator == "-" and isinstance(right, Number) and right.value == FREEZING_F:
            found.divided.update(names(item.left))
        elif item.operator in "*/":
            above, below = _sides(item)
            if _has_step(above.numbers, below.numbers):
                found.times |= above.names
                found.divided |= below.names
            if _has_step(below.numbers, above.numbers):
                found.divided |= above.names
                found.times |= below.names


@dataclass(slots=True)
class _Side:
    """The numbers and the names that stand on one side of a fraction's line."""

    numbers: list[float] = field(default_factory=list)
    names: set[str] = field(default_factory=set)


def _has_step(above: list[float], below: list[float]) -> bool:
    """Whether 1.8 = 9/5 is among the factors."""
    ninths = 9.0 in above and 5.0 in below
    return STEP_F in above or ninths or any(abs(v * STEP_F - 1.0) < ROUNDED for v in below)


def _sides(product: Node) -> tuple[_Side, _Side]:
    """What a term is a product of, above its line and below."""
    above, below = _Side(), _Side()
    for factor, times in _factors(product):
        side = above if times else below
        if isinstance(factor, Number):
            side.numbers.append(factor.value)
        side.names.update(names(factor))
    return above, below


def _factors(node: Node, times: bool = True) -> Iterator[tuple[Node, bool]]:
    """What a term is a product of, and whether each is above the line."""
    if isinstance(node, Binary) and node.operator in "*/":
        yield from _factors(node.left, times)
        yield from _factors(node.right, times == (node.operator == "*"))
    else:
        yield node, times
