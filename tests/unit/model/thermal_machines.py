"""Machines with thermal models made in memory, for the tests of what they add to predictions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from model_examples import loaded

from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

REFERENCE = 20.0
SENSORS = ("T_a_degC", "T_b_degC", "T_c_degC")
MACHINE = """
components:
  px: {of: x, unit: um, coefficients: [1.0, 0.02], covariance: [[0.2, 0], [0, 1e-6]], s_repeat: 0.3}
  py: {of: y, unit: um, coefficients: [-2.0, 0.01, 1e-5]}
  yaw: {of: y, unit: arcsec, coefficients: [0.5, 0.01], s_repeat: 0.1}
  ort: {unit: arcsec, coefficients: [3.0]}
equations:
  Ex: px + y*yaw - y*ort
  Ey: py - x*yaw + 0.5*px
"""
POINTS = np.array(
    [[0.0, 0.0, np.nan], [100.0, 40.0, np.nan], [250.0, 300.0, np.nan], [30.0, 180.0, np.nan]]
)
IDS = ("a", "b", "c", "d")


def drift(
    component: str,
    of: str | None,
    sensors: tuple[str, ...],
    coefficients: FloatArray,
    *,
    unit: str = "um",
    covariance: FloatArray | None = None,
    leftover: FloatArray | None = None,
    time_constants: tuple[float, ...] | None = None,
    sensor_u: tuple[float, ...] | None = None,
) -> ThermalEstimate:
    """A thermal model; coefficients, covariance and leftover in the unit, per degC and mm^m."""
    f = UNITS[unit].to_internal
    m, s = coefficients.shape
    return ThermalEstimate(
        component=component,
        of=of,
        unit=UNITS[unit],
        sensors=sensors,
        reference=REFERENCE,
        coefficients=coefficients * f,
        covariance=(np.zeros((m * s, m * s)) if covariance is None else covariance) * f**2,
        coefficient_dof=np.inf,
        leftover=(np.zeros((m, m)) if leftover is None else leftover) * f**2,
        leftover_dof=np.inf,
        time_constants=np.array(time_constants or (0.0,) * s),
        sensor_u=np.array(sensor_u or (0.0,) * s),
    )


def line(**changes: FloatArray | tuple[float, ...]) -> ThermalEstimate:
    """px drifts with two sensors, by a line in x."""
    coefficients = np.array([[1.5, -0.8], [0.01, 0.004]])
    return drift("px", "x", SENSORS[:2], coefficients, **changes)  # type: ignore[arg-type]  # named


def angle(**changes: FloatArray | tuple[float, ...]) -> ThermalEstimate:
    """yaw drifts with the second and the third sensor, the same everywhere."""
    coefficients = np.array([[2.0, -1.0]])
    return drift("yaw", "y", SENSORS[1:], coefficients, unit="arcsec", **changes)  # type: ignore[arg-type]  # named


def machine(folder: Path, *drifts: ThermalEstimate) -> MachineModel:
    """The machine with the drifts of some of its components."""
    found = loaded(folder, MACHINE)
    estimates = estimates_from_fit(found, None)
    return build_model(found, replace(estimates, thermal={item.component: item for item in drifts}))
