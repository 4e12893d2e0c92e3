"""Validation errors in plain words: what was expected, what stands there, on which line."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from mtu_cli.errors import Problem, nearest, question
from mtu_cli.files.contract_keys import Decimals, expected_key, meant, torn_values
from mtu_cli.files.contract_shapes import (
    annotation_at,
    expected_keys,
    expected_list,
    holds_commas,
    keys_at,
    stands_elsewhere,
)
from mtu_cli.files.shown_values import shown_value
from mtu_cli.files.yaml_entries import COLON, as_entry
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

DISTRIBUTIONS = {
    "rectangular": ("uniform", "flat", "box", "rectangle", "rect"),
    "normal": ("gaussian", "gauss", "bell"),
    "arcsine": ("u-shaped", "u-shape", "ushaped", "arcsin", "arc-sine", "sine", "sinusoidal"),
    "t": ("student", "student-t", "students-t", "student's t", "t-distribution"),
    "triangular": ("triangle", "tri"),
    "trapezoidal": ("trapezoid", "trapeze"),
}
"""Distributions by what else they are called; `-` stands for blanks and underscores too."""
NOT_FINITE = ("inf", "infinite", "infinity", "nan", "∞")
EXPECTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of at most 18 digits",
    "string_type": "a text",
    "string_unicode": "a text of letters",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "keys with values",
    "model_type": "keys with values",
    "finite_number": "a finite number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "too_short": "at least {min_length} of them",
    "too_long": "at most {max_length} of them",
    "string_too_short": "a text that is not empty",
    "value_error": "{error}",
}
ANOTHER = "another value"
"""Of what no contract has asked for yet."""


TOLD = "told"


def told(what: str, expected: str) -> PydanticCustomError:
    """For validators of contract fields: an error that says itself what is wrong."""
    return PydanticCustomError(TOLD, "{what}", {"what": what, "expected": expected})


def lists_within(value: object) -> object:
    """A list of lists; one of them alone, ``[a, b]`` for ``[[a, b]]``, is a single fault."""
    if isinstance(value, list) and value and not any(isinstance(item, list) for item in value):
        raise told("not a list of lists", "brackets around each of them too, [[...], [...]]")
    return value


def path_text(path: YamlPath) -> str:
    """A path as text: ``lengths[0].from``."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
    return text.removeprefix(".")


def existing_path(path: YamlPath, document: YamlDocument) -> YamlPath:
    """A path without indices and numbers that the file lacks: a single value may stand for a list,
    or for one by temperature.
    """
    while path and not isinstance(path[-1], str) and path not in document.lines:
        path = path[:-1]
    return path


def missing_key(key: str) -> str:
    """What is wrong where an entry lacks a key."""
    return f"the key {key!r} is missing"


def to_problems(
    error: ValidationError, document: YamlDocument, model: type[BaseModel]
) -> list[Finding]:
    """One Problem for each fault: a required key that was only misspelt is told once, and so is
    what a comma has torn to pieces.
    """
    items = error.errors(include_url=False)
    misspelt: set[YamlPath] = set()
    alone: dict[YamlPath, list[YamlPath]] = {}
    for item in items:
        if item["type"] == "extra_forbidden":
            *parent, key = item["loc"]
            near = meant(str(key), keys_at(model, tuple(parent)))
            if near is not None:
                misspelt.add((*parent, near))
            if item["input"] is None:
                alone.setdefault(tuple(parent), []).append(item["loc"])
    torn = _torn(alone, items, document, model)
    pieces = {(*path[:-1], key) for path, parts in torn.items() for key in parts[1:]} | set(torn)
    decimals = Decimals(document)
    problems = [
        _problem(item, decimals, model)
        for item in items
        if item["loc"] not in pieces and not (item["type"] == "missing" and item["loc"] in misspelt)
    ]
    return [*problems, *(_torn_problem(path, torn[path], document) for path in torn)]


def _torn(
    alone: dict[YamlPath, list[YamlPath]],
    items: Iterable[ErrorDetails],
    document: YamlDocument,
    model: type[BaseModel],
) -> dict[YamlPath, list[str]]:
    """As `torn_values`, where a list or a text belongs: a number has no comma, whether its
    decimals stand behind it, ``{x_mm: 20,5}``, or a key that lacks its value.
    """
    lists = {item["loc"] for item in items if item["type"] == "list_type"}
    return {
        path: parts
        for parent, unknown in alone.items()
        for path, parts in torn_values(unknown, keys_at(model, parent), document).items()
        if holds_commas(model, path)
        and (path in lists or not all(part.isdecimal() for part in parts[1:]))
    }


def _torn_problem(path: YamlPath, parts: list[str], document: YamlDocument) -> Finding:
    text = ", ".join(parts)
    return Problem(
        what="a comma ends a value",
        file=document.source.shown,
        line=document.line_of(*path),
        path=path_text(path),
        value=text,
        expected=f"a list in brackets, [{text}], or quotes around a text that holds a comma",
    )


def _problem(item: ErrorDetails, decimals: Decimals, model: type[BaseModel]) -> Finding:
    document = decimals.document
    path = tuple(step for step in item["loc"] if step != "[key]")
    path = existing_path(path, document)
    value: str | None = None
    lacks: str | None = None
    line = document.line_of(*path)
    if item["type"] == "missing":
        lacks = str(item["loc"][-1])
        path, what, expected = path[:-1], missing_key(lacks), None
        line = document.line_of(*path)
    elif item["type"] == "extra_forbidden":
        what, value = "unknown key", str(item["loc"][-1])
        known = keys_at(model, item["loc"][:-1])
        elsewhere = stands_elsewhere(model, item["loc"])
        expected = decimals.point(item["loc"]) or elsewhere or expected_key(value, known)
    elif item["type"] == TOLD:
        context = item.get("ctx", {})
        what, expected = str(context["what"]), str(context["expected"])
        value = shown_value(item["input"])
    elif item["type"] == "literal_error":
        what, expected = _literal(item)
        value = shown_value(item["input"])
    elif item["input"] is None:
        what, expected = "has no value", _missing_value(item, path, decimals, model)
    else:
        what, value = "wrong value", shown_value(item["input"])
        expected = _expected(item, annotation_at(model, path))
        line = document.starts.get(path, line)
    return Problem(
        what=what,
        file=document.source.shown,
        line=line,
        path=path_text(path) or None,
        value=value,
        expected=expected,
        lacks=lacks,
    )


def _missing_value(
    item: ErrorDetails, path: YamlPath, decimals: Decimals, model: type[BaseModel]
) -> str:
    entry = as_entry(str(path[-1])) if path else None
    if entry is not None:
        return f"'{entry}', {COLON}"
    return decimals.point(path) or _expected(item, annotation_at(model, path))


def _literal(item: ErrorDetails) -> tuple[str, str]:
    allowed = _allowed(item)
    what = "unknown key" if item["loc"][-1:] == ("[key]",) else "unknown value"
    near = nearest(str(item["input"]), allowed)
    if item["loc"][-1:] == ("distribution",):
        # Another name is no slip of the most alike: `uniform` is not meant to be `normal`.
        own = _distribution(str(item["input"]))
        near = near if own is None else (own,) if own in allowed else ()
    return what, question(near) or f"one of: {', '.join(allowed)}"


def _allowed(item: ErrorDetails) -> list[str]:
    """The texts of a literal."""
    return re.findall(r"'([^']*)'", str(item.get("ctx", {}).get("expected", "")))


def _distribution(text: str) -> str | None:
    """The distribution that goes by another name, None where `text` is none of those known."""
    word = re.sub(r"[\s_-]+", "-", text.strip().casefold())
    words = {
        re.sub(r"\s", "-", other): name for name, own in DISTRIBUTIONS.items() for other in own
    }
    return words.get(word) or words.get(word.removesuffix("-distribution"))


def _expected(item: ErrorDetails, annotation: object) -> str:
    kind = item["type"]
    given = item["input"]
    if kind in ("dict_type", "model_type"):
        return expected_keys(given, annotation)
    if kind in ("list_type", "tuple_type"):
        return expected_list(given, annotation)
    if kind in ("float_type", "int_type") and isinstance(given, str):
        if given.strip("+-. ").casefold() in NOT_FINITE:
            return EXPECTED["finite_number"]
        return number_expectation(given, EXPECTED[kind])
    if kind == "int_type" and isinstance(given, float) and given.is_integer():
        return f"{EXPECTED[kind]}, written {given:.0f}"
    if kind == "string_type" and not isinstance(given, (list, dict, type(None))):
        return f"{EXPECTED[kind]}: '{shown_value(given)}' in quotes"
    return in_words(item)


def in_words(item: ErrorDetails) -> str:
    """What was expected in the place of a faulty value, by the kind of its fault alone."""
    if item["type"] == "literal_error":
        return f"one of: {', '.join(_allowed(item))}"
    phrase = EXPECTED.get(item["type"], ANOTHER)
    return phrase.format(**item.get("ctx", {}))


_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_NUMBER = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
_WITH_UNIT = re.compile(_NUMBER + r"\s*+[A-Za-zµμ°%\"'/].*", re.DOTALL)
_PLAIN = re.compile(_NUMBER)
_OTHER_DIGIT = re.compile(r"[^\D0-9]")
_OTHER_BASE = re.compile(r"[+-]?0(?:[xX][0-9a-fA-F]++|[bB][01]++|[oO][0-7]++)")


def number_expectation(text: str, wanted: str = "a number") -> str:
    """What to write instead of a text that stands where a number belongs."""
    text = text.strip()
    if _PLAIN.fullmatch(text):
        return f"{wanted}, without quotes"
    if _OTHER_BASE.fullmatch(text):
        return f"{wanted} in decimal digits"
    if not text.isascii() and _OTHER_DIGIT.search(text):
        return f"{wanted} in the digits 0 to 9"
    if _DECIMAL_COMMA.fullmatch(text):
        return f"{wanted} with a decimal point"
    if _WITH_UNIT.fullmatch(text):
        return f"{wanted} alone, without its unit"
    return wanted
