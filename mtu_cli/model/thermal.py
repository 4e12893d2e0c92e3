"""Thermal drift of a component: linear in temperatures, a polynomial in position.

    drift(p, T) = sum_m sum_s g[m, s] p^m u_s,      u_s = T_s - T_reference,

T_s a sensor's temperature or, with a time constant, its first-order lag. Valdes et al., eqs.
(4)-(8) and (13): through the observed positions the polynomial is theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalEstimate:
    """The drift of one component, in internal units (mm or rad, per degC and per mm^m).

    `coefficients` (m, s): ascending powers of the position along `of` (one row where the drift
    does not depend on it), one column a sensor. `covariance` (m*s, m*s) of them, powers first,
    with `coefficient_dof`. `leftover` (m, m) is the covariance of what the model leaves of the
    drift, as a polynomial of the same powers: the machine's state, shared by all points of a
    part, with `leftover_dof`. `time_constants` (s,) in min, 0 for a sensor without lag;
    `sensor_u` (s,) in degC; `temperature_range` (s, 2) in degC and `position_range` in mm are
    what the fit saw (None: not known).
    """

    component: str
    of: str | None
    unit: Unit
    sensors: tuple[str, ...]
    reference: float
    coefficients: FloatArray
    covariance: FloatArray
    coefficient_dof: float
    leftover: FloatArray
    leftover_dof: float
    time_constants: FloatArray
    sensor_u: FloatArray
    temperature_range: FloatArray | None = None
    position_range: tuple[float, float] | None = None

    @property
    def degree(self) -> int:
        """Degree of the polynomial in position; 0: the drift is the same everywhere."""
        return len(self.coefficients) - 1

    def gradient_u(self, sensor: int, position: float) -> float:
        """Standard uncertainty of a sensor's gradient at `position` (mm): mm or rad per degC.

        u^2 = x' C x with x the powers of the position and C the sensor's block of the covariance.
        """
        x = position ** np.arange(self.degree + 1.0)
        count = len(self.sensors)
        C = self.covariance[sensor::count, sensor::count]
        return float(np.sqrt(np.clip(x @ C @ x, 0.0, None)))

    def drift(self, position: FloatArray, temperature: Mapping[str, FloatArray]) -> FloatArray:
        """The drift (n,) in mm or rad at `position` (n,) and sensors' temperatures (n,), degC.

        Temperatures of sensors with a time constant are taken as lagged already.
        """
        total = np.zeros(len(position))
        for s, sensor in enumerate(self.sensors):
            u = np.asarray(temperature[sensor]) - self.reference
            total += np.polynomial.polynomial.polyval(position, self.coefficients[:, s]) * u
        return total


def through_positions(positions: FloatArray, values: FloatArray, degree: int) -> FloatArray:
    """Powers (degree + 1, s) of the polynomial through `values` (positions, s), eq. (13).

    With fewer powers than positions the least-squares polynomial.
    """
    from mtu_cli.stats.least_squares import least_squares, polynomial

    X = polynomial(positions, degree)
    return np.column_stack([least_squares(X, column).coefficients for column in values.T])
