"""Templates of candidate families (``mtu/effects/1``): their names, equations and searches checked.

Names in braces stand for what the data has: ``{a}`` and ``{b}`` for axes, ``{n}`` for the axis
normal to both, ``{each}`` for every axis of the errors at once, ``{T}`` for a temperature
column, ``{c}`` for a column that counts parts and ``{v}`` for any other numeric column. A name
followed by ``0``, ``_low`` or ``3`` in the braces is a number of the data: ``{a0}`` its centre,
``{a_low}`` its lowest value, ``{a3}`` sum d^4 / sum d^2 with d = a - a0.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mtu_cli.files.contract import (
    Faults,
    check_contract,
    is_identifier,
    present,
)
from mtu_cli.files.covariates import (
    NUMBER,
    PLACE,
    TEMPERATURE,
    column_dimensions,
)
from mtu_cli.files.effects import BOUNDS, Effects, Family, MemberTemplate, Search
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding, InputError, error, finding, nearest
from mtu_cli.language import LinearForm, Node, check_dimension, linear_form, names, parse, to_text
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.parser import BRACED
from mtu_cli.language.tree import Call, Name, Number, first_column, shown, walk
from mtu_cli.units import LENGTH, PARAMETER_UNITS, Powers, internal

AXIS_MARKS = ("a", "b", "n", "each")
COLUMN_MARKS = ("T", "c", "v")
NUMBER_ENDS = ("_low", "0", "3")
CHOSEN = "chosen"
UNUSED = "it is in no equation"
SCATTERS = ("rotation-scatter", "scale-scatter", "operation-scatter")
"""Effects on the scatter are no equations: close-loop knows these."""
COLUMNS = "a parameter, a position, a column that `needs` names, or {a} {b} {T} {c} {v}"
_BRACES = re.compile(r"\{([A-Za-z_0-9]+)\}")
_POSITIONS = ("x", "y", "z", "{a}", "{b}", "{n}", "{each}")
_EQUATION = re.compile(r"E(?:[xyz]|\{(?:a|b|n|each)\})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """One form of a family: `trees` and their linear `forms` in the parameters.

    Keys and names are as in the file (``E{a}``, ``dir_{a}``). `units` by parameter; `raw_names`
    are the other names of the trees. `readings`: not for points.
    """

    units: dict[str, str]
    forms: dict[str, LinearForm]
    trees: dict[str, Node]
    searched: str | None
    search: Search | None
    raw_names: tuple[str, ...]
    readings: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFamily:
    """A checked family: `name` of its candidates with axes in braces, and its templates."""

    family: Family
    name: str
    templates: tuple[Template, ...]
    line: int | None

    def marks(self) -> set[str]:
        """The placeholders of all its templates and its name."""
        texts = [text for own in self.templates for text in (*own.raw_names, *own.forms)]
        return marks(" ".join([self.name, *texts]))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedEffects:
    """A checked effects file."""

    source: Source
    families: tuple[LoadedFamily, ...]


def load_effects(path: Path, taken: Mapping[str, str] | None = None) -> LoadedEffects:
    """Reads and checks an effects file; `taken` says whose the names are that it must not use.

    Raises InputError with all faults of the file, each with its line.
    """
    try:
        document = read_yaml(path, "effects")
    except InputError as error:
        raise InputError([_braces_hint(fault, path) for fault in error.findings]) from None
    return effects_from(document, taken)


def effects_from(document: YamlDocument, taken: Mapping[str, str] | None = None) -> LoadedEffects:
    """Checks an effects file that was read already: a list of families, or with `schema`.

    Raises InputError with all faults of the document.
    """
    families: list[LoadedFamily] = []

    def check(effects: Effects, faults: Faults) -> None:
        found = present(effects.effects)
        named = [(index, _name(family)) for index, family in found]
        faults.once(("effects",), named, "the name of a family's candidates")
        for index, family in found:
            path: YamlPath = ("effects", index)
            if owner := (taken or {}).get(family.family):
                faults.add((*path, "family"), "name-taken", taken=owner, value=family.family)
            loaded = _loaded(family, path, faults)
            if loaded is not None:
                families.append(loaded)

    check_contract(_with_schema(document), Effects, "effects", check)
    return LoadedEffects(source=document.source, families=tuple(families))


def _with_schema(document: YamlDocument) -> YamlDocument:
    """A list of families as the file that it stands for."""
    if not isinstance(document.data, list):
        return document
    lines = {("effects", *path): line for path, line in document.lines.items()}
    data = {"schema": "mtu/effects/1", "effects": document.data}
    lines = {(): document.line_of() or 1, **lines}
    return replace(document, data=data, lines=lines)


def _braces_hint(fault: Finding, path: Path) -> Finding:
    """YAML takes braces for keys within [...] and {...}."""
    if fault.line is None or fault.code != "not-readable":
        return fault
    text = path.read_text("utf-8-sig", "replace").splitlines()[fault.line - 1 : fault.line]
    if not marks(" ".join(text)):
        return fault
    example = "['dir_{a}']" if "[" in text[0] else "{'E{a}': k*x}"
    hint = f"names with braces on lines of their own, or in quotes: {example}"
    return replace(fault, expected=hint, meant=())


def marks(text: str) -> set[str]:
    """The placeholders of a text; literal names have none.

    >>> sorted(marks("{a0}*dir_{b}"))
    ['a', 'b']
    """
    found = set()
    for inner in _BRACES.findall(text):
        own = number_of("{" + inner + "}")
        found.add(inner if own is None else own[0])
    return found & {*AXIS_MARKS, *COLUMN_MARKS}


def number_of(raw: str) -> tuple[str, str] | None:
    """Name and kind of a number of the data: ``{a0}`` -> (``a``, ``0``); None for other names."""
    inner = raw[1:-1] if _BRACES.fullmatch(raw) else ""
    for end in NUMBER_ENDS:
        if len(inner) > len(end) and inner.endswith(end):
            return inner.removesuffix(end), end
    return None


def _forms(family: Family) -> list[tuple[MemberTemplate, YamlPath]]:
    """The sound forms of a family, each with its path in it."""
    found: list[tuple[MemberTemplate, YamlPath]] = []
    if family.parameters is not None and family.equations is not None:
        own = MemberTemplate.model_construct(
            parameters=family.parameters, equations=family.equations, search=family.search or {}
        )
        found.append((own, ()))
    return found + [(member, ("members", index)) for index, member in present(family.members)]


def _name(family: Family) -> str:
    texts = [each for form, _ in _forms(family) for own in form.equations.items() for each in own]
    ending = "-{a}" if "a" in marks(" ".join(texts)) else ""
    return family.name or f"{family.family}{ending}"


def _loaded(family: Family, path: YamlPath, faults: Faults) -> LoadedFamily | None:
    before = len(faults.findings)
    name = _name(family)
    _check_shape(family, path, faults)
    for mark in sorted(marks(name) - {"a", "b", "n"}):
        where = "equations, a name has {a}, {b} or {n}"
        faults.add((*path, "name"), "misplaced", key=f"{{{mark}}}", where=where, value=name)
    for key in ("says", "separates", "separates_readings"):
        for mark in sorted(marks(getattr(family, key) or "") - marks(name)):
            other = f"it in the name '{name}'"
            faults.add((*path, key), "incomplete", what=f"`{{{mark}}}`", other=other)
    templates = [_template(form, family, (*path, *inner), faults) for form, inner in _forms(family)]
    if len(faults.findings) > before:
        return None
    loaded = LoadedFamily(
        family=family,
        name=name,
        templates=tuple(own for own in templates if own is not None),
        line=faults.document.line_of(*path),
    )
    found = loaded.marks()
    for mark, others in (("b", {"a"}), ("n", {"a", "b"})):
        if mark in found and not others <= found:
            other = " and ".join(f"{{{each}}}" for each in sorted(others))
            faults.add(path, "incomplete", what=f"`{{{mark}}}`", other=other)
    if "each" in found and found & set(AXIS_MARKS) != {"each"}:
        faults.add(path, "misplaced", key="{each}", where="a family without {a} and {b}")
    return loaded


def _check_shape(family: Family, path: YamlPath, faults: Faults) -> None:
    """Which keys go with the kind of a family, and with each other."""
    keys = faults.given(*path)
    own = [key for key in ("parameters", "equations", "search") if key in keys]
    if family.kind == "scatter":
        if family.family not in SCATTERS:
            expected = f"a family that is one of: {', '.join(SCATTERS)}"
            faults.add((*path, "kind"), "wrong-value", value=family.kind, expected=expected)
        for key in [*own, "members"]:
            if key in keys:
                faults.add((*path, key), "misplaced", key=key, where="effects on the mean")
    elif "members" in keys and own:
        faults.add((*path, own[0]), "misplaced", key=own[0], where="each of `members`")
    elif "members" not in keys:
        for key in ("parameters", "equations"):
            if key not in keys:
                faults.add(path, "missing-key", key=key)
    if family.kind == "outlier" and family.over is None:
        expected = "over: feature, part or operation"
        faults.add(path, "missing-key", key="over", expected=expected)


def _template(
    form: MemberTemplate, family: Family, path: YamlPath, faults: Faults
) -> Template | None:
    """The checked template, or None where something is wrong."""
    before = len(faults.findings)
    _check_names(form, path, faults)
    searched, search = next(iter(form.search.items()), (None, None))
    known = _Known(form.parameters, searched, tuple(family.needs), family.over is not None)
    if search is not None:
        _check_search(search, known, (*path, "search", str(searched)), faults)
    trees: dict[str, Node] = {}
    forms: dict[str, LinearForm] = {}
    for key, text in form.equations.items():
        here = (*path, "equations", key)
        if not _EQUATION.fullmatch(key):
            expected = "Ex, Ey, Ez, E{a}, E{b}, E{n} or E{each}"
            faults.add(here, "wrong-value", value=key, expected=expected)
        elif key == "E{each}" and len(form.equations) > 1:
            faults.add(here, "misplaced", key=key, where="an effect with no other equation")
        with faults.collected(here):
            trees[key] = parse(text, name=BRACED)
            forms[key] = _linear(trees[key], key, known)
    used = dict.fromkeys(name for tree in trees.values() for name in names(tree))
    if len(faults.findings) == before:
        places = [("parameters", name) for name in form.parameters]
        places += [("search", name) for name in form.search]
        for key, name in places:
            if name not in used:
                faults.add((*path, key, name), "not-applicable", reason=UNUSED, value=name)
        if family.over is not None and CHOSEN not in used:
            faults.add((*path, "equations"), "not-applicable", reason=UNUSED, value=CHOSEN)
    if len(faults.findings) > before:
        return None
    own = {*form.parameters, searched, CHOSEN}
    return Template(
        units=dict(form.parameters),
        forms=forms,
        trees=trees,
        searched=searched,
        search=search,
        raw_names=tuple(name for name in used if name not in own),
        readings=form.readings,
    )


def _check_names(form: MemberTemplate, path: YamlPath, faults: Faults) -> None:
    taken = {"x", "y", "z", "pi", CHOSEN, "time_min", "sequence", *MACHINE_FUNCTIONS}
    places = [("parameters", name) for name in form.parameters]
    places += [("search", name) for name in form.search]
    for key, name in places:
        if not is_identifier(name.replace("{each}", "_")):
            expected = "letters, digits and _, no digit first; {each} in a parameter's"
            facts = {"kind": "a name that equations can use", "expected": expected}
            faults.add((*path, key, name), "wrong-type", value=name, **facts)
        elif name in taken or (name in form.parameters and name in form.search):
            owner = "part of the equation language" if name in taken else "a parameter"
            faults.add((*path, key, name), "name-taken", value=name, taken=owner)


@dataclass(frozen=True, slots=True)
class _Known:
    """The names that an equation of a template may use."""

    units: Mapping[str, str]
    searched: str | None
    needs: tuple[str, ...]
    chosen: bool

    def is_column(self, raw: str) -> bool:
        """Whether a name is a position or a column of the data."""
        plain = raw in (*_POSITIONS, *self.needs, "time_min", "sequence", "{T}", "{c}", "{v}")
        direction = re.fullmatch(r"dir_(?:[xyz]|\{(?:a|b|n|each)\})", raw)
        return plain or bool(direction) or bool(re.fullmatch(r"T_\w+_degC", raw, re.ASCII))

    def __contains__(self, raw: str) -> bool:
        """Whether a name is known; ``{a0}`` is as ``{a}`` is."""
        own = number_of(raw)
        base = raw if own is None else own[0]
        if base in (*AXIS_MARKS, *COLUMN_MARKS):
            base = "{" + base + "}"
        chosen = raw == CHOSEN and self.chosen
        return raw in self.units or raw == self.searched or chosen or self.is_column(base)

    def column(self, raw: str) -> Powers | None:
        """Dimensions of a column, None where they are not known."""
        if raw in self.units or raw == self.searched:
            return None
        if raw in _POSITIONS or raw == "{T}":
            return TEMPERATURE if raw == "{T}" else PLACE
        if raw in ("{c}", CHOSEN) or raw.startswith("dir_"):
            return NUMBER
        return column_dimensions(raw)


def _linear(tree: Node, key: str, known: _Known) -> LinearForm:
    """An equation as a linear form in its parameters, all its terms lengths.

    Raises InputError with its faults.
    """
    unknown = []
    for name, column in names(tree).items():
        if name not in known:
            meant = nearest(name, known.units)
            unknown.append(
                finding("unknown-name", what="name", column=column, value=name, meant=meant,
                        expected=COLUMNS)
            )  # fmt: skip
        elif "each" in marks(name) and key != "E{each}":
            unknown.append(finding("misplaced", key=name, where="E{each}", column=column))
    if unknown:
        raise InputError(unknown)
    form = linear_form(tree, known.units, known.units)
    _check_units(tree, known)
    if form.remainder is not None:
        reason = "a term without a parameter"
        expected = "parameters in every term"
        raise error("not-applicable", reason=reason, column=1, expected=expected)
    return form


def _check_units(tree: Node, known: _Known) -> None:
    """Checks an equation as it will be written, with numbers of the data as literals, which have no
    unit; the term of a fault is shown as in the file.
    """
    parameters = {name: PARAMETER_UNITS[unit] for name, unit in known.units.items()}
    columns = {name: own for name in names(tree) if (own := known.column(name)) is not None}
    units = {name: internal(unit.dimension) for name, unit in parameters.items()}
    units |= {name: PLACE for name in names(tree) if name in _POSITIONS} | {CHOSEN: NUMBER}
    literal = {
        name: 1.0 for name in names(tree) if number_of(name) is not None or name == known.searched
    }
    written = filled_tree(tree, literal)
    try:
        check_dimension(written, internal(LENGTH), units, parameters=parameters, columns=columns)
    except InputError as error:
        texts: dict[object, str] = {
            (first_column(after), shown(after)): shown(before)
            for before, after in zip(walk(tree), walk(written), strict=True)
        }
        found = [
            replace(each, value=texts.get((each.column, each.value)) or each.value)
            for each in error.findings
        ]
        raise InputError(found) from None


def _check_search(search: Search, known: _Known, path: YamlPath, faults: Faults) -> None:
    """The ends of a grid: expressions in `BOUNDS`, and something between them."""
    used = set()
    for key, texts in (("from", search.from_), ("to", search.to)):
        for text in texts:
            try:
                own = names(parse(text))
            except InputError as error:
                faults.extend((*path, key), error)
                continue
            used |= own.keys() & set(BOUNDS)
            for name in own.keys() - set(BOUNDS):
                faults.unknown((*path, key), name, BOUNDS)
    if search.of is None and (used or search.grid in ("between", "frequency")):
        expected = "the position or column that span, low and the grid are of"
        faults.add(path, "missing-key", key="of", expected=expected)
    elif search.of is not None and not known.is_column(search.of):
        faults.add((*path, "of"), "unknown-name", what="name", value=search.of, expected=COLUMNS)
    if search.grid == "between":
        return
    starts, ends = _numbers(search.from_), _numbers(search.to)
    low, high = max(starts, default=None), min(ends, default=None)
    # Of several bounds the largest `from` counts, and an expression may be it.
    lowest = low if len(starts) == len(search.from_) else None
    for key, value in (("from", lowest), ("to", high)):
        if search.grid in ("log", "frequency") and value is not None and value <= 0:
            faults.add((*path, key), "wrong-value", value=f"{value:g}", expected="more than 0")
    if low is not None and high is not None and low >= high:
        expected = f"more than {low:g}, where the search begins"
        faults.add((*path, "to"), "wrong-value", value=f"{high:g}", expected=expected)


def _numbers(texts: Sequence[str]) -> list[float]:
    """Those of the bounds that are numbers by themselves."""
    trees = [re.fullmatch(r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?", text) for text in texts]
    return [float(match[0]) for match in trees if match]


# Equations as text: names and numbers in place of those in braces.


_TWO_PI = re.compile(r"(^|\(|[+-] )6\.283185307179586\*")


def equation_text(tree: Node, filling: Mapping[str, float | str]) -> str:
    """The equation with its names as `filling` says: another name, or a number in full."""
    # The parser folds 2*pi to one number: written so again, it reads as what it is.
    return _TWO_PI.sub(r"\g<1>2*pi*", to_text(filled_tree(tree, filling)))


def with_number(texts: Mapping[str, str], name: str, value: float) -> dict[str, str]:
    """Equations in which `name` has become a number."""
    number = to_text(Number(value, 0))
    shown = f"({number})" if value < 0.0 else number
    return {key: re.sub(rf"\b{name}\b", shown, text) for key, text in texts.items()}


def filled_tree(node: Node, filling: Mapping[str, float | str]) -> Node:
    """The tree with its names as `filling` says; sums with a negative number are turned."""
    match node:
        case Name(name, column):
            new = filling.get(name, name)
            return Name(new, column) if isinstance(new, str) else Number(new, column)
        case Call("+" | "-" as sign, (left, right), column):
            new_left, new_right = filled_tree(left, filling), filled_tree(right, filling)
            if isinstance(new_right, Number):
                if new_right.value == 0.0:
                    return new_left
                if new_right.value < 0.0:
                    # x - -5 and x + 5 are the same number, bit by bit.
                    turned = Number(-new_right.value, new_right.column)
                    return Call("+" if sign == "-" else "-", (new_left, turned), column)
            return Call(sign, (new_left, new_right), column)
        case Call(function, arguments, column):
            return Call(function, tuple(filled_tree(item, filling) for item in arguments), column)
    return node
