"""The report of fit-components, read back by every command that predicts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
)

from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.files.json_file import read_json
from mtu_cli.files.source import Source
from mtu_cli.units import UNITS

SCHEMA = "mtu/fit-components/1"
NonNegative = Annotated[float, Field(ge=0)]


def _or_nan(value: object) -> object:
    return math.nan if value is None else value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("should not be negative")
    return value


Figure = Annotated[float, Field(strict=True, allow_inf_nan=True), BeforeValidator(_or_nan)]
"""A number; nan where the report says null, because the readings do not determine it."""

Deviation = Annotated[Figure, AfterValidator(_not_negative)]
Matrix = list[list[Figure]]


class ReportedComponent(BaseModel):
    """One entry of `results.components`; in `unit` and mm, as the report states them."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    of: str | None
    unit: str
    degree: int = Field(ge=0)
    n_passes: int | None
    coefficients: list[float] = Field(min_length=1)
    covariance: Matrix
    covariance_independent: Matrix | None
    s: NonNegative | None
    s_repeat: Deviation
    pass_covariance: Matrix
    pass_covariance_moment: Matrix
    pass_center_mm: float
    pass_dof: NonNegative | None
    repeat_dof: NonNegative | None
    position_range_mm: tuple[float, float] | None


class ReportedGroup(BaseModel):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    components: list[str]
    widths: list[int]
    coefficient_covariance: Matrix
    pass_covariance: Matrix
    pass_dof: NonNegative
    n_passes: int | None


class _Results(BaseModel):
    model_config = ConfigDict(extra="ignore")
    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = []


class _Report(BaseModel):
    model_config = ConfigDict(extra="ignore")
    results: _Results


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentsReport:
    """A checked fit-components report."""

    source: Source
    components: dict[str, ReportedComponent]
    joint: tuple[ReportedGroup, ...]


def read_components(path: Path) -> ComponentsReport:
    """Reads a fit-components report.

    Raises InputError for a file that is not one, with the path inside the document.
    """
    return components_from(*read_json(path, "components"))


def components_from(source: Source, document: Any) -> ComponentsReport:
    """Checks a fit-components report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    found = document.get("schema") if isinstance(document, dict) else None
    if found != SCHEMA:
        raise fault(
            "is not a components report",
            file=source.shown,
            path="schema",
            value=str(found),
            expected=f"{SCHEMA!r}, as `mtu fit-components -o FILE.json` writes it",
        )
    try:
        report = _Report.model_validate(document)
    except ValidationError as error:
        raise InputError([_problem(source, item) for item in error.errors()]) from None
    problems = [
        problem
        for name, item in report.results.components.items()
        for problem in _sizes(source, name, item)
    ]
    problems += [
        problem
        for i, group in enumerate(report.results.joint_pass_covariance)
        for problem in _group_problems(source, i, group, report.results.components)
    ]
    if problems:
        raise InputError(problems)
    return ComponentsReport(
        source=source,
        components=report.results.components,
        joint=tuple(report.results.joint_pass_covariance),
    )


def _problem(source: Source, item: Any) -> Problem:
    return Problem(
        what="is missing" if item["type"] == "missing" else str(item["msg"]).lower(),
        file=source.shown,
        path=".".join(str(part) for part in item["loc"]),
        value=None if item["type"] == "missing" else repr(item["input"]),
        expected="the report as `mtu fit-components` writes it",
    )


def _sizes(source: Source, name: str, item: ReportedComponent) -> list[Problem]:
    k = len(item.coefficients)
    q = min(2, k)
    wanted = [("covariance", item.covariance, k), ("pass_covariance", item.pass_covariance, q)]
    wanted.append(("pass_covariance_moment", item.pass_covariance_moment, q))
    if item.covariance_independent is not None:
        wanted.append(("covariance_independent", item.covariance_independent, k))
    problems = [
        Problem(
            what=f"{key} is not {size} x {size}",
            file=source.shown,
            path=f"results.components.{name}.{key}",
        )
        for key, matrix, size in wanted
        if not _square(matrix, size)
    ]
    problems += [
        Problem(
            what="a variance is negative",
            file=source.shown,
            path=f"results.components.{name}.{key}",
        )
        for key, matrix, size in wanted
        # The moment estimate is a difference of mean squares: negative where passes hardly differ.
        if key != "pass_covariance_moment" and _square(matrix, size) and _negative(matrix)
    ]
    if item.degree != k - 1:
        problems.append(
            Problem(
                what=f"{k} coefficients of a component of degree {item.degree}",
                file=source.shown,
                path=f"results.components.{name}.coefficients",
                expected=f"{item.degree + 1}",
            )
        )
    if item.unit not in UNITS:
        problems.append(
            Problem(
                what="unknown unit",
                file=source.shown,
                path=f"results.components.{name}.unit",
                value=item.unit,
                expected=", ".join(UNITS),
            )
        )
    return problems


def _group_problems(
    source: Source, i: int, group: ReportedGroup, known: dict[str, ReportedComponent]
) -> list[Problem]:
    path = f"results.joint_pass_covariance.{i}"
    unknown = [name for name in group.components if name not in known]
    widths = [len(known[name].coefficients) for name in group.components if name in known]
    size = sum(group.widths)
    problems = [
        Problem(
            what="not among results.components",
            file=source.shown,
            path=f"{path}.components",
            value=name,
        )
        for name in unknown
    ]
    if not unknown and group.widths != widths:
        problems.append(
            Problem(
                what="not the numbers of coefficients of the components",
                file=source.shown,
                path=f"{path}.widths",
                value=str(group.widths),
                expected=str(widths),
            )
        )
    for key in ("coefficient_covariance", "pass_covariance"):
        matrix = getattr(group, key)
        what = None if _square(matrix, size) else f"not {size} x {size}"
        if what is None and key == "coefficient_covariance" and _negative(matrix):
            what = "a variance is negative"
        if what is not None:
            problems.append(Problem(what=what, file=source.shown, path=f"{path}.{key}"))
    return problems


def _square(matrix: Matrix, size: int) -> bool:
    return len(matrix) == size and all(len(row) == size for row in matrix)


def _negative(matrix: Matrix) -> bool:
    return any(row[i] < 0 for i, row in enumerate(matrix))
