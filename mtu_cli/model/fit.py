"""A machine's components and their drifts from readings, from a report, or from its own file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.machine_contract import AUTO, Component, Thermal
from mtu_cli.files.readings import Readings, drift_problem
from mtu_cli.files.reports_read import (
    ComponentsReport,
    ReportedComponent,
    ReportedDrift,
    ReportedEffects,
    ReportedGroup,
    ThermalReport,
)
from mtu_cli.findings import Finding, InputError, finding, suggestion
from mtu_cli.model.basis import Powers, TableShape
from mtu_cli.model.estimates import (
    ComponentEstimate,
    EffectEstimates,
    Estimates,
    JointPasses,
    ThermalEstimate,
    through_positions,
)
from mtu_cli.model.estimation import ComponentFit, fit_component, shared_passes
from mtu_cli.model.reading_layout import without_effects
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, LENGTH, PARAMETER_UNITS, UM, UNITS


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFit:
    """Every component that readings were given for, and the groups that share passes; `missing`
    have neither readings nor coefficients. `warnings` of effects that could not be taken off the
    readings, and of these.
    """

    components: dict[str, ComponentFit]
    joint: tuple[JointPasses, ...]
    missing: tuple[str, ...] = ()
    warnings: tuple[Finding, ...] = ()


def fit_machine(machine: LoadedMachine, readings: Readings) -> MachineFit:
    """Fits every component that was read, to the readings less the machine's effects that were
    found in readings of it.

    A component that has neither readings nor coefficients is not fitted, which a note says: a
    prediction that needs it fails (`build_model`).

    Raises InputError for what looks like drift readings.
    """
    components = machine.machine.components
    read, shown = set(readings.components), ", ".join(each.shown for each in readings.sources)
    missing = [
        name
        for name, component in components.items()
        if name not in read and component.coefficients is None
    ]
    sensors = [name for name in readings.covariates if is_temperature(name)]
    moved = readings.has_pass.any() or readings.direction.any()
    if missing and sensors and readings.cycles and not moved:
        # They look like those of drifts: then these are not the machine's components.
        raise InputError(drift_problem(shown, sensors))
    left, warned = without_effects(machine, readings)
    fits = {
        name: fit_component(left, name, component)
        for name, component in components.items()
        if name in read
    }
    warnings = list(warned)
    if missing:
        place = {"file": machine.source.shown, "line": machine.line_of("components", missing[0])}
        reason = f"no readings in {shown}, and none in the machine file"
        given = {"quantity": "coefficients", "names": missing, "reason": reason}
        warnings.append(finding("not-estimable", **given, **place))
    return MachineFit(
        components=fits,
        joint=shared_passes(fits),
        missing=tuple(missing),
        warnings=tuple(warnings),
    )


def estimates_from_fit(machine: LoadedMachine, fit: MachineFit | None) -> Estimates:
    """Readings win over coefficients in the machine file."""
    found = from_machine_file(machine)
    if fit is None:
        return Estimates(components=found)
    found |= {name: item.estimate for name, item in fit.components.items()}
    return Estimates(components=found, joint=fit.joint)


def machine_warnings(machine: LoadedMachine, estimates: Estimates) -> list[Finding]:
    """What the machine file makes one ask; not of coefficients that readings, or a report of
    their fit, win over.
    """
    # A report may do no more than carry the file's own.
    used = {
        name
        for name, own in from_machine_file(machine).items()
        if np.array_equal(estimates.components[name].coefficients, own.coefficients)
    }
    own = [
        item
        for item in machine.warnings
        if item.facts.get("coefficients_of") is None or item.facts.get("coefficients_of") in used
    ]
    stated = [name for name, own in machine.machine.components.items() if own.coefficients]
    idle = [name for name in stated if name not in used and name in machine.used]
    return [*own, *beaten_warnings(machine, idle, "coefficients")]


def beaten_warnings(
    machine: LoadedMachine, idle: Sequence[str], key: Literal["coefficients", "thermal"]
) -> list[Finding]:
    """That what the file states of components under a key is not used: one warning of all."""
    if not idle:
        return []
    what, by = {"coefficients": ("coefficients", "readings"),
                "thermal": ("thermal blocks", "drift readings")}[key]  # fmt: skip
    reason = f"{by}, or the report of their fit, replace them"
    place = {"file": machine.source.shown, "line": machine.line_of("components", idle[0], key)}
    return [finding("not-used", what=what, names=idle, reason=reason, **place)]


def from_machine_file(machine: LoadedMachine) -> dict[str, ComponentEstimate]:
    """The components whose coefficients the machine file states, in their own units there.

    Without a covariance the coefficients are taken as known. `u_future`, the standard uncertainty
    of a future observation, is all that many published tables give: it counts as repeatability,
    independent from point to point, or, without an axis, as shared by all points of a part.
    """
    found: dict[str, ComponentEstimate] = {}
    for name, entry in machine.machine.components.items():
        if entry.coefficients is None:
            continue
        unit = UNITS[entry.unit]
        f, k = unit.to_internal, len(entry.coefficients)
        C = np.zeros((k, k)) if entry.covariance is None else np.asarray(entry.covariance, float)
        D, repeat = entry.pass_covariance, entry.s_repeat or 0.0
        if entry.u_future is not None and entry.of is None:
            D = [[entry.u_future**2]]
        elif entry.u_future is not None:
            repeat = entry.u_future
        q = min(2, k)
        table = _stated_table(entry)
        T = (table or Powers(k - 1)).of_line(entry.pass_center_mm or 0.0, q)
        overall = np.inf if entry.dof is None else float(entry.dof)
        of_passes = overall if entry.pass_dof is None else float(entry.pass_dof)
        found[name] = ComponentEstimate(
            name=name,
            of=entry.of,
            unit=unit,
            coefficients=np.asarray(entry.coefficients, float) * f,
            covariance=C * f**2,
            pass_covariance=T @ np.asarray(np.zeros((q, q)) if D is None else D) @ T.T * f**2,
            s_repeat=repeat * f,
            pass_dof=0.0 if D is None else of_passes,
            repeat_dof=overall if entry.repeat_dof is None else float(entry.repeat_dof),
            table=table,
            # A table says nothing of what is beyond it.
            position_range=None if table is None else (float(table.at[0]), float(table.at[-1])),
        )
    return found


def _stated_table(entry: Component | ReportedComponent) -> TableShape | None:
    """The table that a file states; None of a polynomial."""
    if entry.at_mm is None:
        return None
    square = (UM if UNITS[entry.unit].dimension == LENGTH else ARCSEC) ** 2
    own_dof = getattr(entry, "own_dof", None)
    return TableShape(
        at=np.asarray(entry.at_mm, float),
        roughness=(entry.roughness_um2_per_mm3 or 0.0) * square,
        between=(entry.between_um2 or 0.0) * square,
        own=(entry.own_um2_per_mm3 or 0.0) * square,
        own_dof=np.inf if own_dof is None else own_dof,
    )


def estimates_from_report(machine: LoadedMachine, report: ComponentsReport) -> Estimates:
    """The components of a fit-components report, which win over the machine file.

    Raises InputError where the report and the machine disagree on a component's axis, unit
    or degree.
    """
    found = from_machine_file(machine)
    _check_report(machine, report)
    found |= {name: _reported(name, item) for name, item in report.components.items()}
    return Estimates(
        components=found,
        joint=tuple(_joint(group, found) for group in report.joint),
        effects=None if report.effects is None else _effects(report.effects),
    )


def _check_report(machine: LoadedMachine, report: ComponentsReport | ThermalReport) -> None:
    """Raises InputError where a report and the machine file disagree on a component."""
    known, shown = machine.machine.components, machine.source.shown
    reference = machine.machine.reference_temperature_degC
    problems: list[Finding] = []
    for name, item in report.components.items():
        place = {"file": report.source.shown, "path": f"results.components.{name}"}
        entry, axis = known.get(name), item.of
        if entry is None:
            place |= {"what": f"component in {shown}", "value": name}
            problems.append(finding("unknown-name", **place, **suggestion(name, known)))
            continue
        differ = []
        if isinstance(item, ReportedDrift):
            # A drift that is the same everywhere needs no axis.
            axis = entry.of if item.of is None and item.degree == 0 else item.of
            if abs(item.reference_temperature_degC - reference) > SAME_TEMPERATURE:
                wanted = f"{reference:g} degC, its reference temperature: fit again"
                stated = f"{item.reference_temperature_degC:g} degC"
                differ.append((".reference_temperature_degC", stated, wanted))
        elif entry.degree != AUTO and _shape(item) != _shape(entry):
            differ.append(("", f"of {_shape(item)}", f"{_shape(entry)}: fit again"))
        if axis != entry.of or UNITS[entry.unit].dimension != UNITS[item.unit].dimension:
            wanted = f"of {entry.of} in {entry.unit}"
            differ.append(("", f"of {item.of} in {item.unit}", wanted))
        for key, stated, wanted in differ:
            facts = {"other": shown, "value": stated, "expected": wanted}
            own = {**place, "path": place["path"] + key}
            problems.append(finding("contradicts", **own, **facts))
    if problems:
        raise InputError(problems)


def _shape(entry: Component | ReportedComponent) -> str:
    """As messages have it."""
    return "`shape: table`" if entry.shape == "table" else f"degree {entry.degree}"


def _reported(name: str, item: ReportedComponent) -> ComponentEstimate:
    unit = UNITS[item.unit]
    f = unit.to_internal
    k = len(item.coefficients)
    table = _stated_table(item)
    T = (table or Powers(k - 1)).of_line(item.pass_center_mm, min(2, k))
    independent = item.covariance_independent
    return ComponentEstimate(
        name=name,
        of=item.of,
        unit=unit,
        coefficients=np.asarray(item.coefficients, float) * f,
        covariance=np.asarray(item.covariance, float) * f**2,
        pass_covariance=T @ np.asarray(item.pass_covariance_moment, float) @ T.T * f**2,
        s_repeat=item.s_repeat * f,
        pass_dof=np.inf if item.pass_dof is None else item.pass_dof,
        repeat_dof=np.inf if item.repeat_dof is None else item.repeat_dof,
        n_passes=item.n_passes,
        independent_covariance=None if independent is None else np.asarray(independent) * f**2,
        independent_s=None if item.s is None else item.s * f,
        position_range=item.position_range_mm,
        half_differences=_scaled(item.half_difference_mean_square, T * f),
        run_covariance=_scaled(item.run_covariance, T * f),
        table=table,
    )


def _scaled(matrix: list[list[float]] | None, T: FloatArray) -> FloatArray | None:
    return None if matrix is None else T @ np.asarray(matrix, float) @ T.T


def _joint(group: ReportedGroup, found: dict[str, ComponentEstimate]) -> JointPasses:
    f = np.concatenate(
        [
            np.full(width, found[name].unit.to_internal)
            for name, width in zip(group.components, group.widths, strict=True)
        ]
    )
    return JointPasses(
        components=tuple(group.components),
        widths=tuple(group.widths),
        covariance=np.asarray(group.coefficient_covariance, float) * np.outer(f, f),
        pass_covariance=np.asarray(group.pass_covariance, float) * np.outer(f, f),
        pass_dof=group.pass_dof,
        n_passes=group.n_passes,
        half_differences=_scaled(group.half_difference_mean_square, np.diag(f)),
    )


def _effects(item: ReportedEffects) -> EffectEstimates:
    units = tuple(PARAMETER_UNITS[unit] for unit in item.units)
    f = np.array([unit.to_internal for unit in units])
    return EffectEstimates(
        names=tuple(item.parameters),
        units=units,
        values=np.asarray(item.values, float) * f,
        covariance=np.reshape(item.covariance, (len(f), len(f))) * np.outer(f, f),
    )


SAME_TEMPERATURE = 1e-9
"""degC; less is the rounding of a number that went through text."""


def thermal_from_machine_file(machine: LoadedMachine) -> dict[str, ThermalEstimate]:
    """The drifts that the machine file states, by component."""
    reference = machine.machine.reference_temperature_degC
    return {
        name: _stated(name, entry, entry.thermal, reference)
        for name, entry in machine.machine.components.items()
        if entry.thermal is not None
    }


def _stated(name: str, entry: Component, thermal: Thermal, reference: float) -> ThermalEstimate:
    """Exactly known coefficients; what they leave is a shift of the component as a whole."""
    unit = UNITS[entry.unit]
    sensors = tuple(thermal.gradients)
    gradients = np.array([thermal.gradients[sensor] for sensor in sensors]).T
    positions = thermal.positions_mm
    powers = thermal.degree + 1
    coefficients = gradients
    if positions is not None:
        coefficients = through_positions(np.array(positions, float), gradients, thermal.degree)
    leftover = np.zeros((powers, powers))
    leftover[0, 0] = (thermal.s_leftover * unit.to_internal) ** 2
    size = powers * len(sensors)
    return ThermalEstimate(
        component=name,
        of=entry.of,
        unit=unit,
        sensors=sensors,
        reference=reference,
        coefficients=coefficients * unit.to_internal,
        covariance=np.zeros((size, size)),
        coefficient_dof=np.inf,
        leftover=leftover,
        leftover_dof=np.inf,
        time_constants=np.array([thermal.time_constants_min.get(s, 0.0) for s in sensors], float),
        sensor_u=np.array([thermal.sensor_u_degC.get(s, 0.0) for s in sensors], float),
        position_range=None if positions is None else (min(positions), max(positions)),
    )


def thermal_from_report(
    machine: LoadedMachine, report: ThermalReport
) -> dict[str, ThermalEstimate]:
    """The drifts of a thermal-fit report, which win over those of the machine file.

    Raises InputError where the report and the machine disagree on a component, its axis, its
    kind of unit, or the reference temperature.
    """
    _check_report(machine, report)
    stated = thermal_from_machine_file(machine)
    return stated | {name: _reported_drift(name, item) for name, item in report.components.items()}


def _reported_drift(name: str, item: ReportedDrift) -> ThermalEstimate:
    unit = UNITS[item.unit]
    f = unit.to_internal
    powers, sensors = item.degree + 1, len(item.sensors)
    size = powers * sensors
    ranges = item.temperature_range_degC
    return ThermalEstimate(
        component=name,
        of=item.of,
        unit=unit,
        sensors=tuple(item.sensors),
        reference=item.reference_temperature_degC,
        coefficients=np.array(item.coefficients, float).reshape(powers, sensors) * f,
        covariance=np.array(item.covariance, float).reshape(size, size) * f**2,
        coefficient_dof=np.inf if item.coefficient_dof is None else item.coefficient_dof,
        leftover=np.array(item.leftover_covariance, float) * f**2,
        leftover_dof=np.inf if item.leftover_dof is None else item.leftover_dof,
        time_constants=np.array(item.time_constants_min, float),
        sensor_u=np.array(item.sensor_u_degC, float),
        temperature_range=None if ranges is None else np.array(ranges, float).reshape(sensors, 2),
        position_range=item.position_range_mm,
    )
