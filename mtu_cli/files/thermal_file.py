"""The report of thermal-fit, read back by every command that predicts or corrects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from mtu_cli.errors import InputError, Notice, Problem, counted
from mtu_cli.files.contracts import duplicates
from mtu_cli.files.covariance import covariance_fault
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.report_file import (
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
from mtu_cli.files.thermal_contract import STEEPEST, SensorU, TimeConstant
from mtu_cli.findings import Finding

SCHEMA = "mtu/thermal-fit/1"
DOUBTS = ("no-better", "not-held-out")
"""Warnings that a model carries along: nothing says that it holds for the next warm-up."""


class ReportedDrift(BaseModel):
    """One entry of `results.components`; in `unit`, mm, degC and min, as the report states them.

    `coefficients` (degree + 1, sensors), `covariance` over them, powers first. Degrees of
    freedom that are None are infinite.
    """

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    of: Literal["x", "y", "z"] | None
    unit: str
    degree: int = Field(ge=0)
    sensors: list[str]
    reference_temperature_degC: float  # noqa: N815  # unit
    time_constants_min: list[TimeConstant]
    coefficients: list[list[Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]]]
    covariance: Matrix
    coefficient_dof: NonNegative | None
    leftover_covariance: Matrix
    leftover_dof: NonNegative | None
    sensor_u_degC: list[SensorU]  # noqa: N815  # unit
    temperature_range_degC: list[tuple[float, float]] | None  # noqa: N815  # unit
    position_range_mm: tuple[float, float] | None


class _Warning(BaseModel):
    model_config = ConfigDict(extra="ignore")
    code: str
    message: str


class _Results(BaseModel):
    model_config = ConfigDict(extra="ignore")
    components: dict[str, ReportedDrift]


class _Report(BaseModel):
    model_config = ConfigDict(extra="ignore")
    results: _Results
    warnings: list[_Warning] = []


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalReport:
    """A checked thermal-fit report; `doubts` are those of its warnings that who uses it needs,
    `readings` the hashes of the files that it was fitted to.
    """

    source: Source
    components: dict[str, ReportedDrift]
    doubts: tuple[Finding, ...] = ()
    readings: frozenset[str] = frozenset()


def thermal_from(source: Source, document: Any) -> ThermalReport:
    """Checks a thermal-fit report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    if schema_of(document) != SCHEMA:
        expected = f"{SCHEMA!r}, as `mtu thermal-fit -o FILE.json` writes it"
        raise not_a_report(source, document, expected)
    report = validated(source, document, _Report, "thermal-fit")
    components = report.results.components
    problems = [
        problem
        for name, item in components.items()
        for problem in (
            *unit_problem(source, name, item.unit),
            *_sensors(source, name, item),
            *_sizes(source, name, item),
            *_matrices(source, name, item),
            *_without_dof(source, name, item),
        )
    ]
    if problems:
        raise InputError(problems)
    return ThermalReport(
        source=source,
        components=components,
        doubts=_doubts(source, report.warnings),
        readings=read_from(document, ("drift",)),
    )


def _doubts(source: Source, warnings: list[_Warning]) -> tuple[Finding, ...]:
    """One a code and text, with the components that it is told of: "name: text" each."""
    names: dict[tuple[str, str], list[str]] = {}
    for item in warnings:
        if item.code in DOUBTS:
            name, _, text = item.message.partition(": ")
            names.setdefault((item.code, text), []).append(name)
    return tuple(
        Notice(code=code, message=f"{source.shown}: {', '.join(dict.fromkeys(found))}: {text}")
        for (code, text), found in names.items()
    )


def _problem(
    source: Source, name: str, key: str, what: str, *, value: str | None = None, expected: str = ""
) -> Finding:
    return Problem(
        what=what,
        file=source.shown,
        path=f"results.components.{name}.{key}",
        value=value,
        expected=expected or None,
    )


def _sensors(source: Source, name: str, item: ReportedDrift) -> list[Finding]:
    twice = [
        _problem(source, name, f"sensors.{index}", "the sensor stands twice", value=sensor)
        for index, sensor, _ in duplicates(enumerate(item.sensors))
    ]
    expected = "T_<sensor>_degC, the column of its readings"
    what = "not the name of a temperature"
    return twice + [
        _problem(source, name, f"sensors.{index}", what, value=sensor, expected=expected)
        for index, sensor in enumerate(item.sensors)
        if not is_temperature(sensor)
    ]


def _sizes(source: Source, name: str, item: ReportedDrift) -> list[Finding]:
    """Lists of one entry a sensor, and the rows and columns of the coefficients."""
    sensors = len(item.sensors)
    problems = []
    for key in ("time_constants_min", "sensor_u_degC", "temperature_range_degC"):
        values = getattr(item, key)
        if values is not None and len(values) != sensors:
            entries = counted(len(values), "entry", "entries")
            what = f"{entries} for {counted(sensors, 'sensor')}"
            problems.append(_problem(source, name, key, what))
    if len(item.coefficients) != item.degree + 1:
        rows = counted(len(item.coefficients), "row")
        what = f"{rows} of coefficients of a drift of degree {item.degree}"
        expected = f"{item.degree + 1}"
        problems.append(_problem(source, name, "coefficients", what, expected=expected))
    for index, row in enumerate(item.coefficients):
        if len(row) != sensors:
            what = f"{counted(len(row), 'coefficient')} for {counted(sensors, 'sensor')}"
            problems.append(_problem(source, name, f"coefficients.{index}", what))
    if item.of is None and item.degree > 0:
        expected = "0, or the axis as `of`"
        what = "a drift without `of` does not depend on position"
        value = str(item.degree)
        problems.append(_problem(source, name, "degree", what, value=value, expected=expected))
    return problems


def _without_dof(source: Source, name: str, item: ReportedDrift) -> Iterator[Finding]:
    for key, value, what, matrix in (
        ("coefficient_dof", item.coefficient_dof, "a covariance", item.covariance),
        ("leftover_dof", item.leftover_dof, "a covariance of what is left",
         item.leftover_covariance),
    ):  # fmt: skip
        if value == 0 and any_estimated(matrix):
            yield no_dof(source, f"results.components.{name}.{key}", what)


def _matrices(source: Source, name: str, item: ReportedDrift) -> list[Finding]:
    powers = item.degree + 1
    problems = []
    for key, matrix, size in (
        ("covariance", item.covariance, powers * len(item.sensors)),
        ("leftover_covariance", item.leftover_covariance, powers),
    ):
        if any(value != value for row in matrix for value in row):
            what = "null: the drift readings do not determine it"
            problems.append(_problem(source, name, key, what, expected="more readings or cycles"))
        elif fault := covariance_fault(matrix, size):
            problems.append(_problem(source, name, key, fault))
    return problems
