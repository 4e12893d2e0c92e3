"""The reports that a machine's model is taken from: those of fit-components and thermal-fit.

They are read as they are stated: in the component's unit, mm, degC and min. What a report holds
beyond these fields is ignored, so that reports of other versions are read too.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import isnan, nan
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from mtu_cli.files.contract import (
    SIZED,
    Contract,
    Faults,
    NonNegative,
    Number,
    check_contract,
    must,
    present,
)
from mtu_cli.files.machine import (
    AxisName,
    Gradient,
    ParameterUnitName,
    SensorU,
    TimeConstant,
    UnitName,
    covariance_fault,
)
from mtu_cli.files.source import Source, check_text, read_source
from mtu_cli.files.yaml_file import YamlDocument
from mtu_cli.findings import Finding, InputError, collected, error

MAX_BYTES = 1 << 30
_OR_NULL = BeforeValidator(lambda value: nan if value is None else value)
_STRICT = Field(strict=True, allow_inf_nan=True)
Figure = Annotated[float, _STRICT, _OR_NULL, SIZED]
"""A number; nan where the report says null, because the readings do not determine it."""
Deviation = Annotated[Figure, must(lambda x: not x < 0, "a number of at least 0")]
Matrix = list[list[Figure]]
Known = list[list[Number]]


class _Reported(Contract):
    """A part of a report."""

    model_config = ConfigDict(extra="ignore", strict=False)
    differences: ClassVar[tuple[str, ...]] = ()
    """Matrices that are differences of mean squares: they may be negative."""

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of lists (n,) and matrices (n, m)."""
        return {}

    def check(self, faults: Faults) -> None:
        """Adds lists of another shape, and covariances that are none."""
        for key, (size, *width) in self.shapes().items():
            values, here = getattr(self, key), faults.at(key)
            if values is None:
                continue
            square = "covariance" in key or "mean_square" in key
            if len(values) != size or any(len(row) not in width for row in values if width):
                shape = " x ".join(map(str, (size, *width)))
                here.add("wrong-count", found="another size", expected=shape)
            elif (
                square
                and key not in self.differences
                and not any(isnan(value) for row in values for value in row)
                and (reason := covariance_fault(values, size))
            ):
                here.add("wrong-correlation", reason=reason)


class ReportedComponent(_Reported):
    """One entry of `results.components` of fit-components; in `unit` and mm."""

    of: str | None
    unit: UnitName
    degree: int | None = Field(ge=0)
    shape: Literal["polynomial", "table"] = "polynomial"
    at_mm: list[Number] | None = None
    roughness_um2_per_mm3: NonNegative | None = None
    between_um2: NonNegative | None = None
    own_um2_per_mm3: NonNegative | None = None
    own_dof: NonNegative | None = None
    n_passes: int | None
    coefficients: list[Number] = Field(min_length=1)
    covariance: Matrix
    covariance_independent: Matrix | None
    s: NonNegative | None
    s_repeat: Deviation
    pass_covariance: Known
    pass_covariance_moment: Known
    half_difference_mean_square: Known | None = None
    run_covariance: Known | None = None
    pass_center_mm: Number
    pass_dof: NonNegative | None
    repeat_dof: NonNegative | None
    position_range_mm: tuple[Number, Number] | None

    differences = ("pass_covariance_moment", "run_covariance")

    def shapes(self) -> dict[str, tuple[int, ...]]:
        k = len(self.coefficients)
        of_passes = ("pass_covariance", *self.differences, "half_difference_mean_square")
        return {
            "coefficients": (len(self.at_mm or ()) if self.degree is None else self.degree + 1,),
            **dict.fromkeys(("covariance", "covariance_independent"), (k, k)),
            **dict.fromkeys(of_passes, (min(2, k), min(2, k))),
        }


class ReportedGroup(_Reported):
    """One entry of `results.joint_pass_covariance`; matrices over all coefficients."""

    components: list[str]
    widths: list[int]
    coefficient_covariance: Known
    pass_covariance: Known
    half_difference_mean_square: Known | None = None
    pass_dof: NonNegative
    n_passes: int | None

    differences = ("pass_covariance",)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        keys = ("coefficient_covariance", "pass_covariance", "half_difference_mean_square")
        return dict.fromkeys(keys, (sum(self.widths), sum(self.widths)))


class ReportedEffects(_Reported):
    """`results.effects`: parameters of a machine's effects, each in its own unit, together.

    `parameters` are named ``effect.parameter``; `covariance` is over all of them in order.
    """

    parameters: list[str]
    units: list[ParameterUnitName]
    values: list[Number]
    covariance: Known

    def shapes(self) -> dict[str, tuple[int, ...]]:
        n = len(self.parameters)
        return {"units": (n,), "values": (n,), "covariance": (n, n)}


class ReportedDrift(_Reported):
    """One entry of `results.components` of thermal-fit; in `unit`, mm, degC and min.

    `coefficients` (degree + 1, sensors), `covariance` over them, powers first. Degrees of
    freedom that are None are infinite.
    """

    of: AxisName | None
    unit: UnitName
    degree: int = Field(ge=0)
    sensors: list[str]
    reference_temperature_degC: Number  # noqa: N815  # unit
    time_constants_min: list[TimeConstant]
    coefficients: list[list[Gradient]]
    covariance: Known
    coefficient_dof: NonNegative | None
    leftover_covariance: Known
    leftover_dof: NonNegative | None
    sensor_u_degC: list[SensorU]  # noqa: N815  # unit
    temperature_range_degC: list[tuple[Number, Number]] | None  # noqa: N815  # unit
    position_range_mm: tuple[Number, Number] | None

    def shapes(self) -> dict[str, tuple[int, ...]]:
        powers, sensors = self.degree + 1, len(self.sensors)
        of_sensors = ("time_constants_min", "sensor_u_degC", "temperature_range_degC")
        return {
            "coefficients": (powers, sensors),
            "covariance": (powers * sensors, powers * sensors),
            "leftover_covariance": (powers, powers),
            **dict.fromkeys(of_sensors, (sensors,)),
        }


class _Results(_Reported):
    """The results of a checked report; `document` is the whole of it as it was read."""

    source: Any = None
    document: Any = None


class ComponentsReport(_Results):
    """A fit-components report."""

    components: dict[str, ReportedComponent]
    joint_pass_covariance: list[ReportedGroup] = Field(default=[])
    effects: ReportedEffects | None = None

    def check(self, faults: Faults) -> None:
        """Jointly fitted components are components of the report, with as many coefficients."""
        faulty = {*faults.at("components").keys()} - {*self.components}
        for i, group in present(self.joint_pass_covariance):
            if faulty & {*group.components}:
                continue
            items = [self.components[name] for name in group.components if name in self.components]
            widths = [len(item.coefficients) for item in items]
            if group.widths != widths or len(items) < len(group.components):
                expected = f"components of the report, whose widths are {widths}"
                here = faults.at("joint_pass_covariance", i)
                here.add("wrong-value", value=group.components, expected=expected)


class ThermalReport(_Results):
    """A thermal-fit report."""

    components: dict[str, ReportedDrift]


KINDS: dict[str, tuple[str, Any]] = {
    "fit-components": ("components", ComponentsReport),
    "thermal-fit": ("thermal", ThermalReport),
}
"""By command: the role of its report, and the contract of its results."""


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
    """Reads a fit-components or a thermal-fit report, whichever it is; see `report_from`."""
    return report_from(*read_json(path, "components"))


def report_from(source: Source, document: Any) -> Any:
    """Checks a report of one of KINDS that was read, or made, already.

    Raises InputError for a document that is none, or with every fault of it.
    """
    schema = document.get("schema") if isinstance(document, dict) else None
    kind = next((kind for kind in KINDS if schema == f"mtu/{kind}/1"), None)
    if kind is None:
        expected = "{!r} or {!r}, as `mtu {} -o FILE.json` or `mtu {} -o FILE.json` writes it"
        expected = expected.format(*(f"mtu/{name}/1" for name in KINDS), *KINDS)
        place = {} if schema is None else {"path": "schema", "value": str(schema)}
        facts = {"kind": "a components report", "expected": expected}
        raise error("wrong-type", file=source.shown, **facts, **place)
    role, contract = KINDS[kind]
    whole = YamlDocument(source=source, data=document)
    results = check_contract(whole, contract, kind, at=("results",))
    read = {"source": replace(source, role=role), "document": document}
    return results.model_copy(update=read)


def read_reports(paths: Iterable[Path]) -> ModelReports:
    """Reads all reports of a call.

    Raises InputError with the faults of all files, and for a second report of a kind.
    """
    findings, reports = list[Finding](), dict[str, Any]()
    for path in paths:
        with collected(findings.append):
            report = read_report(path)
            kind = report.source.role
            if (first := reports.setdefault(kind, report)) is not report:
                names = [first.source.shown, report.source.shown]
                facts = {"names": names, "expected": f"one {kind} report at most"}
                raise error("exclusive", file=report.source.shown, **facts)
    if findings:
        raise InputError(findings)
    return ModelReports(**reports)


def read_json(path: Path, role: str) -> tuple[Source, Any]:
    """The values of a JSON file.

    Raises InputError for a file that cannot be read (see `read_source`), text that is not
    JSON (with line and column).
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    text = content.decode("utf-8-sig")
    place: dict[str, Any] = {"file": source.shown}
    try:
        data = json.loads(text)
    except (RecursionError, ValueError) as fault:
        why = "no JSON: nested too deeply, or a number of too many digits"
        if isinstance(fault, json.JSONDecodeError):
            why = f"no JSON: {fault.msg.lower().removesuffix(' starting at')}"
            place |= {"line": fault.lineno, "column": fault.colno}
        expected = f"a {role} report, as -o FILE.json writes it"
        raise error("not-readable", reason=why, expected=expected, **place) from None
    # What was fitted to synthetic data is no more than that.
    inputs = data.get("inputs") if isinstance(data, dict) else None
    synthetic = any(isinstance(x, dict) and x.get("synthetic") is True for x in inputs or ())
    return replace(source, synthetic=synthetic), data
