"""Machine files (``mtu/machine/1``): their keys and what each holds, equations as linear forms,
declared effects, and what a machine may not say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mtu_cli.files.contract import (
    MAX_DEGREE,
    SIZED,
    Contract,
    Faults,
    Loaded,
    Name,
    NonNegative,
    Number,
    Positive,
    check_contract,
    is_number,
    must,
    one_or_more,
    optional,
    present,
    short,
)
from mtu_cli.files.covariates import (
    COVARIATES,
    POSITIONS,
    SENSOR_DEGC,
    column_dimensions,
    is_covariate,
    is_temperature,
)
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding, counted, finding
from mtu_cli.language import LinearForm, check_dimension, check_known, linear_form, names, parse
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.units import LENGTH, PARAMETER_UNITS, UNITS, Unit, internal, plain_unit

AxisName = Literal["x", "y", "z"]
EquationName = Literal["Ex", "Ey", "Ez"]
STEEPEST = 1e6
"""Of a thermal gradient, per degC in any unit: its square must not overflow."""


PLAIN_UNIT = BeforeValidator(lambda x: plain_unit(x) if isinstance(x, str) else x)
RISING = must(
    lambda values: all(before < after for before, after in pairwise(values)),
    "the lowest first: positions that rise",
)
Size = Annotated[NonNegative, SIZED]
Numbers = Annotated[list[Number], Field(min_length=1)]
Matrix = list[list[Number]]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Range = Annotated[Pair, must(lambda ends: ends[0] <= ends[1], "the lower end first")]
UnitName = Annotated[Literal[*UNITS], PLAIN_UNIT]  # type: ignore[valid-type]
ParameterUnitName = Annotated[Literal[*PARAMETER_UNITS], PLAIN_UNIT]  # type: ignore[valid-type]
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

    travel_mm: Annotated[Pair, RISING] = Field(description="Lowest and highest position, mm")


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

    def check(self, faults: Faults) -> None:
        """Positions once, and as many of them as degree and gradients need; sensors."""
        positions = [f"{position + 0.0:g}" for position in self.positions_mm or ()]
        faults.at("positions_mm").once(enumerate(positions), "the position")
        count = len(positions) or 1
        if self.degree >= count:
            facts = {"what": counted(count, "position"), "expected": f"at most {count - 1}"}
            faults.at("degree").add("too-little-data", **facts)
        kind, expected = "the name of a temperature", "T_<sensor>_degC, the column of its readings"
        for sensor, values in self.gradients.items():
            here = faults.at("gradients", sensor)
            if not is_temperature(sensor):
                here.add("wrong-type", kind=kind, value=sensor, expected=expected)
            if len(values) != count:
                text = f"{counted(len(values), 'gradient')} at {counted(count, 'position')}"
                here.add("wrong-count", found=text, expected="one a position")
        for key in ("time_constants_min", "sensor_u_degC"):
            for sensor in getattr(self, key):
                if sensor not in self.gradients:
                    faults.at(key, sensor).unknown(sensor, self.gradients.keys(), "sensor")


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
    at_mm: Annotated[list[Number], Field(min_length=LEAST_OF_TABLE), RISING] | None = optional(
        "Positions of a table whose values are known"
    )
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

    def check(self, faults: Faults) -> None:
        """Degree or positions, sizes and matrices."""
        if self.thermal is not None and self.thermal.positions_mm and self.of is None:
            what = "positions of a component"
            faults.at("thermal", "positions_mm").add("incomplete", what=what, other="`of`")
        count, of_table = len(self.coefficients or ()), self.is_table
        if self.of is None and (of_table or self.degree != 0):
            key, what = ("shape", "a table") if of_table else ("degree", "a degree")
            faults.at(key).add("incomplete", what=what, other="`of`")
            return
        if of_table:
            size = len(self.at_mm or ())
            description = f"a table of {counted(size, 'position')}"
        else:
            size = count if self.degree == AUTO else int(self.degree) + 1
            description = f"a component of degree {self.degree}"
            for key in OF_TABLES:
                if getattr(self, key) is not None:
                    faults.at(key).add("misplaced", key=key, where="a component of `shape: table`")
        if of_table and count and not size:
            what = "the values of a table"
            faults.at("coefficients").add("incomplete", what=what, other="`at_mm`")
            return
        if count not in (0, size):
            text = f"{counted(count, 'coefficient')} of {description}"
            faults.at("coefficients").add("wrong-count", found=text, expected=f"{size}")
        size = size or 2
        check_covariance(self.covariance, size, faults.at("covariance"))
        check_covariance(self.pass_covariance, min(2, size), faults.at("pass_covariance"))
        if self.pass_dof == 0 and any(map(any, self.pass_covariance or ())):
            facts = {"what": "a covariance of passes", "other": "degrees of freedom"}
            expected = "more than 0, or no key: known exactly"
            faults.at("pass_dof").add("incomplete", expected=expected, **facts)
        for key in ("s_repeat", "pass_covariance", "covariance"):
            if self.u_future is not None and getattr(self, key) is not None:
                faults.at(key).add("contradicts", other="u_future, which stands for it")


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

    def check(self, faults: Faults) -> None:
        """Values of all components, whose names are not those of parameters; the covariance."""
        for name, component in self.components.items():
            here = faults.at("components", name)
            if component.coefficients is None:
                what = "a component of an effect"
                here.add("incomplete", what=what, other="`coefficients`")
            if name in self.parameters:
                here.add("name-taken", value=name, taken="a parameter")
        check_covariance(self.covariance, len(self.parameters), faults.at("covariance"))


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


ROUNDING = 1e-6
"""Relative to the standard deviations: what printed digits may leave of an asymmetry."""
INDEFINITE = 1e-8
"""Negative eigenvalue of the correlation matrix that is rounding: more makes variances negative."""
OF_TABLES = ("at_mm", "roughness_um2_per_mm3", "between_um2", "own_um2_per_mm3")
NEEDS_COEFFICIENTS = ("covariance", "s_repeat", "pass_covariance", "u_future")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMachine(Loaded):
    """A checked machine; `forms`, linear in the components, by equation (``Ex``); `effect_forms`
    those of each effect, linear in its parameters and components, too.
    """

    machine: Machine
    forms: dict[str, LinearForm]
    effect_forms: tuple[dict[str, LinearForm], ...]


def load_machine(path: Path) -> LoadedMachine:
    """Reads and checks a machine file.

    Raises InputError with all faults of the file, each with its line.
    """
    return machine_from(read_yaml(path, "machine"))


def machine_from(document: YamlDocument) -> LoadedMachine:
    """Checks a machine that was read already.

    Raises InputError with all faults of the document.
    """
    forms: dict[str, LinearForm] = {}
    effect_forms: list[dict[str, LinearForm]] = []

    def check(machine: Machine, faults: Faults) -> None:
        _check_names(machine, faults)
        if not faults.at("components").keys():
            # That is reported; every name of every equation would be unknown.
            return
        forms.update(_linear_forms(machine, machine, (), faults))
        for index, effect in present(machine.effects):
            effect_forms.append(_linear_forms(machine, effect, ("effects", index), faults))

    machine = check_contract(document, Machine, "machine", check)
    loaded = LoadedMachine(
        document=document, machine=machine, forms=forms, effect_forms=tuple(effect_forms)
    )
    return replace(loaded, warnings=tuple(_warnings(loaded)))


def _warnings(loaded: LoadedMachine) -> Iterator[Finding]:
    """Components and parameters that no equation holds, or that count as exactly known."""
    groups = (loaded.forms, *loaded.effect_forms)
    used = {name for group in groups for form in group.values() for name in form.coefficients}
    for name, item in loaded.machine.components.items():
        place = loaded.place("components", name)
        figures = [key for key in NEEDS_COEFFICIENTS if getattr(item, key) is not None]
        if name not in used:
            yield finding("unused", what="component", name=name, **place)
        if item.coefficients is None and figures:
            facts = {"what": "figures", "names": figures, "reason": "there are no coefficients"}
            yield finding("not-used", **facts, **place)
        elif item.coefficients is not None and not figures and name in used:
            yield finding("no-uncertainty", names=[name], **place)
    for index, effect in enumerate(loaded.machine.effects):
        symbols = {name for text in effect.equations.values() for name in names(parse(text))}
        for name in [name for name in effect.parameters if name not in symbols]:
            place = loaded.place("effects", index, "parameters", name)
            yield finding("unused", what="parameter", name=name, **place)
        parameters = [n for n, p in effect.parameters.items() if "u" not in p.model_fields_set]
        if effect.covariance is None and parameters:
            yield finding("no-uncertainty", names=parameters, **loaded.place("effects", index))


def _check_names(machine: Machine, faults: Faults) -> None:
    """Names of covariates, constants, components and parameters: usable, and used once."""
    effects = present(machine.effects)
    faults.at("effects").once([(i, effect.name) for i, effect in effects], "the effect", "name")
    iso = [(name, item.iso) for name, item in machine.components.items() if item.iso]
    faults.at("components").once(iso, "the name", "iso")
    columns = present(machine.covariates)
    entries = [(faults.at("covariates", i), name, "a covariate") for i, name in columns]
    for key, what in (("constants", "a constant"), ("components", "a component")):
        at = faults.at(key)
        entries += [(at.at(name), name, what) for name in at.valued_keys()]
    for i, effect in effects:
        for key in ("parameters", "components"):
            at = faults.at("effects", i, key)
            entries += [(at.at(name), name, "") for name in getattr(effect, key)]
    uses = dict.fromkeys(("pi", *MACHINE_FUNCTIONS), "part of the equation language")
    uses |= dict.fromkeys(POSITIONS, "a position")
    for at, name, what in entries:
        if what != "a covariate" and is_covariate(name):
            at.add("name-taken", value=name, taken="a covariate")
        elif not (what == "a constant" and name in POSITIONS):
            # A position among the constants fixes it.
            at.symbol(name, uses)
        if what:
            uses[name] = what


def check_covariance(rows: Matrix | None, size: int, faults: Faults) -> None:
    """That a matrix, if there is one, can be a covariance (size, size)."""
    if rows is not None and (reason := covariance_fault(rows, size)):
        expected = f"a covariance matrix of {counted(size, 'row')}"
        faults.add("wrong-correlation", reason=reason, value=rows, expected=expected)


def covariance_fault(rows: Sequence[Sequence[float]], size: int) -> str | None:
    """Why a matrix can be no covariance (size, size), but for rounding; None where it can."""
    import numpy as np

    if len(rows) != size or any(len(row) != size for row in rows):
        return f"not {size} x {size}"
    C = np.array(rows, dtype=np.float64).reshape(size, size)
    variances = np.diagonal(C)
    if (variances < 0).any():
        return "a variance is negative"
    s = np.sqrt(variances)
    if (np.abs(C - C.T) > ROUNDING * (np.outer(s, s) + np.maximum(np.abs(C), np.abs(C.T)))).any():
        return "not symmetric"
    # Coefficients differ by powers of mm: only scaled to correlations are they comparable. One
    # after the other: the product of two small deviations may be zero.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        R = np.where(C == 0.0, 0.0, C / s / s[:, None])
    if np.isfinite(R).all() and (np.linalg.eigvalsh((R + R.T) / 2) >= -INDEFINITE * size).all():
        return None
    return "not positive semidefinite: a combination has a negative variance"


def _linear_forms(
    machine: Machine, entry: Machine | Effect, steps: YamlPath, faults: Faults
) -> dict[str, LinearForm]:
    """The equations in mm of a machine, or of its effect at `steps`, as linear forms, those of them
    that are sound: readable, of known names, linear in the components and in the names of the
    effect, each term a length. Names whose entry is faulty are known.
    """
    units: dict[str, Unit] = {}
    if isinstance(entry, Effect):
        units = {name: PARAMETER_UNITS[item.unit] for name, item in entry.parameters.items()}
        units |= {name: UNITS[item.unit] for name, item in entry.components.items()}
    components, constants = (faults.at(key).keys() for key in ("components", "constants"))
    covariates = [name for _, name in present(machine.covariates)]
    symbols = (*units, *POSITIONS, *components, *constants, *COVARIATES, *covariates)
    powers = dict.fromkeys(POSITIONS, internal(LENGTH))
    powers |= {name: UNITS[item.unit].powers for name, item in machine.components.items()}
    powers |= {name: internal(unit.dimension) for name, unit in units.items()}
    linear = {*components, *units}
    known = linear.union(constants)
    forms: dict[str, LinearForm] = {}
    for key, text in entry.equations.items():
        with faults.at(*steps, "equations", key).collected():
            node = parse(text)
            check_known(node, [*symbols, *filter(is_covariate, names(node))])
            form = linear_form(node, linear)
            # A component has no unit per kelvin or step of a column: beside one any may be meant.
            columns = {name: column_dimensions(name) for name in names(node).keys() - known}
            check_dimension(node, internal(LENGTH), powers, units, columns)
            forms[key] = form
    return forms
