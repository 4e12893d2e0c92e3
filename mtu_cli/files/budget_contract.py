"""The contract of budget files (``mtu/budget/1``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract_errors import lists_within, number_expectation, told
from mtu_cli.files.contracts import Contract, NonNegative, Positive
from mtu_cli.files.study import MAX_COVERAGE

DistributionName = Literal[
    "normal", "t", "rectangular", "triangular", "trapezoidal", "curvilinear-trapezoidal", "arcsine"
]
LARGEST_PROBABILITY = 0.999
"""Beyond it a Monte Carlo takes too many trials to check the interval."""

Text = Annotated[str, Field(min_length=1)]
UNIT = "Unit, such as mm, 1/degC or um/m/K; it converts nothing, but those of a sum must agree"


class Contribution(Contract):
    """How well a quantity is known from one source: JCGM 100:2008, 4.2 and 4.3."""

    elsewhere: ClassVar[Mapping[str, str]] = {
        "readings": "`readings:` beside `contributions:`, in place of `value:`: it is their mean",
        "value": "`value:` beside `contributions:`, which are all about it",
        "unit": "`unit:` beside `contributions:`, which are all in it",
        "values": "`readings:`",
        "resolution": "`half_width:`, half of it, with `distribution: rectangular`",
        "U95": "`U:` with its `k:`",
        "s": "`u:`, of a mean s/sqrt(n), with `dof:`, n - 1; or the `readings:`",
        "n": "`dof:`, n - 1 of a mean of n; or the `readings:`",
        "nu": "`dof:`",
        "df": "`dof:`",
    }
    says: str | None = Field(default=None, description="What it is, in words")
    u: NonNegative | None = Field(default=None, description="Standard uncertainty")
    half_width: NonNegative | None = Field(
        default=None, description="Half-width of the distribution's base"
    )
    low: float | None = Field(default=None, description="Lower limit; with `high`")
    high: float | None = Field(default=None, description="Upper limit; with `low`")
    U: NonNegative | None = Field(default=None, description="Expanded uncertainty; with `k`")
    k: Positive | None = Field(default=None, description="Coverage factor of `U`")
    distribution: DistributionName | None = Field(default=None, description="Default: normal")
    dof: Positive | None = Field(default=None, description="Degrees of freedom; default: infinite")
    top: NonNegative | None = Field(
        default=None, description="Half-width of the flat top of a trapezoidal distribution"
    )
    inexact: Positive | None = Field(
        default=None,
        description="Half-range of the half-width itself (curvilinear-trapezoidal), d of JCGM 101",
    )


class Input(Contribution):
    """An input quantity: an estimate and the contributions to its uncertainty."""

    value: float | None = Field(default=None, description="Estimate; default: mean of readings")
    unit: str | None = Field(default=None, description=UNIT)
    readings: Annotated[list[float], Field(min_length=2)] | None = Field(
        default=None, description="Repeated readings: mean, s/sqrt(n), n - 1"
    )
    contributions: list[Contribution] = Field(
        default=[],
        description="Further independent contributions to the same quantity; `readings` beside it",
    )


def _plain_number(value: object) -> object:
    """`g: 9.81` is a constant: `g: {value: 9.81}`, whose uncertainty nobody can have forgotten."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return {"value": value}
    if isinstance(value, (str, list)):
        expected = number_expectation(value) if isinstance(value, str) else "a number"
        keys = ", or keys with values: {value: 10, u: 0.1}" if expected == "a number" else ""
        raise told("wrong value", expected + keys)
    return value


def _correlation(value: object) -> object:
    if (
        isinstance(value, list)
        and len(value) == 3
        and isinstance(value[0], str)
        and isinstance(value[1], str)
        and isinstance(value[2], (int, float))
        and not isinstance(value[2], bool)
    ):
        return value
    raise told("not a correlation", "two inputs and a coefficient, such as [V, I, 0.2]")


def _correlations(value: object) -> object:
    if isinstance(value, dict):
        expected = "two inputs and a coefficient in brackets for each, [[V, I, 0.2]]"
        raise told("not a list of correlations", expected)
    return lists_within(value)


def _probability(value: object) -> object:
    if isinstance(value, (int, float)) and 1 < value <= 100 * LARGEST_PROBABILITY:
        raise told("a probability above 1", f"{value / 100:.6g} for {value:g} %")
    return value


Correlation = Annotated[
    list[Any],
    BeforeValidator(_correlation, json_schema_input_type=list[str | float]),
    Field(min_length=3, max_length=3),
]


class Quantity(Contract):
    """The measurand."""

    name: Text | None = Field(default=None, description="Its symbol; y by default")
    unit: str | None = Field(default=None, description=UNIT)
    says: str | None = Field(default=None, description="What it is, in words")


class Coverage(Contract):
    """How U is meant: for a coverage probability, or with a given factor."""

    probability: Annotated[
        Annotated[float, Field(gt=0, le=LARGEST_PROBABILITY)] | None, BeforeValidator(_probability)
    ] = Field(default=None, description="Coverage probability; k is then that of Student's t")
    k: Annotated[float, Field(gt=0, lt=MAX_COVERAGE)] | None = Field(
        default=None, description="Coverage factor of U = k u"
    )


class Budget(Contract):
    """An uncertainty budget: JCGM 100, JCGM 101 and, with several equations, JCGM 102."""

    schema_: Literal["mtu/budget/1"] = Field(alias="schema")
    name: Text
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    quantity: Quantity | None = Field(default=None, description="The measurand of `equation`")
    units: dict[str, str] = Field(default={}, description="Units of the outputs of `equations`")
    equation: str | None = Field(default=None, description="The measurand in terms of the inputs")
    equations: Annotated[dict[str, str], Field(min_length=1)] | None = Field(
        default=None, description="Several measurands, with their covariance"
    )
    inputs: Annotated[
        dict[
            str,
            Annotated[Input, BeforeValidator(_plain_number, json_schema_input_type=Input | float)],
        ],
        Field(min_length=1),
    ]
    correlations: Annotated[list[Correlation], BeforeValidator(_correlations)] = Field(
        default=[], description="[input, input, correlation coefficient]"
    )
    simultaneous: Annotated[
        list[Annotated[list[str], Field(min_length=2)]], BeforeValidator(lists_within)
    ] = Field(default=[], description="Inputs whose readings were taken together")
    coverage: Coverage = Field(default=Coverage(), description="Default: probability 0.95")
