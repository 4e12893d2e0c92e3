"""Files of families of effects (``mtu/effects/1``): their contract, names and equations.

Names in braces stand for what the data has: ``{a}`` and ``{b}`` for axes, ``{n}`` for the axis
normal to both, ``{each}`` for every axis of the errors at once, ``{T}`` for a temperature
column, ``{c}`` for a column that counts parts and ``{v}`` for any other numeric column. A name
followed by ``0``, ``_low`` or ``3`` in the braces is a number of the data: ``{a0}`` its centre,
``{a_low}`` its lowest value, ``{a3}`` sum d^4 / sum d^2 with d = a - a0.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
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
from mtu_cli.findings import InputError, error, finding, nearest, suggestion
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
WORD = re.compile(r"\{([^{}]*)\}")
"""What stands in braces in a text."""
SENTENCE = (
    "{A} {B} its axes, {value} {size} {twice} its parameter, {wave} the root of the sum of "
    "squares, {searched} {at} {covariate} {chosen} {values}, {row} part or pass, {column} feature "
    "or position"
)
"""All words that a `sentence` may use."""
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

    @property
    def placeholders(self) -> set[str]:
        """Those of its equations."""
        return marks(*self.equations, *self.equations.values())

    @cached_property
    def trees(self) -> dict[str, Node]:
        """The equations by key, keys and names as in the file: ``E{a}``, ``dir_{a}``."""
        return {key: parse(text, name=BRACED) for key, text in self.equations.items()}

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """The names in its equations, each once."""
        return (*dict.fromkeys(name for tree in self.trees.values() for name in names(tree)),)


class Family(Contract):
    """A family of candidate effects; either one form, or several as `members`."""

    family: FamilyName
    name: Name | None = optional("Name of a candidate; family-{a} or the family where not given")
    says: Text = Field(description="What it is, in words; {a} {b} {n}: axes of its `name`")
    separates: Text | None = optional("What tells it from its rivals; {a} {b} {n} as in `says`")
    separates_readings: Text | None = optional(
        "The same of readings of a component, where it is not the same"
    )
    sentence: str = optional(
        f"What it does, with its size: {SENTENCE}; (gains|loses) by the sign of the first "
        "parameter",
        "",
    )
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

    @cached_property
    def forms(self) -> list[MemberTemplate]:
        """Its one form, and its members."""
        if self.parameters is None or self.equations is None:
            return self.members or []
        of_family = {key: getattr(self, key) for key in ("parameters", "equations", "search")}
        return [MemberTemplate.model_construct(**of_family), *(self.members or [])]

    @property
    def label(self) -> str:
        """The name of its candidates, axes in braces."""
        of_axes = any("a" in form.placeholders for form in self.forms)
        return self.name or self.family + "-{a}" * of_axes

    @property
    def name_axes(self) -> str:
        """The axes that its candidates are named by, and its texts may use: a; a, b; a, b, n."""
        named = marks(self.label)
        return "abn" if "n" in named else "ab" if "b" in named else "a" if "a" in named else ""

    def check(self, faults: Faults) -> None:
        """Its keys and names in braces agree, its equations are linear in the parameters."""
        of_members = [faults.at("members", index) for index, _ in enumerate(self.members or ())]
        places = [faults] * (len(self.forms) - len(of_members)) + of_members
        if self.kind == "scatter":
            if self.family not in SCATTERS:
                expected = f"a family that is one of: {', '.join(SCATTERS)}"
                faults.at("kind").add("wrong-value", expected=expected)
        elif not self.forms:
            for key in ("parameters", "equations"):
                if getattr(self, key) is None:
                    faults.add("missing-key", key=key)
        if self.kind == "outlier" and self.over is None:
            faults.add("missing-key", key="over", expected="over: feature, part or operation")
        for key in ("name", "says", "separates", "separates_readings", "sentence"):
            known = WORD.findall(SENTENCE) if key == "sentence" else self.name_axes
            for word in WORD.findall(getattr(self, key) or ""):
                if word not in known:
                    facts = {"what": "name in braces", "value": word, **suggestion(word, known)}
                    faults.at(key).add("unknown-name", **facts)
        of_forms = (form.placeholders for form in (*self.forms, *self.margins))
        placeholders = marks(self.label).union(*of_forms)
        for mark, other in (("b", "{a}"), ("n", "{b}")):
            if mark in placeholders and other[1] not in placeholders:
                faults.add("incomplete", what=f"`{{{mark}}}`", other=other)
        if "each" in placeholders and placeholders & {*AXIS_MARKS} != {"each"}:
            faults.add("misplaced", key="{each}", where="a family without {a} and {b}")
        for form, here in zip(self.forms, places, strict=True):
            _check_form(form, form.search, self, here)
        for index, margin in enumerate(self.margins):
            _check_form(margin, self.search, self, faults.at("margins", index))


class Effects(Contract):
    """A library of candidate effects."""

    schema_: Literal["mtu/effects/1"] = Field(alias="schema")
    effects: Annotated[list[Family], Field(min_length=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectLibrary:
    """Families of candidates, and the files that they are of."""

    families: tuple[Family, ...]
    sources: tuple[Source, ...]


def load_effects(path: Path, owners: Mapping[str, str] | None = None) -> EffectLibrary:
    """Reads and checks an effects file; `owners` says whose the names are that it must not use.

    Raises InputError with all faults of the file, each with its line.
    """

    def check(effects: Effects, faults: Faults) -> None:
        families = present(effects.effects)
        for index, family in families:
            if owner := (owners or {}).get(family.family):
                faults.at("effects", index, "family").add("name-taken", taken=owner)
        family_names = ((index, family.label) for index, family in families)
        faults.at("effects").once(family_names, "the name of a family's candidates")

    document = read_yaml(path, "effects")
    effects = check_contract(document, Effects, "effects", check)
    return EffectLibrary(families=tuple(effects.effects), sources=(document.source,))


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


# What is checked beyond the contract.


def _check_form(
    form: MemberTemplate, searched: Collection[str], family: Family, faults: Faults
) -> None:
    """Names, the search, and equations in these, the parameters and what is `searched`."""
    before, base = len(faults.findings), dict.fromkeys(LANGUAGE, "part of the equation language")
    for name in form.parameters:
        uses = dict.fromkeys(searched, "what is searched") | base
        faults.at("parameters", name).symbol(filled(name, {"each": "each"}), uses, NAMED)
    for name, search in form.search.items():
        faults.at("search", name).symbol(name, base)
        _check_search(search, family, faults.at("search", name))
        if family.over is not None:
            owner = "a family without `over`"
            faults.at("search").add("misplaced", key="search", where=owner)
    for key, text in form.equations.items():
        here = faults.at("equations", key)
        if not _EQUATION.fullmatch(key):
            expected = "Ex, Ey, Ez, E{a}, E{b}, E{n} or E{each}"
            here.add("wrong-value", value=key, expected=expected)
        elif key == "E{each}" and len(form.equations) > 1:
            here.add("misplaced", key=key, where="an effect with no other equation")
        with here.collected():
            _check_equation(parse(text, name=BRACED), key, form.parameters, searched, family)
    required = {name: faults.at("parameters", name) for name in form.parameters}
    required |= {name: faults.at("search", name) for name in form.search}
    required |= {CHOSEN: faults.at("equations")} if family.over is not None else {}
    if len(faults.findings) == before:
        for name in (name for name in required if name not in form.symbols):
            required[name].add("not-applicable", reason="it is in no equation", value=name)


def _is_column(raw: str, family: Family) -> bool:
    """Whether a name is a position, a column of the data or a number of one."""
    number = number_of(raw)
    plain = filled(raw if number is None else number[0], STAND_INS)
    return plain in (*POSITIONS, *family.needs, STAND_INS["v"]) or is_covariate(plain)


def _check_equation(
    tree: Node,
    key: str,
    parameters: Mapping[str, str],
    searched: Collection[str],
    family: Family,
) -> None:
    """It is linear in the parameters, which all its terms have, and its terms are lengths. Raises
    InputError with its faults.
    """
    symbols = {*parameters, *searched} | ({CHOSEN} if family.over is not None else set())
    faults = []
    for name, column in names(tree).items():
        if name not in symbols and not _is_column(name, family):
            facts = {"value": name, "meant": nearest(name, parameters), "expected": COLUMNS}
            faults.append(finding("unknown-name", what="name", column=column, **facts))
        elif "each" in marks(name) and key != "E{each}":
            faults.append(finding("misplaced", key=name, where="E{each}", column=column))
    if faults:
        raise InputError(faults)
    # Numbers of the data are written as literals, which have no unit.
    number = {name: 1.0 for name in names(tree) if name in searched or number_of(name)}
    data_names = names(tree).keys() - {*parameters, *number}
    columns = {name: column_dimensions(filled(name, STAND_INS)) for name in data_names}
    columns |= {CHOSEN: NUMBER}
    units = {name: PARAMETER_UNITS[unit] for name, unit in parameters.items()}
    form = linear_form(tree, parameters)
    check_dimension(filled_tree(tree, number), internal(LENGTH), {}, units, columns)
    if form.remainder is not None:
        reason, expected = "a term without a parameter", "parameters in every term"
        raise error("not-applicable", reason=reason, column=1, expected=expected)


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
