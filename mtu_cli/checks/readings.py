"""Readings that no machine and no instrument gives: units, copies, signs, outliers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.checks import Odd, ReadingsData, check, labels
from mtu_cli.checks.plausible import (
    BEYOND,
    ERRORS,
    NARROW,
    POSITIONS,
    STEEPEST,
    kind_of,
    meant_units,
)
from mtu_cli.stats.outliers import outlying, spikes
from mtu_cli.units import LENGTH
from mtu_cli.units import UNITS as DECLARED

Rows = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
ALIKE = 0.01
"""Slope of distances on positions within this of 1 or -1."""
LOUD = 20.0
"""A pass whose bends are so many times those of the other passes is in another unit."""
MIRRORED = 0.1
"""Share of the sum of squares that a mirrored pass leaves, mirrored back."""


def of_component(data: ReadingsData) -> Iterator[tuple[str, Rows]]:
    """Each component that was read, and its rows."""
    for code, name in enumerate(data.table.components):
        if len(rows := np.flatnonzero(data.table.code == code)):
            yield name, rows


def by_file(data: ReadingsData, rows: Rows) -> Iterator[Rows]:
    """Those of each file and unit."""
    unit = data.table.unit
    key = labels(data.table.file_index[rows], np.zeros(len(rows)) if unit is None else unit[rows])
    yield from (rows[key == own] for own in np.unique(key))


def stated_unit(data: ReadingsData, row: int) -> str:
    """The unit that a reading was read in: its row's, or the component's where none was read."""
    if data.table.unit is not None:
        return list(DECLARED)[int(data.table.unit[row])]
    known = data.components.get(data.table.components[data.table.code[row]])
    plain = "um" if data.table.dimension[row] == LENGTH else "arcsec"
    return plain if known is None else str(known.unit)


def passes(data: ReadingsData, rows: Rows) -> list[Rows]:
    """The rows of every pass and direction, ordered by position; none where no pass is given."""
    table = data.table
    rows = rows[table.has_pass[rows] & np.isfinite(table.position_mm[rows])]
    if not len(rows):
        return []
    run = labels(table.pass_number[rows], table.direction[rows], table.file_index[rows])
    order = np.lexsort((table.position_mm[rows], run))
    return np.split(rows[order], np.flatnonzero(np.diff(run[order])) + 1)


def alike_passes(data: ReadingsData, rows: Rows) -> list[list[Rows]]:
    """Passes through the same positions in the same direction, those with three others or more."""
    found: dict[tuple[int, bytes], list[Rows]] = {}
    for own in passes(data, rows):
        key = int(data.table.direction[own[0]]), data.table.position_mm[own].tobytes()
        found.setdefault(key, []).append(own)
    return [group for group in found.values() if len(group) > 2 and len(group[0]) > 4]


def are_distances(data: ReadingsData, rows: Rows) -> bool:
    """Whether errors follow the position with a slope of 1 or -1."""
    position, error = data.table.position_mm[rows], data.table.error[rows]
    if len(rows) < 3 or not np.isfinite(position).all() or np.ptp(position) == 0:
        return False
    slope, offset = (
        np.polynomial.Polynomial.fit(position, error, 1).convert().coef[[1, 0]]
        if (np.ptp(error) > 0)
        else (0.0, 0.0)
    )
    rest = error - offset - slope * position
    return abs(abs(slope) - 1) < ALIKE and float(np.abs(rest).max()) < ALIKE * float(
        np.ptp(position)
    )


@check("distances-not-errors", of=("readings", "drift"))
def distances(data: ReadingsData) -> Iterator[Odd]:
    """Errors that are the position, or a distance that grows or falls with it."""
    for name, rows in of_component(data):
        if data.table.dimension[rows[0]] != 1:
            continue
        for own in by_file(data, rows):
            if are_distances(data, own):
                yield Odd(own, {"component": name}, "error")


@check("swapped-columns", of="readings")
def swapped(data: ReadingsData) -> Iterator[Odd]:
    """The same errors to the last digit in every pass, at positions that differ."""
    for name, rows in of_component(data):
        own = passes(data, rows)
        errors = [np.sort(data.table.error[each]) for each in own]
        places = [data.table.position_mm[each] for each in own]
        if len(own) < 2 or len(np.unique(errors[0])) < 4:
            continue
        if all(np.array_equal(each, errors[0]) for each in errors) and not any(
            np.array_equal(each, places[0]) for each in places[1:]
        ):
            yield Odd(rows, {"component": name}, "error")


@check("unit-of-errors", of=("readings", "drift"))
def unit_of_errors(data: ReadingsData) -> Iterator[Odd]:
    """A file whose errors of one kind are those of no machine, but would be in another unit."""
    table = data.table
    odd = {name for name, rows in of_component(data) if are_distances(data, rows)}
    ignored = np.isin(table.code, [table.components.index(name) for name in odd])
    for dimension in np.unique(table.dimension):
        kind = kind_of(int(dimension))
        low, high = ERRORS[kind]
        for rows in by_file(data, np.flatnonzero((table.dimension == dimension) & ~ignored)):
            sizes = np.abs(table.error[rows])
            likely = np.full(len(rows), high)
            if kind == "length":
                far = np.nan_to_num(np.abs(table.position_mm[rows]))
                likely = np.maximum(likely, STEEPEST * far)
            # The largest of each component: one of them may well have hardly any error.
            most = [sizes[table.code[rows] == own].max() for own in np.unique(table.code[rows])]
            large = float(np.quantile(sizes / likely, 0.75)) > 1
            size = float(np.quantile(sizes, 0.75)) if large else min(float(np.median(most)), high)
            stated = stated_unit(data, int(rows[0]))
            found = list(meant_units(size, kind, stated)) if size else []
            if found and (large or size < low):
                shown = size / DECLARED[stated].to_internal
                yield Odd(rows, {"size": shown, "unit": stated, "meant": found}, "error")


@check("position-beyond-travel", of=("readings", "drift"))
def beyond(data: ReadingsData) -> Iterator[Odd]:
    """Positions so far out that no coordinate system of the machine holds them."""
    for name, rows, axis, travel in _on_axes(data):
        far = rows[np.abs(data.table.position_mm[rows]) > BEYOND * travel]
        if len(far):
            facts = {"what": name, "axis": axis, "travel": travel}
            size = float(np.abs(data.table.position_mm[far]).max())
            meant = [unit for unit, to in POSITIONS.items() if size * to <= travel]
            hint = f"; in {' or '.join(meant)} it would lie within" if meant else ""
            yield Odd(far, {**facts, "hint": hint}, "position_mm", f"{size:g}")


@check("unit-of-positions", of="readings")
def narrow(data: ReadingsData) -> Iterator[Odd]:
    """Positions that cover too little of the travel, and all of it in metres or inches."""
    for name, rows, axis, travel in _on_axes(data):
        span = float(np.ptp(data.table.position_mm[rows]))
        meant = [unit for unit, to in POSITIONS.items()
                 if to > 1 and NARROW < span * to / travel <= 1.02]  # fmt: skip
        if meant and 0 < span < NARROW * travel:
            facts = {"component": name, "span": span, "axis": axis, "travel": travel}
            yield Odd(rows, {**facts, "meant": meant}, "position_mm")


def _on_axes(data: ReadingsData) -> Iterator[tuple[str, Rows, str, float]]:
    for name, rows in of_component(data):
        axis = getattr(data.components.get(name), "of", None)
        if axis is not None and axis in data.travels:
            low, high = data.travels[axis]
            yield name, rows, axis, abs(high - low)


def profiles(data: ReadingsData) -> Iterator[tuple[str, list[Rows], Floats]]:
    """Component, the rows of each of its alike passes, and their errors (passes, places)."""
    for name, rows in of_component(data):
        for group in alike_passes(data, rows):
            yield name, group, np.array([data.table.error[own] for own in group])


def in_pass(data: ReadingsData, name: str, rows: Rows, **facts: Any) -> Odd:
    """A pass that is odd as a whole."""
    number = int(data.table.pass_number[rows[0]])
    return Odd(rows, {"component": name, "number": number, **facts}, "error")


@check("copied-pass", of="readings")
def copied_pass(data: ReadingsData) -> Iterator[Odd]:
    """A pass that is another one to the last digit, where other passes are not alike."""
    for name, group, values in profiles(data):
        seen: dict[bytes, int] = {}
        for i, own in enumerate(group):
            first = seen.setdefault(values[i].tobytes(), i)
            others = np.delete(values, [first, i], axis=0)
            usual = float(np.mean(others == values[first])) if len(others) else 1.0
            if first != i and usual < 0.5 and len(np.unique(values[i])) > 3:
                other = int(data.table.pass_number[group[first][0]])
                yield in_pass(data, name, own, other=other)


@check("copied-component", of="readings")
def copied_component(data: ReadingsData) -> Iterator[Odd]:
    """A component whose readings are those of another one."""
    seen: dict[bytes, str] = {}
    for name, rows in of_component(data):
        errors = data.table.error[rows]
        if len(rows) < 5 or len(np.unique(errors)) < 4:
            continue
        first = seen.setdefault(errors.tobytes(), name)
        if first != name:
            yield Odd(rows, {"component": name, "other": first}, "error")


@check("unit-of-pass", of="readings")
def unit_of_pass(data: ReadingsData) -> Iterator[Odd]:
    """A pass whose readings vary many times more or less than those of all others."""
    for name, group, values in profiles(data):
        sizes = np.median(np.abs(np.diff(values, 2)), axis=1), np.ptp(values, axis=1)
        for i, own in enumerate(group):
            rest = [float(np.median(np.delete(size, i))) for size in sizes]
            if all(rest) and all(size[i] > 0 for size in sizes):
                ratios = [float(size[i]) / other for size, other in zip(sizes, rest, strict=True)]
                if min(ratios) > LOUD or max(ratios) < 1 / LOUD:
                    yield in_pass(data, name, own, ratio=ratios[1])


@check("mirrored-pass", of="readings")
def mirrored(data: ReadingsData) -> Iterator[Odd]:
    """A pass that is the mirror image of the median of all others, which agree; levels differ by
    drift.
    """
    for name, group, values in profiles(data):
        levelled = values - values.mean(axis=1, keepdims=True)
        for i, own in enumerate(group):
            others = np.delete(levelled, i, axis=0)
            usual = np.median(others, axis=0)
            size = MIRRORED * float(usual @ usual)
            apart = float(((others - usual) ** 2).sum(axis=1).max())
            if max(apart, float(((levelled[i] + usual) ** 2).sum())) < size:
                yield in_pass(data, name, own)


@check("outlying-reading", of=("readings", "drift"))
def outlier(data: ReadingsData) -> Iterator[Odd]:
    """Single readings far off the others of their passes, or off their neighbours in time."""
    table = data.table
    for name, rows in of_component(data):
        judged = [(own, *found) for own, found in _judged(data, rows)]
        odd = [own[mask] for own, mask, _ in judged]
        found = np.sort(np.concatenate(odd)) if odd else np.zeros(0, np.int64)
        if not 0 < len(found) <= len(rows) / 4:
            continue
        stated = stated_unit(data, int(found[0]))
        unit = DECLARED[stated].to_internal
        off = float(np.abs(table.error[found] - np.median(table.error[rows])).max()) / unit
        s = max(own for _, mask, own in judged if mask.any()) / unit
        facts = {"component": name, "off": off, "s": s, "unit": stated}
        yield Odd(found, facts, "error", f"{table.error[found[0]] / unit:.6g} {stated}")


def _judged(data: ReadingsData, rows: Rows) -> Iterator[tuple[Rows, tuple[Mask, float]]]:
    """Readings that are alike, which of them are outlying, and s (mm, rad)."""
    table = data.table
    if not table.has_pass[rows].any():
        time = table.time_min[rows]
        if np.isfinite(time).all():
            position = np.nan_to_num(table.position_mm[rows])
            order = np.lexsort((time, position, table.cycle[rows], table.file_index[rows]))
            own = rows[order]
            series = labels(position[order], table.cycle[own], table.file_index[own])
            for part in np.split(own, np.flatnonzero(np.diff(series)) + 1):
                yield part, spikes(table.error[part])
        return
    for group in alike_passes(data, rows):
        own = np.concatenate(group)
        left = _off_lines(np.array([table.error[each] for each in group]), group, data)
        fitted = left.shape[1] + 2 * left.shape[0]
        yield own, outlying(left.ravel(), np.zeros(len(own), np.int64), fitted=fitted)


def _off_lines(errors: Floats, group: list[Rows], data: ReadingsData) -> Floats:
    """Errors (passes, places) less the median of their place and the line of their pass: the
    medians of Theil 1950 and Sen 1968, as a slip must not turn it.
    """
    x = data.table.position_mm[group[0]]
    left = errors - np.median(errors, axis=0)
    i, j = np.triu_indices(len(x), 1)
    apart = x[j] > x[i]
    slopes = np.median((left[:, j] - left[:, i])[:, apart] / (x[j] - x[i])[apart], axis=1)
    left = left - slopes[:, None] * (x - np.median(x))
    left = left - np.median(left, axis=1, keepdims=True)
    found: Floats = left - np.median(left, axis=0)
    return found
