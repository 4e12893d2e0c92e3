"""Names and places that are hardly meant, in parts and tables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.checks import Data, DocumentData, Floats, Odd, PointsData, ReadingsData, Rows, check
from mtu_cli.checks.plausible import BEYOND, NARROW, POSITIONS
from mtu_cli.files.points import SAME_MM

Position = tuple[Sequence[str], str, Floats, Rows, str]
NONE = np.arange(0)


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
        known, first = getattr(data.table, f"{column}s"), dict[str, str]()
        others = [first.setdefault("".join(name.split()).casefold(), name) for name in known]
        if pairs := [pair for pair in zip(others, known, strict=True) if pair[0] != pair[1]]:
            odd = [known.index(name) for _, name in pairs]
            rows = np.flatnonzero(np.isin(getattr(data.table, column), odd))
            names = [f"{other!r} and {name!r}" for other, name in pairs]
            facts = {"what": "names that differ by case or blanks only", "names": names}
            yield Odd(rows, facts, column)


@check("position-beyond-travel", of=("readings", "drift", "points", "part"))
def beyond(data: Data) -> Iterator[Odd]:
    """Positions so far out that no coordinate system of the machine holds them, and those of
    passes that cover too little of the travel, and all of it in metres or inches.
    """
    for names, axis, values, rows, column in _positions(data):
        low, high = data.travels.get(axis, (-np.inf, np.inf))
        travel, size = abs(high - low), float(np.ptp(values))
        # Readings are in the frame of the machine, places in one of the part.
        middle = 0.0 if isinstance(data, ReadingsData) else np.median(values)
        odd = np.flatnonzero(np.abs(values - middle) > BEYOND * travel)
        if len(odd):
            size = float(np.abs(values[odd]).max())
        meant = [unit for unit, to in POSITIONS.items() if NARROW * travel < size * to <= travel]
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
        known, column = data.loaded.part.places(), "{}_mm"
        names, nominal = [*known], np.array([*known.values()], np.float64)
    else:
        at = slice(None) if data.part is None and data.travels else slice(0)
        names = np.take(data.table.features, data.table.feature[at]).tolist()
        nominal, column = data.table.nominal[at], "nominal_{}_mm"
    for axis, values in zip("xyz", nominal.T, strict=True):
        if names and np.isfinite(values).all():
            yield names, axis, values, np.arange(len(names)), column.format(axis)
