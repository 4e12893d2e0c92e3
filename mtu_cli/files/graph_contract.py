"""The shape of a measurement graph file (``mtu/graph/1``); `model.graph.net` checks its net."""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract import Contract, IdText, Name, is_number, one_or_more, optional, wrong
from mtu_cli.files.part import LARGEST_MM
from mtu_cli.findings import InputError
from mtu_cli.language import check_known, evaluate, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS

LARGEST_U_UM = 1e6
MAX_REPEATS = 10_000
Triple = tuple[float, float, float]
PlaceKind = Literal["coordinate", "point", "vector", "line", "plane", "frame", "constant"]
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
TransitionKind = Literal[
    "meas", "displace", "middle", "vector", "unit_v", "ratio", "length", "ball", "hole",
    "circle", "sphere", "line", "aline", "plane", "point", "normal", "direction", "project",
    "per_proj", "distance", "angle", "frame", "transform", "compute",
]  # fmt: skip
"""As `model.graph.transitions` registers them."""


def number_or_formula(value: object) -> float:
    """A number, or a formula of numbers such as ``30*pi/180``, as a number.

    >>> number_or_formula("30/4")
    7.5
    """
    if isinstance(value, str):
        try:
            node = parse(value, BUDGET_FUNCTIONS)
            check_known(node, ())
        except InputError as error:
            fault = error.findings[0]
            name = f" {fault.value!r}" if fault.value else ""
            kind = f"a formula of numbers: {fault.text}{name} at column {fault.column}"
            expected = "a number, or a formula of numbers"
            raise wrong(expected, "wrong-type", kind=kind) from None
        value = float(evaluate(node, {}))
    if not is_number(value):
        raise wrong("a number, or a formula such as 30*pi/180")
    if not abs(number := float(value)) <= LARGEST_MM:
        raise wrong(f"a number of at most {LARGEST_MM:g}")
    return number


def _nominal(value: object) -> tuple[float, ...]:
    if not isinstance(value, list):
        return (number_or_formula(value),)
    if len(value) != 3:
        raise wrong("one number for a coordinate, [x, y, z] for a point")
    return tuple(map(number_or_formula, value))


def _direction(value: object) -> Triple:
    """A unit vector from an axis with its sign, ``-z``, or three numbers."""
    expected = "x, -x, y, -y, z, -z or [i, j, k]"
    if isinstance(value, str) and (match := re.fullmatch(r"([+-]?)([xyz])", value)):
        size = -1.0 if match[1] == "-" else 1.0
        value = [size if axis == match[2] else 0.0 for axis in "xyz"]
    if not isinstance(value, list) or len(value) != 3:
        raise wrong(expected)
    i, j, k = map(number_or_formula, value)
    if not (length := math.hypot(i, j, k)):
        raise wrong(f"{expected}, longer than 0")
    return (i / length, j / length, k / length)


Number = Annotated[float, BeforeValidator(number_or_formula, json_schema_input_type=float | str)]
Nominal = Annotated[
    tuple[float, ...],
    BeforeValidator(_nominal, json_schema_input_type=float | str | list[float | str]),
]
Direction = Annotated[
    Triple, BeforeValidator(_direction, json_schema_input_type=str | list[float | str])
]
Um = Annotated[float, Field(ge=0, le=LARGEST_U_UM)]
Repeats = Annotated[int, Field(ge=1, le=MAX_REPEATS)]
Outputs = Annotated[list[IdText], Field(min_length=1), one_or_more(str)]


class Probing(Contract):
    """Standard uncertainties of one probing, um: u1, u2 and u3 of Stryczek, eq. (1)."""

    axis_um: Um = optional("u1: position of the axis", 0.0)
    probe_um: Um = optional("u2: the probe; averaged by repeats", 0.0)
    perpendicular_um: Um = optional("u3: probing not perpendicular", 0.0)


class Place(Contract):
    """A place: what it holds, and its nominal or its value where no transition computes it."""

    kind: PlaceKind
    axis: Literal["x", "y", "z"] | None = optional("Of a coordinate")
    nominal_mm: Nominal | None = optional("Of a measured coordinate or point")
    value: Number | None = optional("Of a constant: mm, rad or 1")
    u: Annotated[Number, Field(ge=0)] | None = optional("Its standard uncertainty")
    distribution: Literal["normal", "rectangular", "triangular"] = "normal"
    known: bool = optional("A point that is exact from the start: of a drawing, say", False)
    unit: Literal["mm", "rad", "1"] | None = optional(
        "Of a constant, where its transition does not give it"
    )
    says: str | None = optional("What it is, in words")

    @property
    def marked(self) -> bool:
        """Whether it holds a marker from the start: no transition makes it."""
        if self.kind == "point":
            return self.known and self.nominal_mm is not None
        return self.kind == "constant" and self.value is not None


class Transition(Contract):
    """A step: what it does, from which places, to which."""

    do: TransitionKind
    in_: list[IdText] = Field(default=[], alias="in")
    out: Outputs
    repeats: Repeats | None = optional("Probings averaged")
    uncertainty: Probing | None = optional("What differs from that of the graph")
    along: Direction | None = optional("Direction of probing")
    formula: str | None = optional("Of compute, in the input places; H1.x of a point H1")
    says: str | None = optional("What it is, in words")


class Graph(Contract):
    """A measurement graph: places, transitions, and the places to report."""

    schema_: Literal["mtu/graph/1"] = Field(alias="schema")
    name: Name
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    uncertainty: Probing = optional("Of one probing, um", Probing())
    repeats: Repeats = optional("Probings averaged at every meas", 1)
    places: Annotated[dict[Name, Place], Field(min_length=1)]
    transitions: Annotated[list[Transition], Field(min_length=1)]
    report: list[IdText] = optional("Default: places that end the graph", [])
