"""A machine's components and their drifts from readings, from a report, or from its own file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.machine import AUTO, Component, LoadedMachine
from mtu_cli.files.readings import Readings, drift_problem
from mtu_cli.files.reports_read import (
    ComponentsReport,
    ReportedComponent,
    ReportedDrift,
    ThermalReport,
)
from mtu_cli.files.source import shown_path
from mtu_cli.findings import Finding, InputError, finding, listed, suggestion
from mtu_cli.language import evaluate
from mtu_cli.model.effect_parameters import range_warnings, renames
from mtu_cli.model.estimates import (
    ComponentEstimate,
    EffectEstimates,
    Estimates,
    JointPasses,
    ThermalEstimate,
    dof_or,
    known_component,
)
from mtu_cli.model.estimation import TESTS, ComponentFit, fit_component, shared_passes
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    design,
    effect_alone,
    places_of,
)
from mtu_cli.model.visits import Passes, passes_read
from mtu_cli.stats.coverage import significant
from mtu_cli.stats.least_squares import FloatArray, IntArray, least_squares, polynomial
from mtu_cli.stats.pass_tests import Shift
from mtu_cli.units import PARAMETER_UNITS, UNITS

SAME_TEMPERATURE = 1e-9
"""degC; less is the rounding of a number that went through text."""
ELSEWHERE = 1.0
"""mm along axes whose position the readings lack: effect and lever arm have the same factor."""


@dataclass(frozen=True, kw_only=True)
class MachineFit:
    """Every component that readings were given for, and the groups that share passes; `missing`
    have neither readings nor coefficients. `warnings` of these and of effects left on the readings.
    """

    components: dict[str, ComponentFit]
    joint: tuple[JointPasses, ...]
    missing: tuple[str, ...] = ()
    warnings: tuple[Finding, ...] = ()

    @cached_property
    def significant(self) -> dict[str, dict[tuple[str, str], float]]:
        """By test, the p of each (component, role) significant among all of them (Bonferroni)."""
        items = [(name, x) for name, fit in self.components.items() for x in fit.instruments]
        return {
            test: significant({(n, x.role): x.tests[test].p for n, x in items if test in x.tests})
            for test in TESTS
        }


def fit_machine(machine: LoadedMachine, readings: Readings | None) -> MachineFit:
    """Fits every component that was read, to the readings less the machine's effects that were
    found in readings of it; none without readings. A component that has neither readings nor
    coefficients is not fitted, with a warning.

    Raises InputError for what looks like drift readings.
    """
    if readings is None:
        return MachineFit(components={}, joint=())
    components = machine.machine.components
    read, files = set(readings.components), ", ".join(each.shown for each in readings.sources)
    missing = [
        name for name, x in components.items() if name not in read and x.coefficients is None
    ]
    sensors = [name for name in readings.covariates if is_temperature(name)]
    moved = readings.has_pass.any() or readings.direction.any()
    if missing and sensors and readings.cycles and not moved:
        # They look like those of drifts: then these are not the machine's components.
        raise InputError(drift_problem(files, sensors))
    rest, warnings = without_effects(machine, readings)
    fits = {name: fit_component(rest, name, x) for name, x in components.items() if name in read}
    if missing:
        reason = f"no readings in {files}, and none in the machine file"
        facts = {"quantity": "coefficients", "names": missing, "reason": reason}
        place = machine.place("components", missing[0])
        warnings.append(finding("not-estimable", **facts, **place))
    joint = shared_passes(fits)
    return MachineFit(
        components=fits, joint=joint, missing=tuple(missing), warnings=tuple(warnings)
    )


WARNED = {"lack_of_fit": "lack-of-fit", "reversal": "reversal", "trend": "passes-drift"}
"""Tests on the passes, and the warning of each."""
SCATTERS = 1e-12
"""Less, in mm or rad, is rounding: the readings do not scatter."""
NO_SCATTER = "they do not scatter, and their uncertainty counts as 0"
ONE_RUN = "read in one run there and back: scatter from run to run is not seen"
ALL_REPEATABILITY = "one pass, or no column `pass`: all of it counts as repeatability"


def fit_warnings(fit: MachineFit) -> list[Finding]:
    """Warnings on scatter that is not separable, or not estimable, on lack of fit, reversal, trend
    and disagreement of instruments, and what else the fit warns of.
    """
    mixed, warnings = list[str](), list[Finding]()
    kinds = [("readings", ONE_RUN), ("readings", NO_SCATTER), ("means of the passes", NO_SCATTER)]
    unknown: dict[tuple[str, str], list[str]] = {kind: [] for kind in kinds}
    for name, component in fit.components.items():
        fits, estimate = [x.fit for x in component.instruments], component.estimate
        if not all(each.separated for each in fits):
            mixed.append(name)
        if any(each.separated and each.n_passes == 2 == 2 * len(each.pairs) for each in fits):
            unknown["readings", ONE_RUN].append(name)
        if estimate.independent_s is not None and estimate.independent_s < SCATTERS:
            unknown["readings", NO_SCATTER].append(name)
        elif not np.diag(estimate.covariance).all():
            unknown["means of the passes", NO_SCATTER].append(name)
    facts: dict[str, Any]
    if mixed:
        facts = {"what": f"the scatter from pass to pass of {listed(mixed)}", "names": mixed}
        facts |= {"others": ["repeatability"], "consequence": ALL_REPEATABILITY}
        warnings.append(finding("not-separable", **facts))
    for (what, consequence), names in unknown.items():
        if names:
            facts = {"what": what, "names": names, "consequence": consequence}
            warnings.append(finding("no-scatter-known", **facts))
    p_values = {name: x.agreement_p for name, x in fit.components.items()}
    conflicts = significant({name: p for name, p in p_values.items() if p is not None})
    for test, code in WARNED.items():
        for (name, role), p in fit.significant[test].items():
            unit = fit.components[name].estimate.unit
            item = next(x for x in fit.components[name].instruments if x.role == role)
            facts = {"component": name, "p": p, "unit": unit.name}
            if isinstance(result := item.tests[test], Shift):
                facts["size"] = result.value / unit.to_internal
            if test == "trend":
                facts["each"] = "a pass there and back" if len(item.fit.pairs) else "a pass"
            warnings.append(finding(code, **facts))
    warnings += [finding("instruments-disagree", component=x, p=p) for x, p in conflicts.items()]
    return [*fit.warnings, *warnings]


def without_effects(machine: LoadedMachine, readings: Readings) -> tuple[Readings, list[Finding]]:
    """The readings less the effects that were found in readings of their component, which else
    would count twice, as coefficients or scatter. Warns of effects whose columns the readings lack.
    """
    of_effects = {effect.found.get("component") for effect in machine.machine.effects}
    errors, warnings = readings.error.copy(), []
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        if name in of_effects and len(rows):
            series = component_readings(machine, readings, name, rows)
            effects, findings = effects_on_readings(machine, name, series.places, series.columns)
            errors[rows] -= effects
            warnings += findings
    return replace(readings, error=errors), warnings


@dataclass(frozen=True, kw_only=True)
class ComponentReadings:
    """The `rows` (n,) of a component among the readings, a function of the axis `of`: the pass
    `group` (n,) of each, `places` (n, 3) mm, nan off this axis, and `columns` (n,) by their names
    in equations.
    """

    rows: IntArray
    of: str | None
    group: IntArray
    passes: Passes
    places: FloatArray
    columns: dict[str, np.ndarray]


def component_readings(
    machine: LoadedMachine, readings: Readings, name: str, rows: IntArray
) -> ComponentReadings:
    """The readings `rows` of a component. It is an error along the axis that it is a function of,
    else the only one whose equation has it; with several or none, the component's name stands.
    """
    of = machine.machine.components[name].of
    along = {key[1:] for key, form in machine.forms.items() if name in form.coefficients}
    axis = of or (along.pop() if len(along) == 1 else name)
    group, passes = passes_read(readings, rows, of)
    places, sign = np.full((len(rows), 3), np.nan), readings.direction[rows].astype(np.float64)
    if of is not None:
        places[:, AXES.index(of)] = readings.position_mm[rows]
    columns: dict[str, np.ndarray] = {"sequence": passes.runs[group] + 1.0}
    if sign.any():
        columns[f"dir_{axis}"] = np.where(sign == 0, np.nan, sign)
    for key, column in {TIME: readings.time_min, **readings.covariates}.items():
        values = column[rows]
        if values.dtype == object or not np.isnan(values).all():
            columns.setdefault(key, values)
    return ComponentReadings(
        rows=rows, of=of, group=group, passes=passes, places=places, columns=columns
    )


def effects_on_readings(
    machine: LoadedMachine, component: str, places: FloatArray, columns: Mapping[str, np.ndarray]
) -> tuple[FloatArray, list[Finding]]:
    """The sum (n,) of the declared effects that were found in the readings of `component`, in
    its unit, at `places` (n, 3) mm with the readings' `columns` (n,).

    An effect f of a component c stands in the machine's equations as L f, L = dE/dc its lever
    arm: f = (L f) / L. An effect whose covariate the readings lack is left out, with a warning.
    """
    total, warnings = np.zeros(len(places)), []
    numeric = {n: c.astype(np.float64) for n, c in columns.items() if c.dtype != object}
    complete = {name: column for name, column in numeric.items() if np.isfinite(column).all()}
    along = {axis: places[:, i] for i, axis in enumerate(AXES)}
    points = np.nan_to_num(places, nan=ELSEWHERE)
    for index, effect in enumerate(machine.machine.effects):
        if effect.found.get("component") != component:
            continue
        model = effect_alone(machine, index)
        levers = {
            axis: form.coefficients[component]
            for axis in model.axes
            if (form := machine.forms.get(f"E{axis}")) and component in form.coefficients
        }
        axis = next(iter(levers), None)
        missing = [name for name in model.covariates() if name not in complete]
        if axis is None or missing:
            lacking = f"they have no column {', '.join(missing)}"
            facts = {"effect": effect.name, "component": component}
            facts["reason"] = lacking if missing else "no equation holds both"
            read, what = [f"the readings of {component}"], f"the effect {effect.name}"
            warnings.append(finding("not-used", what=what, names=read, **facts))
            continue
        warnings += range_warnings([effect], numeric | along, machine.source.shown)
        errors = design(model, points, complete).mean.reshape(len(places), -1)
        values: dict[str, Any] = {**places_of(model, points), **complete}
        values |= {name: value for name, (value, _) in model.constants.items()}
        total += errors[:, model.axes.index(axis)] / evaluate(levers[axis], values)
    return total, warnings


def estimates_from_fit(machine: LoadedMachine, fit: MachineFit | None) -> Estimates:
    """Readings win over coefficients in the machine file."""
    result = from_machine_file(machine)
    if fit is None:
        return Estimates(components=result)
    result |= {name: item.estimate for name, item in fit.components.items()}
    return Estimates(components=result, joint=fit.joint)


def machine_warnings(machine: LoadedMachine, estimates: Estimates) -> list[Finding]:
    """Warnings of the machine file, not of coefficients that readings or a report replace; and of
    effects of a report that the file does not have.
    """
    stated, used = from_machine_file(machine), estimates.components
    replaced = {
        name
        for name, item in stated.items()
        # A report may merely repeat the file's coefficients.
        if not np.array_equal(used[name].coefficients, item.coefficients)
    }
    warnings = [
        x for x in machine.warnings
        if x.code != "no-uncertainty" or not replaced.issuperset(x.facts["names"])
    ]  # fmt: skip
    known = {name for effect in machine.machine.effects for name in renames(effect).values()}
    reported = () if estimates.effects is None else estimates.effects.names
    if unknown := [name for name in reported if name not in known]:
        what, reason = "effects of the report", f"{machine.source.shown} has no such effects"
        warnings.append(finding("not-used", names=unknown, what=what, reason=reason))
    return warnings


def from_machine_file(machine: LoadedMachine) -> dict[str, ComponentEstimate]:
    """The components whose coefficients the machine file states."""
    entries = machine.machine.components.items()
    return {
        name: known_component(name, entry)
        for name, entry in entries
        if entry.coefficients is not None
    }


def estimates_from_report(machine: LoadedMachine, report: ComponentsReport) -> Estimates:
    """The components of a fit-components report, which win over the machine file.

    Raises InputError where the report and the machine disagree on a component's axis, unit
    or degree.
    """
    _check_report(machine, report)
    result = from_machine_file(machine)
    result |= {name: known_component(name, item) for name, item in report.components.items()}
    effects, item = None, report.effects
    if item is not None:
        units = tuple(PARAMETER_UNITS[unit] for unit in item.units)
        f = np.array([unit.to_internal for unit in units])
        effects = EffectEstimates(
            names=tuple(item.parameters),
            units=units,
            values=np.asarray(item.values, float) * f,
            covariance=np.reshape(item.covariance, (len(f), len(f))) * np.outer(f, f),
        )
    joint = []
    for group in report.joint_pass_covariance:
        f = np.repeat([result[name].unit.to_internal for name in group.components], group.widths)
        halves = group.half_difference_mean_square
        joint.append(
            JointPasses(
                components=tuple(group.components),
                widths=tuple(group.widths),
                covariance=np.asarray(group.coefficient_covariance, float) * np.outer(f, f),
                pass_covariance=np.asarray(group.pass_covariance, float) * np.outer(f, f),
                pass_dof=group.pass_dof,
                n_passes=group.n_passes,
                half_differences=None if halves is None else np.asarray(halves) * np.outer(f, f),
            )
        )
    return Estimates(components=result, joint=tuple(joint), effects=effects)


def _check_report(machine: LoadedMachine, report: ComponentsReport | ThermalReport) -> None:
    """Raises InputError where a report and the machine file disagree on a component."""
    components, file = machine.machine.components, machine.source.shown
    reference = machine.machine.reference_temperature_degC
    problems: list[Finding] = []
    for name, item in report.components.items():
        place = {"file": report.source.shown, "path": f"results.components.{name}"}
        entry, axis = components.get(name), item.of
        if entry is None:
            place |= {"what": f"component in {file}", "value": name}
            problems.append(finding("unknown-name", **place, **suggestion(name, components)))
            continue
        differences = []
        if isinstance(item, ReportedDrift):
            # A drift that is the same everywhere needs no axis.
            axis = entry.of if item.of is None and item.degree == 0 else item.of
            if abs(item.reference_temperature_degC - reference) > SAME_TEMPERATURE:
                expected = f"{reference:g} degC, its reference temperature: fit again"
                value = f"{item.reference_temperature_degC:g} degC"
                differences.append((".reference_temperature_degC", value, expected))
        elif entry.degree != AUTO and _shape(item) != _shape(entry):
            differences.append(("", f"of {_shape(item)}", f"{_shape(entry)}: fit again"))
        if axis != entry.of or UNITS[entry.unit].dimension != UNITS[item.unit].dimension:
            expected = f"of {entry.of} in {entry.unit}"
            differences.append(("", f"of {item.of} in {item.unit}", expected))
        for key, value, expected in differences:
            facts = {"other": file, "value": value, "expected": expected}
            facts |= {**place, "path": place["path"] + key}
            problems.append(finding("contradicts", **facts))
    if problems:
        raise InputError(problems)


def _shape(entry: Component | ReportedComponent) -> str:
    """As messages have it."""
    return "`shape: table`" if entry.shape == "table" else f"degree {entry.degree}"


def thermal_from_machine_file(machine: LoadedMachine) -> dict[str, ThermalEstimate]:
    """The drifts that the machine file states, by component: exactly known coefficients, those of
    the least-squares polynomial through their positions (Valdes et al., eq. (13)); the leftover
    is a shift of the component as a whole.
    """
    result = {}
    for name, entry in machine.machine.components.items():
        if (thermal := entry.thermal) is None:
            continue
        unit, sensors, at = UNITS[entry.unit], tuple(thermal.gradients), thermal.positions_mm
        gradients = np.array([thermal.gradients[sensor] for sensor in sensors]).T
        powers = thermal.degree + 1
        if at is not None:
            X = polynomial(np.array(at, float), thermal.degree)
            fits = [least_squares(X, column).coefficients for column in gradients.T]
            gradients = np.column_stack(fits)
        leftover = np.zeros((powers, powers))
        leftover[0, 0] = (thermal.s_leftover * unit.to_internal) ** 2
        lags, u = thermal.time_constants_min, thermal.sensor_u_degC
        result[name] = ThermalEstimate(
            component=name,
            of=entry.of,
            unit=unit,
            sensors=sensors,
            reference=machine.machine.reference_temperature_degC,
            coefficients=gradients * unit.to_internal,
            covariance=np.zeros((powers * len(sensors),) * 2),
            leftover=leftover,
            time_constants=np.array([lags.get(sensor, 0.0) for sensor in sensors], float),
            sensor_u=np.array([u.get(sensor, 0.0) for sensor in sensors], float),
            position_range=None if at is None else (min(at), max(at)),
        )
    return result


def thermal_from_report(
    machine: LoadedMachine, report: ThermalReport
) -> dict[str, ThermalEstimate]:
    """The drifts of a thermal-fit report, which win over those of the machine file.

    Raises InputError where the report and the machine disagree on a component, its axis, its
    kind of unit, or the reference temperature.
    """
    _check_report(machine, report)
    result = thermal_from_machine_file(machine)
    for name, item in report.components.items():
        f, ranges = UNITS[item.unit].to_internal, item.temperature_range_degC
        sensors, size = len(item.sensors), (item.degree + 1) * len(item.sensors)
        result[name] = ThermalEstimate(
            component=name,
            of=item.of,
            unit=UNITS[item.unit],
            sensors=tuple(item.sensors),
            reference=item.reference_temperature_degC,
            coefficients=np.array(item.coefficients, float) * f,
            covariance=np.reshape(item.covariance, (size, size)) * f**2,
            coefficient_dof=dof_or(item.coefficient_dof),
            leftover=np.array(item.leftover_covariance, float) * f**2,
            leftover_dof=dof_or(item.leftover_dof),
            time_constants=np.array(item.time_constants_min, float),
            sensor_u=np.array(item.sensor_u_degC, float),
            temperature_range=None if ranges is None else np.reshape(ranges, (sensors, 2)),
            position_range=item.position_range_mm,
        )
    return result


def not_read(
    report: ComponentsReport | ThermalReport, digests: Mapping[Path, str]
) -> list[Finding]:
    """The warning that readings of a call, by path their `digests`, are not used with a report that
    was fitted to other files.
    """
    entries = report.document.get("inputs")
    items = [x for x in entries if isinstance(x, dict)] if isinstance(entries, list) else []
    roles = ("drift",) if isinstance(report, ThermalReport) else ("lbb", "laser")
    of_fit = {x.get("sha256") for x in items if x.get("role") in roles}
    if not digests or {*digests.values()} == of_fit:
        return []
    other = [path for path, digest in digests.items() if digest not in of_fit]
    reason = f"{report.source.shown} gives {', '.join(report.components)}"
    reason += "; it was fitted to other files" if of_fit else ""
    names = [shown_path(path) for path in other or digests]
    return [finding("not-used", what="readings", names=names, reason=reason)]


def reported_warnings(
    report: ComponentsReport | ThermalReport, codes: Collection[str], components: Collection[str]
) -> list[Finding]:
    """Warnings of a report, of these `codes` and components, that hold for predictions from it."""
    entries, result = report.document.get("warnings"), []
    for item in entries if isinstance(entries, list) else ():
        code, facts = (item.get("code"), item.get("facts")) if isinstance(item, dict) else ("", {})
        # Earlier versions reported no facts.
        component = facts.get("component") if isinstance(facts, dict) else None
        if code in codes and (component is None or component in components):
            what = {"of": code, "message": str(item.get("message"))}
            result.append(finding("reported", file=report.source.shown, **what))
    return list(dict.fromkeys(result))
