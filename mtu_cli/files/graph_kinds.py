"""What transitions there are in a measurement graph, and which kinds of place they join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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

Given = tuple[str | None, str | None]
"""Kind and axis of an input place; None where they are not known, which fits anything."""


@dataclass(frozen=True, slots=True)
class Slot:
    """One input, or a run of `least` to `most` inputs of the same kinds (None: any number)."""

    kinds: tuple[str, ...]
    axis: str | None = None
    least: int = 1
    most: int | None = 1

    def accepts(self, given: Given) -> bool:
        kind, axis = given
        if kind is None:
            return True
        return kind in self.kinds and (self.axis is None or axis in (self.axis, None))

    def __str__(self) -> str:
        text = " or ".join(self.kinds) + (f" {self.axis}" if self.axis else "")
        if self.least == self.most == 1:
            return text
        plural = " or ".join(f"{kind}s" for kind in self.kinds)
        if self.most is None:
            return f"{self.least} or more {plural}"
        return f"{text} (optional)"


@dataclass(frozen=True, slots=True)
class Variant:
    """One way to use a transition: its inputs in order, and all that it can put out.

    `name` tells the variants of one transition apart.
    """

    name: str
    inputs: tuple[Slot, ...]
    outputs: tuple[str, ...]

    def reach(self, given: Sequence[Given]) -> tuple[int, bool]:
        """How many of the inputs fit, in order, and whether nothing is missing after these."""
        at = 0
        for slot in self.inputs:
            count = 0
            while at < len(given) and (slot.most is None or count < slot.most):
                if not slot.accepts(given[at]):
                    break
                at, count = at + 1, count + 1
            if count < slot.least:
                return at, False
        return at, True

    def fits(self, given: Sequence[Given]) -> bool:
        at, whole = self.reach(given)
        return whole and at == len(given)

    def gives(self, given: Sequence[Given]) -> bool:
        """Whether it can fill these output places; it need not fill all that it could."""
        return len(given) <= len(self.outputs) and self.wrong_output(given) is None

    def wrong_output(self, given: Sequence[Given]) -> int | None:
        """The first output place that it does not make."""
        kinds = (*self.outputs, *[""] * len(given))
        return next((i for i, (kind, _) in enumerate(given) if kind not in (kinds[i], None)), None)

    def __str__(self) -> str:
        return ", ".join(map(str, self.inputs)) if self.inputs else "no input"


def _one(*kinds: str, axis: str | None = None) -> Slot:
    return Slot(kinds, axis)


_POINT, _VECTOR, _LINE, _PLANE = _one("point"), _one("vector"), _one("line"), _one("plane")
_CONSTANT = _one("constant")
_CROSS = tuple(_one("coordinate", axis=axis) for axis in "xxyy")


def _points(least: int) -> Slot:
    return Slot(("point",), None, least, None)


TRANSITIONS: dict[str, tuple[Variant, ...]] = {
    "meas": (Variant("coordinate", (), ("coordinate",)), Variant("point", (), ("point",))),
    "displace": (
        Variant("coordinate", (_one("coordinate"), _CONSTANT), ("coordinate",)),
        Variant("point", (_POINT, _VECTOR), ("point",)),
    ),
    "middle": (Variant("", (_POINT, _POINT), ("point",)),),
    "vector": (Variant("", (_POINT, _POINT), ("vector",)),),
    "unit_v": (
        Variant("vector", (_VECTOR,), ("vector",)),
        Variant("points", (_POINT, _POINT), ("vector",)),
    ),
    "ratio": (
        Variant("vector", (_VECTOR, _CONSTANT), ("vector",)),
        Variant("constant", (_CONSTANT, _CONSTANT), ("constant",)),
    ),
    "length": (
        Variant("vector", (_VECTOR,), ("constant",)),
        Variant("points", (_POINT, _POINT), ("constant",)),
    ),
    "ball": (Variant("", (*_CROSS, _one("coordinate", axis="z"), _CONSTANT), ("point",)),),
    "hole": (Variant("", (*_CROSS, Slot(("constant",), None, 0, 1)), ("point",)),),
    "circle": (Variant("", (_points(3),), ("point", "constant")),),
    "sphere": (
        Variant("free", (_points(4),), ("point", "constant")),
        Variant("radius", (_points(4), _CONSTANT), ("point",)),
    ),
    "line": (
        Variant("points", (_POINT, _POINT), ("line",)),
        Variant("planes", (_PLANE, _PLANE), ("line",)),
    ),
    "aline": (Variant("", (_POINT, _VECTOR), ("line",)),),
    "plane": (
        Variant("points", (_points(3),), ("plane",)),
        Variant("vector", (_POINT, _VECTOR), ("plane",)),
    ),
    "point": (
        Variant("line", (_LINE, _PLANE), ("point",)),
        Variant("planes", (_PLANE, _PLANE, _PLANE), ("point",)),
    ),
    "normal": (Variant("", (_PLANE,), ("vector",)),),
    "direction": (Variant("", (_LINE,), ("vector",)),),
    "project": (Variant("", (_POINT, _VECTOR, _PLANE), ("point",)),),
    "per_proj": (
        Variant("plane", (_POINT, _PLANE), ("point",)),
        Variant("line", (_POINT, _LINE), ("point",)),
    ),
    "distance": (
        Variant("points", (_POINT, _POINT), ("constant",)),
        Variant("line", (_POINT, _LINE), ("constant",)),
        Variant("plane", (_POINT, _PLANE), ("constant",)),
        Variant("lines", (_LINE, _LINE), ("constant",)),
    ),
    "angle": (Variant("", (_VECTOR, _VECTOR), ("constant",)),),
    "frame": (Variant("", (_PLANE, _LINE, _POINT), ("frame",)),),
    "transform": (Variant("", (_one("frame"), _POINT), ("point",)),),
    "compute": (
        Variant(
            "", (Slot(("constant", "coordinate", *NAMED_BY_COORDINATE), None, 1, None),),
            ("constant",),
        ),
    ),
}  # fmt: skip


def described(given: Given) -> str:
    """A place in words: ``a coordinate x``."""
    kind, axis = given
    return f"a {kind} {axis}" if axis else f"a {kind}"
