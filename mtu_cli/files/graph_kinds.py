"""What transitions there are in a measurement graph, and which kinds of place they join."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

PlaceKind = Literal["coordinate", "point", "vector", "line", "plane", "frame", "constant"]
KINDS: tuple[str, ...] = get_args(PlaceKind)
COORDINATES: dict[str, tuple[str, ...]] = {
    "coordinate": ("value",),
    "constant": ("value",),
    "point": ("x", "y", "z"),
    "vector": ("i", "j", "k"),
    "line": ("x", "y", "z", "i", "j", "k"),
    "plane": ("x", "y", "z", "i", "j", "k"),
    "frame": ("x", "y", "z", "rx", "ry", "rz"),
}
"""rx, ry, rz: the rotation of a frame about its own nominal axes."""
NAMED_BY_COORDINATE = ("point", "vector")
"""Kinds that a formula takes by their coordinates."""
TransitionKind = Literal[
    "meas", "displace", "middle", "vector", "unit_v", "ratio", "length", "ball", "hole",
    "circle", "sphere", "line", "aline", "plane", "point", "normal", "direction", "project",
    "per_proj", "distance", "angle", "frame", "transform", "compute",
]  # fmt: skip
SIGNATURES = {
    "meas": {"coordinate": "-> coordinate", "point": "-> point"},
    "displace": {
        "coordinate": "coordinate constant -> coordinate",
        "point": "point vector -> point",
    },
    "middle": {"": "point point -> point"},
    "vector": {"": "point point -> vector"},
    "unit_v": {"vector": "vector -> vector", "points": "point point -> vector"},
    "ratio": {"vector": "vector constant -> vector", "constant": "constant constant -> constant"},
    "length": {"vector": "vector -> constant", "points": "point point -> constant"},
    "ball": {"": "coordinate.x*2 coordinate.y*2 coordinate.z constant -> point"},
    "hole": {"": "coordinate.x*2 coordinate.y*2 constant*0-1 -> point"},
    "circle": {"": "point*3- -> point constant*0-1"},
    "sphere": {"free": "point*4- -> point constant*0-1", "radius": "point*4- constant -> point"},
    "line": {"points": "point point -> line", "planes": "plane plane -> line"},
    "aline": {"": "point vector -> line"},
    "plane": {"points": "point*3- -> plane", "vector": "point vector -> plane"},
    "point": {"line": "line plane -> point", "planes": "plane plane plane -> point"},
    "normal": {"": "plane -> vector"},
    "direction": {"": "line -> vector"},
    "project": {"": "point vector plane -> point"},
    "per_proj": {"plane": "point plane -> point", "line": "point line -> point"},
    "distance": {
        "points": "point point -> constant",
        "line": "point line -> constant",
        "plane": "point plane -> constant",
        "lines": "line line -> constant",
    },
    "angle": {"": "vector vector -> constant"},
    "frame": {"": "plane line point -> frame"},
    "transform": {"": "frame point -> point"},
    "compute": {"": "constant|coordinate|point|vector*1- -> constant"},
}
"""By transition and variant the places that it takes and makes, in their order. ``coordinate.x``
is one along x, ``point*3-`` stands for three or more of them, ``constant*0-1`` may be left out.
"""
UNKNOWN = "?"
"""A place of which no kind is known."""
_SLOT = re.compile(r"(?P<kinds>[a-z|]+)(?:\.(?P<axis>[xyz]))?(?:\*(?P<least>\d)(?P<most>-\d?)?)?")


def described(kind: str, axis: str | None) -> str:
    """A place in words: ``a coordinate x``."""
    return f"a {kind} {axis}" if axis else f"a {kind}"


@dataclass(frozen=True, slots=True)
class Slot:
    """`least` to `most` places of the same `kinds` in a row; None: any number."""

    kinds: tuple[str, ...]
    axis: str | None
    least: int
    most: int | None

    @property
    def pattern(self) -> str:
        """Of its places as `described`, each with a semicolon; what is not known fits anything."""
        most = "" if self.most is None else self.most
        place = rf"a (?:{'|'.join(self.kinds)})(?: {self.axis or '[xyz]'})?"
        return rf"(?:(?:\{UNKNOWN}|{place});){{{self.least},{most}}}"

    def __str__(self) -> str:
        text = " or ".join(self.kinds) + (f" {self.axis}" if self.axis else "")
        if self.most is None:
            return f"{self.least} or more of {text}"
        return text if self.least == self.most == 1 else f"{self.least or 'optional'} {text}"


@cache
def _pattern(slots: tuple[Slot, ...]) -> re.Pattern[str]:
    return re.compile("".join(slot.pattern for slot in slots))


def fits(slots: tuple[Slot, ...], places: Sequence[str]) -> bool:
    """Whether places, as `described`, are those of a signature."""
    return _pattern(slots).fullmatch("".join(f"{place};" for place in places)) is not None


@dataclass(frozen=True, slots=True)
class Variant:
    """One way to use a transition: the places that it takes and makes."""

    name: str
    inputs: tuple[Slot, ...]
    outputs: tuple[Slot, ...]


def _slots(text: str) -> tuple[Slot, ...]:
    slots = []
    for found in _SLOT.finditer(text):
        least, most = int(found["least"] or 1), found["most"]
        upper = least if most is None else int(most[1:]) if most[1:] else None
        slots.append(Slot(tuple(found["kinds"].split("|")), found["axis"], least, upper))
    return tuple(slots)


TRANSITIONS: dict[str, tuple[Variant, ...]] = {
    do: tuple(
        Variant(name, *map(_slots, signature.split("->"))) for name, signature in variants.items()
    )
    for do, variants in SIGNATURES.items()
}
