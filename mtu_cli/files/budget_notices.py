"""What a budget is told to think of, without a fault: units that are left alone, and a 1 that may
be meant as a plain number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from mtu_cli.errors import Notice, nearest
from mtu_cli.files.budget_contract import Budget
from mtu_cli.files.budget_kelvin import mixed_temperatures, other_scale
from mtu_cli.files.budget_ones import ones_in_units
from mtu_cli.files.budget_unit_texts import COMMON
from mtu_cli.files.budget_units import BudgetUnits
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.unit_text import GRAMS, WORDS, meant, unit_exponents
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding
from mtu_cli.language import Node, names

SHORTEST = 7
"""Letters of a word for a unit that may be another one with a slip."""
MOST_LETTERS = 2
"""More or fewer that such a word has."""
DOUBLED = re.compile(r"(.)\1")
SHOWN_INPUTS = 6
"""Inputs without a unit, or an uncertainty, that a warning names."""
SPREAD = ("u", "half_width", "low", "high", "U", "readings", "contributions")
"""Keys of which any says how well an input is known."""


def notices(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    """All of them, in the order in which they are told."""
    return (
        *_unused(budget, trees, document),
        *_exact(budget, trees, document),
        *_unclear_units(budget, document),
        *_ones_in_units(budget, trees, document),
        *_like_kelvin(budget, trees, document),
        *_unstated_units(budget, trees, document),
    )


def stated_unit(budget: Budget, place: YamlPath) -> str | None:
    """The unit that the result of the equation at a place is to have, if the file says so."""
    if place == ("equation",):
        return budget.quantity.unit if budget.quantity is not None else None
    return (budget.units or {}).get(str(place[-1]))


def _place_of(budget: Budget, name: str) -> YamlPath:
    """Where the equation of a result stands."""
    return ("equation",) if budget.equation is not None else ("equations", name)


def _unused(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    used = {name for tree in trees.values() for name in names(tree)}
    shown = document.source.shown
    return tuple(
        Notice(
            code="unused-input",
            message=f"{shown}:{document.line_of('inputs', name)}: inputs.{name}: in no equation",
        )
        for name in budget.inputs
        if name not in used
    )


def _exact(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    """That inputs with keys, but none of an uncertainty, are exact: its key may be forgotten, which
    no result shows. A plain number is meant as a constant, and so is a `u` of 0.
    """
    used = {name for tree in trees.values() for name in names(tree)}
    keys = {name: document.data["inputs"][name] for name in budget.inputs if name in used}
    exact = [
        name
        for name, given in keys.items()
        if isinstance(given, dict) and all(given.get(key) in (None, []) for key in SPREAD)
    ]
    if not exact:
        return ()
    one, value = len(exact) == 1, budget.inputs[exact[0]].value
    # A unit, or words, have no place beside a plain number.
    bare = all([*keys[name]] == ["value"] for name in exact)
    bare = bare and all(item.unit is None for item in budget.inputs.values())
    constant = f"`{exact[0]}: {value:.15g}`" if bare else "with `u: 0`"
    text = (
        f"{_inputs(exact, document)}: no uncertainty "
        f"is given, so that {'it is' if one else 'they are'} taken as exact; a constant is written "
        f"{constant}"
    )
    return (Notice(code="taken-as-exact", message=text),)


def _inputs(named: Sequence[str], document: YamlDocument) -> str:
    """Where the first of these inputs stands, and the names of the first few."""
    more = f" and {len(named) - SHOWN_INPUTS} more" if len(named) > SHOWN_INPUTS else ""
    place = f"{document.source.shown}:{document.line_of('inputs', named[0])}"
    which = "input" if len(named) == 1 else "inputs"
    return f"{place}: {which} {', '.join(named[:SHOWN_INPUTS])}{more}"


def _unstated_units(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    """That inputs without a unit are left alone, where others have theirs: who states some expects
    that they are checked. A budget of plain numbers throughout says nothing of units.
    """
    used = {name for tree in trees.values() for name in names(tree)}
    without = [name for name, item in budget.inputs.items() if item.unit is None and name in used]
    if not without or all(item.unit is None for item in budget.inputs.values()):
        return ()
    one = len(without) == 1
    alone = any(not isinstance(document.data["inputs"][name], dict) for name in without)
    constant = ", with `u: 0` where it is a constant" if alone else ""
    text = (
        f"{_inputs(without, document)}: no `unit:`, so "
        f"that no term with {'it' if one else 'one of them'} is checked; `unit: '1'` is that of a "
        f"plain number{constant}"
    )
    return (Notice(code="unit-not-stated", message=text),)


def _ones_in_units(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    """What a 1 is taken for beside a share in a unit of its own."""
    units = BudgetUnits.of_inputs({name: item.unit for name, item in budget.inputs.items()})
    found = []
    for name, tree in trees.items():
        place = _place_of(budget, name)
        for term, what in ones_in_units(units, tree, stated_unit(budget, place)):
            line = document.line_of(*place)
            text = f"{document.source.shown}:{line}: {path_text(place)}: in {term!r} {what}"
            found.append(Notice(code="one-in-unit", message=text))
    return tuple(found)


def _like_kelvin(
    budget: Budget, trees: Mapping[str, Node], document: YamlDocument
) -> tuple[Finding, ...]:
    """Temperatures in K beside what may be degC, ones in degC that would be a room's in K, and
    ones in either that make a result in the other.
    """
    found = []
    results = (
        other_scale(budget.inputs, tree, stated_unit(budget, _place_of(budget, name)))
        for name, tree in trees.items()
    )
    mixed_ones = [*mixed_temperatures(budget.inputs, trees.values()), *filter(None, results)]
    for mixed in dict.fromkeys(mixed_ones):
        if not mixed.sure:
            line = document.line_of("inputs", mixed.name, "unit")
            text = f"{document.source.shown}:{line}: inputs.{mixed.name}: {mixed.what}; expected "
            found.append(Notice(code="like-kelvin", message=text + mixed.expected))
    return tuple(found)


def _near(unit: str | None) -> str | None:
    """The unit that an unknown one is but for a slip, if one is nearest."""
    if unit is None or "/" in unit or unit_exponents(unit, GRAMS[0]) is not None:
        return None
    # Symbols that are known elsewhere (mph, rpm) are no slips; a letter too many is.
    once = DOUBLED.sub(r"\1", unit)
    if once != unit and once in COMMON:
        return once
    near = nearest(unit, WORDS) if len(unit) >= SHORTEST else []
    like = len(near) == 1 and near[0][:1] == unit[:1].lower()
    return near[0] if like and abs(len(near[0]) - len(unit)) <= MOST_LETTERS else None


def _unclear_units(budget: Budget, document: YamlDocument) -> tuple[Finding, ...]:
    """Units that are left alone, as nothing tells what stands under their line, or as they are
    known but for a slip.
    """
    shown = document.source.shown
    found = []
    for name, item in budget.inputs.items():
        clear = meant(item.unit) or _near(item.unit)
        if clear is not None:
            line = document.line_of("inputs", name, "unit")
            text = (
                f"{shown}:{line}: inputs.{name}.unit: {item.unit!r} is not read, so that no sum "
                f"with it is checked; is {clear} meant?"
            )
            found.append(Notice(code="unit-unclear", message=text))
    return tuple(found)
