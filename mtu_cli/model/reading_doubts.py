"""Readings that a fit takes as they are, but that look mistaken: told by row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.files.reading_cells import Travels, largest_errors, look_large
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.units import LENGTH, UM, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.readings import Readings

GROSS = 8.0
"""Standard deviations of the others from which on a reading is no part of them."""
MOST = 0.05
"""Share of a component's readings beyond which they are its own distribution."""
FEWEST = 8
SWEEPS = 5
REPLICATES = 3
NORMAL_MAD = 1.4826
LEAST = 0.1
"""Share of the degrees of freedom that medians leave at least."""
SMALL_MM = 5e-5
"""No machine has errors that are all smaller, where any is seen."""
NARROW = 1e-3
"""Share of a travel that metres taken for mm would cover at most."""
WIDE = 1.02
"""Times its travel that positions of an axis may span: ends are stated to a few mm."""
SHOWN = 6


def reading_doubts(machine: LoadedMachine, readings: Readings) -> list[Warned]:
    """Single readings far off what the others of their component make one expect, errors and
    positions that look like another unit, and positions that are not used.
    """
    components = machine.machine.components
    found = scale_doubts(machine, readings)
    alone = [text for name in readings.components for text in _alone(readings, name, components)]
    if alone:
        more = f"; and {len(alone) - SHOWN} more" if len(alone) > SHOWN else ""
        text = f"{'; '.join(alone[:SHOWN])}{more}: look whether they are mistyped"
        found.append(Warned(code="reading-stands-out", message=text))
    return found


def scale_doubts(machine: LoadedMachine, readings: Readings) -> list[Warned]:
    """Of the same, those of whole columns: a search for effects finds single readings itself."""
    found = [Warned(code=item.code, message=item.message) for item in readings.notes]
    return found + list(_scales(readings, machine.machine.components, machine.machine.travels))


def _scales(
    readings: Readings, components: Mapping[str, Any], travels: Travels
) -> Iterator[Warned]:
    large, narrow, wide = [], [], []
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        unit = UNITS[components[name].unit]
        errors, positions = np.abs(readings.error[rows]), readings.position_mm[rows]
        typical = float(np.median(errors))
        most = largest_errors(unit.dimension, positions, travels)
        if look_large(errors, most, unit.dimension):
            large.append(f"{name} (typically {typical / unit.to_internal:.3g} {unit.name})")
        axis = components[name].of
        if axis in travels:
            low, high = sorted(travels[axis])
            span = float(np.ptp(positions))
            if 0 < span < NARROW * (high - low):
                narrow.append(name)
            if span > WIDE * (high - low):
                wide.append(f"{name} {span:.4g} mm (travel of {axis}: {high - low:.4g} mm)")
    if large:
        text = f"large errors for a machine: {', '.join(large)}; are they in the unit they state?"
        yield Warned(code="readings-large", message=text)
    yield from _small(readings, components)
    if wide:
        text = (
            f"positions from end to end lie farther apart than the axis travels: {', '.join(wide)}"
        )
        yield Warned(code="positions-wide", message=text)
    if narrow:
        text = (
            f"the positions of {', '.join(narrow)} lie within a thousandth of the travel that the "
            "machine states: are they metres in a column of mm?"
        )
        yield Warned(code="positions-narrow", message=text)


def _small(readings: Readings, components: Mapping[str, Any]) -> Iterator[Warned]:
    """Of all lengths together: one component alone may well have hardly any error."""
    units = [UNITS[components[name].unit] for name in readings.components]
    lengths = np.array([unit.dimension == LENGTH for unit in units], bool)[readings.code]
    largest = float(np.abs(readings.error[lengths]).max(initial=0.0))
    if 0 < largest < SMALL_MM:
        text = (
            f"small errors for a machine: no length is off by more than {largest / UM:.2g} um; are "
            "they in the unit they state, or mm marked as um?"
        )
        yield Warned(code="readings-small", message=text)


def _alone(readings: Readings, name: str, components: Mapping[str, Any]) -> Iterator[str]:
    """Readings of one component, one instrument at a time, with what the others have there."""
    inside = np.flatnonzero(readings.code == readings.components.index(name))
    component, unit = components[name], UNITS[components[name].unit]
    roles = np.array(readings.roles, dtype=object)[readings.file_index[inside]]
    for role in dict.fromkeys(readings.roles):
        rows = inside[roles == role]
        if len(rows) < FEWEST:
            continue
        expected, taken = _expected(readings, rows, component)
        left = readings.error[rows] - expected
        spread = _spread(left, taken)
        far = np.flatnonzero(np.abs(left) > GROSS * spread) if spread > 0 else np.zeros(0, int)
        if len(far) > max(1, MOST * len(rows)):
            continue
        for i in far.tolist():
            row, f = rows[i], unit.to_internal
            place = "" if component.of is None else f" at {readings.position_mm[row]:g} mm"
            yield (
                f"{readings.sources[readings.file_index[row]].shown}, row {readings.row[row]}, "
                f"column 'error': {name}{place} is {readings.error[row] / f:.4g} {unit.name} where "
                f"the others make one expect {expected[i] / f:.3g} ± {spread / f:.2g} {unit.name}"
            )


def _spread(left: FloatArray, taken: int) -> float:
    """Standard deviation of what is not gross among deviations `left` (n,), from which `taken`
    parameters were taken: what medians leave has too many small values.
    """
    n = len(left)
    share = max(1 - taken / n, LEAST)
    robust = NORMAL_MAD * float(np.median(np.abs(left))) / np.sqrt(share)
    rest = left[np.abs(left) <= GROSS * robust]
    dof = max(len(rest) - taken, 1)
    return max(robust, float(np.sqrt(rest @ rest / dof))) if robust > 0 else 0.0


def _expected(readings: Readings, rows: IntArray, component: Any) -> tuple[FloatArray, int]:
    """What the others make one expect of each reading (n,), and its number of parameters: the
    medians of pass and place where places are visited again, else the polynomial alone.
    """
    error = readings.error[rows]
    direction = readings.direction[rows].astype(np.int64)
    if component.of is None:
        return np.full(len(rows), np.median(error)), 1
    position = readings.position_mm[rows]
    place = _groups(position, direction)
    run = _groups(readings.file_index[rows], readings.pass_number[rows], direction)
    places, runs = int(place.max()) + 1, int(run.max()) + 1
    if np.bincount(place).min() < REPLICATES or np.bincount(run).min() < REPLICATES:
        return _curve(position, error, component.degree), component.degree + 1
    left = error.copy()
    for _ in range(SWEEPS):
        left = left - _medians(run, left)
        left = left - _medians(place, left)
    return error - left, places + runs - 1


def _groups(*keys: FloatArray | IntArray) -> IntArray:
    """Numbers (n,) from 0, without a gap, of the rows whose `keys` (n,) are alike. One key after
    the other: numpy sorts rows of several keys ten times as slowly.
    """
    found = np.zeros(len(keys[0]), np.int64)
    for key in keys:
        own = np.unique(key, return_inverse=True)[1].reshape(-1)
        joint = found * (int(own.max()) + 1) + own
        found = np.unique(joint, return_inverse=True)[1].reshape(-1)
    return found


def _curve(position: FloatArray, error: FloatArray, degree: int) -> FloatArray:
    """The polynomial through the readings that it does not leave far off."""
    X = np.vander((position - position.mean()) / max(float(np.ptp(position)), 1e-9), degree + 1)
    kept, found = np.ones(len(error), bool), np.zeros(len(error))
    for _ in range(SWEEPS):
        found = X @ least_squares(X[kept], error[kept]).coefficients
        left = np.abs(error - found)
        near = left <= GROSS / 2 * NORMAL_MAD * float(np.median(left))
        if near.sum() <= degree + 1 or (near == kept).all():
            break
        kept = near
    return found


def _medians(group: IntArray, values: FloatArray) -> FloatArray:
    """The median of each value's group, (n,)."""
    count = np.bincount(group)
    # Short integers are sorted by their digits, in a tenth of the time.
    key = group.astype(np.uint16) if len(count) <= np.iinfo(np.uint16).max else group
    ascending = np.argsort(values)
    order = ascending[np.argsort(key[ascending], kind="stable")]
    start = np.cumsum(count) - count
    ordered = values[order]
    middle = (ordered[start + (count - 1) // 2] + ordered[start + count // 2]) / 2
    found: FloatArray = middle[group]
    return found
