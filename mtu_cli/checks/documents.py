"""Parts and machines as they are written: names, places and sizes that are hardly meant."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.polynomial import polynomial

from mtu_cli.checks import DocumentData, Odd, PointsData, check
from mtu_cli.checks.plausible import (
    BEYOND,
    CONSTANT_TRAVELS,
    ERRORS,
    SAME_MM,
    STEEPEST,
    TOLERANCE_UM,
    TRAVEL_MM,
    kind_of,
)
from mtu_cli.units import UNITS

Place = tuple[float, float, float | None]


def alike(names: Sequence[str]) -> list[str]:
    """Pairs of names that differ by case or blanks only."""
    first: dict[str, str] = {}
    found = []
    for name in names:
        other = first.setdefault("".join(name.split()).casefold(), name)
        if other != name:
            found.append(f"{other!r} and {name!r}")
    return found


@check("names-alike", of="points")
def names_alike(data: PointsData) -> Iterator[Odd]:
    """Parts, features or operations that are one but for case and blanks."""
    table = data.table
    for column in ("part", "feature", "operation"):
        if pairs := alike(getattr(table, f"{column}s")):
            yield Odd(np.zeros(1, np.int64), {"column_of": column, "names": pairs}, column)


def same_places(places: Mapping[str, Place]) -> Iterator[list[str]]:
    """Names of features that share a nominal place."""
    at: dict[tuple[float | None, ...], list[str]] = defaultdict(list)
    for name, place in places.items():
        at[tuple(None if v is None or v != v else round(v / SAME_MM) for v in place)].append(name)
    yield from (names for names in at.values() if len(names) > 1)


@check("features-alike", of="part")
def features_of_part(data: DocumentData) -> Iterator[Odd]:
    """Features of a part file at one nominal place."""
    for names in same_places(data.loaded.part.places()):
        yield Odd(facts={"names": names}, path=("features", names[-1]))


@check("features-alike", of="points")
def features_of_points(data: PointsData) -> Iterator[Odd]:
    """Features at one nominal place where the points say where they are."""
    table = data.table
    if data.part is not None:
        return
    first = np.unique(table.feature, return_index=True)[1]
    places = {table.features[table.feature[i]]: tuple(table.nominal[i].tolist()) for i in first}
    row = dict(zip(places, first.tolist(), strict=True))
    for names in same_places(places):
        yield Odd(np.array([row[name] for name in names]), {"names": names}, "feature")


def beyond(
    places: np.ndarray, travels: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[int, str, str, dict[str, object]]]:
    """Places (n, 3) beyond three times the travel from the middle one: index, axis, value, mm."""
    for k, axis in enumerate("xyz"):
        column = places[:, k]
        if axis in travels and np.isfinite(column).any():
            travel = abs(travels[axis][1] - travels[axis][0])
            far = np.abs(column - np.nanmedian(column)) > BEYOND * travel
            for i in np.flatnonzero(far)[:20]:
                facts = {"what": "a nominal place", "axis": axis, "travel": travel, "hint": ""}
                yield int(i), axis, f"{column[i]:g}", facts


@check("position-beyond-travel", of="part")
def part_beyond_travel(data: DocumentData) -> Iterator[Odd]:
    """Features of a part that no axis of the machine reaches."""
    places = data.loaded.part.places()
    own = np.array([[np.nan if v is None else v for v in place] for place in places.values()])
    for i, axis, value, facts in beyond(own, data.travels):
        path = ("features", [*places][i], f"{axis}_mm")
        yield Odd(facts=facts, value=value, path=path)


@check("position-beyond-travel", of="points")
def points_beyond_travel(data: PointsData) -> Iterator[Odd]:
    """Nominal places beside the points that no axis of the machine reaches."""
    if data.part is None:
        for i, axis, value, facts in beyond(data.table.nominal, data.travels):
            yield Odd(np.array([i]), facts, f"nominal_{axis}_mm", value)


@check("implausible-size", of="part")
def sizes_of_part(data: DocumentData) -> Iterator[Odd]:
    """Tolerances that are hardly in um."""
    for i, entry in enumerate(data.loaded.part.lengths):
        if entry.tolerance_um is not None and entry.tolerance_um < TOLERANCE_UM:
            facts = {"what": f"a tolerance of {entry.tolerance_um:g} um", "meant": "mm"}
            yield Odd(facts=facts, path=("lengths", i, "tolerance_um"))


@check("implausible-size", of="machine")
def sizes_of_machine(data: DocumentData) -> Iterator[Odd]:
    """Travels, constants and coefficients whose unit is hardly the one stated."""
    machine = data.loaded.machine
    for axis, (low, high) in machine.travels.items():
        if abs(high - low) < TRAVEL_MM:
            facts = {"what": f"a travel of {abs(high - low):g} mm", "meant": "metres"}
            yield Odd(facts=facts, path=("axes", axis, "travel_mm"))
    longest = max((abs(high - low) for low, high in machine.travels.values()), default=np.inf)
    for name, constant in machine.constants.items():
        value = float(getattr(constant, "value", constant))
        if abs(value) > CONSTANT_TRAVELS * longest:
            facts = {"what": f"a constant of {value:g} mm", "meant": "um"}
            yield Odd(facts=facts, path=("constants", name))
    for name, component in machine.components.items():
        if component.coefficients is None:
            continue
        low, high = machine.travels.get(component.of or "", (0.0, 0.0))
        unit = UNITS[component.unit]
        level, *rest = component.coefficients
        grown = polynomial.polyval(np.linspace(low, high, 9), [0.0, *rest]) * unit.to_internal
        kind = kind_of(unit.dimension)
        steepest = STEEPEST * abs(high - low) if kind == "length" else ERRORS[kind][1]
        size = max(abs(level) * unit.to_internal, float(np.ptp(grown)))
        if abs(level) * unit.to_internal > ERRORS[kind][1] or np.ptp(grown) > steepest:
            what = f"errors of up to {size / unit.to_internal:.3g} {component.unit}"
            facts = {"what": what, "meant": "a smaller unit"}
            yield Odd(facts=facts, path=("components", name, "coefficients"))
