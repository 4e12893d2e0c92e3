"""Drift readings made in memory from planted gradients, for the tests of thermal models."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from made_tables import made_readings, remembering
from numpy.typing import NDArray

from mtu_cli.analyses.thermal_fit import ComponentDrift, ThermalFit, thermal_fit
from mtu_cli.files.readings import Readings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

UM = 1e-3
REFERENCE = 20.0
ROUNDING = 1e-9
"""Relative: doubles round by 2.2e-16, and the sensors' columns, of a condition of up to 1e3,
make its square of it.
"""
METHODS = ("auto", "stepwise", "ridge", "lagged")
LINE = np.array([[1.0, -2.0, 0.0, 0.5], [1.5, -1.0, 0.0, 0.5], [2.0, 0.0, 0.0, 0.5]])
PLACES = (0.0, 100.0, 200.0)
"""Gradients that are a line in position, and where; um per degC, mm."""


def sensor_names(count: int) -> tuple[str, ...]:
    return tuple(f"T_{s + 1:02d}_degC" for s in range(count))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """`gradients` (positions, s) um per degC at `positions`, n readings a cycle, `step` min apart.

    Sensors act with `lags`, min. `noise` um of each reading, following itself with `noise_memory`;
    `slow` um/mm^m of a misfit that all positions share, a polynomial whose coefficients each
    follow themselves with `memory`; `sensor_noise` degC of each temperature reading.
    """

    gradients: FloatArray
    positions: tuple[float, ...] = (np.nan,)
    cycles: int = 4
    n: int = 80
    step: float = 2.0
    lags: tuple[float, ...] = ()
    noise: float = 0.2
    noise_memory: float = 0.0
    slow: tuple[float, ...] = ()
    memory: float = 0.95
    sensor_noise: float = 0.0

    def temperatures(self, rng: np.random.Generator) -> FloatArray:
        """True temperatures (cycles, n, s): every second cycle cools by the six degrees that the
        others warm by. Each sensor follows in its own time and has slow draughts of its own, so
        that they can be told apart.
        """
        count = self.gradients.shape[1]
        t = np.linspace(0.0, 190.0, self.n)[:, None]
        rise = 6 * (1 - np.exp(-t / np.geomspace(15.0, 120.0, count)))
        draughts = [0.5 * remembering(rng, (self.n, count), 0.97) for _ in range(self.cycles)]
        warm = [rise if c % 2 == 0 else rise[-1:] - rise for c in range(self.cycles)]
        return np.asarray(REFERENCE + np.array(warm) + draughts)

    def read(self, rng: np.random.Generator, temperatures: FloatArray | None = None) -> Readings:
        """Readings by cycle and position; all positions are read at the same times."""
        rows: list[tuple[NDArray[Any], ...]] = []
        time = self.step * np.arange(self.n, dtype=np.float64)
        for c, true in enumerate(self.temperatures(rng) if temperatures is None else temperatures):
            seen = true + self.sensor_noise * rng.normal(size=true.shape)
            slow = np.array(self.slow) * remembering(rng, (self.n, len(self.slow)), self.memory)
            acting = true
            if self.lags:
                lagged = first_order_lag(true, time, np.array(self.lags))
                acting = np.asarray(lagged.diagonal(axis1=0, axis2=2))
            for p, position in enumerate(self.positions):
                error = (acting - REFERENCE) @ self.gradients[p] + 3.0 * p
                error = error + slow @ np.nan_to_num(position) ** np.arange(len(self.slow))
                error = error + self.noise * remembering(rng, self.n, self.noise_memory)
                number = np.full(self.n, c)
                place = np.full(self.n, position)
                rows.append((error * UM, place, number, 1440.0 * c + time, seen))
        error, place, cycle, times, T = (np.concatenate(each) for each in zip(*rows, strict=True))
        return made_readings(
            error, ("p",), position=place, cycle=cycle, time=times, role="drift",
            covariates=dict(zip(sensor_names(T.shape[1]), T.T, strict=True)),
        )  # fmt: skip


def rises(found: Readings, sensors: int) -> FloatArray:
    """(n, sensors) degC above the reference."""
    columns = [np.asarray(found.covariates[name], float) for name in sensor_names(sensors)]
    return np.column_stack(columns) - REFERENCE


def reordered(found: Readings, order: NDArray[np.int64]) -> Readings:
    arrays = ("code", "position_mm", "error", "pass_number", "has_pass", "direction", "cycle",
              "time_min", "file_index", "row", "dimension", "unit")  # fmt: skip
    return replace(
        found,
        covariates={name: values[order] for name, values in found.covariates.items()},
        **{name: getattr(found, name)[order] for name in arrays},
    )


def fitted(found: Readings, method: str = "ridge", zeroed: str = "auto") -> ThermalFit:
    """The fit of component p along x."""
    components = {"p": ("x", "um")}
    return thermal_fit(found, components, reference=REFERENCE, method=method, zeroed=zeroed)


def one(found: Readings, method: str = "ridge", zeroed: str = "auto") -> ComponentDrift:
    return fitted(found, method, zeroed).components["p"]
