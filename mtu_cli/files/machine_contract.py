"""The shape of a machine file (``mtu/machine/1``): its keys, and what each holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from mtu_cli.errors import did_you_mean
from mtu_cli.files.contract_errors import told
from mtu_cli.files.contracts import MAX_DEGREE, Contract, NonNegative, Positive
from mtu_cli.files.thermal_contract import Thermal
from mtu_cli.units import PARAMETER_UNITS, UNITS, plain_unit

AxisName = Literal["x", "y", "z"]
EquationName = Literal["Ex", "Ey", "Ez"]
Matrix = list[list[float]]
SearchedName = Annotated[str, Field(min_length=1)]


def _known_unit(text: str) -> str:
    if plain_unit(text) not in UNITS:
        raise told("unknown unit", did_you_mean(text, UNITS))
    return plain_unit(text)


def _known_parameter_unit(text: str) -> str:
    if plain_unit(text) not in PARAMETER_UNITS:
        raise told("unknown unit", did_you_mean(text, PARAMETER_UNITS))
    return plain_unit(text)


def _number_or_keys(value: object) -> object:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return {"value": value}
    if value is not None and not isinstance(value, (dict, Constant)):
        raise told("wrong value", "a number, or {value: ..., u: ...}")
    return value


def _as_text(value: object) -> object:
    # An equation may be a bare number: `Ez: 0`.
    return repr(value) if isinstance(value, (int, float)) and value is not True else value


UnitName = Annotated[
    str, AfterValidator(_known_unit), Field(json_schema_extra={"enum": list(UNITS)})
]
ParameterUnitName = Annotated[
    str,
    AfterValidator(_known_parameter_unit),
    Field(json_schema_extra={"enum": list(PARAMETER_UNITS)}),
]
# No axis twice; which names are components is known to the machine alone.
EffectAxis = Annotated[
    str,
    Field(
        json_schema_extra={"pattern": r"^(?![xyz]*([xyz])[xyz]*\1[xyz]*$)[A-Za-z_][A-Za-z0-9_]*$"}
    ),
]
EquationText = Annotated[str, BeforeValidator(_as_text, json_schema_input_type=str | float)]
Equations = Annotated[dict[EquationName, EquationText], Field(min_length=1)]


class Axis(Contract):
    """A linear axis of the machine."""

    travel_mm: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="Lowest and highest position, mm"
    )


class Constant(Contract):
    """A named number of the equations, in mm, rad, degC or min."""

    value: float = Field(description="Value in mm, rad, degC or min")
    u: NonNegative = Field(default=0.0, description="Standard uncertainty, in the value's unit")


NumberOrConstant = Annotated[
    Constant, BeforeValidator(_number_or_keys, json_schema_input_type=float | Constant)
]


class Component(Contract):
    """One error component: a polynomial in the position along one axis, or a constant.

    Matrices and deviations are in `unit` (squared), positions in mm; `coefficients` ascend
    in powers of mm. `pass_covariance` is of the intercept at `pass_center_mm` (0 where it is
    not given) and the slope.
    """

    of: AxisName | None = Field(
        default=None, description="The axis it depends on; none: a constant"
    )
    unit: UnitName = Field(description="Unit of readings and coefficients")
    degree: Annotated[int, Field(ge=0, le=MAX_DEGREE)] = Field(
        default=1, description="Degree of the polynomial; 0 without `of`"
    )
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    coefficients: Annotated[list[float], Field(min_length=1)] | None = Field(
        default=None, description="Known coefficients, ascending powers of mm"
    )
    covariance: Matrix | None = Field(default=None, description="Covariance of the coefficients")
    s_repeat: NonNegative | None = Field(default=None, description="Repeatability of one visit")
    pass_covariance: Matrix | None = Field(
        default=None, description="Pass-to-pass covariance of intercept and slope"
    )
    pass_center_mm: float | None = Field(default=None, description="Where that intercept is taken")
    dof: Positive | None = Field(default=None, description="Degrees of freedom")
    pass_dof: NonNegative | None = Field(default=None, description="... of pass_covariance")
    repeat_dof: Positive | None = Field(default=None, description="... of s_repeat")
    u_future: NonNegative | None = Field(
        default=None,
        description="Standard uncertainty of a future observation, where no more is known",
    )
    thermal: Thermal | None = Field(default=None, description="Known drift with temperature")

    @model_validator(mode="before")
    @classmethod
    def _degree(cls, data: Any) -> Any:
        # The degree that is not written follows from what is; the contract's 1 else.
        if isinstance(data, dict) and data.get("degree") is None:
            coefficients = data.get("coefficients")
            if isinstance(coefficients, list) and coefficients:
                return data | {"degree": len(coefficients) - 1 if data.get("of") else 0}
            return data | {"degree": 1 if data.get("of") is not None else 0}
        return data


class Parameter(Contract):
    """A fitted number of an effect."""

    value: float = Field(description="Value in `unit`")
    u: NonNegative = Field(default=0.0, description="Standard uncertainty in `unit`")
    unit: ParameterUnitName


class Effect(Contract):
    """An effect that was found and declared: equations linear in its own parameters."""

    name: Annotated[str, Field(min_length=1)]
    family: str | None = None
    axis: EffectAxis | None = Field(
        default=None,
        description="The axis, or those of an angle (`xy`), or the component without `of`, that "
        "it is of",
    )
    covariate: str | None = None
    says: str | None = Field(default=None, description="What it is, in words")
    parameters: dict[str, Parameter]
    covariance: Matrix | None = Field(
        default=None, description="Covariance over the parameters in their order, in their units"
    )
    equations: Equations = Field(description="mm; linear in the parameters")
    alike: dict[SearchedName, Annotated[list[float], Field(min_length=1)]] = Field(
        default={},
        description="Of what was searched (`pitch_mm`): other values that fit what it was found "
        "on as well, so that it holds there alone",
    )
    seen: dict[SearchedName, Annotated[list[float], Field(min_length=2, max_length=2)]] = Field(
        default={},
        description="Lowest and highest value, in what it was found on, of the positions and "
        "columns of its equations: beyond them it is a guess",
    )
    within: dict[SearchedName, Annotated[list[float], Field(min_length=2, max_length=2)]] = Field(
        default={},
        description="Lowest and highest value, in what it was found on, of columns that its "
        "equations do not have: beyond them it may be of another size",
    )
    found: dict[str, Any] = Field(default={}, description="Where it was found, free")


class Machine(Contract):
    """A machine as its equations."""

    schema_: Literal["mtu/machine/1"] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    reference_temperature_degC: float = Field(default=20.0, description="degC")  # noqa: N815  # unit
    axes: dict[AxisName, Axis] = Field(default={}, description="The linear axes")
    constants: dict[str, NumberOrConstant] = Field(
        default={}, description="Names for the equations; x, y or z here fixes that coordinate"
    )
    covariates: list[str] = Field(
        default=[],
        description="Columns beyond dir_x, time_min, sequence, T_..._degC that equations use",
    )
    components: Annotated[dict[str, Component], Field(min_length=1)]
    equations: Equations = Field(description="mm; linear in the components")
    effects: list[Effect] = Field(default=[], description="What close-loop added")

    @property
    def travels(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest position, mm, of the axes whose travel is stated."""
        return {str(name): (x.travel_mm[0], x.travel_mm[1]) for name, x in self.axes.items()}
