"""From YAML documents to checked contracts, with every problem of a file at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from mtu_cli.errors import InputError, Problem, closest, did_you_mean, listing
from mtu_cli.files.contract_errors import (
    existing_path,
    missing_key,
    path_text,
    to_problems,
)
from mtu_cli.files.contract_salvage import salvage, without_unknown
from mtu_cli.files.contract_shapes import lists_texts
from mtu_cli.files.names import EXPECTED, NO_NAME, is_name
from mtu_cli.files.shown_values import shown_value
from mtu_cli.files.sizes import WHAT, expected_size, too_large, without
from mtu_cli.files.source import a_file
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding

SCHEMA_VERSION = 1
MAX_DEGREE = 9
"""Of a polynomial in position."""
HINTED = 50
"""Unknown names of a document that are compared with all that are known."""

OWN_SIZES = ("budget",)
"""Kinds of files whose checks know by themselves how large their numbers may be."""

LEAST = {
    "pass": (0, "below 0", "a whole number from 0 on"),
    "repeat": (0, "a negative repeat", "0, 1, 2, ..."),
}
"""Of columns of counts the least value, what a lesser one is, and what is expected."""

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


class Contract(BaseModel):
    """Base of all contract models: no unknown keys, no coercion, finite numbers, frozen.

    `elsewhere`: where keys stand that an entry has not, but are looked for in it.
    """

    elsewhere: ClassVar[Mapping[str, str]] = {}
    model_config = ConfigDict(
        extra="forbid", strict=True, allow_inf_nan=False, frozen=True, populate_by_name=True
    )


NAME_TAKEN = "column-name-taken"
"""Code of the Notice of a column that no equation can name."""


M = TypeVar("M", bound=Contract)
T = TypeVar("T")


@dataclass(slots=True)
class Findings:
    """Collects the problems of one document; `add` finds file and line from the path."""

    document: YamlDocument
    problems: list[Finding] = field(default_factory=list)

    def add(
        self,
        path: YamlPath,
        what: str,
        *,
        value: object = None,
        expected: str | None = None,
        lacks: str | None = None,
    ) -> None:
        """One more problem at `path`; `value` is shown as it would be written in YAML."""
        path = existing_path(path, self.document)
        self.problems.append(
            Problem(
                what=what,
                file=self.document.source.shown,
                line=self.document.line_of(*path),
                path=path_text(path) or None,
                value=None if value is None else shown_value(value),
                expected=expected,
                lacks=lacks,
            )
        )

    def add_missing(self, path: YamlPath, key: str, *, expected: str | None = None) -> None:
        """That the entry at `path` lacks a key."""
        self.add(path, missing_key(key), expected=expected, lacks=key)

    def add_unknown(
        self,
        path: YamlPath,
        what: str,
        name: str,
        known: Collection[str],
        hint: Callable[[str, Collection[str]], str] = did_you_mean,
    ) -> None:
        """That `name` is none of those `known`; where there are none at all, what is wrong with
        the list of them is told already.
        """
        if known or not self.problems:
            # No more than the first few problems are shown.
            few = len(self.problems) < HINTED
            self.add(path, what, value=name, expected=hint(name, known) if few else listing(known))

    def keys(self, *path: str | int) -> tuple[str, ...]:
        """The keys of a mapping as they stand in the file, those with faults included."""
        return tuple(self._mapping(path))

    def given(self, *path: str | int) -> tuple[str, ...]:
        """The keys that have a value, if a wrong one: `key: ~` says as much as no key."""
        return tuple(key for key, value in self._mapping(path).items() if value is not None)

    def _mapping(self, path: YamlPath) -> Mapping[str, Any]:
        data: Any = self.document.data
        for step in path:
            try:
                data = data[step]
            except (KeyError, IndexError, TypeError):
                return {}
        return data if isinstance(data, dict) else {}


def check_contract(
    document: YamlDocument, model: type[M], kind: str, check: Callable[[M, Findings], None]
) -> M:
    """The document as a checked `model`.

    `check` adds the problems that need more than one value. Where parts of the document are
    faulty in themselves it still sees the sound rest: faulty entries of mappings are left
    out, faulty items of lists and faulty single values are None.

    Raises InputError with all problems, in the order of their lines.
    """
    _check_kind(document, kind)
    findings = Findings(document)
    sound = document.data
    try:
        checked = model.model_validate(document.data)
    except ValidationError as error:
        findings.problems.extend(to_problems(error, document, model))
        sound = without_unknown(document.data, error)
    _check_odd_numbers(findings, model)
    large: set[YamlPath] = set() if kind in OWN_SIZES else _too_large(findings)
    if large or sound is not document.data:
        checked = salvage(model, without(sound, large) if large else sound)
    check(checked, findings)
    _check_names(findings)
    if findings.problems:
        raise InputError(sorted(findings.problems, key=lambda problem: problem.line or 0))
    return checked


def _check_odd_numbers(findings: Findings, model: type[Contract]) -> None:
    for path, odd in findings.document.odd_numbers.items():
        if not lists_texts(model, path):
            findings.add((*path, odd.index), odd.what, value=odd.text, expected=odd.expected)


def _check_names(findings: Findings) -> None:
    told = {problem.path for problem in findings.problems}
    for path, name in _names(findings.document.data, ()):
        if not is_name(name) and path_text(path) not in told:
            findings.add(path, NO_NAME, value=name, expected=EXPECTED)


def _names(data: Any, path: YamlPath) -> Iterator[tuple[YamlPath, str]]:
    """All that is a name in a document: its keys, and what stands at `name` and `id`."""
    if isinstance(data, dict):
        for key, item in data.items():
            own = (*path, key)
            if isinstance(key, str):
                yield own, key
            if key in ("name", "id") and isinstance(item, str):
                yield own, item
            else:
                yield from _names(item, own)
    elif isinstance(data, list):
        for index, item in enumerate(data):
            yield from _names(item, (*path, index))


def _too_large(findings: Findings) -> set[YamlPath]:
    """Paths of the numbers that are too large and have no message of their own yet."""
    told = {problem.path for problem in findings.problems}
    found = {
        path: (value, limit)
        for path, value, limit in too_large(findings.document.data)
        if path_text(path) not in told
    }
    for path, (value, limit) in found.items():
        findings.add(path, WHAT, value=value, expected=expected_size(limit))
    return set(found)


def _check_kind(document: YamlDocument, kind: str) -> None:
    wanted = f"mtu/{kind}/{SCHEMA_VERSION}"
    what = f"not {a_file(kind)}"
    data = document.data
    findings = Findings(document)
    if not isinstance(data, dict):
        is_table = ".csv" in document.source.path.name
        hint = " (a CSV file is given with its option, such as --cmm FILE)" if is_table else ""
        findings.add((), what, value=data, expected=f"keys such as 'schema: {wanted}'{hint}")
    elif "schema" in data and data["schema"] != wanted:
        hint = _belongs(data["schema"], kind)
        findings.add(("schema",), what, value=data["schema"], expected=wanted + hint)
    elif "schema" not in data:
        near = closest("schema", [key for key in data if key != "name"])
        hint = f" (rename {near!r})" if near is not None else ""
        findings.add_missing((), "schema", expected=f"'schema: {wanted}'{hint}")
    if findings.problems:
        raise InputError(findings.problems)


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


def _belongs(schema: object, wanted: str) -> str:
    """Where a file of another kind than the wanted one is to be given, if it is one of ours."""
    kind = str(schema).removeprefix("mtu/").partition("/")[0]
    known = str(schema).startswith("mtu/") and kind in GIVEN_AS and kind != wanted
    return f" (this kind is given as {GIVEN_AS[kind]})" if known else ""


def present(items: Iterable[T | None] | None) -> list[tuple[int, T]]:
    """The sound items of a list with their index."""
    return [(index, item) for index, item in enumerate(items or ()) if item is not None]


def duplicates(names: Iterable[tuple[int, str]]) -> list[tuple[int, str, int]]:
    """Every (index, name, first index) whose name stands further up already."""
    first: dict[str, int] = {}
    found = []
    for index, name in names:
        if name in first:
            found.append((index, name, first[name]))
        first.setdefault(name, index)
    return found


_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")


def is_identifier(name: str) -> bool:
    """Whether an equation can use the name."""
    return _IDENTIFIER.fullmatch(name) is not None


def _id_text(value: object) -> object:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


IdText = Annotated[str, BeforeValidator(_id_text, json_schema_input_type=str | int)]
"""A name that may be written as a whole number: feature 3 is feature '3'."""
