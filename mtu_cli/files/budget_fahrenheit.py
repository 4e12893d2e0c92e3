"""Inputs of a budget in degrees Fahrenheit beside others in degC or K: no unit is converted.

An equation may convert them itself, either way: a temperature by 32 taken off or by 1.8, a
difference, and what is per degree the other way round, by 1.8.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from mtu_cli.language import Node
from mtu_cli.language.tree import Binary, Name, Number, children

FREEZING_F, STEP_F = 32.0, 1.8
ROUNDED = 2e-3
"""Relative difference up to which 0.556 is 5/9."""
IN_C = (
    "degC or K: a temperature less 32 and divided by 1.8, a difference and u divided by 1.8; or "
    "an equation that does so"
)
PER_C = "a unit per degC or K: the value and u times 1.8; or an equation that does so"
TIMES, DIVIDED = "times 1.8", "divided by 1.8, or 32 taken off"
Ways = frozenset[str]
NOTHING: Ways = frozenset()
_FAHRENHEIT = re.compile(r"(?:deg|\u00b0)\s*F(?![a-z])|\u2109|fahrenheit", re.IGNORECASE)
_KELVIN = re.compile(
    r"(?:deg|\u00b0)\s*C(?![a-z])|\u2103|(?<![A-Za-z])m?K(?![A-Za-z])|kelvin|celsius"
)
_INVERSE = re.compile(r"\s*\^?\s*(?:-|\u207b)")


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
    done: dict[str, Ways] = {}
    for tree in trees:
        for name, ways in _converted(tree, frozenset(others)).items():
            done[name] = done.get(name, NOTHING) | ways
    if all(_way(below, to_kelvin=False) in done.get(name, ()) for name, below in others.items()):
        return
    for name, below in ours.items():
        if _way(below, to_kelvin=True) not in done.get(name, ()):
            yield name, PER_C if below == "below" else IN_C


def _way(below: str, *, to_kelvin: bool) -> str:
    """What brings a name to degC, or to degF; `below`: of what is per degree."""
    return TIMES if (below == "below") is to_kelvin else DIVIDED


def _per(degrees: re.Pattern[str], unit: str | None) -> str | None:
    """Whether such degrees are in a unit: `above` or `below` its line."""
    found = degrees.search(unit or "")
    if found is None or unit is None:
        return None
    below = "/" in unit[: found.start()] or _INVERSE.match(unit[found.end() :])
    return "below" if below else "above"


def _converted(tree: Node, others: frozenset[str]) -> dict[str, Ways]:
    """How each name is converted wherever it stands in an equation beside `others`."""
    match tree:
        case Name(name):
            return {name: NOTHING}
        case Binary("-", left, Number(value)) if value == FREEZING_F:
            return {name: ways | {DIVIDED} for name, ways in _converted(left, others).items()}
        case Binary("*" | "/"):
            return _of_product(tree, others)
    places = [_converted(child, others) for child in children(tree)]
    # A term in degF alone may be as it is, of a name that is converted in another.
    found = _common(place for place in places if others.isdisjoint(place))
    return found | _common(place for place in places if not others.isdisjoint(place))


def _common(places: Iterable[dict[str, Ways]]) -> dict[str, Ways]:
    """What each name has in common where it stands: one unconverted term is a fault."""
    found: dict[str, Ways] = {}
    for place in places:
        for name, ways in place.items():
            found[name] = found.get(name, ways) & ways
    return found


def _of_product(product: Node, others: frozenset[str]) -> dict[str, Ways]:
    above, below = _sides(product)
    if _has_step(above.numbers, below.numbers):
        above.way, below.way = TIMES, DIVIDED
    elif _has_step(below.numbers, above.numbers):
        above.way, below.way = DIVIDED, TIMES
    return _common((*above.places(others), *below.places(others)))


@dataclass(slots=True)
class _Side:
    """The numbers and the factors that stand on one side of a fraction's line, and by what all
    of that side is converted.
    """

    numbers: list[float] = field(default_factory=list)
    factors: list[Node] = field(default_factory=list)
    way: str | None = None

    def places(self, others: frozenset[str]) -> Iterator[dict[str, Ways]]:
        own = NOTHING if self.way is None else frozenset({self.way})
        for factor in self.factors:
            yield {name: ways | own for name, ways in _converted(factor, others).items()}


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
        else:
            side.factors.append(factor)
    return above, below


def _factors(node: Node, times: bool = True) -> Iterator[tuple[Node, bool]]:
    """What a term is a product of, and whether each is above the line."""
    if isinstance(node, Binary) and node.operator in "*/":
        yield from _factors(node.left, times)
        yield from _factors(node.right, times == (node.operator == "*"))
    else:
        yield node, times
