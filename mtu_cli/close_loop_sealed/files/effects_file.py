"""Effects files (``mtu/effects/1``): families of candidate effects, read and checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mtu_cli.close_loop_sealed.files.effect_templates import (
    AXIS_MARKS,
    Template,
    marks,
    template_column,
    template_of,
)
from mtu_cli.close_loop_sealed.files.effects_contract import Effects, Family, MemberTemplate, Search
from mtu_cli.errors import InputError
from mtu_cli.files.column_dimensions import PLACE, Dimensions
from mtu_cli.files.contracts import (
    Findings,
    check_contract,
    duplicates,
    is_identifier,
    present,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding
from mtu_cli.language import EquationError, names
from mtu_cli.language import parse as parse_equation
from mtu_cli.language.functions import MACHINE_FUNCTIONS

SCATTERS = ("rotation-scatter", "scale-scatter", "operation-scatter")
"""Effects on the scatter are no equations: close-loop knows these."""

NAMED_UNITS: dict[str, Dimensions] = {"_mm": PLACE}
"""What the end of a searched value's name says of its unit; `_min` may be a minimum as well."""

_SCHEMA = "mtu/effects/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFamily:
    """A checked family: `name` of its candidates with axes in braces, and its templates."""

    family: Family
    name: str
    templates: tuple[Template, ...]
    line: int | None

    def marks(self) -> set[str]:
        """The placeholders of all its templates and its name."""
        found = marks(self.name)
        for template in self.templates:
            for text in (*template.raw_names, *template.forms):
                found |= marks(text)
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedEffects:
    """A checked effects file."""

    source: Source
    families: tuple[LoadedFamily, ...]


def load_effects(path: Path, taken: Mapping[str, str] | None = None) -> LoadedEffects:
    """Reads and checks an effects file; `taken` says whose the names are that it must not use.

    Raises InputError with all problems of the file, each with its line.
    """
    try:
        document = read_yaml(path, "effects")
    except InputError as error:
        raise InputError([_braces_hint(problem, path) for problem in error.findings]) from None
    return effects_from(document, taken)


def effects_from(document: YamlDocument, taken: Mapping[str, str] | None = None) -> LoadedEffects:
    """Checks an effects file that was read already: a list of families, or with `schema`.

    Raises InputError with all problems of the document.
    """
    families: list[LoadedFamily] = []

    def check(effects: Effects, findings: Findings) -> None:
        found = present(effects.effects)
        named = [(index, _name(family)) for index, family in found]
        for index, name, first in duplicates(named):
            line = findings.document.line_of("effects", first)
            what = f"a second family whose candidates are called so (the first: line {line})"
            findings.add(("effects", index), what, value=name)
        for index, family in found:
            owner = (taken or {}).get(family.family)
            if owner is not None:
                path = ("effects", index, "family")
                findings.add(path, f"the name is taken: {owner}", value=family.family)
            loaded = _loaded(family, ("effects", index), findings)
            if loaded is not None:
                families.append(loaded)

    check_contract(_with_schema(document), Effects, "effects", check)
    return LoadedEffects(source=document.source, families=tuple(families))


def _with_schema(document: YamlDocument) -> YamlDocument:
    if not isinstance(document.data, list):
        return document
    lines = {("effects", *path): line for path, line in document.lines.items()}
    lines = {(): document.line_of() or 1, **lines}
    odd = {("effects", *path): item for path, item in document.odd_numbers.items()}
    starts = {("effects", *path): line for path, line in document.starts.items()}
    data = {"schema": _SCHEMA, "effects": document.data}
    return replace(document, data=data, lines=lines, odd_numbers=odd, starts=starts)


def _braces_hint(problem: Finding, path: Path) -> Finding:
    """YAML takes braces for keys within [...] and {...}: say so."""
    if problem.line is None or "not readable as YAML" not in problem.text:
        return problem
    lines = path.read_text("utf-8-sig").splitlines()
    text = lines[problem.line - 1] if problem.line <= len(lines) else ""
    if not marks(text):
        return problem
    example = "['dir_{a}']" if "[" in text else "{'E{a}': k*x}"
    hint = f"names with braces on lines of their own, or in quotes: {example}"
    return replace(problem, expected=hint)


def _name(family: Family) -> str:
    if family.name is not None:
        return family.name
    texts = [key for form in _forms(family) for key in form.equations]
    texts += [text for form in _forms(family) for text in form.equations.values()]
    return f"{family.family}-{{a}}" if any("a" in marks(t) for t in texts) else family.family


def _forms(family: Family) -> Iterator[MemberTemplate]:
    if family.parameters is not None and family.equations is not None:
        yield MemberTemplate.model_construct(
            parameters=family.parameters, equations=family.equations, search=family.search or {}
        )
    yield from (member for member in family.members or () if member is not None)


def _loaded(family: Family, path: YamlPath, findings: Findings) -> LoadedFamily | None:
    before = len(findings.problems)
    name = _name(family)
    _check_shape(family, path, findings)
    _check_words(family, name, path, findings)
    templates = []
    for form, here in _placed(family, path):
        _check_names(form, here, findings)
        for searched, search in form.search.items():
            _check_search(search, (*here, "search", searched), findings)
        template = template_of(
            form.parameters, form.equations, form.search, family.needs, family.over, findings, here
        )
        if template is not None:
            templates.append(replace(template, readings=form.readings))
    if len(findings.problems) > before:
        return None
    line = findings.document.line_of(*path)
    loaded = LoadedFamily(family=family, name=name, templates=tuple(templates), line=line)
    _check_marks(loaded, path, findings)
    return loaded


def _placed(family: Family, path: YamlPath) -> Iterator[tuple[MemberTemplate, YamlPath]]:
    members = 0
    for form in _forms(family):
        if form.parameters is family.parameters:
            yield form, path
        else:
            yield form, (*path, "members", members)
            members += 1


def _check_shape(family: Family, path: YamlPath, findings: Findings) -> None:
    keys = findings.given(*path)
    own = [key for key in ("parameters", "equations", "search") if key in keys]
    if family.kind == "scatter":
        if family.family not in SCATTERS:
            wanted = f"one of: {', '.join(SCATTERS)}"
            findings.add((*path, "kind"), "an unknown effect on the scatter", expected=wanted)
        if own or "members" in keys:
            findings.add(path, "an effect on the scatter with equations", expected="none")
    elif "members" in keys and own:
        findings.add((*path, own[0]), "stands beside `members`", expected="it in each member")
    elif "members" not in keys:
        for key in ("parameters", "equations"):
            if key not in keys:
                findings.add_missing(path, key)
    if family.kind == "outlier" and family.over is None:
        findings.add_missing(path, "over", expected="over: feature, part or operation")


def _check_words(family: Family, name: str, path: YamlPath, findings: Findings) -> None:
    known = marks(name)
    for mark in sorted(known - {"a", "b", "n"}):
        what = f"{{{mark}}} in the name of a candidate"
        findings.add((*path, "name"), what, value=name, expected="{a}, {b} or {n}")
    for key in ("says", "separates", "separates_readings"):
        text = getattr(family, key) or ""
        for mark in sorted(marks(text) - known):
            what = f"{{{mark}}} is not in the name {name!r}"
            findings.add((*path, key), what, value=text, expected="plain words, or what it has")


def _check_names(form: MemberTemplate, path: YamlPath, findings: Findings) -> None:
    taken = {"x", "y", "z", "pi", "chosen", "time_min", "sequence", *MACHINE_FUNCTIONS}
    places = [(name, (*path, "parameters", name)) for name in form.parameters]
    places += [(name, (*path, "search", name)) for name in form.search]
    for name, place in places:
        plain = name.replace("{each}", "_")
        if not is_identifier(plain):
            findings.add(
                place,
                "not a name that equations can use",
                value=name,
                expected="letters, digits and _, no digit first; {each} in a parameter's",
            )
        elif name in taken or (name in form.parameters and name in form.search):
            findings.add(place, "the name is taken", value=name)


def _check_search(search: Search, path: YamlPath, findings: Findings) -> None:
    known = {"span", "spacing", "low", "high"}
    used = set()
    for key, texts in (("from", search.from_), ("to", search.to)):
        for text in texts:
            try:
                unknown = set(names(parse_equation(text)))
            except EquationError as error:
                findings.add((*path, key), error.what, value=text, expected=error.expected)
                continue
            used |= unknown & known
            if unknown - known:
                expected = "numbers, span, spacing, low and high"
                findings.add((*path, key), "unknown name", value=text, expected=expected)
    if search.of is None and (used or search.grid in ("between", "frequency")):
        expected = "the position or column that span, low and the grid are of"
        findings.add_missing(path, "of", expected=expected)
    _check_unit(search, path, findings)
    if search.grid != "between":
        _check_bounds(search, path, findings)


def _check_unit(search: Search, path: YamlPath, findings: Findings) -> None:
    """A value `at_mm` is one of a position, no number of a part."""
    name = str(path[-1])
    wanted = next((own for end, own in NAMED_UNITS.items() if name.endswith(end)), None)
    found = None if search.of is None else template_column(search.of)
    if wanted is not None and found is not None and found != wanted:
        what = f"its name says {name.rpartition('_')[2]}, the column has none"
        expected = f"another name than {name}, or a column in that unit"
        findings.add((*path, "of"), what, value=search.of, expected=expected)


def _check_bounds(search: Search, path: YamlPath, findings: Findings) -> None:
    """Numbers among the bounds that leave nothing to search, whatever the data."""
    low = max(_numbers(search.from_), default=None)
    high = min(_numbers(search.to), default=None)
    if search.grid in ("log", "frequency"):
        # Of several bounds the largest `from` counts, and an expression may be it.
        settled = len(_numbers(search.from_)) == len(search.from_)
        for key, value in (("from", low if settled else None), ("to", high)):
            if value is not None and value <= 0:
                what = f"a {search.grid} grid has positive values alone"
                findings.add((*path, key), what, value=f"{value:g}", expected="more than 0")
    if low is not None and high is not None and low >= high:
        expected = f"more than {low:g}, where the search begins"
        findings.add((*path, "to"), "nothing lies between", value=f"{high:g}", expected=expected)


def _numbers(texts: Sequence[str]) -> list[float]:
    """Those of the bounds that are numbers by themselves."""
    found = []
    for text in texts:
        try:
            found.append(float(text))
        except ValueError:
            continue
    return found


def _check_marks(loaded: LoadedFamily, path: YamlPath, findings: Findings) -> None:
    found = loaded.marks()
    if "b" in found and "a" not in found:
        findings.add(path, "{b} without {a}")
    if "n" in found and not {"a", "b"} <= found:
        findings.add(path, "{n} without {a} and {b}", expected="the two axes that it is normal to")
    if "each" in found and found & set(AXIS_MARKS) != {"each"}:
        findings.add(path, "{each} beside {a} or {b}", expected="one of them")
