"""Coordinates of places as outputs: their names, units, and how they are read from values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.graph_contract import Place
from mtu_cli.files.graph_kinds import COORDINATES
from mtu_cli.findings import error, suggestion
from mtu_cli.model.graph.nominal import Values
from mtu_cli.model.graph.vectors import cross, dot
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One coordinate of a place; `index` is its number among those of the place."""

    place: str
    coordinate: str
    index: int
    kind: str
    unit: str

    def __str__(self) -> str:
        single = self.coordinate == "value"
        return self.place if single else f"{self.place}.{self.coordinate}"


def outputs_of(
    names: Iterable[str], places: Mapping[str, Place], units: Mapping[str, str]
) -> tuple[Output, ...]:
    """The outputs behind names such as ``P1``, ``P1.x`` or ``d_AC``, each once.

    Raises InputError for a place or coordinate that there is not.
    """
    found: dict[tuple[str, int], Output] = {}
    for name in names:
        place, wanted = _split(name, places)
        kind = places[place].kind
        for index, coordinate in enumerate(COORDINATES[kind]):
            if wanted in (None, coordinate):
                found[place, index] = Output(
                    place=place,
                    coordinate=coordinate,
                    index=index,
                    kind=kind,
                    unit=_coordinate_unit(kind, coordinate, units[place]),
                )
    return tuple(found.values())


def _split(name: str, places: Mapping[str, Place]) -> tuple[str, str | None]:
    if name in places:
        return name, None
    place, dot_, coordinate = name.rpartition(".")
    if not dot_ or place not in places:
        near = suggestion(place if dot_ else name, places)
        raise error("unknown-name", what="place", value=name, **near)
    known = COORDINATES[places[place].kind]
    if coordinate not in known:
        hint = f"one of: {', '.join(f'{place}.{item}' for item in known)}"
        raise error("unknown-name", what="coordinate", value=name, expected=hint)
    return place, coordinate


def _coordinate_unit(kind: str, coordinate: str, unit: str) -> str:
    if kind in ("line", "plane", "frame"):
        return "mm" if coordinate in "xyz" else "rad" if kind == "frame" else "1"
    return unit


def read(
    values: Values, outputs: Sequence[Output], nominal: Values, into: FloatArray | None = None
) -> FloatArray:
    """Outputs (n, m) of the places' arrays; frames are compared with their `nominal`."""
    m = next(iter(values.values())).shape[-1]
    found = np.empty((len(outputs), m)) if into is None else into
    turned: dict[str, FloatArray] = {}
    for row, item in zip(found, outputs, strict=True):
        value = values[item.place]
        if item.kind in ("coordinate", "constant"):
            row[:] = value
        elif item.kind in ("point", "vector"):
            row[:] = value[item.index]
        elif item.index < 3:
            row[:] = value[0, item.index]
        elif item.kind == "frame":
            if item.place not in turned:
                turned[item.place] = _rotation(value, nominal[item.place])
            row[:] = turned[item.place][item.index - 3]
        else:
            row[:] = value[1, item.index - 3]
    return found


def _rotation(frame: FloatArray, nominal: FloatArray) -> FloatArray:
    """Rotation (3, m) rad about the nominal axes: (1/2) sum a_i x b_i of nominal axes a_i and
    actual ones b_i, which is the axis times the sine of the angle.
    """
    axes = np.broadcast_to(nominal[1:], (3, 3, frame.shape[-1]))
    total = cross(axes[0], frame[1]) + cross(axes[1], frame[2]) + cross(axes[2], frame[3])
    total *= 0.5
    return np.stack([dot(axis, total) for axis in axes])
