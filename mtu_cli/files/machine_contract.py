"""The shape of a machine file (``mtu/machine/1``): its keys, and what each holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from mtu_cli.files.contract import MAX_DEGREE, Contract, NonNegative, Positive, wrong
from mtu_cli.findings import suggestion
from mtu_cli.units import PARAMETER_UNITS, UNITS, plain_unit

AxisName = Literal["x", "y", "z"]
EquationName = Literal["Ex", "Ey", "Ez"]
Matrix = list[list[float]]
Range = Annotated[list[float], Field(min_length=2, max_length=2)]
SearchedName = Annotated[str, Field(min_length=1)]
STEEPEST = 1e6
"""Of a thermal gradient, per degC in any unit: its square must not overflow."""


def _unit_of(known: dict[str, Any]) -> AfterValidator:
    def check(text: str) -> str:
        if plain_unit(text) not in known:
            hint = suggestion(text, known)
            meant = hint.get("meant", ())
            raise wrong(hint.get("expected", ""), "unknown-name", what="unit", meant=meant)
        return plain_unit(text)

    return AfterValidator(check)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _number_or_keys(value: object) -> object:
    if _is_number(value):
        return {"value": value}
    if value is not None and not isinstance(value, (dict, Constant)):
        raise wrong("a number, or {value: ..., u: ...}")
    return value


def _as_text(value: object) -> object:
    # An equation may be a bare number: `Ez: 0`.
    return repr(value) if _is_number(value) else value


def _listed(value: object) -> object:
    if not isinstance(value, list) and not _is_number(value):
        raise wrong("a number, or a list of one a position")
    return value if isinstance(value, list) else [value]


def _by_sensor(value: object) -> object:
    if not isinstance(value, dict):
        raise wrong("a number of at least 0, or one for each sensor")
    return value


UnitName = Annotated[str, _unit_of(UNITS), Field(json_schema_extra={"enum": list(UNITS)})]
ParameterUnitName = Annotated[
    str, _unit_of(PARAMETER_UNITS), Field(json_schema_extra={"enum": list(PARAMETER_UNITS)})
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
SensorU = Annotated[float, Field(ge=0, le=100)]
"""degC; more is no reading of a sensor."""
TimeConstant = Annotated[float, Field(ge=0, le=1e6)]
"""min; what is slower has not settled in two years."""
Gradients = Annotated[
    list[Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]],
    Field(min_length=1),
    BeforeValidator(_listed, json_schema_input_type=float | list[float]),
]
SensorNoise = Annotated[
    dict[str, SensorU],
    BeforeValidator(_by_sensor, json_schema_input_type=float | dict[str, float]),
]


class Axis(Contract):
    """A linear axis of the machine."""

    travel_mm: Range = Field(description="Lowest and highest position, mm")


class Constant(Contract):
    """A named number of the equations, in mm, rad, degC or min."""

    value: float = Field(description="Value in mm, rad, degC or min")
    u: NonNegative = Field(default=0.0, description="Standard uncertainty, in the value's unit")


NumberOrConstant = Annotated[
    Constant, BeforeValidator(_number_or_keys, json_schema_input_type=float | Constant)
]


class Thermal(Contract):
    """Drift that is linear in temperatures: through given values at given positions.

    Gradients are per degC above the machine's reference temperature, in the component's unit.
    Valdes et al., eqs. (5)-(8) and (13).
    """

    positions_mm: Annotated[list[float], Field(min_length=1)] | None = Field(
        default=None, description="Where the gradients hold; none: the drift is the same everywhere"
    )
    degree: Annotated[int, Field(ge=0, le=MAX_DEGREE)] = Field(
        default=0, description="Degree in position; number of positions - 1 unless said"
    )
    gradients: Annotated[dict[str, Gradients], Field(min_length=1)] = Field(
        description="By sensor (T_<sensor>_degC): unit per degC at each position"
    )
    time_constants_min: dict[str, TimeConstant] = Field(
        default={}, description="By sensor: time constant of its first-order lag, min"
    )
    s_leftover: NonNegative = Field(
        default=0.0,
        description="Standard deviation of what the model leaves, shared by the points of a part",
    )
    sensor_u_degC: SensorNoise = Field(  # noqa: N815  # unit
        default={}, description="Standard uncertainty of a reading; a number, or by sensor"
    )

    @model_validator(mode="before")
    @classmethod
    def _what_follows(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        found = dict(data)
        if found.get("degree") is None:
            positions = found.get("positions_mm")
            found["degree"] = max(0, len(positions) - 1) if isinstance(positions, list) else 0
        noise, gradients = found.get("sensor_u_degC"), found.get("gradients")
        if isinstance(noise, (int, float)) and _is_number(noise) and noise >= 0:
            # What is no standard uncertainty stays a number, and is reported as such.
            sensors = gradients if isinstance(gradients, dict) else ()
            found["sensor_u_degC"] = dict.fromkeys(sensors, noise)
        return found


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
    seen: dict[SearchedName, Range] = Field(
        default={},
        description="Lowest and highest value, in what it was found on, of the positions and "
        "columns of its equations: beyond them it is a guess",
    )
    within: dict[SearchedName, Range] = Field(
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
