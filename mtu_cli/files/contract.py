"""From documents to checked contracts, with every fault of a file at once.

A contract is a pydantic model. What pydantic finds wrong becomes a `Finding` with the line, the
path, the value and what is expected there; a chapter's own `check` adds, through `Faults`, what
takes more than one value to see.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from types import UnionType
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from mtu_cli.files.names import EXPECTED as A_NAME
from mtu_cli.files.names import is_name
from mtu_cli.files.source import a_file
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, path_text, shown_value
from mtu_cli.findings import Finding, InputError, closest, finding, nearest, suggestion

SCHEMA_VERSION = 1
MAX_DEGREE = 9
"""Of a polynomial in position."""
LARGEST = 1e30
"""Of a number in size: products of some of them stay far from what overflows."""
IDENTIFIER = "letters, digits and _, no digit first"
"""A name that equations can use."""
HINTED = 50
"""Unknown names of a document that are compared with all that are known."""
SQUARED = ("covariance", "half_difference_mean_square")
"""Parts of the keys whose numbers are squares of others."""
UNLIMITED = ("dof", "pass_dof", "repeat_dof", "coefficient_dof", "leftover_dof", "seed", "found")
"""Keys of numbers that may be of any size: 1e99 degrees of freedom are infinitely many."""
GIVEN_AS = {
    "machine": "-m FILE",
    "part": "-p FILE",
    "study": "STUDY, without an option",
    "fit-components": "-c FILE",
    "thermal-fit": "-c FILE",
    "budget": "mtu budget FILE",
    "graph": "mtu graph ... FILE",
    "effects": "--effects FILE",
}
EXPECTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of at most 18 digits",
    "string_type": "a text",
    "bool_type": "true or false",
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
"""What is expected, by pydantic's name of the error."""

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class Contract(BaseModel):
    """Base of all contract models: no unknown keys, no coercion, finite numbers, frozen.

    `elsewhere`: for keys that an entry has not, where what they mean belongs.
    """

    elsewhere: ClassVar[Mapping[str, str]] = {}
    model_config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True, populate_by_name=True
    )


M = TypeVar("M", bound=BaseModel)
T = TypeVar("T")


def wrong(expected: str, code: str = "wrong-value", **facts: Any) -> PydanticCustomError:
    """For validators of fields: an error that becomes a Finding of `code`."""
    return PydanticCustomError(
        "finding", "{code}", {"code": code, "expected": expected, "facts": facts}
    )


def _id_text(value: object) -> object:
    return str(value) if type(value) is int else value


IdText = Annotated[str, BeforeValidator(_id_text, json_schema_input_type=str | int)]
"""A name that may be written as a whole number: feature 3 is feature '3'."""


@dataclass(slots=True)
class Faults:
    """The findings of one document; `add` knows file and line by the path."""

    document: YamlDocument
    findings: list[Finding] = field(default_factory=list)

    def add(self, path: YamlPath, code: str, *, value: object = None, **given: Any) -> None:
        """One more finding at `path`: `expected`, `meant`, `column` and the facts of its code.

        `value` is shown as it would be written in the file.
        """
        path = self.existing(path)
        place = {"file": self.document.source.shown, "line": self.document.line_of(*path)}
        shown = None if value is None else shown_value(value)
        own = finding(code, **place, path=path_text(path) or None, value=shown, **given)
        self.findings.append(own)

    def unknown(
        self, path: YamlPath, name: str, known: Collection[str], what: str = "name"
    ) -> None:
        """That `name` is none of those `known`; where there are none at all, what is wrong with
        the list of them is reported already.
        """
        if known or not self.findings:
            hint = suggestion(name, known) if len(self.findings) < HINTED else {}
            self.add(path, "unknown-name", value=name, what=what, **hint)

    def extend(self, path: YamlPath, found: InputError | Iterable[Finding]) -> None:
        """The findings of an equation that stands at `path`."""
        line = self.document.line_of(*path)
        place = {"file": self.document.source.shown, "line": line, "path": path_text(path)}
        listed = found.findings if isinstance(found, InputError) else found
        self.findings += [own.at(**place) for own in listed]

    @contextmanager
    def collected(self, path: YamlPath) -> Iterator[None]:
        """Adds what is raised while an equation at `path` is read; what follows is left out."""
        try:
            yield
        except InputError as error:
            self.extend(path, error)

    def symbol(
        self, path: YamlPath, name: str, taken: Mapping[str, str], expected: str = IDENTIFIER
    ) -> None:
        """That equations can use `name`, which is none of those `taken` (name: what it is)."""
        if not is_identifier(name):
            self.add(path, "not-a-name", value=name, expected=expected)
        elif name in taken:
            self.add(path, "name-taken", value=name, taken=taken[name])

    def once(
        self, path: YamlPath, items: Iterable[tuple[int, str]], what: str, *key: str, **given: Any
    ) -> None:
        """That no name of a list at `path`, at the `key` of each item, stands further up too."""
        for index, name, _ in duplicates(items):
            self.add((*path, index, *key), "appears-twice", value=name, what=what, **given)

    def correlated(
        self, items: Iterable[tuple[int, Sequence[Any]]], judge: Callable[[YamlPath, str], None]
    ) -> None:
        """Correlations [first, second, r]: `judge` sees both names; no pair twice, |r| <= 1."""
        seen: set[frozenset[str]] = set()
        for index, (first, second, r) in items:
            path: YamlPath = ("correlations", index)
            for at, name in enumerate((first, second)):
                judge((*path, at), name)
            if not -1.0 <= r <= 1.0:
                self.add((*path, 2), "wrong-value", value=f"{r:g}", expected="-1 to 1")
            pair = frozenset((first, second))
            if first == second or pair in seen:
                what = "the name" if first == second else "the correlation"
                self.add(path, "appears-twice", what=what, value=f"{first}, {second}")
            seen.add(pair)

    def is_faulty(self, *path: str | int) -> bool:
        """Whether something is wrong with an entry: what it lacks may be misspelt."""
        own = path_text(path)
        return any((each.path or "").startswith(own) for each in self.findings)

    def keys(self, *path: str | int) -> tuple[str, ...]:
        """The keys of a mapping as they stand in the file, those with faults included."""
        found = self.document.at(*path)
        return tuple(found) if isinstance(found, dict) else ()

    def given(self, *path: str | int) -> tuple[str, ...]:
        """The keys that have a value, if a wrong one: ``key: ~`` says as much as no key."""
        return tuple(key for key in self.keys(*path) if self.document.at(*path, key) is not None)

    def existing(self, path: YamlPath) -> YamlPath:
        """A path without what the file lacks: a single value may stand for a list."""
        while path and isinstance(path[-1], (int, float)):
            if isinstance(self.document.at(*path[:-1]), list):
                break
            path = path[:-1]
        return path


def check_contract(
    document: YamlDocument,
    model: type[M],
    kind: str,
    check: Callable[[M, Faults], None] = lambda *_: None,
    *,
    largest: float = LARGEST,
) -> M:
    """The document as a checked `model` of the schema ``mtu/<kind>/1``.

    `check` adds the faults that need more than one value. Where parts of the document are faulty
    it still sees the sound rest: faulty entries of mappings are left out, faulty items of lists
    and faulty single values are None. Numbers beyond `largest` are faults.

    Raises InputError with all findings, in the order of their lines.
    """
    _check_kind(document, kind)
    faults = Faults(document)
    sound = document.data
    try:
        checked = model.model_validate(document.data)
    except ValidationError as error:
        _add_all(error, faults, model)
        unknown = {item["loc"] for item in error.errors() if item["type"] == "extra_forbidden"}
        sound = _without(document.data, unknown)
    for path, odd in document.odd_numbers.items():
        if annotation_at(model, (*path, 0)) is not str:
            faults.findings.append(odd)
    known = {own.path for own in faults.findings}
    large = {p: (v, most) for p, v, most in too_large(sound, largest) if path_text(p) not in known}
    for path, (value, most) in large.items():
        faults.add(path, "too-large", value=value, expected=f"at most {most:g} in size")
    if large or sound is not document.data:
        checked = _salvaged(model, _without(sound, set(large), drop=False))
    check(checked, faults)
    if issubclass(model, Contract):
        known = {own.path for own in faults.findings}
        for path, name in _names(document.data, ()):
            if not is_name(name) and path_text(path) not in known:
                faults.add(path, "not-printable", value=name, expected=A_NAME)
    if faults.findings:
        raise InputError(faults.findings)
    return checked


def _check_kind(document: YamlDocument, kind: str) -> None:
    wanted, faults, data = f"mtu/{kind}/{SCHEMA_VERSION}", Faults(document), document.data
    if not isinstance(data, dict):
        is_table = ".csv" in document.source.path.name
        hint = " (a CSV file is given with its option, such as --cmm FILE)" if is_table else ""
        expected = f"keys such as 'schema: {wanted}'{hint}"
        faults.add((), "other-kind", kind=a_file(kind), value=data, expected=expected)
    elif "schema" not in data:
        near = closest("schema", [key for key in data if key != "name"])
        hint = "" if near is None else f" (rename {near!r})"
        faults.add((), "missing-key", key="schema", expected=f"'schema: {wanted}'{hint}")
    elif data["schema"] != wanted:
        found = str(data["schema"]).removeprefix("mtu/").partition("/")[0]
        hint = f" (this kind is given as {GIVEN_AS[found]})" if found in GIVEN_AS else ""
        expected = wanted + hint * (found != kind)
        faults.add(
            ("schema",), "other-kind", kind=a_file(kind), value=data["schema"], expected=expected
        )
    if faults.findings:
        raise InputError(faults.findings)


def _add_all(error: ValidationError, faults: Faults, model: type[BaseModel]) -> None:
    """One finding for each fault; a required key that was misspelt is reported once."""
    items = error.errors(include_url=False)
    unknown = [item for item in items if item["type"] == "extra_forbidden"]
    misspelt = {
        (*item["loc"][:-1], near)
        for item in unknown[:HINTED]
        for near in _meant(str(item["loc"][-1]), keys_at(model, item["loc"][:-1]))
    }
    for item in items:
        if item["type"] == "missing" and item["loc"] in misspelt:
            continue
        path, code, given = _explained(item, faults, model)
        faults.add(path, code, **given)


def _explained(
    item: ErrorDetails, faults: Faults, model: type[BaseModel]
) -> tuple[YamlPath, str, dict[str, Any]]:
    """Path and code of one of pydantic's errors; and its value, expectation and facts."""
    path = tuple(step for step in item["loc"] if step != "[key]")
    kind, value, context = item["type"], item["input"], item.get("ctx", {})
    if kind == "missing":
        return path[:-1], "missing-key", {"key": str(path[-1])}
    if kind == "extra_forbidden":
        given = {"what": "key", "value": str(path[-1])}
        return path, "unknown-name", given | _instead(path, value, faults, model)
    if kind == "finding":
        told = {"value": value, "expected": context["expected"], **context["facts"]}
        return path, context["code"], told
    annotation = annotation_at(model, faults.existing(path))
    if value is None:
        return path, "no-value", {"expected": _expected(item, annotation)}
    if kind == "literal_error":
        allowed = re.findall(r"'([^']*)'", str(context.get("expected", "")))
        near = nearest(str(value), allowed)
        hint = {"meant": near} if near else {"expected": f"one of: {', '.join(allowed)}"}
        what = "key" if item["loc"][-1:] == ("[key]",) else "value"
        return path, "unknown-name", {"what": what, "value": value, **hint}
    return path, "wrong-value", {"value": value, "expected": _expected(item, annotation)}


def _instead(
    path: YamlPath, value: object, faults: Faults, model: type[BaseModel]
) -> dict[str, Any]:
    """What to write instead of an unknown key."""
    name, known = str(path[-1]), keys_at(model, path[:-1])
    entry = annotation_at(model, path[:-1])
    if name in getattr(entry, "elsewhere", {}):
        return {"expected": entry.elsewhere[name]}
    if value is None and name[:1].isdigit() and not any(key[:1].isdigit() for key in known):
        return {"expected": f"a decimal point before {name}: a comma ends a value"}
    if len(faults.findings) >= HINTED:
        return {}
    near = _meant(name, known)
    return {"meant": near} if near else suggestion(name, known)


def _meant(name: str, known: Collection[str]) -> tuple[str, ...]:
    """Known keys that an unknown one may stand for; `x` stands for `x_mm`."""
    return tuple(key for key in known if key.rpartition("_")[0] == name) or nearest(name, known)


def _expected(item: ErrorDetails, annotation: Any) -> str:
    """What was expected in the place of a faulty value."""
    kind, given = item["type"], item["input"]
    words = EXPECTED.get(kind, "another value").format(**item.get("ctx", {}))
    if kind in ("float_type", "int_type") and isinstance(given, str):
        return number_expectation(given, words)
    if kind == "string_type" and isinstance(given, (int, float)):
        return f"{words}: '{shown_value(given)}' in quotes"
    entry = annotation if kind in ("dict_type", "model_type") else _step(annotation, 0)
    if kind in ("dict_type", "model_type", "list_type") and (fields := _fields(entry)):
        must = [key for key, info in fields.items() if info.is_required()] or list(fields)
        keys = ", ".join(f"{key}: ..." for key in must[:3]) + (", ..." if must[3:] else "")
        return f"{words}: {'- ' if kind == 'list_type' else ''}{{{keys}}}"
    if kind == "list_type" and isinstance(given, str) and _bare(entry) is str:
        return f"{words}: [{given}]" if "," not in given else words
    return words


_NUMBER = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
_PLAIN = re.compile(_NUMBER)
_OTHER_DIGIT = re.compile(r"[^\D0-9]")
_OTHER_BASE = re.compile(r"[+-]?0(?:[xX][0-9a-fA-F]++|[bB][01]++|[oO][0-7]++)")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_WITH_UNIT = re.compile(_NUMBER + r"\s*+[A-Za-zµμ°%\"'/].*", re.DOTALL)


def number_expectation(text: str, wanted: str = "a number") -> str:
    """What to write instead of a text that stands where a number belongs.

    >>> number_expectation("1,5"), number_expectation("20 mm")
    ('a number with a decimal point', 'a number alone, without its unit')
    """
    text = text.strip()
    if _PLAIN.fullmatch(text):
        return f"{wanted}, without quotes"
    if _OTHER_BASE.fullmatch(text):
        return f"{wanted} in decimal digits"
    if not text.isascii() and _OTHER_DIGIT.search(text):
        return f"{wanted} in the digits 0 to 9"
    if _DECIMAL_COMMA.fullmatch(text):
        return f"{wanted} with a decimal point"
    return f"{wanted} alone, without its unit" if _WITH_UNIT.fullmatch(text) else wanted


def annotation_at(model: Any, path: YamlPath) -> Any:
    """The type of what stands at a path of a contract's document; None where it has none."""
    for step in path:
        model = _step(model, step)
    return _bare(model)


def keys_at(model: Any, path: YamlPath) -> list[str]:
    """The keys that the entry at a path may have."""
    return list(_fields(annotation_at(model, path)))


def _fields(annotation: Any) -> dict[str, Any]:
    if isinstance(annotation := _bare(annotation), type) and issubclass(annotation, BaseModel):
        return {info.alias or name: info for name, info in annotation.model_fields.items()}
    return {}


def _step(annotation: Any, step: str | float) -> Any:
    annotation = _bare(annotation)
    if fields := _fields(annotation):
        own = fields.get(str(step)) or annotation.model_fields.get(str(step))
        return None if own is None else own.annotation
    return get_args(annotation)[-1] if get_origin(annotation) in (dict, list) else None


def _bare(annotation: Any) -> Any:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _bare(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return _bare(next(part for part in get_args(annotation) if part is not type(None)))
    return annotation


def _without(data: Any, paths: Collection[YamlPath], path: YamlPath = (), drop: bool = True) -> Any:
    """The document with None for the values at `paths`; entries of mappings are dropped there."""
    if isinstance(data, dict):
        kept = ((key, (*path, key), item) for key, item in data.items())
        return {
            key: None if own in paths else _without(item, paths, own, drop)
            for key, own, item in kept
            if not (drop and own in paths)
        }
    if isinstance(data, list):
        return [
            None if (*path, i) in paths else _without(item, paths, (*path, i), drop)
            for i, item in enumerate(data)
        ]
    return data


def _salvaged(model: type[M], data: Mapping[str, Any]) -> M:
    """The sound part of a document; see `check_contract`."""
    values: dict[str, Any] = {}
    for name, info in model.model_fields.items():
        given = data.get(info.alias or name)
        if given is None:
            required = info.is_required()
            values[name] = None if required else info.get_default(call_default_factory=True)
            continue
        sound, values[name] = _attempt(model, name, given)
        origin = get_origin(info.annotation)
        if not sound and origin is dict and isinstance(given, dict):
            tried = ((key, _attempt(model, name, item, inside=True)) for key, item in given.items())
            values[name] = {key: value for key, (sound, value) in tried if sound}
        elif not sound and origin is list and isinstance(given, list):
            values[name] = [_attempt(model, name, item, inside=True)[1] for item in given]
        elif not sound and origin in (dict, list):
            values[name] = origin()
    return model.model_construct(**values)


def _attempt(
    model: type[BaseModel], name: str, data: Any, *, inside: bool = False
) -> tuple[bool, Any]:
    try:
        return True, _adapter(model, name, inside).validate_python(data, strict=True)
    except ValidationError:
        return False, None


@cache
def _adapter(model: type[BaseModel], name: str, inside: bool) -> TypeAdapter[Any]:
    """Of a field, or of the values `inside` its mapping or list."""
    info = model.model_fields[name]
    if inside:
        return TypeAdapter(get_args(info.annotation)[-1])
    whole: Any = Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
    return TypeAdapter(whole)


def too_large(
    data: Any, largest: float = LARGEST, path: YamlPath = ()
) -> Iterator[tuple[YamlPath, float, float]]:
    """Path, value and limit of every number of a document that is beyond what it may be."""
    if isinstance(data, dict):
        for key, item in data.items():
            squared = isinstance(item, list) and any(word in key for word in SQUARED)
            if key not in UNLIMITED or isinstance(item, dict):
                most = max(largest, LARGEST**2) if squared else largest
                yield from too_large(item, most, (*path, key))
    elif isinstance(data, (list, tuple)):
        for index, item in enumerate(data):
            yield from too_large(item, largest, (*path, index))
    elif isinstance(data, (int, float)) and largest < abs(data) < math.inf:
        yield path, data, largest


def _names(data: Any, path: YamlPath) -> Iterator[tuple[YamlPath, str]]:
    """All that is a name in a document: its keys, and what stands at `name` and `id`."""
    items = (
        data.items() if isinstance(data, dict) else enumerate(data) if type(data) is list else ()
    )
    for key, item in items:
        own = (*path, key)
        if isinstance(key, str):
            yield own, key
        if key in ("name", "id") and isinstance(item, str):
            yield own, item
        else:
            yield from _names(item, own)


def present(items: Iterable[T | None] | None) -> list[tuple[int, T]]:
    """The sound items of a list with their index."""
    return [(index, item) for index, item in enumerate(items or ()) if item is not None]


def duplicates(names: Iterable[tuple[int, str]]) -> list[tuple[int, str, int]]:
    """Every (index, name, first index) whose name stands further up already.

    >>> duplicates(enumerate("aba"))
    [(2, 'a', 0)]
    """
    first: dict[str, int] = {}
    return [
        (index, name, first[name])
        for index, name in names
        if first.setdefault(name, index) != index
    ]


def is_identifier(name: str) -> bool:
    """Whether an equation can use the name."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z_0-9]*", name) is not None
