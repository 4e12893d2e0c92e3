"""Readings that a fit takes as they are, but that look mistaken: told by row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import Warned
from mtu_cli.files import small_readings
from mtu_cli.files.reading_cells import (
    NARROW,
    WIDE,
    Travels,
    largest_errors,
    look_large,
    may_be_narrow,
    seems_narrow,
)
from mtu_cli.findings import Finding
from mtu_cli.model.reading_expected import expected
from mtu_cli.stats.outliers import told_apart
from mtu_cli.units import LENGTH, UM, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.machine import LoadedMachine
    from mtu_cli.files.readings import Readings

    IntArray = NDArray[np.int64]

FEW = 0.05
"""Share of a component's readings up to which those beyond the limit are slips; more must be apart
from all others."""
FEWEST = 8
SMALL_MM = 5e-5
"""No machine has errors that are all smaller, where any is seen."""
NAMES = {"m": "metres", "inch": "inches"}
SHOWN = 6


def reading_doubts(machine: LoadedMachine, readings: Readings) -> list[Finding]:
    """Single readings far off what the others of their component make one expect, errors and
    positions that look like another unit, and positions that are not used.
    """
    components = machine.machine.components
    found = scale_doubts(machine, readings)
    single = {name: list(_alone(readings, name, components)) for name in readings.components}
    alone = [text for texts in single.values() for text in texts]
    if alone:
        more = f"; and {len(alone) - SHOWN} more" if len(alone) > SHOWN else ""
        mistyped = "they are" if len(alone) > 1 else "it is"
        text = f"{'; '.join(alone[:SHOWN])}{more}: look whether {mistyped} mistyped"
        about = tuple(name for name, texts in single.items() if texts)
        found.append(Warned(code="reading-stands-out", message=text, about=about))
    return found


def scale_doubts(machine: LoadedMachine, readings: Readings) -> list[Finding]:
    """Of the same, those of whole columns: a search for effects finds single readings itself."""
    scales = _scales(readings, machine.machine.components, machine.machine.travels)
    return [*readings.notes, *scales]


def _scales(
    readings: Readings, components: Mapping[str, Any], travels: Travels
) -> Iterator[Finding]:
    wide = []
    narrow: dict[str, list[str]] = {}
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        positions = readings.position_mm[rows]
        axis = components[name].of
        if axis in travels:
            low, high = sorted(travels[axis])
            span = float(np.ptp(positions))
            meant = seems_narrow(positions, travels, axis)
            if meant and (meant == "m" or _in_inches(readings, rows, components, travels)):
                narrow.setdefault(meant, []).append(name)
            if span > WIDE * (high - low):
                wide.append(f"{name} {span:.4g} mm (travel of {axis}: {high - low:.4g} mm)")
    yield from _large(readings, components, travels)
    if not any(item.code == small_readings.CODE for item in readings.notes):
        yield from _small(readings, components)
    if wide:
        text = (
            f"positions from end to end lie farther apart than the axis travels: {', '.join(wide)}"
        )
        yield Warned(code="positions-wide", message=text)
    for meant, names in narrow.items():
        text = (
            f"the positions of {', '.join(names)} cover at most 1/{NARROW[meant][0]:g} of the "
            f"travel that the machine states: are they {NAMES[meant]} in a column of mm?"
        )
        yield Warned(code="positions-narrow", message=text)


def _large(
    readings: Readings, components: Mapping[str, Any], travels: Travels
) -> Iterator[Finding]:
    """Components whose errors make one ask about their unit, by the files in which they do."""
    found: dict[str, list[str]] = {}
    for code, name in enumerate(readings.components):
        rows = np.flatnonzero(readings.code == code)
        unit = UNITS[components[name].unit]
        errors, index = np.abs(readings.error[rows]), readings.file_index[rows]
        most = largest_errors(unit.dimension, readings.position_mm[rows], travels)
        if not look_large(errors, most, unit.dimension):
            continue
        files = np.unique(index)
        own = [f for f in files if look_large(errors[index == f], most[index == f], unit.dimension)]
        # They may be so in all files together alone.
        own = own or files.tolist()
        shown = [readings.sources[file].shown for file in own[:SHOWN]]
        if len(own) > SHOWN:
            shown.append(f"{len(own) - SHOWN} more")
        typical = float(np.median(errors[np.isin(index, own)])) / unit.to_internal
        text = f"{name} (typically {typical:.3g} {unit.name})"
        found.setdefault(", ".join(shown), []).append(text)
    if found:
        told = "; ".join(f"in {files}: {', '.join(names)}" for files, names in found.items())
        text = f"large errors for a machine {told}; are they in the unit they state?"
        yield Warned(code="readings-large", message=text)


def _in_inches(
    readings: Readings, rows: IntArray, components: Mapping[str, Any], travels: Travels
) -> bool:
    """Whether all positions beside the `rows` (n,) of a component, in one of their files, may be
    inches too: nobody writes half a file in them.
    """
    for file in np.unique(readings.file_index[rows]).tolist():
        inside = readings.file_index == file
        codes = readings.code[inside]
        if all(
            may_be_narrow(
                readings.position_mm[inside][codes == code],
                travels,
                components[readings.components[code]].of,
                "inch",
            )
            for code in np.unique(codes).tolist()
        ):
            return True
    return False


def _small(readings: Readings, components: Mapping[str, Any]) -> Iterator[Finding]:
    """Of all lengths together: one component alone may well have hardly any error."""
    units = [UNITS[components[name].unit] for name in readings.components]
    lengths = np.array([unit.dimension == LENGTH for unit in units], bool)[readings.code]
    largest = float(np.abs(readings.error[lengths]).max(initial=0.0))
    if 0 < largest < SMALL_MM:
        text = (
            f"small errors for a machine: no length is off by more than {largest / UM:.2g} um; are "
            "they in the unit they state, or mm marked as um?"
        )
        yield Warned(code=small_readings.CODE, message=text)


def _alone(readings: Readings, name: str, components: Mapping[str, Any]) -> Iterator[str]:
    """Readings of one component, one instrument at a time, with what the others have there."""
    inside = np.flatnonzero(readings.code == readings.components.index(name))
    component, unit = components[name], UNITS[components[name].unit]
    roles = np.array(readings.roles, dtype=object)[readings.file_index[inside]]
    for role in dict.fromkeys(readings.roles):
        rows = inside[roles == role]
        if len(rows) < FEWEST:
            continue
        found = expected(readings, rows, component)
        for i in told_apart(found.distance, found.limit, FEW).tolist():
            row, f = rows[i], unit.to_internal
            place = "" if component.of is None else f" at {readings.position_mm[row]:g} mm"
            yield (
                f"{readings.sources[readings.file_index[row]].shown}, row {readings.row[row]}, "
                f"column 'error': {name}{place} is {readings.error[row] / f:.4g} {unit.name} where "
                f"the others make one expect {found.expected[i] / f:.3g} ± {found.spread / f:.2g} "
                f"{unit.name}"
            )
