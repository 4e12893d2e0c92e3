"""The contract of a measurement graph file (``mtu/graph/1``)."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract_errors import lists_within, number_expectation, told
from mtu_cli.files.contracts import Contract, IdText
from mtu_cli.files.graph_kinds import PlaceKind, TransitionKind
from mtu_cli.language import EquationError, evaluate, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS

LARGEST = 1e9
"""A thousand kilometres: beyond it a coordinate is a slip, and products of them overflow."""
LARGEST_U_UM = 1e6
MAX_REPEATS = 10_000
Axis = Literal["x", "y", "z"]
Triple = tuple[float, float, float]


def number_or_formula(value: object) -> float:
    """A number, or a formula of numbers such as ``30*pi/180``, as a number."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        number = float(value)
    elif isinstance(value, str):
        try:
            node = parse(value, BUDGET_FUNCTIONS)
        except EquationError as error:
            raise told(f"not a formula: {error}", error.expected or "a number") from None
        unknown = list(names(node))
        if unknown:
            hint = number_expectation(value, "a number, or a formula of numbers")
            raise told(f"unknown name {unknown[0]!r} in a formula of numbers", hint)
        number = float(evaluate(node, {}))
    else:
        raise told("wrong value", "a number, or a formula such as 30*pi/180")
    if not math.isfinite(number) or abs(number) > LARGEST:
        raise told("wrong value", f"a number of at most {LARGEST:g}")
    return number


def _not_negative(value: object) -> float:
    number = number_or_formula(value)
    if number < 0:
        raise told("wrong value", "a number of at least 0")
    return number


def _nominal(value: object) -> tuple[float, ...]:
    items = value if isinstance(value, list) else [value]
    if isinstance(value, list) and len(items) != 3:
        raise told("wrong value", "one number for a coordinate, [x, y, z] for a point")
    return tuple(number_or_formula(item) for item in items)


_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _along(value: object) -> Triple:
    expected = "x, -x, y, -y, z, -z or [i, j, k]"
    if isinstance(value, str):
        sign, letter = (-1.0, value[1:]) if value[:1] == "-" else (1.0, value.removeprefix("+"))
        if letter not in _AXES:
            raise told("no direction", expected)
        i, j, k = _AXES[letter]
        return (sign * i + 0.0, sign * j + 0.0, sign * k + 0.0)
    if not isinstance(value, list) or len(value) != 3:
        raise told("no direction", expected)
    i, j, k = (number_or_formula(item) for item in value)
    length = math.hypot(i, j, k)
    if length == 0:
        raise told("a direction of length 0", expected)
    return (i / length, j / length, k / length)


def _list(value: object) -> object:
    return value if isinstance(value, list) else [value]


def _correlation(value: object) -> object:
    if not isinstance(value, list) or len(value) != 3:
        raise told("not a correlation", "[first, second, r]")
    return tuple(value)


Number = Annotated[
    float, BeforeValidator(number_or_formula, json_schema_input_type=float | str)
]  # fmt: skip
Uncertain = Annotated[float, BeforeValidator(_not_negative, json_schema_input_type=float | str)]
Nominal = Annotated[
    tuple[float, ...],
    BeforeValidator(_nominal, json_schema_input_type=float | str | list[float | str]),
]
Direction = Annotated[
    Triple, BeforeValidator(_along, json_schema_input_type=str | list[float | str])
]
Um = Annotated[float, Field(ge=0, le=LARGEST_U_UM)]
Repeats = Annotated[int, Field(ge=1, le=MAX_REPEATS)]
Correlation = Annotated[
    tuple[IdText, IdText, float],
    BeforeValidator(_correlation, json_schema_input_type=list[Any]),
]


class Probing(Contract):
    """Standard uncertainties of one probing, um: u1, u2 and u3 of Stryczek, eq. (1)."""

    axis_um: Um = Field(default=0.0, description="u1: position of the axis")
    probe_um: Um = Field(default=0.0, description="u2: the probe; averaged by repeats")
    perpendicular_um: Um = Field(default=0.0, description="u3: probing not perpendicular")


class OwnProbing(Contract):
    """What one transition has otherwise than the graph."""

    axis_um: Um | None = None
    probe_um: Um | None = None
    perpendicular_um: Um | None = None


class Place(Contract):
    """A place: what it holds, and its nominal or its value where no transition computes it."""

    kind: PlaceKind
    axis: Axis | None = Field(default=None, description="Of a coordinate")
    nominal_mm: Nominal | None = Field(
        default=None, description="Of a measured coordinate or point"
    )
    value: Number | None = Field(default=None, description="Of a constant: mm, rad or 1")
    u: Uncertain | None = Field(default=None, description="Its standard uncertainty")
    distribution: Literal["normal", "rectangular", "triangular"] = "normal"
    known: bool = Field(
        default=False, description="A point that is exact from the start: of a drawing, say"
    )
    unit: Literal["mm", "rad", "1"] | None = Field(
        default=None, description="Of a constant, where its transition does not tell it"
    )
    says: str | None = Field(default=None, description="What it is, in words")

    @property
    def marked(self) -> bool:
        """Whether it holds a marker from the start: no transition makes it."""
        return self.value is not None or (self.known and self.nominal_mm is not None)


class Transition(Contract):
    """A step: what it does, from which places, to which."""

    do: TransitionKind
    in_: list[IdText] = Field(default=[], alias="in")
    out: Annotated[
        list[IdText],
        Field(min_length=1),
        BeforeValidator(_list, json_schema_input_type=str | list[str]),
    ]
    repeats: Repeats | None = Field(default=None, description="Probings averaged")
    uncertainty: OwnProbing | None = None
    along: Direction | None = Field(default=None, description="Direction of probing")
    formula: str | None = Field(
        default=None, description="Of compute, in the input places; H1.x of a point H1"
    )
    says: str | None = Field(default=None, description="What it is, in words")


class Graph(Contract):
    """A measurement graph: places, transitions, and the places to report."""

    schema_: Literal["mtu/graph/1"] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    uncertainty: Probing = Field(default=Probing(), description="Of one probing, um")
    repeats: Repeats = Field(default=1, description="Probings averaged at every meas")
    places: Annotated[dict[str, Place], Field(min_length=1)]
    transitions: Annotated[list[Transition], Field(min_length=1)]
    report: list[IdText] = Field(default=[], description="Default: places that end the graph")
    correlations: Annotated[list[Correlation], BeforeValidator(lists_within)] = Field(
        default=[], description="Of two uncertain constants: [first, second, r]"
    )
