"""Equations with names in braces, as linear forms whose names are filled in later."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from mtu_cli.close_loop_sealed.files.effect_text import filled_tree
from mtu_cli.close_loop_sealed.files.effects_contract import (
    EffectEquations,
    EffectParameters,
    Search,
)
from mtu_cli.files.column_dimensions import (
    NUMBER,
    PLACE,
    TEMPERATURE,
    Dimensions,
    column_dimensions,
    columns_of,
)
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings
from mtu_cli.files.yaml_file import YamlPath
from mtu_cli.language import EquationError, LinearForm, Node, check_dimension, linear_form, names
from mtu_cli.language import parse as parse_equation
from mtu_cli.language.dimensions import first_column, shown
from mtu_cli.language.term_dimensions import Columns
from mtu_cli.language.tree import walk
from mtu_cli.units import LENGTH, PARAMETER_UNITS

AXIS_MARKS = ("a", "b", "n", "each")
COLUMN_MARKS = ("T", "c", "v")
NUMBER_ENDS = ("_low", "0", "3")
CHOSEN = "chosen"
COLUMNS = "a position, a column that `needs` names, or {a} {b} {T} {c} {v}"

_WORD = re.compile(r"(?:[A-Za-z_0-9]++|\{[A-Za-z_0-9]++\})++")
"""A name, of which parts may stand in braces; without a way back, so that long ones cost little."""
_BRACES = re.compile(r"\{([A-Za-z_0-9]+)\}")
_POSITIONS = ("x", "y", "z", "{a}", "{b}", "{n}", "{each}")
_EQUATION = re.compile(r"E(?:[xyz]|\{(?:a|b|n|each)\})")

__all__ = ["AXIS_MARKS", "CHOSEN", "COLUMN_MARKS", "Template", "marks", "number_of", "template_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """One form of a family: `trees` and their linear `forms` in the parameters.

    Keys of `forms` and `trees` are as in the file (``E{a}``). A name in braces stands in a
    tree as `braced` says: ``dir_a__`` -> ``dir_{a}``. `units` by parameter, as named in a
    tree; `raw_names` are the other names of the trees, as in the file. `readings`: not for
    points.
    """

    units: dict[str, str]
    forms: dict[str, LinearForm]
    trees: dict[str, Node]
    braced: dict[str, str]
    searched: str | None
    search: Search | None
    raw_names: tuple[str, ...]
    readings: bool = False


def marks(text: str) -> set[str]:
    """The placeholders of a text: ``{a0}*dir_{b}`` has a and b; literal names have none."""
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


def template_of(
    parameters: EffectParameters,
    equations: EffectEquations,
    search: Mapping[str, Search],
    needs: list[str],
    over: str | None,
    findings: Findings,
    path: YamlPath,
) -> Template | None:
    """The checked template, or None where something is wrong; the faults go to `findings`."""
    before = len(findings.problems)
    searched, plan = next(iter(search.items()), (None, None))
    braced: dict[str, str] = {}
    units = {_mangled(name, braced): unit for name, unit in parameters.items()}
    known = _Known(units, searched, needs, over)
    if plan is not None and plan.of is not None and not known.is_column(plan.of):
        here = (*path, "search", str(searched), "of")
        findings.add(here, "unknown name", value=plan.of, expected=COLUMNS)
    trees: dict[str, Node] = {}
    forms: dict[str, LinearForm] = {}
    for key, text in equations.items():
        here = (*path, "equations", key)
        _check_key(key, equations, findings, here)
        found = _equation(text, key, known, braced, findings, here)
        if found is not None:
            trees[key], forms[key] = found
    if len(findings.problems) == before:
        _check_used(units, trees, searched, over, braced, findings, path)
    if len(findings.problems) > before:
        return None
    return Template(
        units=units,
        forms=forms,
        trees=trees,
        braced=braced,
        searched=searched,
        search=plan,
        raw_names=_raw_names(trees, {*units, searched, CHOSEN}, braced),
    )


def _raw_names(
    trees: Mapping[str, Node], own: set[str | None], braced: Mapping[str, str]
) -> tuple[str, ...]:
    found = dict.fromkeys(name for tree in trees.values() for name in names(tree))
    return tuple(braced.get(name, name) for name in found if name not in own)


@dataclass(frozen=True, slots=True)
class _Known:
    units: Mapping[str, str]
    searched: str | None
    needs: list[str]
    over: str | None

    def dimension(self, raw: str, mangled: str) -> int | None:
        """Exponent of length of a name; raises KeyError where the name is not known."""
        if mangled in self.units:
            return PARAMETER_UNITS[self.units[mangled]].dimension
        if raw == self.searched:
            return None
        if raw == CHOSEN and self.over is not None:
            return 0
        own = number_of(raw)
        base = raw if own is None else own[0]
        base = "{" + base + "}" if own is not None and _is_mark(base) else base
        if not self.is_column(base):
            raise KeyError(raw)
        return LENGTH if base in _POSITIONS else None

    def column(self, raw: str) -> Dimensions | None:
        """Dimensions of a column, None where they are not known."""
        if raw in self.units or raw == self.searched:
            return None
        return NUMBER if raw == CHOSEN else template_column(raw)

    def is_column(self, raw: str) -> bool:
        """Whether a name is a position or a column of the data."""
        return raw in _POSITIONS or _is_column(raw) or raw in self.needs


def template_column(raw: str) -> Dimensions | None:
    """Dimensions of a position or column as a template names it, None where they are not known."""
    if raw in _POSITIONS:
        return PLACE
    if raw in ("{T}", "{c}"):
        return TEMPERATURE if raw == "{T}" else NUMBER
    return column_dimensions(_BRACES.sub("x", raw) if raw.startswith("dir_") else raw)


def _is_mark(name: str) -> bool:
    return name in AXIS_MARKS or name in COLUMN_MARKS


def _is_column(raw: str) -> bool:
    plain = raw in ("time_min", "sequence", "{T}", "{c}", "{v}")
    direction = re.fullmatch(r"dir_(?:[xyz]|\{(?:a|b|n|each)\})", raw)
    return plain or bool(direction) or bool(re.fullmatch(r"T_\w+_degC", raw, re.ASCII))


def _mangled(text: str, braced: dict[str, str]) -> str:
    # A name of equal length, so that the column of a fault is that of the file.
    def plain(match: re.Match[str]) -> str:
        if "{" not in match.group():
            return match.group()
        name = _BRACES.sub(lambda inner: inner.group(1) + "__", match.group())
        braced[name] = match.group()
        return name

    return _WORD.sub(plain, text)


def _check_key(key: str, equations: Mapping[str, str], findings: Findings, path: YamlPath) -> None:
    if not _EQUATION.fullmatch(key):
        known = "Ex, Ey, Ez, E{a}, E{b}, E{n} or E{each}"
        findings.add(path, "not an equation", value=key, expected=known)
    elif key == "E{each}" and len(equations) > 1:
        findings.add(path, "stands beside other equations", expected="E{each} alone")


def _equation(
    text: str,
    key: str,
    known: _Known,
    braced: dict[str, str],
    findings: Findings,
    path: YamlPath,
) -> tuple[Node, LinearForm] | None:
    try:
        tree = parse_equation(_mangled(text, braced))
        dimensions = _dimensions(tree, known, braced, key)
        form = linear_form(tree, known.units, known.units)
        columns = columns_of(
            {name: known.column(braced.get(name, name)) for name in dimensions},
            {name: PARAMETER_UNITS[unit] for name, unit in known.units.items()},
        )
        _check_dimension(tree, _as_written(tree, known, braced), dimensions, columns)
        if form.remainder is not None:
            raise EquationError("a term without a parameter", 1, "parameters in every term")
    except EquationError as error:
        _add(error, braced, findings, path)
        return None
    return tree, form


def _check_dimension(
    tree: Node, written: Node, dimensions: Mapping[str, int | None], columns: Columns
) -> None:
    """Checks the equation as it will be `written`; the term of a fault is shown as in the file."""
    try:
        check_dimension(written, LENGTH, dimensions, columns)
    except EquationError as error:
        own = (
            shown(before)
            for before, after in zip(walk(tree), walk(written), strict=True)
            if first_column(after) == error.column and shown(after) == error.value
        )
        raise EquationError(
            error.what, error.column, error.expected, next(own, error.value)
        ) from None


def _as_written(tree: Node, known: _Known, braced: Mapping[str, str]) -> Node:
    """The tree with literals where the written equation will have them: they have no unit."""
    literal = {
        name: 1.0
        for name in names(tree)
        if number_of(braced.get(name, name)) is not None or name == known.searched
    }
    return filled_tree(tree, literal)


def _dimensions(
    tree: Node, known: _Known, braced: Mapping[str, str], key: str
) -> dict[str, int | None]:
    found: dict[str, int | None] = {}
    for name, column in names(tree).items():
        raw = braced.get(name, name)
        try:
            found[name] = known.dimension(raw, name)
        except KeyError:
            hint = f"a parameter, {COLUMNS}"
            raise EquationError(f"unknown name {raw!r}", column, hint) from None
        if "each" in marks(raw) and key != "E{each}":
            raise EquationError(f"{raw!r} in {key}", column, "{each} in E{each} only")
    return found


def _add(
    error: EquationError, braced: Mapping[str, str], findings: Findings, path: YamlPath
) -> None:
    what, value, expected = error.what, error.value, error.expected
    for name, raw in braced.items():
        what = what.replace(name, raw)
        value = value and value.replace(name, raw)
        expected = expected and expected.replace(name, raw)
    told = EquationError(what, error.column, expected, value)
    shown_file, line = findings.document.source.shown, findings.document.line_of(*path)
    findings.problems.append(told.problem(file=shown_file, line=line, path=path_text(path)))


def _check_used(
    units: Mapping[str, str],
    trees: Mapping[str, Node],
    searched: str | None,
    over: str | None,
    braced: Mapping[str, str],
    findings: Findings,
    path: YamlPath,
) -> None:
    used = {name for tree in trees.values() for name in names(tree)}
    for name in units:
        raw = braced.get(name, name)
        if name not in used:
            findings.add((*path, "parameters", raw), "in no equation", value=raw)
    if searched is not None and searched not in used:
        findings.add((*path, "search", searched), "in no equation", value=searched)
    if over is not None and CHOSEN not in used:
        findings.add((*path, "equations"), "`chosen` is in no equation", expected="it, with `over`")
