"""The reports that a machine's model is taken from: those of fit-components and thermal-fit.

They are read as they are stated: in the component's unit, mm, degC and min. What a report holds
beyond these fields is ignored, so that reports of other versions are read too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import isnan
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from mtu_cli.files.contract import Faults, NonNegative, Number, check_contract, sized
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.json_file import read_json
from mtu_cli.files.machine import covariance_fault
from mtu_cli.files.machine_contract import (
    STEEPEST,
    SensorU,
    TimeConstant,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.findings import Finding, InputError, counted, error, finding
from mtu_cli.units import PARAMETER_UNITS, UNITS

COMPONENTS = "mtu/fit-components/1"
THERMAL = "mtu/thermal-fit/1"
DOUBTS = ("no-better", "not-held-out")
"""Warnings that a model carries along: nothing says that it holds for the next warm-up."""


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("a number of at least 0")
    return value


Figure = Annotated[
    float,
    Field(strict=True, allow_inf_nan=True),
    BeforeValidator(lambda value: math.nan if value is None else value),
    AfterValidator(sized),
]
"""A number; nan where the report says null, because the readings do not determine it."""
Matrix = list[list[Figure]]
Shape = tuple[int, ...]


class _Reported(BaseModel):
    """A part of a report, with what its values ask of one another.

    The `shapes` of lists and covariances; the texts `known` of a unit, or a list of them; which
    lists of `names` hold each name once; which matrices are `differences` of mean squares, negative
    where passes, or runs, hardly differ; and whether something was `estimated` with each of its
    degrees of freedom, which then are not 0.
    """

    known: ClassVar[Mapping[str, Collection[str]]] = {}
    names: ClassVar[tuple[str, ...]] = ()
    differences: ClassVar[tuple[str, ...]] = ()
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    def shapes(self) -> dict[str, Shape]:
        return {}

    def estimated(self) -> dict[str, bool]:
        return {}


class ReportedComponent(_Reported):
    """One entry of `results.components` of fit-components; in `unit` and mm."""

    known = {"unit": UNITS}
    differences = ("pass_covariance_moment", "run_covariance")
    of: str | None
    unit: str
    degree: int = Field(ge=0)
    n_passes: int | None
    coefficients: list[Number] = Field(min_length=1)
    covariance: Matrix
    covariance_independent: Matrix | None
    s: NonNegative | None
    s_repeat: Annotated[Figure, AfterValidator(_not_negative)]
    pass_covariance: Matrix
    pass_covariance_moment: Matrix
    half_difference_mean_square: list[list[Number]] | None = None
    run_covariance: list[list[Number]] | None = None
    pass_center_mm: Number
    pass_dof: NonNegative | None
    repeat_dof: NonNegative | None
    position_range_mm: tuple[Number, Number] | None

    def shapes(self) -> dict[str, Shape]:
        k = len(self.coefficients)
        whole = dict.fromkeys(("covariance", "covariance_independent"), (k, k))
        linear = ("pass_covariance", "half_difference_mean_square", *self.differences)
        passes = dict.fromkeys(linear, (min(2, k), min(2, k)))
        return {"coefficients": (self.degree + 1,), **whole, **passes}

    def estimated(self) -> dict[str, bool]:
        # pass_dof 0 alone says that one mean square stands behind all, with `repeat_dof`.
        one_square = self.pass_dof == 0 and _any(self.covariance)
        repeat = self.s_repeat > 0 or one_square
        return {"pass_dof": _any(self.pass_covariance), "repeat_dof": repeat}


class ReportedGroup(_Reported):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    differences = ("pass_covariance",)
    components: list[str]
    widths: list[int]
    coefficient_covariance: Matrix
    pass_covariance: Matrix
    half_difference_mean_square: list[list[Number]] | None = None
    pass_dof: NonNegative
    n_passes: int | None

    def shapes(self) -> dict[str, Shape]:
        keys = ("coefficient_covariance", "pass_covariance", "half_difference_mean_square")
        return dict.fromkeys(keys, (sum(self.widths), sum(self.widths)))

    def estimated(self) -> dict[str, bool]:
        return {"pass_dof": _any(self.pass_covariance) or _any(self.coefficient_covariance)}


class ReportedEffects(_Reported):
    """`results.effects`: parameters of a machine's effects, each in its own unit, together.

    `parameters` are named ``effect.parameter``; `covariance` is over all of them in order.
    """

    known = {"units": PARAMETER_UNITS}
    names = ("parameters",)
    parameters: list[str]
    units: list[str]
    values: list[Number]
    covariance: list[list[Number]]

    def shapes(self) -> dict[str, Shape]:
        n = len(self.parameters)
        return {"units": (n,), "values": (n,), "covariance": (n, n)}


class ReportedDrift(_Reported):
    """One entry of `results.components` of thermal-fit; in `unit`, mm, degC and min.

    `coefficients` (degree + 1, sensors), `covariance` over them, powers first. Degrees of
    freedom that are None are infinite.
    """

    known = {"unit": UNITS}
    names = ("sensors",)
    of: Literal["x", "y", "z"] | None
    unit: str
    degree: int = Field(ge=0)
    sensors: list[str]
    reference_temperature_degC: Number  # noqa: N815  # unit
    time_constants_min: list[TimeConstant]
    coefficients: list[list[Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]]]
    covariance: Matrix
    coefficient_dof: NonNegative | None
    leftover_covariance: Matrix
    leftover_dof: NonNegative | None
    sensor_u_degC: list[SensorU]  # noqa: N815  # unit
    temperature_range_degC: list[tuple[Number, Number]] | None  # noqa: N815  # unit
    position_range_mm: tuple[Number, Number] | None

    def shapes(self) -> dict[str, Shape]:
        powers, sensors = self.degree + 1, len(self.sensors)
        per_sensor = ("time_constants_min", "sensor_u_degC", "temperature_range_degC")
        return {
            "coefficients": (powers, sensors),
            "covariance": (powers * sensors, powers * sensors),
            "leftover_covariance": (powers, powers),
            **dict.fromkeys(per_sensor, (sensors,)),
        }

    def estimated(self) -> dict[str, bool]:
        left = _any(self.leftover_covariance)
        return {"coefficient_dof": _any(self.covariance), "leftover_dof": left}


class _Components(_Reported):
    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = []
    effects: ReportedEffects | None = None


class _Drifts(_Reported):
    components: dict[str, ReportedDrift]


class _Warning(_Reported):
    code: str
    message: str
    facts: dict[str, Any] = {}


class _Fit(_Reported):
    results: _Components


class _ThermalFit(_Reported):
    results: _Drifts
    warnings: list[_Warning] = []


R = TypeVar("R", _Fit, _ThermalFit)


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
    facts = {"kind": "a components report", "expected": expected}
    raise error("wrong-type", file=source.shown, **facts, **place)


def read_reports(paths: Iterable[Path]) -> ModelReports:
    """Reads all reports of a call.

    Raises InputError with the faults of all files, and for a second report of a kind.
    """
    findings: list[Finding] = []
    reports: dict[str, Any] = {}
    for path in paths:
        try:
            report = read_report(path)
        except InputError as fault:
            findings += fault.findings
            continue
        kind = "components" if isinstance(report, ComponentsReport) else "thermal"
        first = reports.setdefault(kind, report)
        if first is not report:
            names = [first.source.shown, report.source.shown]
            expected = f"one {kind} report at most"
            facts = {"names": names, "expected": expected}
            findings.append(finding("exclusive", file=report.source.shown, **facts))
    if findings:
        raise InputError(findings)
    return ModelReports(**reports)


def components_from(source: Source, document: Any) -> ComponentsReport:
    """Checks a fit-components report that was read, or made, already.

    Raises InputError with every fault of the document.
    """
    results = _checked(source, document, _Fit, "fit-components", _check_components).results
    return ComponentsReport(
        source=source,
        components=results.components,
        joint=tuple(results.joint_pass_covariance),
        effects=results.effects,
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
    doubts = []
    for (code, text), doubted in names.items():
        facts = {"components": list(dict.fromkeys(doubted)), "reported": text}
        doubts.append(finding("unconfirmed-drift", **facts, reported_code=code, file=source.shown))
    return ThermalReport(
        source=source,
        components=report.results.components,
        doubts=tuple(doubts),
        readings=_read_from(document, ("drift",)),
    )


def _read_from(document: Any, roles: Collection[str]) -> frozenset[str]:
    """The hashes of the readings that a report was made from, as far as it states them."""
    inputs = document.get("inputs")
    entries = [item for item in inputs if isinstance(item, dict)] if type(inputs) is list else []
    return frozenset(str(item.get("sha256")) for item in entries if item.get("role") in roles)


def _checked(
    source: Source, document: Any, model: type[R], kind: str, check: Callable[[R, Faults], None]
) -> R:
    """A report as its `model`; `check(report, faults)` sees it where its shape is sound."""

    def sound(report: R, faults: Faults) -> None:
        if not faults.findings:
            check(report, faults)

    # JSON has no lines: the path tells the place.
    plain = YamlDocument(source=source, data=document, lines={})
    return check_contract(plain, model, kind, sound)


def _check_entry(item: _Reported, path: YamlPath, faults: Faults) -> bool:
    """Shapes, covariances and degrees of freedom of a part of a report; whether these are sound."""
    before = len(faults.findings)
    for key, known in item.known.items():
        value = getattr(item, key)
        for i, unit in enumerate([value] if isinstance(value, str) else value):
            if unit not in known:
                at = (*path, key) if unit is value else (*path, key, i)
                faults.unknown(at, unit, known, "unit")
    for key in item.names:
        faults.once((*path, key), enumerate(getattr(item, key)), "the name")
    for key, (size, *width) in item.shapes().items():
        values, place = getattr(item, key), (*path, key)
        if values is None:
            continue
        if width and key != "coefficients":
            reason = covariance_fault(values, size, difference=key in item.differences)
            if reason is not None:
                faults.add(place, "wrong-correlation", reason=reason)
            continue
        rows = [((*place, i), row, width[0]) for i, row in enumerate(values) if width]
        for at, entries, wanted in [(place, values, size), *rows]:
            if len(entries) != wanted:
                count = counted(len(entries), "entry", "entries")
                faults.add(at, "wrong-count", found=count, expected=f"{wanted}")
    for key, estimated in item.estimated().items():
        if estimated and getattr(item, key) == 0:
            facts = {"what": "an estimate", "other": "degrees of freedom"}
            expected = "more than 0, or null: known exactly"
            faults.add((*path, key), "incomplete", value=0, expected=expected, **facts)
    return len(faults.findings) == before


def _any(matrix: Matrix) -> bool:
    """Whether a covariance is not 0 throughout: nan counts as estimated."""
    return any(map(any, matrix))


def _unknown(matrix: Matrix) -> list[tuple[int, int]]:
    """The places of a matrix that the readings do not determine."""
    return [(i, j) for i, row in enumerate(matrix) for j, v in enumerate(row) if isnan(v)]


def _check_components(report: _Fit, faults: Faults) -> None:
    results = report.results
    for name, item in results.components.items():
        path: YamlPath = ("results", "components", name)
        _check_entry(item, path, faults)
        # A fit of as many readings as coefficients tells neither a covariance nor a repeatability;
        # any other tells all of both.
        unknown = _unknown(item.covariance)
        if len(unknown) < sum(map(len, item.covariance)):
            places = [("covariance", *at) for at in unknown[:1]]
            for place in [*places, *([("s_repeat",)] if isnan(item.s_repeat) else [])]:
                faults.add((*path, *place), "missing-input", what="a number")
    for index, group in enumerate(results.joint_pass_covariance):
        path = ("results", "joint_pass_covariance", index)
        _check_group(group, results.components, path, faults)
    if results.effects is not None:
        _check_entry(results.effects, ("results", "effects"), faults)


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
    if unknown or group.widths != widths or not _check_entry(group, path, faults):
        return
    # Of as many readings as coefficients nobody can tell a covariance, but of passes everybody can.
    bare = [bool(_unknown(known[name].covariance)) for name in group.components]
    lacks = [each for each, width in zip(bare, widths, strict=True) for _ in range(width)]
    places = [("pass_covariance", i, j) for i, j in _unknown(group.pass_covariance)]
    places += [
        ("coefficient_covariance", i, j)
        for i, j in _unknown(group.coefficient_covariance)
        if not (lacks[i] or lacks[j])
    ]
    for place in places[:1]:
        faults.add((*path, *place), "missing-input", what="a number")


def _check_drifts(report: _ThermalFit, faults: Faults) -> None:
    for name, item in report.results.components.items():
        path: YamlPath = ("results", "components", name)
        for i, sensor in enumerate(item.sensors):
            if not is_temperature(sensor):
                facts = {"kind": "the name of a temperature", "expected": "T_<sensor>_degC"}
                faults.add((*path, "sensors", i), "wrong-type", value=sensor, **facts)
        unknown = [k for k in ("covariance", "leftover_covariance") if _unknown(getattr(item, k))]
        for key in unknown:
            facts = {"what": "the readings do not determine it"}
            expected = "more readings or cycles"
            faults.add((*path, key), "too-little-data", expected=expected, **facts)
        if not unknown:
            _check_entry(item, path, faults)
        if item.of is None and item.degree > 0:
            facts = {"what": "a degree", "other": "`of`", "expected": "0, or the axis as `of`"}
            faults.add((*path, "degree"), "incomplete", value=item.degree, **facts)
