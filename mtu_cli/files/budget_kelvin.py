"""Temperatures of a budget in K beside ones in degC: 295.15 K less 20 degC is no difference.

A difference may be in either; what is 200 K or more is a temperature.
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
LEAST, MOST = 5.0, 100.0
"""degC of a temperature, not a correction, in a workshop."""
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
    """Sums in which an input in K stands beside a temperature in degC, and ones in degC that look
    like K; each input once.
    """
    told: set[str] = set()
    for tree in trees:
        for terms in _sums(tree):
            for found in _of_sum(inputs, terms):
                if found.name not in told:
                    told.add(found.name)
                    yield found


def _of_sum(inputs: Mapping[str, Input], terms: list[Node]) -> Iterator[Mixed]:
    numbers = [abs(value) for term in terms if (value := literal_value(term)) is not None]
    if any(value >= ABSOLUTE for value in numbers):
        return
    known = {term.name: inputs[term.name] for term in terms if isinstance(term, Name)
             and term.name in inputs}  # fmt: skip
    kelvin = {name: _value(item) for name, item in known.items() if _is(_KELVIN, item)}
    celsius = {name: _value(item) for name, item in known.items() if _is(_CELSIUS, item)}
    low = [f"{name} ({value:.9g} degC)" for name, value in celsius.items() if _is_low(value)]
    low += [f"{value:.9g}" for value in numbers if _is_low(value)]
    if not low:
        return
    for name, value in kelvin.items():
        if value >= ABSOLUTE:
            one = f"one scale: {value - ZERO_C:.9g} degC for {value:.9g} K"
            yield Mixed(name, f"a temperature in K and {low[0]} are in one sum", one, True)
    for name, value in celsius.items():
        if ROOM[0] <= value <= ROOM[1]:
            what = f"{value:.9g} degC is in one sum with {low[0]}"
            yield Mixed(name, what, f"{value - ZERO_C:.9g} degC, if it is in K", False)


def _sums(tree: Node) -> Iterator[list[Node]]:
    """The terms of every sum, the whole of it and not its parts."""
    inner: set[int] = set()
    for node in walk(tree):
        if isinstance(node, Binary) and node.operator in "+-" and id(node) not in inner:
            inner.update(id(side) for side in walk(node) if isinstance(side, Binary))
            yield [term for _, term in signed_terms(node)]
            for _, term in signed_terms(node):
                yield from _sums(term)


def _is_low(value: float) -> bool:
    return LEAST <= value <= MOST


def _is(pattern: re.Pattern[str], item: Input) -> bool:
    return item.unit is not None and pattern.fullmatch(item.unit) is not None


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
