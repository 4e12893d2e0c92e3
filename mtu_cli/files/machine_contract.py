"""The shape of a machine file (``mtu/machine/1``): its keys, and what each holds."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from mtu_cli.files.contract import (
    MAX_DEGREE,
    Contract,
    Name,
    NonNegative,
    Number,
    Positive,
    is_number,
    one_or_more,
    optional,
    short,
    sized,
    wrong,
)
from mtu_cli.files.covariates import SENSOR_DEGC
from mtu_cli.findings import suggestion
from mtu_cli.units import PARAMETER_UNITS, UNITS, plain_unit

AxisName = Literal["x", "y", "z"]
EquationName = Literal["Ex", "Ey", "Ez"]
STEEPEST = 1e6
"""Of a thermal gradient, per degC in any unit: its square must not overflow."""


def _unit_of(units: Collection[str]) -> AfterValidator:
    def check(text: str) -> str:
        if (unit := plain_unit(text)) not in units:
            raise wrong(code="unknown-name", what="unit", **suggestion(text, units))
        return unit

    return AfterValidator(check)


def _rising(ends: list[float]) -> list[float]:
    if ends[0] > ends[1]:
        raise wrong("the lower end first")
    return ends


def _climbing(values: list[float]) -> list[float]:
    if any(after <= before for before, after in pairwise(values)):
        raise wrong("the lowest first: positions that rise")
    return values


Size = Annotated[NonNegative, AfterValidator(sized)]
Numbers = Annotated[list[Number], Field(min_length=1)]
Matrix = list[list[Number]]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Range = Annotated[Pair, AfterValidator(_rising)]
UnitName = Annotated[str, _unit_of(UNITS), Field(json_schema_extra={"enum": list(UNITS)})]
ParameterUnitName = Annotated[
    str, _unit_of(PARAMETER_UNITS), Field(json_schema_extra={"enum": list(PARAMETER_UNITS)})
]
EquationText = Annotated[str, short(is_number, repr, str | float)]
"""An equation may be a bare number: `Ez: 0`."""
Equations = Annotated[dict[EquationName, EquationText], Field(min_length=1)]
Degree = Annotated[int, Field(ge=0, le=MAX_DEGREE)]
AUTO: Literal["auto"] = "auto"
LEAST_OF_TABLE = 3
"""Positions: of fewer there is no bend."""
IsoName = Annotated[str, Field(pattern=r"^E[ABCXYZ](0[ABCXYZ]|\(0[XYZ]\)[ABCXYZ]|[ABCXYZ])$")]
"""Such as EXX, EAX; of squareness EC0Y or EC(0X)Y (ISO 230-1:2012)."""
SensorU = Annotated[float, Field(ge=0, le=100)]
"""degC; more is no reading of a sensor."""
TimeConstant = Annotated[float, Field(ge=0, le=1e6)]
"""min; what is slower has not settled in two years."""
Gradient = Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]
Gradients = Annotated[list[Gradient], Field(min_length=1), one_or_more(float)]


class Axis(Contract):
    """A linear axis of the machine."""

    travel_mm: Annotated[Pair, AfterValidator(_climbing)] = Field(
        description="Lowest and highest position, mm"
    )


class Constant(Contract):
    """A named number of the equations, in mm, rad, degC or min."""

    value: Number = Field(description="Value in mm, rad, degC or min")
    u: Size = optional("Standard uncertainty, in the value's unit", 0.0)


NumberOrConstant = Annotated[
    Constant, short(is_number, lambda value: {"value": value}, float | Constant)
]


class Thermal(Contract):
    """Drift that is linear in temperatures: through given values at given positions.

    Gradients are per degC above the machine's reference temperature, in the component's unit.
    Valdes et al., eqs. (5)-(8) and (13).
    """

    positions_mm: Numbers | None = optional(
        "Where the gradients hold; none: the drift is the same everywhere"
    )
    degree: Degree = optional("Degree in position; number of positions - 1 unless said", 0)
    gradients: Annotated[dict[str, Gradients], Field(min_length=1)] = Field(
        description="By sensor (T_<sensor>_degC): unit per degC at each position"
    )
    time_constants_min: dict[str, TimeConstant] = optional(
        "By sensor: time constant of its first-order lag, min", {}
    )
    s_leftover: Size = optional(
        "Standard deviation of what the model leaves, shared by the points of a part", 0.0
    )
    sensor_u_degC: Annotated[  # noqa: N815  # unit
        dict[str, SensorU], short(lambda _: False, dict, float | dict[str, float])
    ] = optional("Standard uncertainty of a reading; a number, or by sensor", {})

    @model_validator(mode="before")
    @classmethod
    def _what_follows(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        positions, noise = data.get("positions_mm"), data.get("sensor_u_degC")
        result = dict(data)
        if result.get("degree") is None:
            result["degree"] = max(0, len(positions) - 1) if isinstance(positions, list) else 0
        if is_number(noise):
            sensors = gradients if isinstance(gradients := data.get("gradients"), dict) else ()
            result["sensor_u_degC"] = dict.fromkeys(sensors, noise)
        return result


class Component(Contract):
    """One error component: a polynomial or a table of the position along one axis, or a constant.

    Matrices and deviations are in `unit` (squared), positions in mm; `coefficients` ascend
    in powers of mm, those of a table are its values at `at_mm`. `pass_covariance` is of the
    intercept at `pass_center_mm` (0 where it is not given) and the slope. What is in um2 is in
    arcsec2 of an angle.
    """

    of: AxisName | None = optional("The axis it depends on; none: a constant")
    unit: UnitName = Field(description="Unit of readings and coefficients")
    iso: IsoName | None = optional("Its name of ISO 230-1, such as EXX")
    shape: Literal["polynomial", "table"] = optional(
        "A table has a value at every position, with natural cubic interpolation", "polynomial"
    )
    degree: Degree | Literal["auto"] = optional(
        "Degree of the polynomial; auto: that, or the table, which held-out passes choose; 0 "
        "without `of`",
        1,
    )
    at_mm: (
        Annotated[list[Number], Field(min_length=LEAST_OF_TABLE), AfterValidator(_climbing)] | None
    ) = optional("Positions of a table whose values are known")
    roughness_um2_per_mm3: Size | None = optional(
        "Of a table: variance of the integrated Wiener process between its positions"
    )
    between_um2: Size | None = optional("Of a table: a variance added off its positions")
    own_um2_per_mm3: Size | None = optional("Of a table: the same of the runs' own bend")
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    coefficients: Numbers | None = optional(
        "Known coefficients, ascending powers of mm; of a table its values"
    )
    covariance: Matrix | None = optional("Covariance of the coefficients")
    s_repeat: Size | None = optional("Repeatability of one visit")
    pass_covariance: Matrix | None = optional("Pass-to-pass covariance of intercept and slope")
    pass_center_mm: Number | None = optional("Where that intercept is taken")
    dof: Positive | None = optional("Degrees of freedom")
    pass_dof: NonNegative | None = optional("... of pass_covariance")
    repeat_dof: Positive | None = optional("... of s_repeat")
    u_future: Size | None = optional(
        "Standard uncertainty of a future observation, where no more is known"
    )
    thermal: Thermal | None = optional("Known drift with temperature")

    @model_validator(mode="before")
    @classmethod
    def _degree(cls, data: Any) -> Any:
        # The degree that is not written follows from what is; the contract's 1 else.
        if not isinstance(data, dict) or data.get("degree") not in (None, AUTO):
            return data
        coefficients = data.get("coefficients")
        if data.get("shape") == "table" or (data.get("degree") == AUTO and not coefficients):
            return data
        count = len(coefficients) if isinstance(coefficients, list) and coefficients else 2
        return data | {"degree": count - 1 if data.get("of") else 0}

    @property
    def is_table(self) -> bool:
        """Whether its coefficients are values at positions."""
        return self.shape == "table"


class Parameter(Contract):
    """A fitted number of an effect."""

    value: Number = Field(description="Value in `unit`")
    u: Size = optional("Standard uncertainty in `unit`", 0.0)
    unit: ParameterUnitName


class Effect(Contract):
    """An effect that was found and declared: equations linear in its own parameters."""

    name: Name
    family: str | None = None
    axis: str | None = optional(
        "The axis, or those of an angle (`xy`), or the component without `of`"
    )
    covariate: str | None = None
    says: str | None = optional("What it is, in words")
    parameters: dict[str, Parameter] = optional("By the names that its equations have", {})
    components: dict[str, Component] = optional("Its own, such as the table of a smooth effect", {})
    covariance: Matrix | None = optional(
        "Covariance over the parameters in their order, in their units"
    )
    equations: Equations = Field(description="mm; linear in its parameters and components")
    seen: dict[Name, Range] = optional(
        "Range, in its data, of the columns of its equations: a guess beyond", {}
    )
    alike: dict[str, Any] = optional("Of older files, not used", {})
    within: dict[str, Any] = optional("Of older files, not used", {})
    found: dict[str, Any] = optional("Where it was found, free", {})


class Machine(Contract):
    """A machine as its equations."""

    schema_: Literal["mtu/machine/1"] = Field(alias="schema")
    name: Name
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    reference_temperature_degC: Annotated[  # noqa: N815  # unit
        float, Field(ge=SENSOR_DEGC[0], le=SENSOR_DEGC[1])
    ] = optional("degC", 20.0)
    axes: dict[AxisName, Axis] = optional("The linear axes", {})
    constants: dict[str, NumberOrConstant] = optional(
        "Names for the equations; x, y or z here fixes that coordinate", {}
    )
    covariates: list[str] = optional(
        "Columns beyond dir_x, time_min, sequence, T_..._degC that equations use", []
    )
    components: Annotated[dict[str, Component], Field(min_length=1)]
    equations: Equations = Field(description="mm; linear in the components")
    effects: list[Effect] = optional("What close-loop added", [])

    @property
    def travels(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest position, mm, of the axes whose travel is stated."""
        return {str(name): (x.travel_mm[0], x.travel_mm[1]) for name, x in self.axes.items()}
