"""Simulated drift tests: climate, and readings of drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

WOBBLE_MEMORY_MIN = 15.0
"""Correlation time of draughts and of the air conditioning's swings."""
_CLIMATE_STREAM = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Climate:
    """The room and what its sensors make of it; temperatures in degC, times in min. The room goes
    from `low` to `high` and back with the lag `room_lag`; on top of it `room_wobble` for all and
    `sensor_wobble` for each sensor, standard deviations of Ornstein-Uhlenbeck processes. Sensors
    follow with lags spread over `sensor_lag` (lowest, highest; evenly in the logarithm), with
    shares of the room's rise of 1 +- `sensor_spread`, and read with the standard deviation
    `sensor_noise`.
    """

    reference: float
    low: float
    high: float
    room_lag: float
    room_wobble: float
    sensor_lag: tuple[float, float]
    sensor_spread: float
    sensor_wobble: float
    sensor_noise: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Names, lags (s,) in min and shares (s,) of the room's rise above the reference.

    `twins` (name, sensor): a second sensor at the same place, with a noise of its own.
    """

    names: tuple[str, ...]
    lags: FloatArray
    shares: FloatArray
    twins: tuple[tuple[str, str], ...] = ()


def followed(
    climate: Climate, sensors: Sensors, targets: FloatArray, step: float, seed: int
) -> FloatArray:
    """Noise-free temperatures (n, s) every `step` min while the room is driven to `targets` (n,);
    room and sensors start settled at the reference.
    """
    n = len(targets)
    times = np.arange(n, dtype=np.float64) * step
    driven = np.concatenate([[climate.reference], targets[1:]])
    room = _lagged(driven, times, climate.room_lag) + _wobble(
        climate.room_wobble, n, step, stream(seed, _CLIMATE_STREAM, 1)
    )
    result = np.empty((n, len(sensors.names)))
    for s, (lag, share) in enumerate(zip(sensors.lags, sensors.shares, strict=True)):
        draught = _wobble(climate.sensor_wobble, n, step, stream(seed, _CLIMATE_STREAM, 2, s))
        air = climate.reference + share * (room - climate.reference) + draught
        result[:, s] = _lagged(air, times, float(lag))
    return result


def _lagged(signal: FloatArray, times: FloatArray, lag: float) -> FloatArray:
    return first_order_lag(signal[:, None], times, np.array([lag]))[0, :, 0]


def _wobble(deviation: float, n: int, step: float, rng: np.random.Generator) -> FloatArray:
    """An Ornstein-Uhlenbeck process from 0: w_i = q w_(i-1) + sqrt(1 - q^2) deviation z_i."""
    q = np.exp(-step / WOBBLE_MEMORY_MIN)
    kicks = deviation * np.sqrt(1.0 - q * q) * rng.standard_normal(max(n - 1, 0))
    values = np.zeros(n)
    for i, kick in enumerate(kicks, start=1):
        values[i] = q * values[i - 1] + kick
    return values


def settled(
    climate: Climate, sensors: Sensors, rooms: FloatArray, wobble: float, seed: int
) -> FloatArray:
    """Noise-free temperatures (r, s) with the room settled at each of `rooms`, degC, each with
    draughts of its own of standard deviation `wobble`.
    """
    draughts = np.empty((len(rooms), len(sensors.names)))
    for r, s in np.ndindex(draughts.shape):
        draughts[r, s] = stream(seed, _CLIMATE_STREAM, 3, r, s).standard_normal()
    rise = sensors.shares * (rooms[:, None] - climate.reference)
    return climate.reference + rise + wobble * draughts


def as_read(
    climate: Climate, sensors: Sensors, true: Mapping[str, FloatArray], seed: int, part: int = 0
) -> dict[str, FloatArray]:
    """What the sensors read: the true temperatures, twins included, each with its own noise."""
    places = {name: name for name in sensors.names} | dict(sensors.twins)
    return {
        name: true[place]
        + climate.sensor_noise
        * stream(seed, _CLIMATE_STREAM, 5, part, c).standard_normal(len(true[place]))
        for c, (name, place) in enumerate(places.items())
    }


_DRIFT_STREAM = 6
_REACHED = 1e-6
"""Of the rise: drifts that the sensors' shares miss by more are undefined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftPlan:
    """A drift test: `cycles` warm-ups and cool-downs in turn, times in min, read every `interval`
    for `minutes`, then `soak` without readings; each component at its `positions` (mm, by name; nan
    where it has no axis). `noise` is a reading's standard deviation by dimension of the unit, mm
    and rad. `settled` (mm or rad, by component) are the drifts at the positions once the room has
    settled at `high`; those of other components are kept within `limits`, by dimension.
    """

    climate: Climate
    cycles: int
    minutes: float
    interval: float
    soak: float
    positions: Mapping[str, FloatArray]
    noise: Mapping[int, float]
    settled: Mapping[str, FloatArray]
    limits: Mapping[int, float]
    twins: tuple[tuple[str, str], ...] = ()

    @property
    def moments(self) -> int:
        """Readings of one place in one cycle."""
        return int(np.floor(self.minutes / self.interval * (1 + 1e-12))) + 1


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


class _Target(NamedTuple):
    """Settled drifts `value` (places,) of a component in its unit, `G` (places, s) per degC."""

    drift: ThermalEstimate
    G: FloatArray
    value: FloatArray


def sensors_for(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> Sensors:
    """The sensors of all drifts; shares moved as little as it takes to keep the drifts sensible:
    with the seeded shares a0, gradients G (places, s) and rise R = high - reference the settled
    drifts are R G a. Where one is asked for or exceeds its limit it becomes a target d of a = a0 +
    G^+ (d/R - G a0), the solution nearest to a0. Limits that the sensors cannot keep beside the
    other drifts are left alone.

    Raises InputError where the sensors cannot give the drifts that are asked for.
    """
    names = tuple(sorted({sensor for drift in drifts for sensor in drift.sensors}))
    climate = plan.climate
    draws = np.array([stream(seed, _CLIMATE_STREAM, 0, s).random(2) for s in range(len(names))])
    low, high = climate.sensor_lag
    lags = low + (high - low) * draws[:, 0] if low <= 0 else low * (high / low) ** draws[:, 0]
    drawn = 1.0 + climate.sensor_spread * (2.0 * draws[:, 1] - 1.0)
    rise = climate.high - climate.reference
    asked, within, beyond = [], [], []
    for drift in drifts:
        scale, positions = drift.unit.to_internal, plan.positions[drift.component]
        G = np.zeros((len(positions), len(names)))
        place = np.zeros(len(positions)) if drift.degree == 0 else positions
        G[:, [names.index(sensor) for sensor in drift.sensors]] = drift.gradients(place).T / scale
        free, limit = rise * G @ drawn, plan.limits[drift.unit.dimension] / scale
        if drift.component in plan.settled:
            asked.append(_Target(drift, G, plan.settled[drift.component] / scale))
        elif (np.abs(free) <= limit).all():
            within.append(_Target(drift, G, free))
        else:
            beyond.append(_Target(drift, G, np.clip(free, -limit, limit)))
    _check_reached(asked, plan, drawn, rise)
    kept = asked
    # Limits come last: they may give way, and what is within them shall stay so.
    for item in (*within, *beyond):
        if _missed([*kept, item], drawn, rise)[1] <= 1.0:
            kept = [*kept, item]
    shares, _ = _missed(kept, drawn, rise)
    return Sensors(names=names, lags=lags, shares=shares, twins=plan.twins)


def _missed(
    targets: Sequence[_Target], shares: FloatArray, rise: float
) -> tuple[FloatArray, float]:
    """The nearest shares (s,) that come closest to the targets; by how much they miss them."""
    if not targets:
        return shares, 0.0
    G = np.concatenate([item.G for item in targets])
    value = np.concatenate([item.value for item in targets])
    moved = shares
    if rise != 0:
        moved = shares + np.linalg.pinv(G) @ (value / rise - G @ shares)
    reach = _REACHED * max(1.0, float(np.abs(value).max()))
    return moved, float(np.abs(rise * G @ moved - value).max()) / reach


def _check_reached(
    asked: Sequence[_Target], plan: DriftPlan, shares: FloatArray, rise: float
) -> None:
    """Refuses settled drifts that are asked for and undefined, naming the one missed by most."""
    moved, missed = _missed(asked, shares, rise)
    if missed <= 1.0:
        return
    drift, G, value = max(asked, key=lambda x: np.abs(rise * x.G @ moved - x.value).max())
    found = rise * G @ moved
    i, unit = int(np.argmax(np.abs(found - value))), drift.unit.name
    position = plan.positions[drift.component][i]
    at = "" if np.isnan(position) else f" at {position:g} mm"
    raise error(
        "not-applicable",
        reason=f"--settled-drift: no shares of the sensors in the rise of {rise:.4g} degC give "
        f"{drift.component} the settled drift{at}",
        value=f"{drift.component}: {' '.join(f'{each:g}' for each in value)}",
        expected=f"instead of {value[i]:g} {unit} about {found[i]:.4g} {unit} (nearest for all "
        "that is asked): drifts differ only where the gradients of the sensors do",
    )


def simulate_drift(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> SimulatedDrift:
    """Readings of every component that drifts, cycle by cycle: warm-ups first, in turn."""
    sensors = sensors_for(drifts, plan, seed)
    period = plan.moments + round(plan.soak / plan.interval)
    cool = np.repeat(np.arange(plan.cycles) % 2, period)
    targets = np.where(cool, plan.climate.low, plan.climate.high)
    true = followed(plan.climate, sensors, targets, plan.interval, seed)
    count = len(true)
    times = np.arange(count, dtype=np.float64) * plan.interval
    read = as_read(plan.climate, sensors, dict(zip(sensors.names, true.T, strict=True)), seed)
    kept = (np.arange(count) % period < plan.moments).nonzero()[0].reshape(plan.cycles, -1)
    rows: list[tuple[str, str, float, FloatArray]] = []
    for number, item in enumerate(drifts):
        # A drift follows a sensor's temperature, or its lag.
        known = {
            sensor: _lagged(true[:, sensors.names.index(sensor)], times, float(lag))
            for sensor, lag in zip(item.sensors, item.time_constants, strict=True)
        }
        for p, position in enumerate(plan.positions[item.component]):
            errors = item.drift(np.full(count, np.nan_to_num(position)), known)
            # What the model leaves at a position, one draw a cycle.
            power = np.nan_to_num(position) ** np.arange(len(item.leftover))
            draws = stream(seed, _DRIFT_STREAM, 0, number).standard_normal(
                (plan.cycles, len(power))
            )
            leftover = draws @ (power @ covariance_root(item.leftover))
            errors += leftover[np.arange(count) // period]
            rng = stream(seed, _DRIFT_STREAM, 1, number, p)
            errors += plan.noise[item.unit.dimension] * rng.standard_normal(count)
            rows.append((item.component, item.unit.name, position, errors / item.unit.to_internal))
    each = [(cycle, row) for cycle in range(plan.cycles) for row in rows]
    n, at = kept.shape[1], np.concatenate([kept[cycle] for cycle, _ in each])
    return SimulatedDrift(
        component=tuple(row[0] for _, row in each for _ in range(n)),
        unit=tuple(row[1] for _, row in each for _ in range(n)),
        position=np.repeat([row[2] for _, row in each], n),
        cycle=np.repeat([cycle + 1 for cycle, _ in each], n),
        time=times[at],
        error=np.concatenate([row[3][kept[cycle]] for cycle, row in each]),
        temperatures={name: values[at] for name, values in read.items()},
        sensors=sensors,
    )
