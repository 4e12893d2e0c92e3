"""A machine's components from readings, from a components report, or from its own file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import drift_problem
from mtu_cli.files.reports_read import (
    ComponentsReport,
    ReportedComponent,
    ReportedEffects,
    ReportedGroup,
)
from mtu_cli.findings import Finding, InputError, finding, suggestion
from mtu_cli.model.estimates import (
    ComponentEstimate,
    EffectEstimates,
    Estimates,
    JointPasses,
    from_centre,
    known_component,
)
from mtu_cli.model.estimation import ComponentFit, fit_component
from mtu_cli.model.joint import shared_passes
from mtu_cli.model.reading_layout import without_effects
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFit:
    """Every component that readings were given for, and the groups that share passes; `warnings`
    of effects that could not be taken off the readings.
    """

    components: dict[str, ComponentFit]
    joint: tuple[JointPasses, ...]
    warnings: tuple[Finding, ...] = ()


def fit_machine(machine: LoadedMachine, readings: Readings) -> MachineFit:
    """Fits every component that was read, to the readings less the machine's effects that were
    found in readings of it.

    Raises InputError naming every component of the machine that has neither readings nor
    coefficients.
    """
    components = machine.machine.components
    read = set(readings.components)
    missing = [
        finding(
            "missing-input",
            what=f"an estimate of {name}",
            estimate_of=name,
            file=machine.source.shown,
            line=machine.line_of("components", name),
            path=f"components.{name}",
            expected=f"readings of it in {_shown(readings)}, or coefficients here"
            + ("" if name in machine.used else "; or no such component, as no equation uses it"),
        )
        for name, component in components.items()
        if name not in read and component.coefficients is None
    ]
    if missing:
        raise InputError(_drift_instead(readings) or missing)
    left, warned = without_effects(machine, readings)
    fits = {
        name: fit_component(left, name, component)
        for name, component in components.items()
        if name in read
    }
    return MachineFit(components=fits, joint=shared_passes(fits), warnings=warned)


def _drift_instead(readings: Readings) -> list[Finding]:
    """That the readings look like those of drifts: then these are not the machine's components."""
    sensors = [name for name in readings.covariates if is_temperature(name)]
    if not sensors or not readings.cycles or readings.has_pass.any() or readings.direction.any():
        return []
    return [drift_problem(_shown(readings), sensors)]


def _shown(readings: Readings) -> str:
    return ", ".join(source.shown for source in readings.sources)


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
    """The components whose coefficients the machine file states."""
    found: dict[str, ComponentEstimate] = {}
    for name, entry in machine.machine.components.items():
        if entry.coefficients is None:
            continue
        found[name] = known_component(
            name=name,
            of=entry.of,
            unit=UNITS[entry.unit],
            coefficients=np.asarray(entry.coefficients, float),
            covariance=_matrix(entry.covariance),
            pass_covariance=_matrix(entry.pass_covariance),
            pass_center=entry.pass_center_mm,
            s_repeat=entry.s_repeat,
            u_future=entry.u_future,
            dof=entry.dof,
            pass_dof=entry.pass_dof,
            repeat_dof=entry.repeat_dof,
        )
    return found


def _matrix(values: list[list[float]] | None) -> FloatArray | None:
    return None if values is None else np.asarray(values, float)


def estimates_from_report(machine: LoadedMachine, report: ComponentsReport) -> Estimates:
    """The components of a fit-components report, which win over the machine file.

    Raises InputError where the report and the machine disagree on a component's axis, unit
    or degree.
    """
    found = from_machine_file(machine)
    problems: list[Finding] = []
    for name, item in report.components.items():
        path = f"results.components.{name}"
        problems += [
            own.at(file=report.source.shown, path=path)
            for own in _disagreements(machine, name, item)
        ]
    if problems:
        raise InputError(problems)
    found |= {name: _reported(name, item) for name, item in report.components.items()}
    return Estimates(
        components=found,
        joint=tuple(_joint(group, found) for group in report.joint),
        effects=None if report.effects is None else _effects(report.effects),
    )


def _disagreements(machine: LoadedMachine, name: str, item: ReportedComponent) -> list[Finding]:
    """What the report says otherwise than the machine file."""
    file = machine.source.shown
    entry = machine.machine.components.get(name)
    if entry is None:
        known = machine.machine.components
        return [
            finding(
                "unknown-name", what=f"component in {file}", value=name, **suggestion(name, known)
            )
        ]
    found = []
    degree = len(item.coefficients) - 1
    if degree != entry.degree:
        found.append((f"of degree {degree}", f"degree {entry.degree}: fit again"))
    same_unit = UNITS[entry.unit].dimension == UNITS[item.unit].dimension
    if entry.of != item.of or not same_unit:
        expected = f"of {entry.of} in {entry.unit}"
        found.append((f"of {item.of} in {item.unit}", expected))
    return [
        finding("contradicts", other=file, value=reported, expected=expected)
        for reported, expected in found
    ]


def _reported(name: str, item: ReportedComponent) -> ComponentEstimate:
    unit = UNITS[item.unit]
    f = unit.to_internal
    k = len(item.coefficients)
    T = from_centre(item.pass_center_mm, k, min(2, k))
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
