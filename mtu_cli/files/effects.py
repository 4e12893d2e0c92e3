"""Files of candidate families of effects (``mtu/effects/1``): what stands in them."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from mtu_cli.files.contract import Contract, Name, optional, wrong
from mtu_cli.files.machine_contract import AxisName, EquationText, ParameterUnitName

MAX_GRID = 500
BOUNDS = ("span", "spacing", "low", "high")
"""What the ends of a search may be given in."""


Text = Annotated[str, Field(min_length=1)]
_FAMILY = "[a-z][a-z0-9-]*"


def _family(text: str) -> str:
    if not re.fullmatch(_FAMILY, text):
        raise wrong("small letters, digits and -, such as lost-motion-2")
    return text


FamilyName = Annotated[
    str, AfterValidator(_family), Field(json_schema_extra={"pattern": f"^{_FAMILY}$"})
]
EffectEquations = Annotated[dict[Name, EquationText], Field(min_length=1)]
EffectParameters = Annotated[dict[Name, ParameterUnitName], Field(min_length=1)]
Kind = Literal["mean", "offset", "outlier", "scatter"]


def _listed(value: object) -> object:
    values = value if isinstance(value, list) else [value]
    return [repr(item) if type(item) in (int, float) else item for item in values]


Bounds = Annotated[
    list[Text], BeforeValidator(_listed, json_schema_input_type=float | str | list[float | str])
]
"""Numbers or expressions in `BOUNDS` of the column searched along."""


class Search(Contract):
    """The grid of a parameter in which the equation is not linear."""

    of: Text | None = optional("The position or column that `span` and `low` are of")
    grid: Literal["linear", "log", "frequency", "between"] = optional(
        "Even steps, even ratios, even steps of 1/value (at most a quarter of "
        "1/span), or half-way between the values of `of`",
        "linear",
    )
    from_: Bounds = Field(default=["low"], alias="from", description="The largest of these")
    to: Bounds = optional("The smallest of these", ["high"])
    count: Annotated[int, Field(ge=2, le=MAX_GRID)] | None = optional(
        "Number of values; the largest number of a frequency grid"
    )
    margin: Annotated[int, Field(ge=1)] = optional(
        "Values on either side of a grid between values", 2
    )

    @model_validator(mode="before")
    @classmethod
    def _log(cls, data: Any) -> Any:
        if isinstance(data, dict) and "log" in data and "grid" not in data:
            if not isinstance(data["log"], bool):
                raise wrong("`log: true`, or `grid: log`")
            rest = {key: value for key, value in data.items() if key != "log"}
            return rest | {"grid": "log" if data["log"] else "linear"}
        return data


Searched = Annotated[dict[Name, Search], Field(max_length=1)]


class MemberTemplate(Contract):
    """One form of a family: its parameters, and its equations linear in them."""

    parameters: EffectParameters = Field(description="Name and unit")
    equations: EffectEquations = Field(description="mm; linear in the parameters")
    search: Searched = optional("A parameter that is searched", {})
    readings: bool = optional("Whether it is tested on readings of a component alone", False)


class Family(Contract):
    """A family of candidate effects; either one form, or several as `members`."""

    family: FamilyName
    name: Name | None = optional("Name of a candidate; family-{a} or the family where not given")
    says: Text = Field(description="What it is, in words")
    separates: Text | None = optional("What tells it from its rivals")
    separates_readings: Text | None = optional(
        "The same of readings of a component, where it is not the same"
    )
    kind: Kind = optional("What of the errors it changes", "mean")
    over: Literal["feature", "part", "operation"] | None = optional(
        "`chosen` is 1 on one of these, 0 on the others"
    )
    axes: list[AxisName] | None = optional("What {a} may be; any if not given")
    least_axes: Annotated[int, Field(ge=1, le=3)] = optional("Axes with errors that it needs", 1)
    needs: list[Text] = optional("Columns that must be there and change", [])
    parameters: EffectParameters | None = optional("Name and unit")
    equations: EffectEquations | None = optional("mm; linear in the parameters")
    search: Searched = optional("A parameter that is searched", {})
    members: Annotated[list[MemberTemplate], Field(min_length=1)] | None = optional(
        "Several forms of the family, tested apart"
    )


class Effects(Contract):
    """A library of candidate effects."""

    schema_: Literal["mtu/effects/1"] = Field(alias="schema")
    effects: Annotated[list[Family], Field(min_length=1)]
