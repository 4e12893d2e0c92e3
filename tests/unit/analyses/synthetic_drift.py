"""Drift readings made in memory from planted gradients, for the tests of thermal models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from mtu_cli.analyses.thermal_fit import thermal_fit
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, ThermalFit
from mtu_cli.files.readings import Readings
from mtu_cli.files.source import Source
from mtu_cli.stats.least_squares import FloatArray

UM = 1e-3
DAY = 1440.0
REFERENCE = 20.0
ROUNDING = 1e-9
"""Relative: doubles round by 2.2e-16, and the sensors' columns, of a condition of up to 1e3,
make its square of it.
"""


def ar1(rng: np.random.Generator, shape: tuple[int, ...], r: float) -> FloatArray:
    """Stationary noise of variance 1 along the first axis, with autocorrelation r^k."""
    e = rng.normal(size=shape)
    e[1:] *= np.sqrt(1 - r**2)
    return np.asarray(lfilter([1.0], [1.0, -r], e, axis=0), float)


def warm_up(rng: np.random.Generator, n: int, sensors: int, cycle: int, length: float = 190.0
            ) -> FloatArray:  # fmt: skip
    """(n, sensors) degC: every second cycle cools by the six degrees that the others warm by.

    Each sensor follows in its own time and has slow draughts of its own, so that they can be
    told apart.
    """
    t = np.linspace(0.0, length, n)[:, None]
    rise = 1 - np.exp(-t / np.geomspace(15.0, 120.0, sensors))
    rise = rise if cycle % 2 == 0 else rise[-1:] - rise
    return np.asarray(REFERENCE + 6 * rise + 0.5 * ar1(rng, (n, sensors), 0.97), float)


@dataclass(frozen=True, kw_only=True)
class Run:
    """One component at one position in one cycle: time (n,), temperature (n, s), error (n,) mm."""

    name: str = "p"
    position: float | None = None
    cycle: str | None = None
    time: FloatArray | None = None
    temperature: FloatArray
    error: FloatArray


def sensor_names(count: int) -> tuple[str, ...]:
    """T_01_degC, T_02_degC, ..."""
    return tuple(f"T_{s + 1:02d}_degC" for s in range(count))


def readings(runs: Sequence[Run]) -> Readings:
    """The runs one after the other as if read from a file."""
    names = tuple(dict.fromkeys(run.name for run in runs))
    cycles = tuple(dict.fromkeys(run.cycle for run in runs if run.cycle is not None))
    sizes = [len(run.error) for run in runs]
    n = sum(sizes)

    def numbers(values: Sequence[object]) -> FloatArray:
        parts = zip(values, sizes, strict=True)
        return np.concatenate([np.broadcast_to(np.asarray(v, float), k) for v, k in parts])

    def codes(values: Sequence[int]) -> NDArray[np.int64]:
        return np.repeat(np.array(values, np.int64), sizes)

    temperature = np.concatenate([run.temperature for run in runs])
    return Readings(
        components=names,
        code=codes([names.index(run.name) for run in runs]),
        position_mm=numbers([np.nan if run.position is None else run.position for run in runs]),
        error=numbers([run.error for run in runs]),
        dimension=np.ones(n, np.int8),
        pass_number=np.full(n, -1),
        has_pass=np.zeros(n, bool),
        direction=np.zeros(n, np.int8),
        cycles=cycles,
        cycle=codes([-1 if run.cycle is None else cycles.index(run.cycle) for run in runs]),
        time_min=numbers([np.nan if run.time is None else run.time for run in runs]),
        covariates={
            name: temperature[:, s] for s, name in enumerate(sensor_names(temperature.shape[1]))
        },
        file_index=np.zeros(n, np.int64),
        row=np.arange(2, n + 2),
        sources=(Source(role="drift", path=Path("d.csv"), shown="d.csv", sha256="", rows=None),),
        roles=("drift",),
    )


def rises(found: Readings, sensors: int) -> FloatArray:
    """(n, sensors) degC above the reference."""
    columns = [np.asarray(found.covariates[name], float) for name in sensor_names(sensors)]
    return np.column_stack(columns) - REFERENCE


def reordered(found: Readings, order: NDArray[np.int64]) -> Readings:
    """Some rows of readings, in another order."""
    arrays = ("code", "position_mm", "error", "pass_number", "has_pass", "direction", "cycle",
              "time_min", "file_index", "row", "dimension")  # fmt: skip
    return replace(
        found,
        covariates={name: values[order] for name, values in found.covariates.items()},
        **{name: getattr(found, name)[order] for name in arrays},
    )


@dataclass(frozen=True, kw_only=True)
class Plan:
    """`gradients` (positions, s) um per degC at `positions`, n readings a cycle, `step` min apart.

    `noise` um of each reading, following itself with `noise_memory`; `slow` um/mm^m of a misfit
    that all positions share, a polynomial whose coefficients each follow themselves with
    `memory`; `sensor_noise` degC of each temperature reading.
    """

    gradients: FloatArray
    positions: tuple[float | None, ...] = (None,)
    cycles: int = 4
    n: int = 80
    step: float = 2.0
    noise: float = 0.2
    noise_memory: float = 0.0
    slow: tuple[float, ...] = ()
    memory: float = 0.95
    sensor_noise: float = 0.0

    def temperatures(self, rng: np.random.Generator) -> list[FloatArray]:
        """True temperatures (n, s) of every cycle."""
        count = self.gradients.shape[1]
        return [warm_up(rng, self.n, count, c) for c in range(self.cycles)]

    def time(self, cycle: int) -> FloatArray:
        """Times (n,) of a cycle, min."""
        return cycle * DAY + self.step * np.arange(self.n, dtype=np.float64)

    def runs(
        self, rng: np.random.Generator, temperatures: Sequence[FloatArray] | None = None
    ) -> list[Run]:
        """Runs by cycle and position; all positions are read at the same times."""
        found = []
        for c, true in enumerate(temperatures or self.temperatures(rng)):
            read = true + self.sensor_noise * rng.normal(size=true.shape)
            slow = np.array(self.slow) * ar1(rng, (self.n, len(self.slow)), self.memory)
            for p, position in enumerate(self.positions):
                error = (true - REFERENCE) @ self.gradients[p] + 3.0 * p
                error = error + slow @ float(position or 0.0) ** np.arange(len(self.slow))
                error = error + self.noise * ar1(rng, (self.n,), self.noise_memory)
                found.append(Run(position=position, cycle=f"c{c}", time=self.time(c),
                                 temperature=read, error=error * UM))  # fmt: skip
        return found

    def read(
        self, rng: np.random.Generator, temperatures: Sequence[FloatArray] | None = None
    ) -> Readings:
        """The readings of `runs`."""
        return readings(self.runs(rng, temperatures))


METHODS = ("auto", "stepwise", "ridge", "lagged")
LINE = np.array([[1.0, -2.0, 0.0, 0.5], [1.5, -1.0, 0.0, 0.5], [2.0, 0.0, 0.0, 0.5]])
PLACES = (0.0, 100.0, 200.0)
"""Gradients that are a line in position, and where; um per degC, mm."""


def fitted(found: Readings, method: str = "ridge") -> ThermalFit:
    """The fit of component p along x."""
    return thermal_fit(found, {"p": ("x", "um")}, reference=REFERENCE, method=method)


def one(found: Readings, method: str = "ridge") -> ComponentDrift:
    """The drift of component p along x."""
    return fitted(found, method).components["p"]
