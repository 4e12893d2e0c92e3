"""Temperatures that no sensor of a machine reads: codes, spikes, stuck sensors, other units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mtu_cli.checks import Odd, PointsData, ReadingsData, check
from mtu_cli.checks.plausible import SENSOR_CODES, SENSOR_DEGC, SENSOR_STEP_K, SHOP_DEGC
from mtu_cli.files.covariates import is_temperature

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]
Data = ReadingsData | PointsData
STUCK_SHARE, OTHERS_MOVE_K = 0.5, 0.5
NEAR_K = 8.0
"""Converted readings lie so near to those of the other sensors."""


def sensors(data: Data) -> Iterator[tuple[str, Floats]]:
    """Every temperature column and its values (n,)."""
    for name, values in data.table.covariates.items():
        if is_temperature(name) and values.dtype != object:
            yield name, np.asarray(values, np.float64)


def other_unit(data: Data, name: str, values: Floats) -> str | None:
    """``degF`` or ``K`` where a whole column would agree with the other sensors in that unit."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    middle = float(np.median(known))
    others = [float(np.nanmedian(each)) for own, each in sensors(data)
              if own != name and np.isfinite(each).any()]  # fmt: skip
    near = float(np.median(others)) if others else 20.0
    tried = {"K": middle - 273.15, "degF": (middle - 32) / 1.8}
    for unit, converted in tried.items():
        sound = SHOP_DEGC[0] <= converted <= SHOP_DEGC[1]
        if not sound or abs(converted - middle) < NEAR_K:
            continue
        alone = middle > SHOP_DEGC[1] and abs(near - middle) < NEAR_K
        if alone or (abs(converted - near) < NEAR_K < 3 * NEAR_K < abs(middle - near)):
            return unit
    return None


@check("sensor-unit", of=("drift", "points"))
def unit(data: Data) -> Iterator[Odd]:
    """A column that agrees with the other sensors in degF or K alone."""
    for name, values in sensors(data):
        if meant := other_unit(data, name, values):
            rows = np.flatnonzero(np.isfinite(values))
            yield Odd(rows, {"unit": meant}, name, f"{values[rows[0]]:g}")


@check("sensor-out-of-range", of=("drift", "points"))
def out_of_range(data: Data) -> Iterator[Odd]:
    """Temperatures of no machine."""
    low, high = SENSOR_DEGC
    for name, values in sensors(data):
        rows = np.flatnonzero((values < low) | (values > high))
        if len(rows) and not other_unit(data, name, values):
            yield Odd(rows, {"low": low, "high": high}, name, f"{values[rows[0]]:g}")


def series(data: Data) -> Iterator[Rows]:
    """Rows in the order of time: of each cycle of drift, one row for every set of temperatures."""
    table = data.table
    time = np.asarray(table.time_min, np.float64)
    cycle = getattr(table, "cycle", np.zeros(len(time), np.int64))
    order = np.lexsort((np.arange(len(time)), time, cycle))
    yield from np.split(order, np.flatnonzero(np.diff(cycle[order])) + 1)


@check("sensor-spike", of=("drift", "points"))
def spike(data: Data) -> Iterator[Odd]:
    """Readings beyond all of their neighbours' by more than the sensor ever steps."""
    for name, values in sensors(data):
        found = [rows[_beyond_neighbours(values[rows])] for rows in series(data)]
        inside = (values >= SENSOR_DEGC[0]) & (values <= SENSOR_DEGC[1])
        rows = np.sort(np.concatenate(found)) if found else np.zeros(0, np.int64)
        if len(rows := rows[inside[rows]]):
            code = np.isin(values[rows], SENSOR_CODES).all()
            text = "an error code of the sensor" if code else "a spike of the sensor"
            yield Odd(rows, {"looks": text}, name, f"{values[rows[0]]:g}")


def _beyond_neighbours(values: Floats) -> NDArray[np.bool_]:
    """Which are outside the two different readings before and after by three large steps."""
    # Readings of several components at one moment hold one temperature: one of a run is enough.
    changes = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    short = values[changes]
    if len(short) < 6:
        return np.zeros(len(values), bool)
    padded = np.concatenate([[np.nan] * 2, short, [np.nan] * 2])
    window = np.lib.stride_tricks.sliding_window_view(padded, 5)
    around = np.sort(window[:, [0, 1, 3, 4]], axis=1)  # nan last: two at the ends
    known = np.isfinite(around).sum(axis=1)
    # One neighbour may be a spike itself: the second of them counts where four are known.
    low = np.where(known > 3, around[:, 1], around[:, 0])
    high = np.where(known > 3, around[:, 2], around[np.arange(len(short)), known - 1])
    away = np.maximum(np.maximum(short - high, low - short), 0.0)
    step = float(np.quantile(np.abs(np.diff(short)), 0.8))
    inner = np.arange(len(short)) > 0
    odd = (away > max(SENSOR_STEP_K, 4 * step)) & inner
    return odd[np.searchsorted(changes, np.arange(len(values)), side="right") - 1]


@check("stuck-sensor", of=("drift", "points"))
def stuck(data: Data) -> Iterator[Odd]:
    """A sensor that stays where it is to the last digit while others move."""
    known = dict(sensors(data))
    # The temperatures of points stand still while one part is measured.
    share, fewest = (1.0, 2) if isinstance(data, PointsData) else (STUCK_SHARE, 1)
    spans = {name: float(np.nanmax(v) - np.nanmin(v)) for name, v in known.items()
             if np.isfinite(v).any()}  # fmt: skip
    for name, values in known.items():
        others = [span for other, span in spans.items() if other != name]
        # One other sensor beside points may well be in the air, and this one in the part.
        if len(others) < fewest or np.median(others) < OTHERS_MOVE_K or len(values) < 10:
            continue
        order = np.concatenate(list(series(data)))
        own = values[order]
        ends = np.flatnonzero(np.diff(own, append=np.nan) != 0)
        lengths = np.diff(ends, prepend=-1)
        longest = int(np.argmax(lengths))
        rows = np.sort(order[ends[longest] - lengths[longest] + 1 : ends[longest] + 1])
        moved = max(float(np.ptp(v[rows])) for other, v in known.items() if other != name)
        if len(rows) >= share * len(own) and moved >= OTHERS_MOVE_K:
            yield Odd(rows, {"others": moved}, name, f"{values[rows[0]]:g}")
