"""What the reports that are read back have in common: their numbers, and how faults are told."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.sizes import WHAT, expected_size, too_large
from mtu_cli.files.source import Source
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
    """The fault of a document of another `schema`."""
    return InputError(
        Problem(
            what="is not a components report",
            file=source.shown,
            path="schema",
            value=str(schema_of(document)),
            expected=expected,
        )
    )


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


def _problem(source: Source, item: Any, command: str) -> Problem:
    return Problem(
        what="is missing" if item["type"] == "missing" else str(item["msg"]).lower(),
        file=source.shown,
        path=".".join(str(part) for part in item["loc"]),
        value=None if item["type"] == "missing" else repr(item["input"]),
        expected=f"the report as `mtu {command}` writes it",
    )


def unit_problem(source: Source, name: str, unit: str) -> list[Problem]:
    """The Problem of a component's unknown unit, if it is one."""
    if unit in UNITS:
        return []
    path = f"results.components.{name}.unit"
    what, expected = "unknown unit", ", ".join(UNITS)
    return [Problem(what=what, file=source.shown, path=path, value=unit, expected=expected)]


def square(matrix: Matrix, size: int) -> bool:
    """Whether a matrix is (size, size)."""
    return len(matrix) == size and all(len(row) == size for row in matrix)


def negative(matrix: Matrix) -> bool:
    """Whether a variance on the diagonal is negative."""
    return any(row[i] < 0 for i, row in enumerate(matrix))


def matrix_fault(matrix: Matrix, size: int, *, may_be_negative: bool = False) -> str | None:
    """Why a matrix is no covariance (size, size) by what each pair of its numbers says. An estimate
    that is a difference `may_be_negative`, and need not be a covariance in all directions.
    """
    if not square(matrix, size):
        return f"not {size} x {size}"
    if not may_be_negative and negative(matrix):
        return "a variance is negative"
    return None if symmetric(matrix) else "not symmetric"


def symmetric(matrix: Matrix) -> bool:
    """Whether a matrix is its own transpose, but for rounding; unknown entries (nan) may be."""
    import numpy as np

    C = np.array(matrix, float).reshape(len(matrix), len(matrix))
    s = np.sqrt(np.abs(np.diag(C)))
    scale = np.outer(s, s) + np.maximum(np.abs(C), np.abs(C.T))
    return not (np.abs(C - C.T) > INDEFINITE * scale).any()


INDEFINITE = 1e-6
"""Size of a negative eigenvalue of correlations that rounding of a report may leave."""
LARGEST_VARIANCE = 1e24


def covariance_like(matrix: Matrix) -> bool:
    """Whether a matrix is symmetric and has no negative variance in any direction."""
    import numpy as np

    C = np.array(matrix, float).reshape(len(matrix), len(matrix))
    if not np.abs(C).max(initial=0.0) <= LARGEST_VARIANCE:
        return False
    s = np.sqrt(np.diag(C))
    scale = np.outer(s, s)
    R = np.divide(C, scale, out=np.where(C == 0, 0.0, np.inf), where=scale > 0)
    if not np.isfinite(R).all() or np.abs(R - R.T).max(initial=0.0) > INDEFINITE:
        return False
    return not len(R) or bool(np.linalg.eigvalsh((R + R.T) / 2)[0] >= -INDEFINITE * len(R))


def any_estimated(matrix: Matrix) -> bool:
    """Whether a covariance is not 0 throughout: nan counts as estimated."""
    return any(map(any, matrix))


def no_dof(source: Source, path: str, what: str, *, known: bool = True) -> Problem:
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
