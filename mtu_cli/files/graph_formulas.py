"""Formulas of a graph's `compute`: parsed, and their names against the input places."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings
from mtu_cli.files.graph_contract import Place, Transition
from mtu_cli.files.graph_kinds import COORDINATES, NAMED_BY_COORDINATE
from mtu_cli.files.graph_names import known_places
from mtu_cli.files.yaml_file import YamlPath
from mtu_cli.language import EquationError, Node, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.tree import Name, rewritten

_DOTTED = re.compile(r"(?<![\w.])([A-Za-z_][A-Za-z_0-9]*)\.(?=[A-Za-z_])")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")


def formula_of(
    item: Transition, places: Mapping[str, Place], path: YamlPath, findings: Findings
) -> Node | None:
    """The tree of a formula whose names are inputs: a constant or coordinate by its name, a
    point or vector by those of its coordinates, ``H1.x``. None with the faults in `findings`.
    """
    if item.formula is None:
        findings.add(path, "compute without a formula", expected="`formula:` in the input places")
        return None
    try:
        node = parse_dotted(item.formula)
        for name, column in names(node).items():
            _check_name(name, column, item.in_, places)
    except EquationError as error:
        document, where = findings.document, (*path, "formula")
        line = document.line_of(*where)
        findings.problems.append(
            error.problem(file=document.source.shown, line=line, path=path_text(where))
        )
        return None
    used = {place_of(name) for name in names(node)}
    for at, name in enumerate(item.in_):
        if name not in used:
            findings.add((*path, "in", at), "the formula does not use this input", value=name)
    return node


def parse_dotted(text: str) -> Node:
    """The tree of a formula whose names may be those of coordinates, ``H1.x``.

    The equation language knows no dots: it is given underscores, and the names are put back at
    their columns.
    """
    dotted = {match.start() + 1 for match in _DOTTED.finditer(text)}
    tree = parse(_DOTTED.sub(r"\1_", text), BUDGET_FUNCTIONS)

    def named(node: Node) -> Node:
        if not isinstance(node, Name) or node.column not in dotted:
            return node
        word = _WORD.match(text, node.column - 1)
        return node if word is None else replace(node, name=word.group())

    return rewritten(tree, named)


def place_of(name: str) -> str:
    """The place of a name in a formula: H1 of ``H1.x``."""
    return name.partition(".")[0]


def coordinate_names(place: str, kind: str) -> tuple[str, ...]:
    """How a formula names what is in a place: ``x1``, or ``H1.x``, ``H1.y``, ``H1.z``."""
    if kind not in NAMED_BY_COORDINATE:
        return (place,)
    return tuple(f"{place}.{item}" for item in COORDINATES[kind])


def _check_name(name: str, column: int, inputs: Iterable[str], places: Mapping[str, Place]) -> None:
    place = place_of(name)
    if place not in inputs:
        hint = known_places(place, inputs)
        raise EquationError(f"{place!r} is not an input of this transition", column, hint)
    if place not in places:
        return
    kind = places[place].kind
    known = coordinate_names(place, kind)
    if name in known:
        return
    what = f"a {kind} has no such coordinate: {name!r}"
    if name == place:
        what = f"{name!r} is a {kind}: a formula takes its coordinates"
    raise EquationError(what, column, f"one of: {', '.join(known)}" if known[1:] else known[0])
