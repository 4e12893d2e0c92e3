"""The shape of an effects file (``mtu/effects/1``): families of candidate effects as data.

Names in braces stand for what the data has: ``{a}`` and ``{b}`` for axes, ``{n}`` for the axis
normal to both, ``{each}`` for every axis of the errors at once, ``{T}`` for a temperature
column, ``{c}`` for a column that counts parts and ``{v}`` for any other numeric column. A name
followed by ``0``, ``_low`` or ``3`` in the braces is a number of the data: ``{a0}`` its centre,
``{a_low}`` its lowest value, ``{a3}`` sum d^4 / sum d^2 with d = a - a0.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from mtu_cli.files.contract_errors import told
from mtu_cli.files.contracts import Contract
from mtu_cli.files.machine_contract import AxisName, EquationText, ParameterUnitName

MAX_GRID = 500

Text = Annotated[str, Field(min_length=1)]
_FAMILY = re.compile(r"[a-z][a-z0-9-]*")


def _family(text: str) -> str:
    if not _FAMILY.fullmatch(text):
        raise told("wrong value", "small letters, digits and -, such as lost-motion-2")
    return text


FamilyName = Annotated[
    str, AfterValidator(_family), Field(json_schema_extra={"pattern": f"^{_FAMILY.pattern}$"})
]
EffectEquations = Annotated[dict[Text, EquationText], Field(min_length=1)]
EffectParameters = Annotated[dict[Text, ParameterUnitName], Field(min_length=1)]
Over = Literal["feature", "part", "operation"]
Kind = Literal["mean", "offset", "outlier", "scatter"]


def _listed(value: object) -> object:
    values = value if isinstance(value, list) else [value]
    numbers = (int, float)
    return [repr(v) if isinstance(v, numbers) and v is not True else v for v in values]


Bounds = Annotated[
    list[Text], BeforeValidator(_listed, json_schema_input_type=float | str | list[float | str])
]
"""Numbers or expressions in `span`, `spacing`, `low` and `high` of the column searched along."""


class Search(Contract):
    """The grid of a parameter in which the equation is not linear."""

    of: Text | None = Field(
        default=None, description="The position or column that `span` and `low` are of"
    )
    grid: Literal["linear", "log", "frequency", "between"] = Field(
        default="linear",
        description="Even steps, even ratios, even steps of 1/value (at most a quarter of "
        "1/span), or half-way between the values of `of`",
    )
    from_: Bounds = Field(default=["low"], alias="from", description="The largest of these")
    to: Bounds = Field(default=["high"], description="The smallest of these")
    count: Annotated[int, Field(ge=2, le=MAX_GRID)] | None = Field(
        default=None, description="Number of values; the largest number of a frequency grid"
    )
    margin: Annotated[int, Field(ge=1)] = Field(
        default=2, description="Values on either side of a grid between values"
    )

    @model_validator(mode="before")
    @classmethod
    def _log(cls, data: Any) -> Any:
        if isinstance(data, dict) and "log" in data and "grid" not in data:
            if not isinstance(data["log"], bool):
                raise told("wrong value of `log`", "true or false, or `grid: log`")
            rest = {key: value for key, value in data.items() if key != "log"}
            return rest | {"grid": "log" if data["log"] else "linear"}
        return data


Searched = Annotated[dict[Text, Search], Field(max_length=1)]


class MemberTemplate(Contract):
    """One form of a family: its parameters, and its equations linear in them."""

    parameters: EffectParameters = Field(description="Name and unit")
    equations: EffectEquations = Field(description="mm; linear in the parameters")
    search: Searched = Field(default={}, description="A parameter that is searched")
    readings: bool = Field(
        default=False, description="Whether it is tested on readings of a component alone"
    )


class Family(Contract):
    """A family of candidate effects; either one form, or several as `members`."""

    family: FamilyName
    name: Text | None = Field(
        default=None, description="Name of a candidate; family-{a} or the family where not given"
    )
    says: Text = Field(description="What it is, in words")
    separates: Text | None = Field(default=None, description="What tells it from its rivals")
    separates_readings: Text | None = Field(
        default=None, description="The same of readings of a component, where it is not the same"
    )
    kind: Kind = Field(default="mean", description="What of the errors it changes")
    over: Over | None = Field(
        default=None, description="`chosen` is 1 on one of these, 0 on the others"
    )
    axes: list[AxisName] | None = Field(
        default=None, description="What {a} may be; any if not given"
    )
    least_axes: Annotated[int, Field(ge=1, le=3)] = Field(
        default=1, description="Axes with errors that it needs"
    )
    needs: list[Text] = Field(default=[], description="Columns that must be there and change")
    parameters: EffectParameters | None = Field(default=None, description="Name and unit")
    equations: EffectEquations | None = Field(
        default=None, description="mm; linear in the parameters"
    )
    search: Searched = Field(default={}, description="A parameter that is searched")
    members: Annotated[list[MemberTemplate], Field(min_length=1)] | None = Field(
        default=None, description="Several forms of the family, tested apart"
    )


class Effects(Contract):
    """A library of candidate effects."""

    schema_: Literal["mtu/effects/1"] = Field(alias="schema")
    effects: Annotated[list[Family], Field(min_length=1)]
