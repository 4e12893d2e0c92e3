"""What the reports that are read back have in common: their numbers, and how faults are told."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.contract_errors import in_words
from mtu_cli.files.shown_values import shown_value
from mtu_cli.files.sizes import WHAT, expected_size, too_large
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS

NonNegative = Annotated[float, Field(ge=0)]


def _or_nan(value: object) -> object:
    return math.nan if value is None else value


Figure = Annotated[float, Field(strict=True, allow_inf_nan=True), BeforeValidator(_or_nan)]
"""A number; nan where the report says null, because the readings do not determine it."""

Matrix = list[list[Figure]]

M = TypeVar("M", bound=BaseModel)


def schema_of(document: Any) -> str | None:
    """The `schema` of a JSON document, None where it has none."""
    found = document.get("schema") if isinstance(document, dict) else None
    return None if found is None else str(found)


def read_from(document: Any, roles: Collection[str]) -> frozenset[str]:
    """The hashes of the readings that a report was made from, as far as it states them."""
    found = document.get("inputs") if isinstance(document, dict) else None
    entries = found if isinstance(found, list) else ()
    return frozenset(
        str(item.get("sha256"))
        for item in entries
        if isinstance(item, dict) and item.get("role") in roles
    )


def not_a_report(source: Source, document: Any, expected: str) -> InputError:
    """The fault of a document of another `schema`, or of none."""
    found, what = schema_of(document), "is not a components report"
    if found is None:
        lacks = "the key 'schema' is missing" if isinstance(document, dict) else "it holds no keys"
        problem = Problem(what=f"{what}: {lacks}", file=source.shown, expected=expected)
    else:
        problem = Problem(
            what=what, file=source.shown, path="schema", value=found, expected=expected
        )
    return InputError(problem)


def validated(source: Source, document: Any, model: type[M], command: str) -> M:
    """The document as a `model`; raises InputError with every fault and its path."""
    try:
        found = model.model_validate(document)
    except ValidationError as error:
        raise InputError([_problem(source, item, command) for item in error.errors()]) from None
    large = [
        Problem(
            what=WHAT,
            file=source.shown,
            path=".".join(str(step) for step in path),
            value=f"{value:g}",
            expected=expected_size(limit),
        )
        for path, value, limit in too_large(found.model_dump())
    ]
    if large:
        raise InputError(large)
    return found


def _problem(source: Source, item: Any, command: str) -> Finding:
    return Problem(
        what=_what(item),
        file=source.shown,
        path=".".join(str(part) for part in item["loc"]),
        value=None if item["type"] == "missing" else _shown(item["input"]),
        expected=f"the report as `mtu {command}` writes it",
    )


def _shown(value: Any) -> str:
    # A text in its quotation marks: it may look like a number.
    return repr(value) if isinstance(value, str) else shown_value(value)


def _what(item: Any) -> str:
    if item["type"] == "missing":
        return "is missing"
    # A check of ours says by itself what is wrong; else there is a noun for what is expected.
    return in_words(item) if item["type"] == "value_error" else f"is not {in_words(item)}"


def unit_problem(source: Source, name: str, unit: str) -> list[Finding]:
    """The Problem of a component's unknown unit, if it is one."""
    if unit in UNITS:
        return []
    path = f"results.components.{name}.unit"
    what, expected = "unknown unit", ", ".join(UNITS)
    return [Problem(what=what, file=source.shown, path=path, value=unit, expected=expected)]


def any_estimated(matrix: Matrix) -> bool:
    """Whether a covariance is not 0 throughout: nan counts as estimated."""
    return any(map(any, matrix))


def no_dof(source: Source, path: str, what: str, *, known: bool = True) -> Finding:
    """The Problem of 0 degrees of freedom at `path` of `what` was estimated; `known`: null may
    say that it is known exactly.
    """
    return Problem(
        what=f"{what} without degrees of freedom",
        file=source.shown,
        path=path,
        value="0",
        expected="more than 0, or null: known exactly" if known else "more than 0",
    )
