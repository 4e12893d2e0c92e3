"""The reports that a machine's model is taken from: those of fit-components and thermal-fit.

They are read as they are stated: in the component's unit, mm, degC and min. What a report holds
beyond these fields is ignored, so that reports of other versions are read too.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from math import isnan
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from mtu_cli.files.contract import Faults, check_contract, duplicates, too_large
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.json_file import read_json
from mtu_cli.files.machine import PASSES, covariance_fault
from mtu_cli.files.machine_contract import STEEPEST, SensorU, TimeConstant
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding, InputError, counted, error, finding
from mtu_cli.units import PARAMETER_UNITS, UNITS

COMPONENTS = "mtu/fit-components/1"
THERMAL = "mtu/thermal-fit/1"
DOUBTS = ("no-better", "not-held-out")
"""Warnings that a model carries along: nothing says that it holds for the next warm-up."""


def _or_nan(value: object) -> object:
    return math.nan if value is None else value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("a number of at least 0")
    return value


NonNegative = Annotated[float, Field(ge=0)]
Figure = Annotated[float, Field(strict=True, allow_inf_nan=True), BeforeValidator(_or_nan)]
"""A number; nan where the report says null, because the readings do not determine it."""
Deviation = Annotated[Figure, AfterValidator(_not_negative)]
Matrix = list[list[Figure]]


class _Reported(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class ReportedComponent(_Reported):
    """One entry of `results.components` of fit-components; in `unit` and mm."""

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
    run_covariance: list[list[float]] | None = None
    pass_center_mm: float
    pass_dof: NonNegative | None
    repeat_dof: NonNegative | None
    position_range_mm: tuple[float, float] | None


class ReportedGroup(_Reported):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    components: list[str]
    widths: list[int]
    coefficient_covariance: Matrix
    pass_covariance: Matrix
    half_difference_mean_square: list[list[float]] | None = None
    pass_dof: NonNegative
    n_passes: int | None


class ReportedEffects(_Reported):
    """`results.effects`: parameters of a machine's effects, each in its own unit, together.

    `parameters` are named ``effect.parameter``; `covariance` is over all of them in order.
    """

    parameters: list[str]
    units: list[str]
    values: list[float]
    covariance: list[list[float]]


class ReportedDrift(_Reported):
    """One entry of `results.components` of thermal-fit; in `unit`, mm, degC and min.

    `coefficients` (degree + 1, sensors), `covariance` over them, powers first. Degrees of
    freedom that are None are infinite.
    """

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


class _Components(_Reported):
    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = []
    effects: ReportedEffects | None = None


class _Fit(_Reported):
    results: _Components


class _Warning(_Reported):
    code: str
    message: str
    facts: dict[str, Any] = {}


class _Drifts(_Reported):
    components: dict[str, ReportedDrift]


class _ThermalFit(_Reported):
    results: _Drifts
    warnings: list[_Warning] = []


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalReport:
    """A checked thermal-fit report; `doubts` are those of its warnings that its user needs,
    `readings` the hashes of the files that it was fitted to.
    """

    source: Source
    components: dict[str, ReportedDrift]
    doubts: tuple[Finding, ...] = ()
    readings: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelReports:
    """At most one report of each kind."""

    components: ComponentsReport | None = None
    thermal: ThermalReport | None = None

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files that were read."""
        return tuple(item.source for item in (self.components, self.thermal) if item is not None)


def read_components(path: Path) -> ComponentsReport:
    """Reads a fit-components report.

    Raises InputError for a file that is not one, with the path inside the document.
    """
    return components_from(*read_json(path, "components"))


def read_report(path: Path) -> ComponentsReport | ThermalReport:
    """Reads a fit-components or a thermal-fit report, whichever it is.

    Raises InputError for a file that is neither, or a faulty one.
    """
    source, document = read_json(path, "components")
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema == THERMAL:
        return thermal_from(replace(source, role="thermal"), document)
    if schema == COMPONENTS:
        return components_from(source, document)
    expected = (
        f"{COMPONENTS!r} or {THERMAL!r}, as `mtu fit-components -o FILE.json` or "
        "`mtu thermal-fit -o FILE.json` writes it"
    )
    place = {} if schema is None else {"path": "schema", "value": str(schema)}
    kind = "a components report"
    raise error("other-kind", kind=kind, file=source.shown, expected=expected, **place)


def read_reports(paths: Iterable[Path]) -> ModelReports:
    """Reads all reports of a call.

    Raises InputError with the faults of all files, and for a second report of a kind.
    """
    findings: list[Finding] = []
    found = ModelReports()
    for path in paths:
        try:
            report = read_report(path)
        except InputError as fault:
            findings += fault.findings
            continue
        key = "components" if isinstance(report, ComponentsReport) else "thermal"
        if (earlier := getattr(found, key)) is not None:
            place = {"file": report.source.shown, "expected": "at most one of each kind"}
            kind = {"components": "fit-components", "thermal": "thermal-fit"}[key]
            findings.append(
                finding("second-report", kind=kind, other=earlier.source.shown, **place)
            )
        if isinstance(report, ComponentsReport):
            found = replace(found, components=report)
        else:
            found = replace(found, thermal=report)
    if findings:
        raise InputError(findings)
    return found


M = TypeVar("M", bound=BaseModel)


def _checked(source: Source, document: Any, model: type[M], kind: str, check: Any) -> M:
    """A report as its `model`; `check(results, faults)` sees it where its shape is sound."""

    def sound(report: Any, faults: Faults) -> None:
        if faults.findings:
            return
        for path, value, most in too_large(report.model_dump()):
            faults.add(path, "too-large", value=value, expected=f"at most {most:g} in size")
        if not faults.findings:
            check(report.results, faults)

    # JSON has no lines: the path tells the place.
    plain = YamlDocument(source=source, data=document, lines={})
    return check_contract(plain, model, kind, sound, largest=math.inf)


def _read_from(document: Any, roles: Collection[str]) -> frozenset[str]:
    """The hashes of the readings that a report was made from, as far as it states them."""
    found = document.get("inputs")
    entries = [item for item in found if isinstance(item, dict)] if type(found) is list else []
    return frozenset(str(item.get("sha256")) for item in entries if item.get("role") in roles)


def components_from(source: Source, document: Any) -> ComponentsReport:
    """Checks a fit-components report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    report = _checked(source, document, _Fit, "fit-components", _check_components)
    return ComponentsReport(
        source=source,
        components=report.results.components,
        joint=tuple(report.results.joint_pass_covariance),
        effects=report.results.effects,
        document=document,
        readings=_read_from(document, ("lbb", "laser")),
    )


def thermal_from(source: Source, document: Any) -> ThermalReport:
    """Checks a thermal-fit report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    report = _checked(source, document, _ThermalFit, "thermal-fit", _check_drifts)
    names: dict[tuple[str, str], list[str]] = {}
    for item in report.warnings:
        if item.code in DOUBTS:
            # Reports of version 0.1 have no facts: "name: text".
            name = str(item.facts.get("component") or item.message.partition(": ")[0])
            text = item.message.removeprefix(f"{name}: ")
            names.setdefault((item.code, text), []).append(name)
    doubts = [
        finding(
            "unconfirmed-drift",
            components=list(dict.fromkeys(found)),
            reported=text,
            reported_code=code,
            file=source.shown,
        )
        for (code, text), found in names.items()
    ]
    return ThermalReport(
        source=source,
        components=report.results.components,
        doubts=tuple(doubts),
        readings=_read_from(document, ("drift",)),
    )


def _check_components(results: _Components, faults: Faults) -> None:
    for name, item in results.components.items():
        _check_component(item, ("results", "components", name), faults)
    for index, group in enumerate(results.joint_pass_covariance):
        path = ("results", "joint_pass_covariance", index)
        _check_group(group, results.components, path, faults)
    if results.effects is not None:
        _check_effects(results.effects, ("results", "effects"), faults)


def _check_unit(unit: str, known: Collection[str], path: YamlPath, faults: Faults) -> None:
    if unit not in known:
        faults.add(path, "unknown-name", what="unit", value=unit, expected=", ".join(known))


def _check_matrix(
    matrix: Sequence[Sequence[float]] | None,
    size: int,
    path: YamlPath,
    faults: Faults,
    *,
    difference: bool = False,
) -> bool:
    """Whether a matrix can be a covariance, or is not given."""
    reason = None if matrix is None else covariance_fault(matrix, size, difference=difference)
    if reason is not None:
        faults.add(path, "not-a-covariance", reason=reason)
    return reason is None


def _estimated(matrix: Matrix) -> bool:
    """Whether a covariance is not 0 throughout: nan counts as estimated."""
    return any(map(any, matrix))


def _check_component(item: ReportedComponent, path: YamlPath, faults: Faults) -> None:
    """Sizes, covariances, degrees of freedom and the unit of a component."""
    k = len(item.coefficients)
    q = min(2, k)
    # Differences of mean squares: negative where passes, or runs, hardly differ.
    for key, size, difference in (
        ("covariance", k, False), ("covariance_independent", k, False),
        ("pass_covariance", q, False), ("pass_covariance_moment", q, True),
        ("half_difference_mean_square", q, False), ("run_covariance", q, True),
    ):  # fmt: skip
        _check_matrix(getattr(item, key), size, (*path, key), faults, difference=difference)
    # A fit of as many readings as coefficients tells neither a covariance nor a repeatability; any
    # other tells all of both.
    unknown = [
        (i, j) for i, row in enumerate(item.covariance) for j, v in enumerate(row) if isnan(v)
    ]
    if len(unknown) < sum(map(len, item.covariance)):
        for i, j in unknown[:1]:
            faults.add((*path, "covariance", i, j), "no-value", expected="a number")
        if isnan(item.s_repeat):
            faults.add((*path, "s_repeat"), "no-value", expected="a number")
    # pass_dof 0 alone says that one mean square stands behind all, with `repeat_dof`.
    one_square = item.pass_dof == 0 and _estimated(item.covariance)
    _check_dof(item.pass_dof, _estimated(item.pass_covariance), PASSES, path, "pass_dof", faults)
    repeat = item.s_repeat > 0 or one_square
    _check_dof(item.repeat_dof, repeat, "a repeatability", path, "repeat_dof", faults)
    if item.degree != k - 1:
        found = f"{counted(k, 'coefficient')} of a component of degree {item.degree}"
        own = (*path, "coefficients")
        faults.add(own, "wrong-count", found=found, expected=f"{item.degree + 1}")
    _check_unit(item.unit, UNITS, (*path, "unit"), faults)


def _check_dof(
    dof: float | None, estimated: bool, what: str, path: YamlPath, key: str, faults: Faults
) -> None:
    if dof == 0 and estimated:
        expected = "more than 0, or null: known exactly"
        faults.add((*path, key), "without-dof", value=0, what=what, expected=expected)


def _check_group(
    group: ReportedGroup, known: dict[str, ReportedComponent], path: YamlPath, faults: Faults
) -> None:
    """The matrices of components that were fitted together."""
    unknown = [name for name in group.components if name not in known]
    for name in unknown:
        faults.unknown((*path, "components"), name, known.keys(), "component")
    widths = [len(known[name].coefficients) for name in group.components if name in known]
    if not unknown and group.widths != widths:
        faults.add((*path, "widths"), "wrong-value", value=group.widths, expected=str(widths))
    if unknown or group.widths != widths:
        return
    matrices = (group.pass_covariance, group.coefficient_covariance)
    _check_dof(group.pass_dof, any(map(_estimated, matrices)), PASSES, path, "pass_dof", faults)
    # Of as many readings as coefficients nobody can tell a covariance, but of passes everybody can.
    bare = [any(map(isnan, chain(*known[name].covariance))) for name in group.components]
    lacks = [own for own, width in zip(bare, widths, strict=True) for _ in range(width)]
    size = sum(widths)
    for key in ("coefficient_covariance", "pass_covariance"):
        matrix, passes = getattr(group, key), key == "pass_covariance"
        if not _check_matrix(matrix, size, (*path, key), faults, difference=passes):
            continue
        open_entries = (
            (i, j)
            for i, row in enumerate(matrix)
            for j, value in enumerate(row)
            if isnan(value) and (passes or not (lacks[i] or lacks[j]))
        )
        if (first := next(open_entries, None)) is not None:
            faults.add((*path, key, *first), "no-value", expected="a number")
    halves = "half_difference_mean_square"
    _check_matrix(group.half_difference_mean_square, size, (*path, halves), faults)


def _check_effects(effects: ReportedEffects, path: YamlPath, faults: Faults) -> None:
    size = len(effects.parameters)
    for key, values in (("units", effects.units), ("values", effects.values)):
        if len(values) != size:
            entries = counted(len(values), "entry", "entries")
            found = f"{entries} for {counted(size, 'parameter')}"
            faults.add((*path, key), "wrong-count", found=found)
    for index, name, _ in duplicates(enumerate(effects.parameters)):
        own = (*path, "parameters", index)
        faults.add(own, "appears-twice", value=name, what="the parameter")
    for index, unit in enumerate(effects.units):
        _check_unit(unit, PARAMETER_UNITS, (*path, "units", index), faults)
    _check_matrix(effects.covariance, size, (*path, "covariance"), faults)


def _check_drifts(results: _Drifts, faults: Faults) -> None:
    for name, item in results.components.items():
        _check_drift(item, ("results", "components", name), faults)


def _check_drift(item: ReportedDrift, path: YamlPath, faults: Faults) -> None:
    """Unit, sensors, sizes, covariances and degrees of freedom of a drift."""
    _check_unit(item.unit, UNITS, (*path, "unit"), faults)
    for index, sensor, _ in duplicates(enumerate(item.sensors)):
        own = (*path, "sensors", index)
        faults.add(own, "appears-twice", value=sensor, what="the sensor")
    for index, sensor in enumerate(item.sensors):
        if not is_temperature(sensor):
            expected = "T_<sensor>_degC, the column of its readings"
            own = (*path, "sensors", index)
            faults.add(own, "not-a-temperature", value=sensor, expected=expected)
    sensors, powers = len(item.sensors), item.degree + 1
    for key in ("time_constants_min", "sensor_u_degC", "temperature_range_degC"):
        values = getattr(item, key)
        if values is not None and len(values) != sensors:
            entries = counted(len(values), "entry", "entries")
            found = f"{entries} for {counted(sensors, 'sensor')}"
            faults.add((*path, key), "wrong-count", found=found)
    rows = len(item.coefficients)
    if rows != powers:
        found = f"{counted(rows, 'row')} of coefficients of a drift of degree {item.degree}"
        faults.add((*path, "coefficients"), "wrong-count", found=found, expected=f"{powers}")
    for index, row in enumerate(item.coefficients):
        if len(row) != sensors:
            found = f"{counted(len(row), 'coefficient')} for {counted(sensors, 'sensor')}"
            faults.add((*path, "coefficients", index), "wrong-count", found=found)
    if item.of is None and item.degree > 0:
        own = (*path, "degree")
        expected = "0, or the axis as `of`"
        faults.add(own, "without-axis", value=item.degree, what="a degree", expected=expected)
    for key, size, dof, what in (
        ("covariance", powers * sensors, "coefficient_dof", "a covariance"),
        ("leftover_covariance", powers, "leftover_dof", "a covariance of what is left"),
    ):
        matrix = getattr(item, key)
        if any(map(isnan, chain(*matrix))):
            expected = "more readings or cycles"
            faults.add((*path, key), "not-determined", expected=expected)
        else:
            _check_matrix(matrix, size, (*path, key), faults)
        _check_dof(getattr(item, dof), _estimated(matrix), what, path, dof, faults)
