"""Temperatures of a budget in K beside ones in degC: 295.15 K less 20 degC is no difference.

A difference may be in either; what is 200 K or more is a temperature, and so is most that is 5 degC
or more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from mtu_cli.files.budget_contract import Input
from mtu_cli.files.contracts import present
from mtu_cli.language import Node
from mtu_cli.language.dimensions import literal_value, signed_terms
from mtu_cli.language.tree import Binary, Name, walk

ZERO_C = 273.15
ABSOLUTE = 200.0
"""K, from which on it is a temperature and no difference."""
REFERENCE = (15.0, 30.0)
"""degC of a workshop."""
TEMPERATURES = (5.0, 100.0)
"""degC that are rather a temperature than a difference."""
ROOM = (273.15, 323.15)
"""degC that would be a room, in K."""
_KELVIN = re.compile(r"\s*(?:(?:deg(?:rees?)?|\u00b0)?\s*K|kelvin)\s*", re.IGNORECASE)
_CELSIUS = re.compile(
    r"\s*(?:(?:deg(?:rees?)?|\u00b0)\s*C(?:elsius)?|celsius|\u2103)\s*", re.IGNORECASE
)


class Mixed(NamedTuple):
    """A temperature that does not go with what it is added to: the input, what is wrong, what is
    expected, and whether that is sure.
    """

    name: str
    what: str
    expected: str
    sure: bool


def mixed_temperatures(inputs: Mapping[str, Input], trees: Iterable[Node]) -> Iterator[Mixed]:
    """Differences of an input in K and a temperature in degC, and ones in degC that look like K;
    each input once. A constant of an equation (T - 35.86) may be in K.
    """
    told: set[str] = set()
    for tree in trees:
        for terms in _sums(tree):
            for found in _of_sum(inputs, terms):
                if found.name not in told:
                    told.add(found.name)
                    yield found


def _of_sum(inputs: Mapping[str, Input], terms: list[tuple[int, Node]]) -> Iterator[Mixed]:
    known = {term.name: (sign, inputs[term.name]) for sign, term in terms
             if isinstance(term, Name) and term.name in inputs}  # fmt: skip
    kelvin = {name: own for name, own in known.items() if _is(_KELVIN, own[1])}
    celsius = {name: own for name, own in known.items() if _is(_CELSIUS, own[1])}
    values = [(sign, value) for sign, term in terms if (value := literal_value(term)) is not None]
    # Who takes off 273.15, or another temperature in K, knows what is in K.
    zeros = [abs(_value(own[1]) - ZERO_C) < 1.0 for own in celsius.values()]
    if any(zeros) or any(abs(value) >= ABSOLUTE for _, value in values):
        return
    inside = [(f"{name} ({_value(own[1]):.9g} degC)", own[0], _value(own[1]), True)
              for name, own in celsius.items()]  # fmt: skip
    numbers = [(f"{abs(value):.9g}", sign if value > 0 else -sign, abs(value), False)
               for sign, value in values]  # fmt: skip
    low = [own for own in inside if _within(own[2], TEMPERATURES)]
    low += [own for own in numbers if _within(own[2], REFERENCE)]
    if not low:
        return
    # The likeliest temperature of a workshop first.
    first, sign, value, is_input = min(low, key=lambda own: not _within(own[2], REFERENCE))
    if len(kelvin) == 1:
        ((name, (own, item)),) = kelvin.items()
        if _value(item) >= ABSOLUTE and own != sign:
            one = f"one scale: {_value(item) - ZERO_C:.9g} degC for {_value(item):.9g} K"
            sure = is_input and _within(value, REFERENCE) and _within(_value(item), ROOM)
            yield Mixed(name, f"a temperature in K and {first} are in one sum", one, sure)
    for name, (own, item) in celsius.items():
        # No room has 293.15 degC to the hundredth, and few ovens have.
        exact = round(_value(item) % 1, 6) == 0.15
        if _within(_value(item), ROOM) and _within(value, REFERENCE) and own != sign and exact:
            what = f"{_value(item):.9g} degC is in one sum with {first}"
            yield Mixed(name, what, f"{_value(item) - ZERO_C:.9g} degC, if it is in K", False)


def other_scale(inputs: Mapping[str, Input], tree: Node, stated: str | None) -> Mixed | None:
    """The one temperature of a result that is `stated` in K while it is in degC, or the other way
    round: none is converted. In K it may be meant as a difference.
    """
    to_kelvin = _names(_KELVIN, stated)
    if not to_kelvin and not _names(_CELSIUS, stated):
        return None
    found, zeros = [], []
    for sign, term in signed_terms(tree):
        item = inputs.get(term.name) if isinstance(term, Name) else None
        value = literal_value(term) if item is None else _value(item)
        if value is None:
            return None
        celsius = item is not None and _is(_CELSIUS, item)
        # One less another is a difference, one less a small correction is none.
        if sign < 0 and celsius and not abs(value) < TEMPERATURES[0]:
            return None
        kelvin = abs(value) >= ABSOLUTE and not celsius
        if abs(abs(value) - ZERO_C) < 1.0:
            zeros.append((sign, term, value, True))
        elif kelvin or _within(abs(value), REFERENCE):
            found.append((sign, term, value, kelvin))
    # Who takes 273.15 off a temperature, or adds it, knows what is in K; by itself 273.5 K is one.
    if len(found) + len(zeros) != 1:
        return None
    ((sign, term, value, kelvin),) = found or zeros
    if sign < 0 or not isinstance(term, Name) or term.name not in inputs:
        return None
    name = term.name
    if kelvin == to_kelvin or not _is(_KELVIN if kelvin else _CELSIUS, inputs[name]):
        return None
    own, other, way = ("K", "degC", "-") if kelvin else ("degC", "K", "+")
    what = f"{value:.9g} {own} make a result in {other}, and no unit is converted"
    expected = f"{own} for the result, or {name} {way} {ZERO_C:g}"
    return Mixed(name, what, expected, sure=False)


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]


def _sums(tree: Node) -> Iterator[list[tuple[int, Node]]]:
    """The terms of every sum, the whole of it and not its parts."""
    inner: set[int] = set()
    for node in walk(tree):
        if isinstance(node, Binary) and node.operator in "+-" and id(node) not in inner:
            inner.update(id(side) for side in walk(node) if isinstance(side, Binary))
            yield [*signed_terms(node)]
            for _, term in signed_terms(node):
                yield from _sums(term)


def _is(pattern: re.Pattern[str], item: Input) -> bool:
    return _names(pattern, item.unit)


def _names(pattern: re.Pattern[str], unit: str | None) -> bool:
    return unit is not None and pattern.fullmatch(unit) is not None


def _value(item: Input) -> float:
    """The estimate, as far as it is given; nan where it is not."""
    if item.value is not None:
        return item.value
    readings = [reading for _, reading in present(item.readings)]
    if readings:
        return sum(readings) / len(readings)
    if item.low is not None and item.high is not None:
        return (item.low + item.high) / 2
    return float("nan")
