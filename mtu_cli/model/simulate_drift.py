"""Simulated drift tests: climate, and readings of drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM

WOBBLE_MEMORY_MIN = 15.0
"""Correlation time of draughts and of the air conditioning's swings."""
_CLIMATE_STREAM, _DRIFT_STREAM = 4, 6
_REACHED = 1e-6
"""Of the rise: drifts that the sensors' shares miss by more are undefined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftPlan:
    """A drift test: temperatures in degC, times in min.

    The room goes from `low` to `high` and back with the lag `room_lag`; on top of it `room_wobble`
    for all and `sensor_wobble` for each sensor, standard deviations of Ornstein-Uhlenbeck
    processes. Sensors follow with lags spread over `sensor_lag` (lowest, highest; evenly in the
    logarithm), with shares of the room's rise of 1 +- `sensor_spread`, and read with the standard
    deviation `sensor_noise`. While parts are measured the room is settled, with draughts of the
    standard deviation `parts_wobble` at each sensor.

    `cycles` warm-ups and cool-downs in turn, read every `interval` for `minutes`, then `soak`
    without readings; each component at its `positions` (mm, by name; nan where it has no axis).
    `noise` is a reading's standard deviation by dimension of the unit, mm and rad. `settled` (mm or
    rad, by component) are the drifts at the positions once the room has settled at `high`; those of
    other components stay within `limits`, by dimension. `twins` (name, sensor): a second sensor at
    the same place, with independent noise.
    """

    reference: float
    low: float = 20.0
    high: float = 26.0
    room_lag: float = 30.0
    room_wobble: float = 0.5
    sensor_lag: tuple[float, float] = (5.0, 25.0)
    sensor_spread: float = 0.05
    sensor_wobble: float = 0.8
    sensor_noise: float
    parts_wobble: float = 0.1
    cycles: int
    minutes: float = 190.0
    interval: float
    soak: float = 120.0
    positions: Mapping[str, FloatArray]
    noise: Mapping[int, float]
    settled: Mapping[str, FloatArray]
    limits: Mapping[int, float] = field(
        default_factory=lambda: {LENGTH: 40.0 * UM, ANGLE: 40.0 * ARCSEC}
    )
    twins: tuple[tuple[str, str], ...] = ()

    @property
    def moments(self) -> int:
        """Readings of one place in one cycle."""
        return int(np.floor(self.minutes / self.interval * (1 + 1e-12))) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Names, lags (s,) in min and shares (s,) of the room's rise above the reference."""

    names: tuple[str, ...]
    lags: FloatArray
    shares: FloatArray


def followed(plan: DriftPlan, sensors: Sensors, targets: FloatArray, seed: int) -> FloatArray:
    """Noise-free temperatures (n, s) every interval while the room is driven to `targets` (n,);
    room and sensors start settled at the reference.
    """
    n, reference, step = len(targets), plan.reference, plan.interval
    times = np.arange(n, dtype=np.float64) * step
    q = np.exp(-step / WOBBLE_MEMORY_MIN)

    def lagged(signal: FloatArray, lag: float) -> FloatArray:
        return first_order_lag(signal[:, None], times, np.array([lag]))[0, :, 0]

    def wobble(deviation: float, *place: int) -> FloatArray:
        """An Ornstein-Uhlenbeck process from 0: w_i = q w_(i-1) + sqrt(1 - q^2) deviation z_i."""
        z = stream(seed, _CLIMATE_STREAM, *place).standard_normal(max(n - 1, 0))
        values = [0.0]
        for kick in (deviation * np.sqrt(1.0 - q * q) * z).tolist():
            values.append(q * values[-1] + kick)
        return np.array(values)

    driven = lagged(np.concatenate([[reference], targets[1:]]), plan.room_lag)
    room = driven + wobble(plan.room_wobble, 1)
    air = [
        reference + share * (room - reference) + wobble(plan.sensor_wobble, 2, s)
        for s, share in enumerate(sensors.shares)
    ]
    return np.column_stack([lagged(T, lag) for T, lag in zip(air, sensors.lags, strict=True)])


def settled(plan: DriftPlan, sensors: Sensors, rooms: FloatArray, seed: int) -> FloatArray:
    """Noise-free temperatures (r, s) with the room settled at each of `rooms`, degC, each with
    independent draughts.
    """
    draughts = np.empty((len(rooms), len(sensors.names)))
    for r, s in np.ndindex(draughts.shape):
        draughts[r, s] = stream(seed, _CLIMATE_STREAM, 3, r, s).standard_normal()
    rise = sensors.shares * (rooms[:, None] - plan.reference)
    return plan.reference + rise + plan.parts_wobble * draughts


def as_read(
    plan: DriftPlan, sensors: Sensors, true: Mapping[str, FloatArray], seed: int, part: int = 0
) -> dict[str, FloatArray]:
    """What the sensors read: the true temperatures, twins included, each with its own noise."""
    places = {name: name for name in sensors.names} | dict(plan.twins)
    return {
        name: true[place]
        + plan.sensor_noise
        * stream(seed, _CLIMATE_STREAM, 5, part, c).standard_normal(len(true[place]))
        for c, (name, place) in enumerate(places.items())
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedDrift:
    """Columns of a drift file, rows by (cycle, component, position, time): `error` in each
    component's own unit, `time` in min, `temperatures` in degC as read; `sensors` say how they
    follow the room.
    """

    component: tuple[str, ...]
    unit: tuple[str, ...]
    position: FloatArray
    cycle: np.ndarray
    time: FloatArray
    error: FloatArray
    temperatures: dict[str, FloatArray]
    sensors: Sensors


def sensors_for(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> Sensors:
    """The sensors of all drifts; shares moved as little as it takes to keep the drifts sensible:
    with the seeded shares a0, gradients G (places, s) and rise R = high - reference the settled
    drifts are R G a. Where one is requested or exceeds its limit it becomes a target d of a = a0 +
    G^+ (d/R - G a0), the solution nearest to a0. Limits that the sensors cannot keep along with
    the other drifts are dropped.

    Raises InputError where the sensors cannot give the requested drifts.
    """
    names = tuple(sorted({sensor for drift in drifts for sensor in drift.sensors}))
    draws = np.array([stream(seed, _CLIMATE_STREAM, 0, s).random(2) for s in range(len(names))])
    low, high = plan.sensor_lag
    lags = low + (high - low) * draws[:, 0] if low <= 0 else low * (high / low) ** draws[:, 0]
    a0 = shares = 1.0 + plan.sensor_spread * (2.0 * draws[:, 1] - 1.0)
    rise = plan.high - plan.reference
    targets = []
    for drift in drifts:
        scale, positions = drift.unit.to_internal, plan.positions[drift.component]
        G = np.zeros((len(positions), len(names)))
        place = np.zeros(len(positions)) if drift.degree == 0 else positions
        G[:, [names.index(sensor) for sensor in drift.sensors]] = drift.gradients(place).T / scale
        raw, limit = rise * G @ a0, plan.limits[drift.unit.dimension] / scale
        value, rank = np.clip(raw, -limit, limit), 1 + bool((np.abs(raw) > limit).any())
        if drift.component in plan.settled:
            value, rank = plan.settled[drift.component] / scale, 0
        targets.append((rank, drift, G, value))
    base_G, base = np.zeros((0, len(names))), np.zeros(0)
    # Limits come last: they may give way, and what is within them shall stay so.
    for rank, drift, G, value in sorted(targets, key=lambda target: target[0]):
        all_G, d = np.vstack([base_G, G]), np.concatenate([base, value])
        a = a0
        if rise != 0:
            a = a0 + np.linalg.pinv(all_G) @ (d / rise - all_G @ a0)
        residual = np.abs(rise * all_G @ a - d).max()
        if residual <= _REACHED * max(1.0, float(np.abs(d).max())):
            base_G, base, shares = all_G, d, a
        elif rank == 0:
            requested, near = (" ".join(f"{x:.4g}" for x in y) for y in (value, rise * G @ a))
            raise error(
                "not-applicable",
                reason=f"--settled-drift: no shares of the sensors in the rise of {rise:.4g} degC "
                f"give {drift.component} the settled drift",
                value=f"{drift.component}: {requested}",
                expected=f"about {near} {drift.unit.name} (nearest to all that is asked): drifts "
                "differ only where the gradients of the sensors do",
            )
    return Sensors(names=names, lags=lags, shares=shares)


def simulate_drift(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> SimulatedDrift:
    """Readings of every component that drifts, cycle by cycle: warm-ups first, in turn."""
    sensors = sensors_for(drifts, plan, seed)
    period = plan.moments + round(plan.soak / plan.interval)
    cool = np.repeat(np.arange(plan.cycles) % 2, period)
    targets = np.where(cool, plan.low, plan.high)
    true = followed(plan, sensors, targets, seed)
    count = len(true)
    times = np.arange(count, dtype=np.float64) * plan.interval
    read = as_read(plan, sensors, dict(zip(sensors.names, true.T, strict=True)), seed)
    at = (np.arange(count) % period < plan.moments).nonzero()[0].reshape(plan.cycles, -1)
    rows: list[tuple[str, str, float]] = []
    errors: list[FloatArray] = []
    for number, item in enumerate(drifts):
        # A drift follows a sensor's temperature, or its lag.
        columns = true[:, [sensors.names.index(sensor) for sensor in item.sensors]]
        lagged = first_order_lag(columns, times, item.time_constants).diagonal(axis1=0, axis2=2)
        temperatures = dict(zip(item.sensors, lagged.T, strict=True))
        # The leftover, one draw a cycle, and the noise of every reading.
        shape = plan.cycles, len(item.leftover)
        draws = stream(seed, _DRIFT_STREAM, 0, number).standard_normal(shape)
        noise = plan.noise[item.unit.dimension]
        for p, position in enumerate(plan.positions[item.component]):
            place = np.nan_to_num(position)
            root = place ** np.arange(shape[1]) @ covariance_root(item.leftover)
            error = item.drift(np.full(count, place), temperatures)
            error = error + (draws @ root)[np.arange(count) // period]
            error += noise * stream(seed, _DRIFT_STREAM, 1, number, p).standard_normal(count)
            rows.append((item.component, item.unit.name, position))
            errors.append((error / item.unit.to_internal)[at])
    table = np.stack(errors, axis=1)
    components, units, positions = (np.array(each) for each in zip(*rows, strict=True))

    def spread(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, table.shape).ravel()

    return SimulatedDrift(
        component=tuple(spread(components[:, None]).tolist()),
        unit=tuple(spread(units[:, None]).tolist()),
        position=spread(positions[:, None]),
        cycle=spread(np.arange(plan.cycles)[:, None, None] + 1),
        time=spread(times[at][:, None]),
        error=table.ravel(),
        temperatures={name: spread(values[at][:, None]) for name, values in read.items()},
        sensors=sensors,
    )
