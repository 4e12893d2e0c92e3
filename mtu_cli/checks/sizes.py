"""Names, places and sizes that are hardly meant, in parts, machines and tables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from mtu_cli.checks import Data, DocumentData, Floats, Odd, PointsData, ReadingsData, Rows, check
from mtu_cli.checks.plausible import (
    BEYOND,
    CONSTANT_TRAVELS,
    NARROW,
    NEARLY,
    POSITIONS,
    SPAN,
    TOLERANCE_UM,
    TRAVEL_MM,
    largest,
)
from mtu_cli.files.headers import meant_by
from mtu_cli.files.points import SAME_MM
from mtu_cli.units import UNITS

Position = tuple[Sequence[str], str, Floats, Rows, str]
NONE, FIRST = np.arange(0), np.arange(1)


@check("alike", of="part")
def places_alike(data: DocumentData) -> Iterator[Odd]:
    """Features at one nominal place."""
    at: dict[bytes, list[str]] = defaultdict(list)
    for name, place in data.loaded.part.places().items():
        at[(np.round(np.array(place, np.float64) / SAME_MM) + 0.0).tobytes()].append(name)
    for names in at.values():
        if len(names) > 1:
            facts = {"what": "features at the same nominal place", "names": names}
            yield Odd(NONE, facts, path=("features", names[-1]))


@check("alike", of="points")
def names_alike(data: PointsData) -> Iterator[Odd]:
    """Parts, features or operations that are one but for case and blanks."""
    for column in ("part", "feature", "operation"):
        labels, first = getattr(data.table, f"{column}s"), dict[str, str]()
        spellings = [first.setdefault("".join(name.split()).casefold(), name) for name in labels]
        if pairs := [pair for pair in zip(spellings, labels, strict=True) if pair[0] != pair[1]]:
            odd = [labels.index(name) for _, name in pairs]
            rows = np.flatnonzero(np.isin(getattr(data.table, column), odd))
            names = [f"{spelling!r} and {name!r}" for spelling, name in pairs]
            facts = {"what": "names that differ by case or blanks only", "names": names}
            yield Odd(rows, facts, column)


@check("alike", of=("readings", "drift", "points"))
def columns_alike(data: ReadingsData | PointsData) -> Iterator[Odd]:
    """Covariates that are nearly called as a column of the contract that is not there."""
    table = data.table
    columns: dict[str, NDArray[np.bool_]]
    columns = dict.fromkeys(("time", "time_min"), ~np.isnan(table.time_min))
    if isinstance(data, PointsData):
        columns |= {"operation": table.operation >= 0, "repeat": table.repeat >= 0}
        columns |= {f"dir_{axis}": ~np.isnan(table.direction[:, i]) for i, axis in enumerate("xyz")}
        columns |= {"sequence": table.sequence != table.part + 1}
        columns |= {"z_mm": ~np.isnan(table.measured[:, 2])}
    else:
        columns |= {"pass": table.has_pass, "direction": table.direction != 0}
        columns |= {"cycle": table.cycle >= 0}
    for name, mask in columns.items():
        column = None if mask.any() else meant_by(name, [*table.covariates], NEARLY)
        if column:
            what = "a covariate is nearly called as a column that is not there"
            yield Odd(FIRST, {"what": what, "names": [repr(name)]}, column)


@check("position-beyond-travel", of=("readings", "drift", "points", "part"))
def beyond(data: Data) -> Iterator[Odd]:
    """Positions so far out that no coordinate system of the machine holds them, and those of
    passes that cover too little of the travel, but not in metres or inches.
    """
    for names, axis, values, rows, column in _positions(data):
        low, high = data.travels.get(axis, (-np.inf, np.inf))
        travel = abs(high - low)
        # Readings are in the frame of the machine, places in one of the part.
        middle = 0.0 if isinstance(data, ReadingsData) else np.median(values)
        distance = np.abs(values - middle)
        odd, farthest = np.flatnonzero(distance > BEYOND * travel), float(distance.max())
        size, least = (farthest, SPAN) if len(odd) else (float(np.ptp(values)), NARROW)
        meant = [
            unit
            for unit, to in POSITIONS.items()
            if least * travel < size * to <= travel and farthest * to <= BEYOND * travel
        ]
        hint = f"; in {' or '.join(meant)} they would not be" if meant else ""
        facts = {"axis": axis, "travel": travel, "hint": hint}
        if isinstance(data, DocumentData):
            for i in odd.tolist():
                yield Odd(NONE, facts, column, f"{values[i]:g}", ("features", names[i], column))
        elif len(odd):
            yield Odd(rows[odd], facts, column, values=values[odd])
        elif meant and 0 < size < NARROW * travel and isinstance(data, ReadingsData):
            facts = {"names": names[:1], **facts}
            if data.table.has_pass[rows].all():
                yield Odd(rows, facts, column, f"{size:g}", code="unit-of-positions")


def _positions(data: Data) -> Iterator[Position]:
    """Whose positions along an axis are where (mm), in which rows and column."""
    if isinstance(data, ReadingsData):
        for name, rows in data.by_component:
            if axis := getattr(data.components.get(name), "of", None):
                yield [name] * len(rows), axis, data.table.position_mm[rows], rows, "position_mm"
        return
    if isinstance(data, DocumentData):
        places, column = data.loaded.part.places(), "{}_mm"
        names, nominal = [*places], np.array([*places.values()], np.float64)
    else:
        at = slice(None) if data.part is None and data.travels else slice(0)
        names = np.take(data.table.features, data.table.feature[at]).tolist()
        nominal, column = data.table.nominal[at], "nominal_{}_mm"
    for axis, values in zip("xyz", nominal.T, strict=True):
        if names and np.isfinite(values).all():
            yield names, axis, values, np.arange(len(names)), column.format(axis)


@check("implausible-size", of="part")
def tolerances(data: DocumentData) -> Iterator[Odd]:
    """Tolerances and zones that are hardly in um."""
    part = data.loaded.part
    sizes = [
        (("lengths", i, "tolerance_um"), f"a tolerance of {half:g} um", half)
        for i, entry in enumerate(part.lengths)
        if (zone := entry.tolerance) and (half := (zone.high - zone.low) / 2)
    ] + [
        (("features", name, "position_um"), f"a zone of {zone:g} um", zone)
        for name, entry in part.features.items()
        if (zone := entry.position_um)
    ]
    for path, what, size in sizes:
        if size < TOLERANCE_UM:
            yield Odd(NONE, {"what": what, "meant": "mm"}, path=path)


@check("implausible-size", of="machine")
def machine_sizes(data: DocumentData) -> Iterator[Odd]:
    """Travels and constants in another unit, and coefficients that make errors of no machine over
    the travel.
    """
    machine = data.loaded.machine
    travels = {axis: abs(high - low) for axis, (low, high) in machine.travels.items()}
    findings = [
        (("axes", axis, "travel_mm"), f"a travel of {travel:g} mm", "metres")
        for axis, travel in travels.items()
        if travel < TRAVEL_MM
    ]
    limit = CONSTANT_TRAVELS * max(travels.values(), default=np.inf)
    for name, constant in machine.constants.items():
        value = float(getattr(constant, "value", constant))
        if abs(value) > limit:
            findings.append((("constants", name, ""), f"a constant of {value:g} mm", "um"))
    for path, what, meant in findings:
        yield Odd(NONE, {"what": what, "meant": meant}, path=tuple(filter(None, path)))
    for name, component in machine.components.items():
        low, high = data.travels.get(component.of, (0.0, 0.0))
        position, unit = np.linspace(low, high, 9), UNITS[component.unit]
        errors = np.abs(polynomial.polyval(position, component.coefficients or [0.0]))
        if component.is_table and component.coefficients:
            position, errors = np.array(component.at_mm), np.abs(component.coefficients)
        if (errors * unit.to_internal > largest(unit.dimension, position)).any():
            what = f"errors of up to {errors.max():.3g} {component.unit}"
            path = ("components", name, "coefficients")
            yield Odd(NONE, {"what": what, "meant": "a smaller unit"}, path=path)
