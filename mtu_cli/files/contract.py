"""From documents to checked contracts, with every fault of a file at once.

A contract is a pydantic model. What pydantic finds wrong becomes a `Finding` with the line, the
path, the value and what is expected there; the `check` of each entry adds, through `Faults`, what
takes more than one value to see.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from types import UnionType
from typing import Annotated, Any, TypeGuard, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from mtu_cli.files.source import Source, a_file
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, shown_value
from mtu_cli.findings import Finding, InputError, collected, error, finding, suggestion

MAX_DEGREE = 9
"""Of a polynomial in position."""
LARGEST = 1e30
"""Of a number in size: products of some of them stay far from what overflows."""
A_NAME = "a text on one line that is not empty, without control characters"
IDENTIFIER = "letters, digits and _, no digit first"
"""A name that equations can use."""
HINTED = 50
"""Unknown names of a document that are compared with all names that it may use."""
EXPECTED = {
    "float": "a number",
    "int": "a whole number",
    "string": "a text",
    "bool": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dict": "keys with values",
    "model": "keys with values",
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
"""What is expected, by pydantic's name of the error or its first word."""

M = TypeVar("M", bound=BaseModel)
T = TypeVar("T")


class Contract(BaseModel):
    """Base of all contract models: no unknown keys, no coercion, finite numbers, frozen."""

    model_config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True, populate_by_name=True
    )

    def check(self, faults: Faults) -> None:
        """Adds what takes more than one value of a sound entry to see; `faults` are those here."""


def wrong(expected: str = "", code: str = "wrong-value", **facts: Any) -> PydanticCustomError:
    """For validators: an error that becomes a Finding of `code`."""
    return PydanticCustomError("finding", code, {"code": code, "expected": expected, **facts})


def must(
    hold: Callable[[Any], bool], expected: str, code: str = "wrong-value", **facts: Any
) -> AfterValidator:
    """That a condition holds of a value; a Finding of `code` where it does not."""

    def check(value: T) -> T:
        if not hold(value):
            raise wrong(expected, code, **facts)
        return value

    return AfterValidator(check)


def is_name(text: str) -> bool:
    """Whether a table can show the text: not blank, and nothing in it that a terminal obeys."""
    return bool(text.strip()) and re.search("[\x00-\x1f\x7f-\x9f\u2028\u2029]", text) is None


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a number: true and false are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def short(of: Callable[[object], bool], meant: Callable[[Any], Any], form: Any) -> BeforeValidator:
    """A short form of a value, such as `9.81` for `{value: 9.81}`; `form` is its type."""
    return BeforeValidator(
        lambda value: meant(value) if of(value) else value, json_schema_input_type=form
    )


def one_or_more(form: Any, *kinds: type) -> BeforeValidator:
    """A list of which a single item, of the type `form`, may stand without brackets; of some
    `kinds` alone, if they are given.
    """
    return short(
        lambda value: not isinstance(value, list) and isinstance(value, kinds or object),
        lambda value: [value],
        form | list[form],
    )


def optional(description: str, default: Any = None, alias: str | None = None) -> Any:
    """A key of a contract that need not be given."""
    return Field(default=default, description=description, alias=alias)


NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
SIZED = must(lambda x: not abs(x) > LARGEST, f"at most {LARGEST:g} in size", "out-of-range")
"""A number that products of some of them do not overflow with."""
Number = Annotated[float, SIZED]
NAMED = must(is_name, A_NAME, "wrong-type", kind="a name")
Name = Annotated[str, NAMED, Field(json_schema_extra={"minLength": 1})]
"""A text on one line, as tables show it."""
IdText = Annotated[Name, short(lambda value: type(value) is int, str, str | int)]
"""A name that may be written as a whole number: feature 3 is feature '3'."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """What is read from a document, and where each of its values stands there."""

    document: YamlDocument
    warnings: tuple[Finding, ...] = ()

    @property
    def source(self) -> Source:
        """The file as reports know it."""
        return self.document.source

    def place(self, *path: str | int) -> dict[str, Any]:
        """File, line and path of a value, for findings: ``place("components", "dx_x")``."""
        return self.document.place(path)


@dataclass(slots=True)
class Faults:
    """The findings of one document, to which `add` adds those at a `place`, with file and line."""

    document: YamlDocument
    place: YamlPath = ()
    findings: list[Finding] = field(default_factory=list)

    def at(self, *steps: str | int) -> Faults:
        """The same findings, at a place farther inside."""
        return replace(self, place=(*self.place, *steps))

    def add(self, code: str, *, value: object = None, **facts: Any) -> None:
        """One more finding here: `expected`, `meant`, `column` and the facts of its code.

        `value` is shown as it would be written in the file; None: the number or text of the file.
        """
        stands = self.document.at(*self.place)
        value = stands if value is None and not isinstance(stands, (dict, list)) else value
        self.extend([finding(code, value=None if value is None else shown_value(value), **facts)])

    def extend(self, findings: Iterable[Finding]) -> None:
        """Findings that stand here, such as those of an equation."""
        prefix, value = self.document.reached(self.place)
        # A short form stands for keys, or for a list, that the file does not have.
        place = self.document.place(self.place if isinstance(value, dict) else prefix)
        self.findings += [item.at(**place) for item in findings]

    def collected(self) -> AbstractContextManager[None]:
        """Adds what is raised while an equation here is read; what follows is left out."""
        return collected(lambda item: self.extend([item]))

    def unknown(self, name: str, names: Collection[str], what: str = "name") -> None:
        """That `name` is none of the `names`; where there are none at all, what is wrong with
        the list of them is reported already.
        """
        if names or not self.findings:
            hint = suggestion(name, names) if len(self.findings) < HINTED else {}
            self.add("unknown-name", value=name, what=what, **hint)

    def symbol(self, name: str, uses: Mapping[str, str], expected: str = IDENTIFIER) -> None:
        """That equations can use `name`, which has none of the `uses` yet (name: what it is)."""
        if not is_identifier(name):
            kind = "a name that equations can use"
            self.add("wrong-type", value=name, kind=kind, expected=expected)
        elif name in uses:
            self.add("name-taken", value=name, taken=uses[name])

    def once(
        self, items: Iterable[tuple[str | int, str]], what: str, *key: str, **facts: Any
    ) -> None:
        """That no name here, at the `key` of each item, stands further up too."""
        first: dict[str, str | int] = {}
        for step, name in items:
            if first.setdefault(name, step) != step:
                self.at(step, *key).add("appears-twice", value=name, what=what, **facts)

    def keys(self) -> tuple[str, ...]:
        """The keys of a mapping as they stand in the file, those with faults included."""
        result = self.document.at(*self.place)
        return tuple(result) if isinstance(result, dict) else ()

    def valued_keys(self) -> tuple[str, ...]:
        """The keys that have a value, if a wrong one: ``key: ~`` says as much as no key."""
        return tuple(key for key in self.keys() if self.document.at(*self.place, key) is not None)


def check_contract(
    document: YamlDocument,
    model: type[M],
    kind: str,
    check: Callable[[M, Faults], None] = lambda *_: None,
    *,
    at: YamlPath = (),
) -> M:
    """The document, or what of it stands `at` a place, as a checked `model` of the schema
    ``mtu/<kind>/1``.

    `check` adds the faults of the whole, behind those of its entries. Both see the sound part of a
    document: faulty entries of mappings are left out, faulty items of lists and single values are
    None.

    Raises InputError with all findings, in the order of their lines.
    """
    faults, data = Faults(document), document.data
    schema = f"mtu/{kind}/1"
    if not isinstance(data, dict):
        faults.add("wrong-type", kind=a_file(kind), value=data, expected=f"'schema: {schema}'")
    elif "schema" not in data:
        faults.add("missing-key", key="schema", expected=f"'schema: {schema}'")
    elif (value := data["schema"]) != schema:
        faults.at("schema").add("wrong-type", kind=a_file(kind), value=value, expected=schema)
    elif document.at(*at) is None:
        faults.add("missing-key", key=at[-1])
    if faults.findings:
        raise InputError(faults.findings)
    here, data = faults.at(*at), document.at(*at)
    try:
        # By the keys of the contract alone, not by our names of fields.
        result = model.model_validate(data, by_alias=True, by_name=False)
    except ValidationError as fault:
        for item in fault.errors(include_url=False):
            _report(item, here, model)
        result = _sound_part(model, data if isinstance(data, dict) else {})
    _check_entries(result, here)
    check(result, here)
    if faults.findings:
        raise InputError(faults.findings)
    return result


def _check_entries(entry: object, faults: Faults) -> None:
    """The checks of an entry and of all within it."""
    if not isinstance(entry, Contract):
        return
    for name, info in type(entry).model_fields.items():
        value, here = getattr(entry, name), faults.at(info.alias or name)
        _check_entries(value, here)
        if isinstance(value, (dict, list)):
            for step, item in value.items() if isinstance(value, dict) else enumerate(value):
                _check_entries(item, here.at(step))
    entry.check(faults)


def _report(item: ErrorDetails, faults: Faults, model: type[BaseModel]) -> None:
    """One of pydantic's errors as a finding."""
    path = tuple(step for step in item["loc"] if step != "[key]")
    kind, value, context = item["type"], item["input"], item.get("ctx", {})
    literal = "null" if value is None else value
    at, here = type_at(model, path), faults.at(*path)
    if kind == "missing":
        faults.at(*path[:-1]).add("missing-key", key=path[-1])
    elif kind == "extra_forbidden":
        here.unknown(str(path[-1]), keys_of(type_at(model, path[:-1])), "key")
    elif kind == "finding":
        here.add(**{"value": None if isinstance(value, dict) else literal, **context})
    elif kind == "literal_error":
        is_key = path != item["loc"]
        choices = get_args(get_args(type_at(model, path[:-1]))[0] if is_key else at)
        here.unknown(shown_value(literal), choices, "key" if is_key else "value")
    else:
        here.add("wrong-value", value=literal, expected=expectation(item, at))


def expectation(item: ErrorDetails, annotation: Any) -> str:
    """What was expected in the place of a faulty value."""
    kind, value = item["type"], item["input"]
    words = EXPECTED.get(kind) or EXPECTED.get(kind.partition("_")[0], "another value")
    words = words.format(**item.get("ctx", {}))
    if kind.startswith(("float", "int")) and isinstance(value, str):
        point = " with a decimal point" if kind.startswith("float") else ""
        return f"{words}{point}, without quotes or unit"
    if kind == "string_type" and is_number(value):
        return f"{words}: '{shown_value(value)}' in quotes"
    if kind in ("dict_type", "model_type") and (keys := keys_of(annotation)):
        must = [key for key, info in keys.items() if info.is_required()] or list(keys)
        return f"{words}: {{{', '.join(f'{key}: ...' for key in must)}}}"
    return words


def type_at(model: Any, path: YamlPath) -> Any:
    """The type of what stands at a path of a contract's document; None where it has none."""
    for step in path:
        if fields := keys_of(model):
            model = fields[step].annotation if step in fields else None
        else:
            model = get_args(model)[-1] if get_origin(model) in (dict, list) else None
        while get_origin(model) in (Annotated, Union, UnionType):
            model = get_args(model)[0]
    return model


def keys_of(model: Any) -> dict[str, Any]:
    """The keys that an entry of this type may have, and the field of each."""
    fields = getattr(model, "model_fields", {})
    return {info.alias or name: info for name, info in fields.items()}


def _sound_part(model: type[M], data: Mapping[str, Any]) -> M:
    """The sound part of a document; see `check_contract`."""
    values, strict = dict[str, Any](), model.model_config.get("strict")
    for name, info in model.model_fields.items():
        entry, kind = data.get(info.alias or name), get_origin(info.annotation)
        value = None
        if entry is not None:
            value = _lenient(model, name).validate_python(
                entry, strict=strict, extra="ignore", by_alias=True, by_name=False
            )
        elif not info.is_required():
            value = info.get_default(call_default_factory=True)
        if kind is dict:
            entries = (value or {}).items()
            value = {key: item for key, item in entries if key is not None and item is not None}
        values[name] = [] if kind is list and value is None else value
    return model.model_construct(**values)


@cache
def _lenient(model: type[BaseModel], name: str) -> TypeAdapter[Any]:
    """Of a field: what is faulty is None, an entry of its mapping or list by itself."""
    info = model.model_fields[name]
    form: Any = info.annotation
    if (kind := get_origin(form)) in (dict, list):
        form = kind[tuple(Annotated[item, WrapValidator(_or_none)] for item in get_args(form))]
    return TypeAdapter(Annotated[(form, *info.metadata, WrapValidator(_or_none))])


def _or_none(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
    try:
        return validate(value)
    except ValidationError:
        return None


def present(items: Iterable[T | None] | None) -> list[tuple[int, T]]:
    """The sound items of a list with their index."""
    return [(index, item) for index, item in enumerate(items or ()) if item is not None]


def is_identifier(name: str) -> bool:
    """Whether an equation can use the name."""
    return name.isascii() and name.isidentifier()


SCHEMAS = {
    "machine": ("mtu_cli.files.machine", "Machine"),
    "part": ("mtu_cli.files.part", "Part"),
    "study": ("mtu_cli.files.study", "Study"),
    "budget": ("mtu_cli.files.budget", "Budget"),
    "graph": ("mtu_cli.files.graph_contract", "Graph"),
    "effects": ("mtu_cli.files.effects", "Effects"),
    "import": ("mtu_cli.formats.table_map", "Profile"),
}
"""Module and model of each kind; the modules are imported when asked for."""


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of ``mtu/<kind>/1``; InputError where there is no such."""
    if kind not in SCHEMAS:
        raise error("unknown-name", what="schema", value=kind, **suggestion(kind, SCHEMAS))
    module, name = SCHEMAS[kind]
    schema: dict[str, Any] = getattr(import_module(module), name).model_json_schema(by_alias=True)
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"mtu/{kind}/1"}
    return head | schema | {"title": f"mtu {kind}"}
