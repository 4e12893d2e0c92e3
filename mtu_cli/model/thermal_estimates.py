"""The drifts of a machine's components, from its own file or from a thermal-fit report."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.machine_contract import Component, Thermal
from mtu_cli.files.reports_read import ReportedDrift, ThermalReport
from mtu_cli.findings import Finding, InputError, finding, suggestion
from mtu_cli.model.thermal import ThermalEstimate, through_positions
from mtu_cli.units import UNITS

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
    found = thermal_from_machine_file(machine)
    problems: list[Finding] = []
    for name, item in report.components.items():
        entry = machine.machine.components.get(name)
        if entry is None:
            problems.append(
                finding(
                    "unknown-name",
                    what="component",
                    file=report.source.shown,
                    path=f"results.components.{name}",
                    value=name,
                    **suggestion(name, machine.machine.components),
                )
            )
            continue
        problems += _differences(machine, report, name, entry, item)
        found[name] = _reported(name, item)
    if problems:
        raise InputError(problems)
    return found


def _differences(
    machine: LoadedMachine,
    report: ThermalReport,
    name: str,
    entry: Component,
    item: ReportedDrift,
) -> list[Finding]:
    shown = machine.source.shown
    found = []
    # A drift that is the same everywhere needs no axis.
    same_axis = entry.of == item.of or (item.of is None and item.degree == 0)
    if not same_axis or UNITS[entry.unit].dimension != UNITS[item.unit].dimension:
        reported = f"of {item.of} in {item.unit}"
        found.append(("", reported, f"of {entry.of} in {entry.unit}"))
    reference = machine.machine.reference_temperature_degC
    if not math.isclose(
        item.reference_temperature_degC, reference, rel_tol=0, abs_tol=SAME_TEMPERATURE
    ):
        reported = f"{item.reference_temperature_degC:g} degC"
        expected = f"{reference:g} degC, its reference temperature: fit again"
        found.append((".reference_temperature_degC", reported, expected))
    return [
        finding(
            "contradicts",
            other=shown,
            value=reported,
            file=report.source.shown,
            path=f"results.components.{name}{key}",
            expected=expected,
        )
        for key, reported, expected in found
    ]


def _reported(name: str, item: ReportedDrift) -> ThermalEstimate:
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
