"""Temperatures that no sensor of a machine reads: codes, spikes, stuck sensors, other units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.checks import Floats, Odd, PointsData, ReadingsData, check, split
from mtu_cli.checks.plausible import (
    OTHERS_MOVE_K,
    SENSOR_STEP_K,
    SENSORS_NEAR_K,
    SHOP_DEGC,
    STUCK_SHARE,
)
from mtu_cli.files.covariates import SENSOR_DEGC, is_temperature
from mtu_cli.stats.outliers import spikes
from mtu_cli.stats.resolution import rounding_variance

Data = ReadingsData | PointsData


def sensors(data: Data) -> dict[str, Floats]:
    """Every temperature column with a value, and its values (n,)."""
    return {
        name: values
        for name, values in data.table.covariates.items()
        if is_temperature(name) and values.dtype != object and np.isfinite(values).any()
    }


@check("sensor-out-of-range", of=("readings", "drift", "points"))
def out_of_range(data: Data) -> Iterator[Odd]:
    """Temperatures of no machine, and a column that agrees with the others in degF or K alone, or
    together with them is in that unit.
    """
    low, high = SENSOR_DEGC
    coldest, hottest = SHOP_DEGC
    columns = sensors(data)
    middles = {name: float(np.nanmedian(values)) for name, values in columns.items()}
    for name, middle in middles.items():
        facts, values = {"low": low, "high": high, "unit": ""}, columns[name]
        rows = np.flatnonzero((values < low) | (values > high))
        rest = [item for other, item in middles.items() if other != name]
        reference = float(np.median(rest)) if rest else 20.0
        for unit, converted in (("degF", (middle - 32) / 1.8), ("K", middle - 273.15)):
            odd = abs(converted - reference) < SENSORS_NEAR_K < abs(middle - reference) / 3
            if reference > hottest:
                odd = middle > hottest
            if odd and coldest <= converted <= hottest:
                rows, facts["unit"] = np.flatnonzero(~np.isnan(values)), unit
        if facts["unit"]:
            yield Odd(rows, facts, name, f"{values[rows[0]]:g}", code="sensor-unit")
        elif len(rows):
            yield Odd(rows, facts, name, values=values[rows])


@check("sensor-spike", of=("drift", "points"))
def spike(data: Data) -> Iterator[Odd]:
    """Readings beyond all of their neighbours' by more than the sensor ever steps."""
    table = data.table
    cycle = getattr(table, "cycle", table.file_index)
    runs = split(np.argsort(table.time_min, kind="stable"), cycle)
    for name, values in sensors(data).items():
        odd = np.zeros(len(values), bool)
        for rows in runs:
            # Readings of several components at one moment hold one temperature.
            changes = np.flatnonzero(np.diff(values[rows], prepend=np.nan) != 0)
            sampled = values[rows[changes]]
            mask, _ = spikes(sampled, SENSOR_STEP_K, rounding_variance(sampled))
            odd[rows] = np.repeat(mask, np.diff(changes, append=len(rows)))
        if odd.any():
            yield Odd(np.flatnonzero(odd), {}, name, f"{values[odd][0]:g}")


@check("stuck-sensor", of=("readings", "drift", "points"))
def stuck(data: Data) -> Iterator[Odd]:
    """A sensor that reads one value to the last digit while others move.

    What the others move by in the rows of that value tells a stuck sensor from a steady shop.
    """
    columns = sensors(data)
    # The temperatures of points stand still while one part is measured, and one other sensor
    # beside points may well be in the air, and this one in the part.
    share, fewest = (1.0, 2) if isinstance(data, PointsData) else (STUCK_SHARE, 1)
    for name, values in columns.items():
        different, count = np.unique(values[np.isfinite(values)], return_counts=True)
        rows = np.flatnonzero(values == different[np.argmax(count)])
        ranges = [np.ptp(column[rows]) for other, column in columns.items() if other != name]
        movement = float(np.median(ranges)) if len(ranges) >= fewest else 0.0
        if len(values) >= 10 and len(rows) >= share * len(values) and movement >= OTHERS_MOVE_K:
            yield Odd(rows, {"others": movement}, name, f"{values[rows[0]]:g}")
