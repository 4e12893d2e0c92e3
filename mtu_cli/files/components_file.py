"""The report of fit-components, read back by every command that predicts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mtu_cli.errors import InputError, Problem, counted
from mtu_cli.files.covariance import covariance_fault
from mtu_cli.files.json_file import read_json
from mtu_cli.files.machine_checks import PASSES
from mtu_cli.files.report_file import (
    Figure,
    Matrix,
    NonNegative,
    any_estimated,
    no_dof,
    not_a_report,
    read_from,
    schema_of,
    unit_problem,
    validated,
)
from mtu_cli.files.source import Source
from mtu_cli.units import PARAMETER_UNITS

SCHEMA = "mtu/fit-components/1"


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("should not be negative")
    return value


Deviation = Annotated[Figure, AfterValidator(_not_negative)]


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
    half_difference_mean_square: list[list[float]] | None = None
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
    half_difference_mean_square: list[list[float]] | None = None
    pass_dof: NonNegative
    n_passes: int | None


class ReportedEffects(BaseModel):
    """`results.effects`: parameters of a machine's effects, each in its own unit, together.

    `parameters` are named ``effect.parameter``; `covariance` is over all of them in order.
    """

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    parameters: list[str]
    units: list[str]
    values: list[float]
    covariance: list[list[float]]


class _Results(BaseModel):
    model_config = ConfigDict(extra="ignore")
    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = []
    effects: ReportedEffects | None = None


class _Report(BaseModel):
    model_config = ConfigDict(extra="ignore")
    results: _Results


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentsReport:
    """A checked fit-components report; `document` is the whole of it as it was read, `readings`
    the hashes of the files that it was fitted to.
    """

    source: Source
    components: dict[str, ReportedComponent]
    joint: tuple[ReportedGroup, ...]
    effects: ReportedEffects | None = None
    document: dict[str, Any] = field(default_factory=dict)
    readings: frozenset[str] = frozenset()


def read_components(path: Path) -> ComponentsReport:
    """Reads a fit-components report.

    Raises InputError for a file that is not one, with the path inside the document.
    """
    return components_from(*read_json(path, "components"))


def components_from(source: Source, document: Any) -> ComponentsReport:
    """Checks a fit-components report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    if schema_of(document) != SCHEMA:
        expected = f"{SCHEMA!r}, as `mtu fit-components -o FILE.json` writes it"
        raise not_a_report(source, document, expected)
    report = validated(source, document, _Report, "fit-components")
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
    if report.results.effects is not None:
        problems += _effect_problems(source, report.results.effects)
    if problems:
        raise InputError(problems)
    return ComponentsReport(
        source=source,
        components=report.results.components,
        joint=tuple(report.results.joint_pass_covariance),
        effects=report.results.effects,
        document=document,
        readings=read_from(document, ("lbb", "laser")),
    )


def _sizes(source: Source, name: str, item: ReportedComponent) -> list[Problem]:
    k = len(item.coefficients)
    q = min(2, k)
    wanted = [("covariance", item.covariance, k), ("pass_covariance", item.pass_covariance, q)]
    wanted.append(("pass_covariance_moment", item.pass_covariance_moment, q))
    if item.covariance_independent is not None:
        wanted.append(("covariance_independent", item.covariance_independent, k))
    if item.half_difference_mean_square is not None:
        wanted.append(("half_difference_mean_square", item.half_difference_mean_square, q))
    problems = []
    for key, matrix, size in wanted:
        # The moment estimate is a difference of mean squares: negative where passes hardly differ.
        moment = key == "pass_covariance_moment"
        what = covariance_fault(matrix, size, difference=moment)
        if what is not None:
            path = f"results.components.{name}.{key}"
            problems.append(Problem(what=what, file=source.shown, path=path))
    problems += _without_dof(source, name, item)
    if item.degree != k - 1:
        problems.append(
            Problem(
                what=f"{counted(k, 'coefficient')} of a component of degree {item.degree}",
                file=source.shown,
                path=f"results.components.{name}.coefficients",
                expected=f"{item.degree + 1}",
            )
        )
    return problems + unit_problem(source, name, item.unit)


def _without_dof(source: Source, name: str, item: ReportedComponent) -> Iterator[Problem]:
    """Of `pass_dof` and `repeat_dof`: 0 where something was estimated with it.

    pass_dof 0 alone says that one mean square stands behind all, with `repeat_dof`.
    """
    one_square = item.pass_dof == 0 and any_estimated(item.covariance)
    for key, value, what, estimated in (
        ("pass_dof", item.pass_dof, PASSES, any_estimated(item.pass_covariance)),
        ("repeat_dof", item.repeat_dof, "a repeatability", item.s_repeat > 0 or one_square),
    ):
        if value == 0 and estimated:
            yield no_dof(source, f"results.components.{name}.{key}", what)


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
    matrices = (group.pass_covariance, group.coefficient_covariance)
    if group.pass_dof == 0 and any(map(any_estimated, matrices)):
        problems.append(no_dof(source, f"{path}.pass_dof", PASSES, known=False))
    for key in ("coefficient_covariance", "pass_covariance", "half_difference_mean_square"):
        matrix = getattr(group, key)
        if matrix is None:
            continue
        what = covariance_fault(matrix, size, difference=key == "pass_covariance")
        if what is None and key == "pass_covariance" and any(map(math.isnan, chain(*matrix))):
            # Of components that were fitted together all passes are known.
            what = "an entry is not known"
        if what is not None:
            problems.append(Problem(what=what, file=source.shown, path=f"{path}.{key}"))
    return problems


def _effect_problems(source: Source, effects: ReportedEffects) -> list[Problem]:
    path = "results.effects"
    size = len(effects.parameters)
    problems = [
        Problem(
            what=f"{counted(len(values), 'entry', 'entries')} for {counted(size, 'parameter')}",
            file=source.shown,
            path=f"{path}.{key}",
        )
        for key, values in (("units", effects.units), ("values", effects.values))
        if len(values) != size
    ]
    if len(set(effects.parameters)) < size:
        problems.append(
            Problem(what="a parameter twice", file=source.shown, path=f"{path}.parameters")
        )
    problems += [
        Problem(
            what="unknown unit",
            file=source.shown,
            path=f"{path}.units",
            value=unit,
            expected=", ".join(PARAMETER_UNITS),
        )
        for unit in effects.units
        if unit not in PARAMETER_UNITS
    ]
    what = covariance_fault(effects.covariance, size)
    if what is not None:
        problems.append(Problem(what=what, file=source.shown, path=f"{path}.covariance"))
    return problems
