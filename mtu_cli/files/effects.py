"""Files of families of effects (``mtu/effects/1``): their contract, names and equations.

Names in braces stand for what the data has: ``{a}`` and ``{b}`` for axes, ``{n}`` for the axis
normal to both, ``{each}`` for every axis of the errors at once, ``{T}`` for a temperature
column, ``{c}`` for a column that counts parts and ``{v}`` for any other numeric column. A name
followed by ``0``, ``_low`` or ``3`` in the braces is a number of the data: ``{a0}`` its centre,
``{a_low}`` its lowest value, ``{a3}`` sum d^4 / sum d^2 with d = a - a0.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from mtu_cli.files.contract import (
    IDENTIFIER,
    Contract,
    Faults,
    Name,
    check_contract,
    one_or_more,
    optional,
    present,
)
from mtu_cli.files.covariates import COVARIATES, NUMBER, POSITIONS, column_dimensions, is_covariate
from mtu_cli.files.machine import AxisName, EquationText, ParameterUnitName
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import InputError, error, finding, nearest
from mtu_cli.language import Node, check_dimension, check_known, linear_form, names, parse
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.parser import BRACED
from mtu_cli.language.tree import filled_tree
from mtu_cli.units import LENGTH, PARAMETER_UNITS, internal

MAX_GRID = 500
BOUNDS = ("span", "spacing", "low", "high")
"""What the ends of a search may be given in."""
AXIS_MARKS = ("a", "b", "n", "each")
COLUMN_MARKS = ("T", "c", "v")
STAND_INS = dict.fromkeys(AXIS_MARKS, "x") | {"T": "T_any_degC", "c": "sequence", "v": "{v}"}
"""Columns that the names in braces are checked as; of {v} nothing is known."""
CHOSEN = "chosen"
LANGUAGE = (*POSITIONS, "pi", CHOSEN, *COVARIATES, *MACHINE_FUNCTIONS)
SCATTERS = ("rotation-scatter", "scale-scatter", "operation-scatter")
"""Effects on the scatter are no equations: close-loop knows these."""
COLUMNS = "a parameter, a position, a column that `needs` names, or {a} {b} {T} {c} {v}"
NAMED = f"{IDENTIFIER}; {{each}} in a parameter's"
_BRACES = re.compile(r"\{(\w+?)(_low|0|3)?\}", re.ASCII)
_EQUATION = re.compile(r"E(?:[xyz]|\{(?:a|b|n|each)\})")

# The contract.

Text = Annotated[str, Field(min_length=1)]
FamilyName = Annotated[str, Field(pattern="^[a-z][a-z0-9-]*$")]
EffectEquations = Annotated[dict[Name, EquationText], Field(min_length=1)]
EffectParameters = Annotated[dict[Name, ParameterUnitName], Field(min_length=1)]
Kind = Literal["mean", "offset", "outlier", "scatter"]
Bounds = Annotated[list[EquationText], one_or_more(float | str)]
"""Numbers or expressions in `BOUNDS` of the column searched along."""


class Search(Contract):
    """The grid of a parameter in which the equation is not linear."""

    of: Text | None = optional("The position or column that `span` and `low` are of")
    grid: Literal["linear", "log", "frequency", "between"] = optional(
        "Even steps, even ratios, even steps of 1/value (at most a quarter of "
        "1/span), or half-way between the values of `of`",
        "linear",
    )
    from_: Bounds = optional("The largest of these", ["low"], alias="from")
    to: Bounds = optional("The smallest of these", ["high"])
    count: Annotated[int, Field(ge=2, le=MAX_GRID)] | None = optional(
        "Number of values; the largest number of a frequency grid"
    )


Searched = Annotated[dict[Name, Search], Field(max_length=1)]


class MemberTemplate(Contract):
    """One form of a family: its parameters, and its equations linear in them."""

    parameters: EffectParameters = Field(description="Name and unit")
    equations: EffectEquations = Field(description="mm; linear in the parameters")
    search: Searched = optional("A parameter that is searched", {})
    readings: bool = optional("Whether it is tested on readings of a component alone", False)


class Family(Contract):
    """A family of candidate effects; either one form, or several as `members`."""

    family: FamilyName
    name: Name | None = optional("Name of a candidate; family-{a} or the family where not given")
    says: Text = Field(description="What it is, in words")
    separates: Text | None = optional("What tells it from its rivals")
    separates_readings: Text | None = optional(
        "The same of readings of a component, where it is not the same"
    )
    sentence: str = optional(
        "What it does, with its size: {A} {B} its axes, {value} {size} {twice} its parameter, "
        "{wave} the root of the sum of squares, {searched} {at} {covariate} {chosen} {values}, "
        "{row} part or pass, {column} feature or position; (gains|loses) by the sign of the first "
        "parameter",
        "",
    )
    sentence_readings: str = optional("The same of readings of a component", "")
    kind: Kind = optional("What of the errors it changes", "mean")
    over: Literal["feature", "part", "operation"] | None = optional(
        "`chosen` is 1 on one of these, 0 on the others"
    )
    axes: list[AxisName] | None = optional("What {a} may be; any if not given")
    least_axes: Annotated[int, Field(ge=1, le=3)] = optional("Axes with errors that it needs", 1)
    needs: list[Text] = optional("Columns that must be there and change", [])
    parameters: EffectParameters | None = optional("Name and unit")
    equations: EffectEquations | None = optional("mm; linear in the parameters")
    search: Searched = optional("A parameter that is searched", {})
    members: Annotated[list[MemberTemplate], Field(min_length=1)] | None = optional(
        "Several forms of the family, each tested by itself"
    )
    margins: list[MemberTemplate] = optional(
        "Terms of lower order that are estimated with a product wherever it is", []
    )


class Effects(Contract):
    """A library of candidate effects."""

    schema_: Literal["mtu/effects/1"] = Field(alias="schema")
    effects: Annotated[list[Family], Field(min_length=1)]


# What is checked beyond the contract.


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """One form of a family: `trees` by key and names as in the file (``E{a}``, ``dir_{a}``), linear
    in the parameters, whose `units` are given, with the `levers` of these; `columns` are what the
    equations name besides: columns, positions, numbers of them; `readings`: not for points.
    """

    units: dict[str, str]
    trees: dict[str, Node]
    levers: dict[str, dict[str, Node]]
    columns: tuple[str, ...]
    searched: str
    search: Search | None
    readings: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFamily:
    """A checked family: `name` of its candidates with axes in braces, its forms, its margins."""

    family: Family
    name: str
    templates: tuple[Template, ...]
    margins: tuple[Template, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectLibrary:
    """Families of candidates, and the files that they are of."""

    families: tuple[LoadedFamily, ...]
    sources: tuple[Source, ...]


def load_effects(path: Path, owners: Mapping[str, str] | None = None) -> EffectLibrary:
    """Reads and checks an effects file; `owners` says whose the names are that it must not use.

    Raises InputError with all faults of the file, each with its line.
    """
    families: list[LoadedFamily] = []

    def check(effects: Effects, faults: Faults) -> None:
        family_names = []
        for index, family in present(effects.effects):
            if owner := (owners or {}).get(family.family):
                faults.at("effects", index, "family").add("name-taken", taken=owner)
            families.append(_loaded(family, faults.at("effects", index)))
            family_names.append((index, families[-1].name))
        faults.at("effects").once(family_names, "the name of a family's candidates")

    document = read_yaml(path, "effects")
    check_contract(document, Effects, "effects", check)
    return EffectLibrary(families=tuple(families), sources=(document.source,))


def marks(*texts: str) -> set[str]:
    """The placeholders of texts; literal names have none.

    >>> sorted(marks("{a0}*dir_{b}"))
    ['a', 'b']
    """
    result = {name for text in texts for name, _ in _BRACES.findall(text)}
    return result & {*AXIS_MARKS, *COLUMN_MARKS}


def filled(text: str, binding: Mapping[str, str]) -> str:
    """A text with its names in braces filled in, numbers of the data as they are."""
    for mark, name in binding.items():
        text = text.replace("{" + mark + "}", name)
    return text


def number_of(raw: str) -> tuple[str, str] | None:
    """Column and kind of a number of the data: ``{a0}`` -> (``{a}``, ``0``), ``{load0}`` ->
    (``load``, ``0``); None for other names.
    """
    match = _BRACES.fullmatch(raw)
    if match is None or match[2] is None:
        return None
    return ("{" + match[1] + "}" if marks(raw) else match[1]), match[2]


def _loaded(family: Family, faults: Faults) -> LoadedFamily:
    """A family whose keys and names in braces agree; else their faults are added."""
    at_members, at_margins = faults.at("members"), faults.at("margins")
    forms = [(member, at_members.at(index)) for index, member in present(family.members)]
    if family.parameters is not None and family.equations is not None:
        of_family = {key: getattr(family, key) for key in ("parameters", "equations", "search")}
        forms.insert(0, (MemberTemplate.model_construct(**of_family), faults))
    if family.kind == "scatter":
        if family.family not in SCATTERS:
            expected = f"a family that is one of: {', '.join(SCATTERS)}"
            faults.at("kind").add("wrong-value", expected=expected)
    elif not forms and "members" not in (keys := faults.valued_keys()):
        for key in ("parameters", "equations"):
            if key not in keys:
                faults.add("missing-key", key=key)
    if family.kind == "outlier" and family.over is None:
        faults.add("missing-key", key="over", expected="over: feature, part or operation")
    placeholders = _marks_of(form for form, _ in forms)
    name, margins = family.name or family.family + ("-{a}" if "a" in placeholders else ""), []
    for index, margin in present(family.margins):
        # A margin has what is searched where its equations name it.
        words = {name for text in margin.equations.values() for name in re.findall(r"\w+", text)}
        search = {name: item for name, item in family.search.items() if name in words}
        margins.append((margin.model_copy(update={"search": search}), at_margins.at(index)))
    placeholders |= marks(name) | _marks_of(margin for margin, _ in margins)
    for mark, other in (("b", "{a}"), ("n", "{b}")):
        if mark in placeholders and other[1] not in placeholders:
            faults.add("incomplete", what=f"`{{{mark}}}`", other=other)
    if "each" in placeholders and placeholders & {*AXIS_MARKS} != {"each"}:
        faults.add("misplaced", key="{each}", where="a family without {a} and {b}")
    return LoadedFamily(
        family=family,
        name=name,
        templates=tuple(_template(form, family, here) for form, here in forms),
        margins=tuple(_template(form, family, here) for form, here in margins),
    )


def _marks_of(forms: Iterable[MemberTemplate]) -> set[str]:
    return marks(*(text for form in forms for pair in form.equations.items() for text in pair))


def _template(form: MemberTemplate, family: Family, faults: Faults) -> Template:
    """The template, whose faults are added: of names, of the search, of equations."""
    before, base = len(faults.findings), dict.fromkeys(LANGUAGE, "part of the equation language")
    places = [("parameters", name) for name in form.parameters]
    places += [("search", name) for name in form.search]
    for key, name in places:
        uses = dict.fromkeys(form.parameters if key == "search" else (), "a parameter") | base
        faults.at(key, name).symbol(filled(name, {"each": "each"}), uses, NAMED)
    searched, search = next(iter(form.search.items()), ("", None))
    if search is not None:
        _check_search(search, family, faults.at("search", searched))
        if family.over is not None:
            owner = "a family without `over`"
            faults.at("search").add("misplaced", key="search", where=owner)
    trees, levers = dict[str, Node](), dict[str, dict[str, Node]]()
    for key, text in form.equations.items():
        here = faults.at("equations", key)
        if not _EQUATION.fullmatch(key):
            expected = "Ex, Ey, Ez, E{a}, E{b}, E{n} or E{each}"
            here.add("wrong-value", value=key, expected=expected)
        elif key == "E{each}" and len(form.equations) > 1:
            here.add("misplaced", key=key, where="an effect with no other equation")
        with here.collected():
            trees[key] = parse(text, name=BRACED)
            levers[key] = _levers(trees[key], key, form.parameters, searched, family)
    symbols = dict.fromkeys(name for tree in trees.values() for name in names(tree))
    if len(faults.findings) == before:
        unused = [(faults.at(*place), place[1]) for place in places if place[1] not in symbols]
        if family.over is not None and CHOSEN not in symbols:
            unused.append((faults.at("equations"), CHOSEN))
        for here, name in unused:
            here.add("not-applicable", reason="it is in no equation", value=name)
    return Template(
        units=dict(form.parameters),
        trees=trees,
        levers=levers,
        columns=tuple(x for x in symbols if x not in {*form.parameters, searched, CHOSEN}),
        searched=searched,
        search=search,
        readings=form.readings,
    )


def _is_column(raw: str, family: Family) -> bool:
    """Whether a name is a position, a column of the data or a number of one."""
    number = number_of(raw)
    plain = filled(raw if number is None else number[0], STAND_INS)
    return plain in (*POSITIONS, *family.needs, STAND_INS["v"]) or is_covariate(plain)


def _levers(
    tree: Node, key: str, parameters: Mapping[str, str], searched: str, family: Family
) -> dict[str, Node]:
    """The levers of the parameters of an equation that is linear in these, which all its terms
    have, and its terms are lengths. Raises InputError with its faults.
    """
    symbols = {*parameters, searched} | ({CHOSEN} if family.over is not None else set())
    faults = []
    for name, column in names(tree).items():
        if name not in symbols and not _is_column(name, family):
            facts = {"value": name, "meant": nearest(name, parameters), "expected": COLUMNS}
            faults.append(finding("unknown-name", what="name", column=column, **facts))
        elif "each" in marks(name) and key != "E{each}":
            faults.append(finding("misplaced", key=name, where="E{each}", column=column))
    if faults:
        raise InputError(faults)
    form = linear_form(tree, parameters)
    # Numbers of the data are written as literals, which have no unit.
    number = {name: 1.0 for name in names(tree) if name == searched or number_of(name)}
    columns = {CHOSEN: NUMBER}
    for name in names(tree).keys() - {*parameters, *number}:
        if (powers := column_dimensions(filled(name, STAND_INS))) is not None:
            columns[name] = powers
    units = {name: PARAMETER_UNITS[unit] for name, unit in parameters.items()}
    equation = filled_tree(tree, number)
    check_dimension(equation, internal(LENGTH), {}, units, columns)
    if form.remainder is not None:
        reason, expected = "a term without a parameter", "parameters in every term"
        raise error("not-applicable", reason=reason, column=1, expected=expected)
    return form.coefficients


def _check_search(search: Search, family: Family, faults: Faults) -> None:
    """The ends of a grid are expressions in `BOUNDS`."""
    symbols = set[str]()
    for key in ("from_", "to"):
        for text in getattr(search, key):
            with faults.at(key.rstrip("_")).collected():
                tree = parse(text)
                check_known(tree, BOUNDS)
                symbols |= names(tree).keys()
    if search.of is None and (symbols or search.grid in ("between", "frequency")):
        expected = "the position or column that span, low and the grid are of"
        faults.add("missing-key", key="of", expected=expected)
    elif search.of is not None and not _is_column(search.of, family):
        faults.at("of").add("unknown-name", what="name", expected=COLUMNS)
