"""Temperatures of a machine's sensors in a room that is warmed and cooled.

A sensor sees the air of its place and follows it with a lag of its own; places differ by their
share of the room's rise (the gradient) and by draughts. Every sensor has its own streams, so that
more cycles, or another noise, leave the rest as it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

WOBBLE_MEMORY_MIN = 15.0
"""Correlation time of draughts and of the air conditioning's swings."""
_STREAM = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Climate:
    """The room and what its sensors make of it; temperatures in degC, times in min.

    The room goes from `low` to `high` and back with the lag `room_lag`; on top of it
    `room_wobble` for all and `sensor_wobble` for each sensor, standard deviations of
    Ornstein-Uhlenbeck processes. Sensors follow with lags spread over `sensor_lag` (lowest,
    highest; evenly in the logarithm), with shares of the room's rise of 1 +- `sensor_spread`,
    and read with the standard deviation `sensor_noise`.
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

    def columns(self) -> tuple[str, ...]:
        """All columns of temperatures, the twins behind the others."""
        return (*self.names, *(name for name, _ in self.twins))


def drawn_sensors(
    names: tuple[str, ...], climate: Climate, twins: tuple[tuple[str, str], ...], seed: int
) -> Sensors:
    """Lags and shares of the sensors, each from its own stream."""
    draws = np.array([stream(seed, _STREAM, 0, s).random(2) for s in range(len(names))])
    low, high = climate.sensor_lag
    lags = low + (high - low) * draws[:, 0] if low <= 0 else low * (high / low) ** draws[:, 0]
    shares = 1.0 + climate.sensor_spread * (2.0 * draws[:, 1] - 1.0)
    return Sensors(names=names, lags=lags, shares=shares, twins=twins)


def followed(
    climate: Climate, sensors: Sensors, targets: FloatArray, step: float, seed: int
) -> FloatArray:
    """Noise-free temperatures (n, s) every `step` min while the room is driven to `targets` (n,).

    Room and sensors start settled at the reference, without wobble.
    """
    n = len(targets)
    times = np.arange(n, dtype=np.float64) * step
    driven = np.concatenate([[climate.reference], targets[1:]])
    room = _lagged(driven, times, climate.room_lag) + _wobble(
        climate.room_wobble, n, step, stream(seed, _STREAM, 1)
    )
    found = np.empty((n, len(sensors.names)))
    for s, (lag, share) in enumerate(zip(sensors.lags, sensors.shares, strict=True)):
        draught = _wobble(climate.sensor_wobble, n, step, stream(seed, _STREAM, 2, s))
        air = climate.reference + share * (room - climate.reference) + draught
        found[:, s] = _lagged(air, times, float(lag))
    return found


def _lagged(signal: FloatArray, times: FloatArray, lag: float) -> FloatArray:
    lagged: FloatArray = first_order_lag(signal[:, None], times, np.array([lag]))[0, :, 0]
    return lagged


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
    """Noise-free temperatures (r, s) with the room settled at each of `rooms`, degC.

    Each has its own draughts at the sensors, of standard deviation `wobble`.
    """
    draughts = np.array(
        [
            [stream(seed, _STREAM, 3, r, s).standard_normal() for s in range(len(sensors.names))]
            for r in range(len(rooms))
        ]
    ).reshape(len(rooms), len(sensors.names))
    rise = sensors.shares * (rooms[:, None] - climate.reference)
    temperatures: FloatArray = climate.reference + rise + wobble * draughts
    return temperatures


def as_read(
    climate: Climate, sensors: Sensors, true: Mapping[str, FloatArray], seed: int, part: int = 0
) -> dict[str, FloatArray]:
    """What the sensors read: the true temperatures, twins included, each with its own noise."""
    places = {name: name for name in sensors.names} | dict(sensors.twins)
    return {
        name: true[place]
        + climate.sensor_noise * stream(seed, _STREAM, 5, part, c).standard_normal(len(true[place]))
        for c, (name, place) in enumerate(places.items())
    }
