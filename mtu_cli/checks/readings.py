"""Readings that no machine and no instrument gives, and temperatures that no sensor of a machine
reads: units, signs, columns, outliers, spikes, stuck sensors.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.checks import Floats, Mask, Odd, PointsData, ReadingsData, Rows, check, limits, split
from mtu_cli.files.covariates import SENSOR_DEGC, is_temperature
from mtu_cli.stats.outliers import FEWEST, GROSS, median_polish, medians, outlying, spikes
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.units import LENGTH, UNITS, Unit


def stated_unit(data: ReadingsData, row: int) -> Unit:
    """The unit that a reading was read in."""
    return [*UNITS.values()][data.table.unit[row]]


def passes(data: ReadingsData, rows: Rows) -> list[Rows]:
    """The rows of every pass and direction, ordered by position; none where no pass is given."""
    table = data.table
    rows = rows[table.has_pass[rows] & np.isfinite(table.position_mm[rows])]
    rows = rows[np.argsort(table.position_mm[rows], kind="stable")]
    return split(rows, table.pass_number, table.direction, table.file_index)


def profiles(data: ReadingsData, fewest: int = 3) -> Iterator[tuple[str, Rows]]:
    """Components and the rows (passes, positions) of their passes through the same five positions
    or more in one direction, where there are `fewest` or more.
    """
    table = data.table
    for name, rows in data.by_component:
        alike: dict[tuple[int, bytes], list[Rows]] = {}
        for run in passes(data, rows):
            place = int(table.direction[run[0]]), table.position_mm[run].tobytes()
            alike.setdefault(place, []).append(run)
        for group in alike.values():
            if len(group) >= fewest and len(group[0]) > 4:
                yield name, np.array(group)


def are_distances(data: ReadingsData, rows: Rows) -> bool:
    """Whether errors follow the position with a slope of 1 or -1.

    Whoever reads an instrument's display at every position, and enters it as it is, has the error
    in the last digits of a distance.
    """
    position, error = data.table.position_mm[rows], data.table.error[rows]
    span = np.ptp(position)
    if len(rows) < 3 or not span > 0:
        return False
    x = position - position.mean()
    slope = (x @ error) / (x @ x)
    rest = error - error.mean() - slope * x
    return bool(abs(abs(slope) - 1) < limits.ALIKE and np.abs(rest).max() < limits.ALIKE * span)


@check("unit-of-errors", of=("readings", "drift"))
def unit_of_errors(data: ReadingsData) -> Iterator[Odd]:
    """A file whose errors of one kind are those of no machine, but would be in another unit; and
    errors that are the position, or a distance that grows or falls with it.

    Errors are too large where a quarter of them is; they are too small where the largest of each
    component typically is. Nothing is reported where no other unit makes them plausible.
    """
    table = data.table
    for block in split(None, table.dimension, table.file_index, table.unit):
        dimension, groups = int(table.dimension[block[0]]), []
        for group in split(block, table.code):
            if dimension == LENGTH and are_distances(data, group):
                name = table.components[table.code[group[0]]]
                yield Odd(group, {"component": name}, "error", code="distances-not-errors")
            else:
                groups.append(group)
        if not groups:
            continue
        (low, high), rows = limits.ERRORS[dimension], np.sort(np.concatenate(groups))
        sizes = np.abs(table.error[rows])
        large = np.quantile(sizes / limits.largest(dimension, table.position_mm[rows]), 0.75) > 1
        # The largest of each component: one of them may well have hardly any error.
        peak = np.median([np.abs(table.error[group]).max() for group in groups])
        size = float(np.quantile(sizes, 0.75) if large else min(peak, high))
        stated = stated_unit(data, int(rows[0]))
        others = {**limits.UNITS[dimension]}
        number = size / others.pop(stated.name, 1.0)
        meant = [unit for unit, to in others.items() if low <= number * to <= high]
        if size and meant and (large or size < low):
            largest = float(sizes.max()) if large else size
            facts = {"size": largest / stated.to_internal, "unit": stated.name, "meant": meant}
            yield Odd(rows, facts, "error")


@check("swapped-columns", of="readings")
def swapped(data: ReadingsData) -> Iterator[Odd]:
    """The same errors to the last digit in every pass, at positions that differ."""
    table = data.table
    for name, rows in data.by_component:
        runs = passes(data, rows)
        errors = {np.sort(table.error[run]).tobytes() for run in runs}
        places = {table.position_mm[run].tobytes() for run in runs}
        several = len(np.unique(table.error[rows])) >= limits.FEWEST_EQUAL
        if several and len(errors) == 1 < len(places) == len(runs):
            yield Odd(rows, {"component": name}, "error")


@check("unlike-pass", of="readings")
def unlike(data: ReadingsData) -> Iterator[Odd]:
    """A pass whose bends and range are many times larger or smaller than those of the others, or
    that is the mirror image of all others, which agree.

    Bends are second differences: drift in the course of a pass leaves them as they are.
    """
    for name, group in profiles(data):
        values = data.table.error[group]
        sizes = np.array([np.median(np.abs(np.diff(values, 2)), axis=1), np.ptp(values, axis=1)])
        if not sizes.all():
            continue
        for i, rows in enumerate(group):
            ratios = sizes[:, i] / np.median(np.delete(sizes, i, axis=1), axis=1)
            turned, how = np.where(np.arange(len(group)) == i, -1.0, 1.0)[:, None], ""
            if ratios.min() > limits.LOUD or ratios.max() < 1 / limits.LOUD:
                how = f"varies {ratios[1]:.4g} times as much as the other passes: another unit?"
            elif np.corrcoef(values * turned).min() > limits.MIRRORED:
                how = "has the opposite sign of all other passes"
            if how:
                number = int(data.table.pass_number[rows[0]])
                yield Odd(rows, {"component": name, "number": number, "how": how}, "error")


@check("outlying-value", of=("readings", "drift"))
def outlying_readings(data: ReadingsData) -> Iterator[Odd]:
    """Single readings far off the others of their passes, or off their neighbours in time."""
    error = data.table.error
    for name, sample, mask, s in _samples(data):
        if mask.any():
            rows = sample[mask]
            distance = np.abs(error[rows] - np.median(error[sample])).max()
            unit = stated_unit(data, int(rows[0]))
            off, s = float(distance) / unit.to_internal, s / unit.to_internal
            facts = {"what": name, "beside": "the others", "unit": unit.name, "off": off, "s": s}
            value = f"{error[rows[0]] / unit.to_internal:.6g} {unit.name}"
            yield Odd(rows, facts, "error", value)


def _samples(data: ReadingsData) -> Iterator[tuple[str, Rows, Mask, float]]:
    """Components, rows of readings that differ by noise alone, which are outlying, and the standard
    deviation s: the passes in one direction, or one place of a cycle in the order of time.
    """
    table = data.table
    for name, group in profiles(data, fewest=2):
        # A pass that is a copy of another one shows no scatter.
        group = group[np.sort(np.unique(table.error[group], axis=0, return_index=True)[1])]
        if len(group) < 2:
            continue
        error, x, r = table.error[group], table.position_mm[group[0]], _rounding(data, group)
        residuals = median_polish(error, x)
        mask, s = outlying(residuals, residuals.shape[1] + 2 * residuals.shape[0], r)
        # Two readings far off at one end of a pass hide in a slope of it.
        residuals = median_polish(error)
        hidden, scatter = outlying(residuals, sum(residuals.shape), r)
        mask |= hidden & _off_the_line(error, x, hidden, scatter)
        if len(group) == 2:
            # Both are as far from their mean: the one farther off its neighbours is meant.
            bend = np.abs(np.diff(table.error[group], 2, append=np.nan, prepend=np.nan))
            mask &= bend == bend.max(axis=0)
        yield name, group, mask, s
    for name, rows in data.by_component:
        time = table.time_min[rows]
        if not table.has_pass[rows].any() and np.isfinite(time).all():
            rows = rows[np.argsort(time, kind="stable")]
            place = np.nan_to_num(table.position_mm)
            for run in split(rows, place, table.cycle, table.file_index):
                yield name, run, *spikes(table.error[run], r=_rounding(data, run))


def _off_the_line(error: Floats, x: Floats, mask: Mask, s: float) -> Mask:
    """Readings (passes, n) at x (n,) that are GROSS standard deviations of the prediction by the
    line through those of their pass that are not in `mask` off it.
    """
    rest, result = error - medians(np.where(mask, np.nan, error), 0), np.zeros_like(mask)
    X = np.vander(x - x.mean(), 2)
    for i in np.flatnonzero(mask.any(axis=1) & ((~mask).sum(axis=1) >= FEWEST)):
        Q = X @ np.linalg.pinv(X[~mask[i]])
        off = np.abs(rest[i] - Q @ rest[i, ~mask[i]])
        result[i] = off > GROSS * s * np.sqrt(1 + (Q**2).sum(axis=1))
    return result


def _rounding(data: ReadingsData, rows: Rows) -> float:
    """The variance of one of the readings by its last digit, in mm or rad, squared."""
    unit = stated_unit(data, int(rows.flat[0]))
    return rounding_variance(data.table.error[rows].ravel(), unit.to_internal)


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
    coldest, hottest = limits.SHOP_DEGC
    columns = sensors(data)
    middles = {name: float(np.nanmedian(values)) for name, values in columns.items()}
    for name, middle in middles.items():
        facts, values = {"low": low, "high": high, "unit": ""}, columns[name]
        rows = np.flatnonzero((values < low) | (values > high))
        rest = [item for other, item in middles.items() if other != name]
        reference = float(np.median(rest)) if rest else 20.0
        for unit, converted in (("degF", (middle - 32) / 1.8), ("K", middle - 273.15)):
            odd = abs(converted - reference) < limits.SENSORS_NEAR_K < abs(middle - reference) / 3
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
            mask, _ = spikes(sampled, limits.SENSOR_STEP_K, rounding_variance(sampled))
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
    share, fewest = (1.0, 2) if isinstance(data, PointsData) else (limits.STUCK_SHARE, 1)
    for name, values in columns.items():
        different, count = np.unique(values[np.isfinite(values)], return_counts=True)
        rows = np.flatnonzero(values == different[np.argmax(count)])
        ranges = [np.ptp(column[rows]) for other, column in columns.items() if other != name]
        movement = float(np.median(ranges)) if len(ranges) >= fewest else 0.0
        still = len(values) >= 10 and len(rows) >= share * len(values)
        if still and movement >= limits.OTHERS_MOVE_K:
            yield Odd(rows, {"others": movement}, name, f"{values[rows[0]]:g}")
