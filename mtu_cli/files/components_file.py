"""The report of fit-components, read back by every command that predicts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.files.json_file import read_json
from mtu_cli.files.source import Source
from mtu_cli.units import UNITS

SCHEMA = "mtu/fit-components/1"
Matrix = list[list[float]]


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
    s: float | None
    s_repeat: float
    pass_covariance: Matrix
    pass_covariance_moment: Matrix
    pass_center_mm: float
    pass_dof: float | None
    repeat_dof: float | None
    position_range_mm: tuple[float, float] | None


class ReportedGroup(BaseModel):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    components: list[str]
    widths: list[int]
    coefficient_covariance: Matrix
    pass_covariance: Matrix
    pass_dof: float
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
    source, document = read_json(path, "components")
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
        for problem in _group_sizes(source, i, group)
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
        what=str(item["msg"]).lower(),
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


def _group_sizes(source: Source, i: int, group: ReportedGroup) -> list[Problem]:
    size = sum(group.widths)
    good = len(group.widths) == len(group.components)
    good = good and _square(group.coefficient_covariance, size)
    if good and _square(group.pass_covariance, size):
        return []
    return [
        Problem(
            what=f"the matrices are not {size} x {size}",
            file=source.shown,
            path=f"results.joint_pass_covariance.{i}",
        )
    ]


def _square(matrix: Matrix, size: int) -> bool:
    return len(matrix) == size and all(len(row) == size for row in matrix)
