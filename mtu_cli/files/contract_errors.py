"""Validation errors in plain words: what was expected, what stands there, on which line."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from mtu_cli.errors import Problem, closest, did_you_mean
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

OTHER_KEYS = {"s_pass": "pass_covariance"}
"""Keys by the names that tables give what they hold."""
NAMED_BY = ("id", "name", "feature", "component", "key")
"""Keys that hold the name of an entry where entries stand in a list."""
DISTRIBUTIONS = {
    "rectangular": ("uniform", "flat", "box", "rectangle", "rect"),
    "normal": ("gaussian", "gauss", "bell"),
    "arcsine": ("u-shaped", "u-shape", "ushaped", "arcsin", "arc-sine", "sine", "sinusoidal"),
    "t": ("student", "student-t", "students-t", "student's t", "t-distribution"),
    "triangular": ("triangle", "tri"),
    "trapezoidal": ("trapezoid", "trapeze"),
}
"""Distributions by what else they are called; `-` stands for blanks and underscores too."""
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "list_type": "a list",
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


TOLD = "told"
PLAIN = "in plain letters"


def told(what: str, expected: str) -> PydanticCustomError:
    """For validators of contract fields: an error that says itself what is wrong."""
    return PydanticCustomError(TOLD, "{what}", {"what": what, "expected": expected})


def path_text(path: YamlPath) -> str:
    """A path as text: ``lengths[0].from``."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
    return text.removeprefix(".")


def existing_path(path: YamlPath, document: YamlDocument) -> YamlPath:
    """A path without indices that the file lacks: a single value may stand for a list."""
    while path and isinstance(path[-1], int) and path not in document.lines:
        path = path[:-1]
    return path


def shown_value(value: object) -> str:
    """A value as it would be written in the file."""
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:
        return str(value)


def to_problems(
    error: ValidationError, document: YamlDocument, model: type[BaseModel]
) -> list[Problem]:
    """One Problem for each fault; a required key that was only misspelt is told once."""
    items = error.errors(include_url=False)
    misspelt: set[YamlPath] = set()
    for item in items:
        if item["type"] == "extra_forbidden":
            *parent, key = item["loc"]
            near = _meant(str(key), _keys_at(model, tuple(parent)))
            if near is not None:
                misspelt.add((*parent, near))
    return [
        _problem(item, document, model)
        for item in items
        if not (item["type"] == "missing" and item["loc"] in misspelt)
    ]


def _problem(item: ErrorDetails, document: YamlDocument, model: type[BaseModel]) -> Problem:
    path = tuple(step for step in item["loc"] if step != "[key]")
    path = existing_path(path, document)
    value: str | None = None
    if item["type"] == "missing":
        path, what, expected = path[:-1], f"the key {item['loc'][-1]!r} is missing", None
    elif item["type"] == "extra_forbidden":
        known = _keys_at(model, item["loc"][:-1])
        what, value = "unknown key", str(item["loc"][-1])
        meant, in_unit = _by_other_name(value, known), _in_its_unit(value, known)
        expected = in_unit or (f"{meant!r}" if meant else did_you_mean(value, known))
        if value.isdecimal() and item["input"] is None:
            # {value: 1,5} has the keys `value` and `5`.
            expected = f"a decimal point before {value}: a comma ends a value"
    elif item["type"] == TOLD:
        context = item.get("ctx", {})
        what, expected = str(context["what"]), str(context["expected"])
        value = shown_value(item["input"])
    elif item["type"] == "literal_error":
        what, expected = _literal(item)
        value = shown_value(item["input"])
    elif item["input"] is None:
        what, expected = "has no value", _expected(item)
    else:
        what, value = "wrong value", shown_value(item["input"])
        expected = _expected(item)
    return Problem(
        what=what,
        file=document.source.shown,
        line=document.line_of(*path),
        path=path_text(path) or None,
        value=value,
        expected=expected,
    )


def _meant(key: str, known: Collection[str]) -> str | None:
    """The known key that an unknown one was probably meant to be."""
    return _by_other_name(key, known) or closest(key, known)


def _by_other_name(key: str, known: Collection[str]) -> str | None:
    """A known key by another name for what it holds, or by its name without the unit."""
    with_unit = [name for name in known if name.rpartition("_")[0] == key]
    units = {name.rpartition("_")[2] for name in with_unit}
    names = [OTHER_KEYS.get(key), *(with_unit if units <= {*UNITS, "m"} else ())]
    found = [name for name in names if name in known]
    return found[0] if len(found) == 1 else None


def _in_its_unit(key: str, known: Collection[str]) -> str | None:
    """What is expected of a key that is known with another unit at its end: not the same number."""
    name, _, unit = key.rpartition("_")
    for other in known:
        stem, _, own = other.rpartition("_")
        if stem == name and own != unit and {unit, own} <= {*UNITS, "m"}:
            return f"{other!r}: in {own}, not {unit}"
    return None


def _literal(item: ErrorDetails) -> tuple[str, str]:
    allowed = re.findall(r"'([^']*)'", str(item.get("ctx", {}).get("expected", "")))
    what = "unknown key" if item["loc"][-1:] == ("[key]",) else "unknown value"
    near = closest(str(item["input"]), allowed)
    if item["loc"][-1:] == ("distribution",):
        # Another name is no slip of the most alike: `uniform` is not meant to be `normal`.
        meant = _distribution(str(item["input"]))
        near = near if meant is None else meant if meant in allowed else None
    return what, f"did you mean {near!r}?" if near else f"one of: {', '.join(allowed)}"


def _distribution(text: str) -> str | None:
    """The distribution that goes by another name, None where `text` is none of those known."""
    word = re.sub(r"[\s_-]+", "-", text.strip().casefold())
    words = {
        re.sub(r"\s", "-", other): name for name, own in DISTRIBUTIONS.items() for other in own
    }
    return words.get(word) or words.get(word.removesuffix("-distribution"))


def _expected(item: ErrorDetails) -> str:
    kind = item["type"]
    given = item["input"]
    if kind in ("dict_type", "model_type") and isinstance(given, list):
        return _not_a_list(given)
    if kind in ("float_type", "int_type") and isinstance(given, str):
        return number_expectation(given, _EXPECTED[kind])
    phrase = _EXPECTED.get(kind)
    if phrase is None:
        return item["msg"].removeprefix("Input should be ")
    return phrase.format(**item.get("ctx", {}))


def _not_a_list(given: list[Any]) -> str:
    """What belongs in the place of a list: its first item under its name, where it has one."""
    first = given[0] if given and isinstance(given[0], dict) else {}
    for key in NAMED_BY:
        if isinstance(name := first.get(key), str | int):
            return f"keys with values: '{name}: {{...}}' instead of '- {{{key}: {name}, ...}}'"
    return _EXPECTED["dict_type"]


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


def unit_expectation(text: str, units: Collection[str] = UNITS) -> str:
    """The unit that an unknown one was probably meant to be."""
    plain = text.strip().replace("\u00b5", "u").replace("\u03bc", "u")
    if plain in units:
        return f"{plain!r}, {PLAIN}"
    return did_you_mean(text, units)


def lists_texts(model: type[BaseModel], path: YamlPath) -> bool:
    """Whether the items of a list are texts: a name may look like a number."""
    return _annotation_at(model, (*path, 0)) is str


def _annotation_at(model: type[BaseModel], loc: YamlPath) -> Any:
    annotation: Any = model
    for step in loc:
        annotation = _step(annotation, step)
    return _bare(annotation)


def _keys_at(model: type[BaseModel], loc: YamlPath) -> list[str]:
    annotation = _annotation_at(model, loc)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [info.alias or name for name, info in annotation.model_fields.items()]
    return []


def _step(annotation: Any, step: str | int) -> Any:
    annotation = _bare(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, info in annotation.model_fields.items():
            if step in (name, info.alias):
                return info.annotation
    elif get_origin(annotation) is dict:
        return get_args(annotation)[1]
    elif get_origin(annotation) is list:
        return get_args(annotation)[0]
    return None


def _bare(annotation: Any) -> Any:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _bare(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return _bare(next(part for part in get_args(annotation) if part is not type(None)))
    return annotation
