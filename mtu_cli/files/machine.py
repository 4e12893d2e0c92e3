"""Machine files: equations as linear forms, declared effects, and what a machine may not say."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from mtu_cli.files.contract import Faults, check_contract, duplicates, present
from mtu_cli.files.covariates import (
    COVARIATES,
    POSITIONS,
    is_covariate,
    is_temperature,
    own_columns,
)
from mtu_cli.files.machine_contract import Component, Effect, Machine, Thermal
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, path_text, read_yaml
from mtu_cli.findings import Finding, InputError, counted, finding, suggestion
from mtu_cli.language import LinearForm, check_dimension, check_known, linear_form, names, parse
from mtu_cli.language.evaluate import check_finite
from mtu_cli.language.functions import MACHINE_FUNCTIONS
from mtu_cli.language.unit_algebra import Algebra
from mtu_cli.units import LENGTH, MINUTE, PARAMETER_UNITS, UNITS, Unit, internal, parameter_units_of

FOUND_BY = "mtu close-loop"
TIME = "time_min"
LOWER_FIRST = "the lower end first"


def parameter_units(effect: Effect) -> dict[str, Unit]:
    """Units of its parameters; those that close-loop once wrote as um, where the time makes them
    um/min, are per minute.
    """
    units = {name: PARAMETER_UNITS[item.unit] for name, item in effect.parameters.items()}
    by = effect.found.get("by")
    if effect.covariate != TIME or not (isinstance(by, str) and by.startswith(FOUND_BY)):
        return units
    timed: dict[str, list[bool]] = {}
    try:
        for text in effect.equations.values():
            tree = parse(text)
            algebra = Algebra(units=own_columns(names(tree), effect.parameters), whole=True)
            for name, lever in linear_form(tree, effect.parameters).coefficients.items():
                timed.setdefault(name, []).append(algebra.of(lever).minute == 1)
    except InputError:
        # The equations' own check reports it.
        return units
    per = [name for name, own in timed.items() if all(own) and units[name].per is None]
    return units | {name: replace(units[name], per=MINUTE) for name in per}


def units_per_minute(unit: Unit) -> list[str]:
    """Units per time that are per minute what `unit` is."""
    return parameter_units_of(unit.powers / internal(minute=1), unit.name)


def check_ranges(effect: Effect, index: int, faults: Faults) -> None:
    """Ranges that an effect was found in, against the names of its equations, which are sound."""
    used = _used(effect)
    columns = used - set(effect.parameters)
    for key, ranges in (("seen", effect.seen), ("within", effect.within)):
        for name, (low, high) in ranges.items():
            here = ("effects", index, key, name)
            if key == "seen" and name not in columns:
                faults.unknown(here, name, sorted(columns), "column")
            elif key == "within" and name in used:
                where = "`seen`: its equations hold it"
                faults.add(here, "key-elsewhere", key=name, where=where)
            elif key == "within" and not is_temperature(name):
                expected = "the column of a sensor: T_<name>_degC"
                faults.add(here, "not-a-temperature", value=name, expected=expected)
            elif low > high:
                faults.add(here, "wrong-value", value=[low, high], expected=LOWER_FIRST)


def _used(effect: Effect) -> set[str]:
    return {name for text in effect.equations.values() for name in names(parse(text))}


def effect_warnings(machine: Machine, document: YamlDocument) -> Iterator[Finding]:
    """Parameters that no equation holds, that count as exactly known, or whose unit is not the
    one that is written.
    """
    for index, effect in enumerate(machine.effects):
        path: YamlPath = ("effects", index)
        place = {"file": document.source.shown, "line": document.line_of(*path)}
        used = _used(effect)
        for name in [name for name in effect.parameters if name not in used]:
            own = path_text((*path, "parameters", name))
            yield finding("unused", what="parameter", name=name, path=own, **place)
        without = [n for n, p in effect.parameters.items() if "u" not in p.model_fields_set]
        if effect.covariance is None and without:
            yield finding("no-uncertainty", names=without, path=path_text(path), **place)
        for name, unit in parameter_units(effect).items():
            if unit != PARAMETER_UNITS[unit.name]:
                own = path_text((*path, "parameters", name))
                yield finding("unit-per-minute", unit=unit.name, path=own, **place)


ROUNDING = 1e-6
"""Relative to the standard deviations: what printed digits may leave of an asymmetry."""
INDEFINITE = 1e-8
"""Negative eigenvalue of the correlation matrix that is rounding: more makes variances negative."""
TOLERANCE = 1e-9
"""Of a standard deviation beside its square, relative: what calculation leaves beyond digits."""
NOT_MISSED = 0.01
"""Share of the largest gradient by which a polynomial may pass one by without a warning."""
COLDEST, HOTTEST = -60.0, 150.0
"""degC: a reference temperature beyond them is an error."""
PASSES = "a covariance of passes"
NEEDS_COEFFICIENTS = ("covariance", "s_repeat", "pass_covariance", "u_future")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMachine:
    """A checked machine with its equations written as linear forms in the components.

    `forms` by equation (``Ex``); `effect_forms` one such mapping an effect, linear in the
    effect's parameters and in the components.
    """

    source: Source
    machine: Machine
    forms: dict[str, LinearForm]
    effect_forms: tuple[dict[str, LinearForm], ...]
    warnings: tuple[Finding, ...]
    document: YamlDocument

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file: ``line_of("components", "dx_x")``."""
        return self.document.line_of(*path)

    @property
    def used(self) -> set[str]:
        """The components that stand in an equation."""
        groups = (self.forms, *self.effect_forms)
        return {name for group in groups for form in group.values() for name in form.coefficients}


def load_machine(path: Path, role: str = "machine") -> LoadedMachine:
    """Reads and checks a machine file.

    Raises InputError with all faults of the file, each with its line.
    """
    return machine_from(read_yaml(path, role))


def machine_from(document: YamlDocument) -> LoadedMachine:
    """Checks a machine that was read already.

    Raises InputError with all faults of the document.
    """
    forms: dict[str, LinearForm] = {}
    effect_forms: list[dict[str, LinearForm]] = []

    def check(machine: Machine, faults: Faults) -> None:
        _check_names(machine, faults)
        _check_values(machine, faults)
        for name, component in (machine.components or {}).items():
            _check_component(component, ("components", name), faults)
            if component.thermal is not None:
                axis = (machine.axes or {}).get(component.of) if component.of else None
                travel = None if axis is None else axis.travel_mm
                path = ("components", name, "thermal")
                _check_thermal(component.thermal, component.of, travel, path, faults)
        if not faults.keys("components"):
            # That is reported; every name of every equation would be unknown.
            return
        vocabulary = Vocabulary.of(machine, faults)
        forms.update(_linear_forms(machine.equations, vocabulary, faults, ("equations",)))
        for index, effect in present(machine.effects):
            _check_effect(effect, index, faults)
            own = vocabulary.with_parameters(effect)
            found = _linear_forms(effect.equations, own, faults, ("effects", index, "equations"))
            if len(found) == len(effect.equations):
                check_ranges(effect, index, faults)
            effect_forms.append(found)

    machine = check_contract(document, Machine, "machine", check)
    loaded = LoadedMachine(
        source=document.source,
        machine=machine,
        forms=forms,
        effect_forms=tuple(effect_forms),
        warnings=(),
        document=document,
    )
    return replace(loaded, warnings=(*_warnings(loaded), *effect_warnings(machine, document)))


def _warnings(loaded: LoadedMachine) -> Iterator[Finding]:
    for name, component in loaded.machine.components.items():
        path: YamlPath = ("components", name)
        place = {
            "file": loaded.source.shown,
            "line": loaded.line_of(*path),
            "path": path_text(path),
        }
        if name not in loaded.used:
            yield finding("unused", what="component", name=name, **place)
        idle = [key for key in NEEDS_COEFFICIENTS if getattr(component, key) is not None]
        if component.coefficients is None and idle:
            yield finding("incomplete-component", keys=idle, **place)
        elif component.coefficients is not None and not idle and name in loaded.used:
            yield finding("no-uncertainty", names=[name], coefficients_of=name, **place)
        if component.thermal is not None and (missed := missed_gradient(component.thermal)):
            sensor, position, difference = missed
            yield finding(
                "thermal-degree", degree=component.thermal.degree, sensor=sensor,
                position_mm=position, difference=difference, unit=component.unit,
                **place | {"path": path_text((*path, "thermal"))},
            )  # fmt: skip


# Names and plain values.


def _check_names(machine: Machine, faults: Faults) -> None:
    """Names of constants, covariates, components and parameters: usable, and used once."""
    taken = dict.fromkeys(("pi", *MACHINE_FUNCTIONS), "part of the equation language")
    positions = dict.fromkeys(POSITIONS, "a position")
    covariates = [name for name in machine.covariates or () if isinstance(name, str)]
    for index, name in enumerate(covariates):
        _check_name(name, ("covariates", index), taken | positions, faults)
    faults.once(("covariates",), enumerate(covariates), "the covariate")
    taken |= dict.fromkeys(covariates, "a covariate")
    # A position among the constants fixes it. A constant without a value is reported already.
    for name in faults.given("constants"):
        _check_name(name, ("constants", name), taken, faults)
    taken |= positions | dict.fromkeys(faults.keys("constants"), "a constant")
    for name in faults.keys("components"):
        _check_name(name, ("components", name), taken, faults)
    taken |= dict.fromkeys(faults.keys("components"), "a component")
    for index, effect in present(machine.effects):
        for name in effect.parameters:
            _check_name(name, ("effects", index, "parameters", name), taken, faults)
    named = [(index, effect.name) for index, effect in present(machine.effects)]
    faults.once(("effects",), named, "the effect", "name")


def _check_name(name: str, path: YamlPath, taken: Mapping[str, str], faults: Faults) -> None:
    covariate = {name: "a covariate"} if is_covariate(name) and path[0] != "covariates" else {}
    faults.symbol(path, name, {**covariate, **taken})


def _check_values(machine: Machine, faults: Faults) -> None:
    for name, axis in (machine.axes or {}).items():
        if axis.travel_mm[0] >= axis.travel_mm[1]:
            path = ("axes", name, "travel_mm")
            faults.add(path, "wrong-value", value=axis.travel_mm, expected="the lower end first")
    reference = machine.reference_temperature_degC
    if reference is not None and not COLDEST <= reference <= HOTTEST:
        expected = f"{COLDEST:g} to {HOTTEST:g} degC"
        own = ("reference_temperature_degC",)
        faults.add(own, "wrong-value", value=reference, expected=expected)


# Components.


def _check_component(component: Component, path: YamlPath, faults: Faults) -> None:
    """Degree, sizes and matrices of a component."""
    size, count = component.degree + 1, len(component.coefficients or ())
    if component.of is None and component.degree != 0:
        faults.add(
            (*path, "degree"), "without-axis", value=component.degree,
            what="a degree", expected="degree 0, or `of: x`",
        )  # fmt: skip
        return
    if count and count != size:
        of = f"of degree {component.degree}" if component.of else "without `of`"
        found = f"{counted(count, 'coefficient')} of a component {of}"
        faults.add((*path, "coefficients"), "wrong-count", found=found, expected=f"{size}")
    # The degree that is not written follows from the coefficients.
    one = component.of is not None and count == size == 1
    why = ": one coefficient makes a component without a slope" if one else ""
    if component.covariance is not None:
        check_covariance(component.covariance, size, (*path, "covariance"), faults, why)
    if component.pass_covariance is not None:
        own = (*path, "pass_covariance")
        check_covariance(component.pass_covariance, min(2, size), own, faults, why)
        if component.pass_dof == 0 and any(map(any, component.pass_covariance)):
            expected = "more than 0, or no key: known exactly"
            faults.add((*path, "pass_dof"), "without-dof", value=0, what=PASSES, expected=expected)
    for key in ("s_repeat", "pass_covariance", "covariance"):
        if component.u_future is not None and getattr(component, key) is not None:
            faults.add((*path, key), "contradicts", other="u_future, which stands for it")


def check_covariance(
    rows: Sequence[Sequence[float]],
    size: int,
    path: YamlPath,
    faults: Faults,
    why: str = "",
    *,
    difference: bool = False,
) -> None:
    """Adds what is wrong with a matrix (size, size) that should be a covariance."""
    lengths = [len(row) for row in rows]
    if lengths != [size] * size:
        *less, most = sorted(set(lengths)) or [0]
        widths = "/".join(map(str, [*less, counted(most, "number")]))
        expected = f"{counted(size, 'row')} of {size}{why}"
        found = f"{counted(len(rows), 'row')} of {widths}"
        faults.add(path, "wrong-count", found=found, expected=expected)
    elif reason := covariance_fault(rows, size, difference=difference):
        faults.add(
            path, "not-a-covariance", reason=reason, value=rows, expected="a covariance matrix"
        )


def covariance_fault(
    rows: Sequence[Sequence[float]], size: int, *, difference: bool = False
) -> str | None:
    """Why a matrix can be no covariance (size, size), but for rounding; None where it can.

    A `difference` of two, as a moment estimate is, has to be symmetric alone. Where entries are
    not known (nan), pairs and variances are all that can be judged.
    """
    import numpy as np

    if len(rows) != size or any(len(row) != size for row in rows):
        return f"not {size} x {size}"
    C = np.array(rows, dtype=np.float64).reshape(size, size)
    if np.isinf(C).any():
        return "not finite"
    variances = np.diagonal(C)
    if not difference and (variances < 0).any():
        return "a variance is negative"
    s = np.sqrt(np.abs(variances))
    with np.errstate(over="ignore"):
        apart, scale = np.abs(C - C.T), np.outer(s, s) + np.maximum(np.abs(C), np.abs(C.T))
    if (apart > ROUNDING * scale).any() or (np.isnan(C) != np.isnan(C.T)).any():
        return "not symmetric"
    if difference or not size or np.isnan(C).any():
        return None
    # Coefficients differ by powers of mm: only scaled to correlations are they comparable. One
    # after the other: the product of two small deviations may be zero.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        R = np.where(C == 0.0, 0.0, C / s / s[:, None])
    if not np.isfinite(R).all():
        return "not positive semidefinite: a covariance is far beyond its variances"
    if np.linalg.eigvalsh((R + R.T) / 2)[0] < -INDEFINITE * size:
        return "not positive semidefinite: a combination has a negative variance"
    return None


# Known drift with temperature.


def _check_thermal(
    thermal: Thermal, of: str | None, travel: Sequence[float] | None, path: YamlPath, faults: Faults
) -> None:
    """Positions, degree, sensors and the number of gradients of a drift along `of`."""
    positions = thermal.positions_mm
    own = (*path, "positions_mm")
    if positions is not None and of is None:
        expected = "`of: x` of the component, or no positions"
        faults.add(own, "without-axis", what="positions of a component", expected=expected)
    for index, _, first in duplicates(enumerate(str(value + 0.0) for value in positions or ())):
        value = (positions or [])[first]
        faults.add((*own, index), "appears-twice", value=f"{value:g}", what="the position")
    for index, position in enumerate(positions or ()):
        if travel is not None and not min(travel) <= position <= max(travel):
            expected = f"from {min(travel):g} to {max(travel):g} mm"
            shown = f"{position:g}"
            faults.add((*own, index), "outside-travel", value=shown, axis=of, expected=expected)
    count = len(positions) if positions is not None else 1
    if thermal.degree >= count:
        expected = f"at most {count - 1}"
        faults.add((*path, "degree"), "degree-too-high", value=thermal.degree, expected=expected)
    for sensor, values in thermal.gradients.items():
        here = (*path, "gradients", sensor)
        if not is_temperature(sensor):
            known = f"T_{sensor}_degC"
            plain = re.fullmatch(r"\w+", sensor, re.ASCII) and "degC" not in sensor
            hint = f", such as {known}" if plain else ""
            expected = f"T_<sensor>_degC, the column of its readings{hint}"
            faults.add(here, "not-a-temperature", value=sensor, expected=expected)
        if len(values) != count:
            where = f"{count} positions" if positions is not None else "no positions"
            found = f"{counted(len(values), 'gradient')} at {where}"
            expected = f"{count}, one a position" if positions is not None else "one"
            faults.add(here, "wrong-count", found=found, expected=expected)
    for key in ("time_constants_min", "sensor_u_degC"):
        for sensor in getattr(thermal, key):
            if sensor not in thermal.gradients:
                faults.unknown((*path, key, sensor), sensor, thermal.gradients.keys(), "sensor")


def missed_gradient(thermal: Thermal) -> tuple[str, float, float] | None:
    """The sensor and position whose given gradient the polynomial misses most, and by how much.

    None where the degree takes it through all of them, or they lie on it all the same.
    """
    positions = thermal.positions_mm
    if positions is None or thermal.degree >= len(positions) - 1:
        return None
    import numpy as np

    place = np.array(positions, float)
    half = float(np.ptp(place)) / 2
    powers = np.vander((place - place.mean()) / half, thermal.degree + 1)
    given = np.array(list(thermal.gradients.values()), float).T
    left = np.abs(given - powers @ np.linalg.lstsq(powers, given, rcond=None)[0])
    p, s = np.unravel_index(np.argmax(left), left.shape)
    if left[p, s] <= NOT_MISSED * np.abs(given).max():
        return None
    return list(thermal.gradients)[s], positions[p], float(left[p, s])


# Effects and equations.


def _check_effect(effect: Effect, index: int, faults: Faults) -> None:
    """What an effect is of: axes of the machine, none twice, or a component; its covariance."""
    path: YamlPath = ("effects", index)
    axis, components = effect.axis, faults.keys("components")
    several = axis is not None and len(set(axis)) == len(axis) and set(axis) <= set(POSITIONS)
    if axis is not None and axis not in components and not (axis and several):
        expected = "x, y or z, several of them (xy, for an angle), or the name of a component"
        hint = suggestion(axis, components)
        meant = hint.get("meant", ())
        faults.add((*path, "axis"), "not-an-axis", value=axis, expected=expected, meant=meant)
    if effect.covariance is None:
        return
    before = len(faults.findings)
    own = (*path, "covariance")
    check_covariance(effect.covariance, len(effect.parameters), own, faults)
    if len(faults.findings) > before:
        return
    for i, (name, parameter) in enumerate(effect.parameters.items()):
        variance = effect.covariance[i][i]
        if "u" in parameter.model_fields_set and not _same_u(parameter.u, variance):
            faults.add(
                (*path, "parameters", name, "u"), "contradicts", value=parameter.u,
                other="the effect's covariance, which stands for it",
                expected=f"{math.sqrt(variance):.6g}, or another covariance, or none",
            )  # fmt: skip


def _same_u(u: float, variance: float) -> bool:
    """Whether u^2 is the variance, as far as the digits go that both are written with."""
    low, high = max(0.0, variance - _half_digit(variance)), variance + _half_digit(variance)
    slack = _half_digit(u) + TOLERANCE * u
    return math.sqrt(low) - slack <= u <= math.sqrt(high) + slack


def _half_digit(value: float) -> float:
    """Half of the last digit of a number as it is written; nothing of 0, which is exact."""
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return 0.5 * 10.0 ** min(int(exponent), 0) if value else 0.0


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that equations may use; `linear` are those they must be linear in.

    `dimensions` are exponents of length, None where a name may stand for anything; `values` those
    of the `constants`, which are no columns whatever their names; `parameters` the units of those
    of an effect.
    """

    linear: frozenset[str]
    dimensions: Mapping[str, int | None]
    constants: frozenset[str]
    values: Mapping[str, float]
    parameters: Mapping[str, Unit] = field(default_factory=dict)

    @classmethod
    def of(cls, machine: Machine, faults: Faults) -> Vocabulary:
        """The names of a machine; those whose own entry is faulty count as known."""
        components, constants = faults.keys("components"), faults.keys("constants")
        covariates = [name for name in machine.covariates or () if name is not None]
        # Positions come first in a hint, then what is the machine's own.
        known = (*POSITIONS, *components, *constants, *COVARIATES, *covariates)
        dimensions: dict[str, int | None] = dict.fromkeys(known)
        dimensions |= dict.fromkeys(POSITIONS, LENGTH)
        for name, component in (machine.components or {}).items():
            dimensions[name] = UNITS[component.unit].dimension
        values = {name: item.value for name, item in (machine.constants or {}).items()}
        return cls(frozenset(components), dimensions, frozenset(constants), values)

    def with_parameters(self, effect: Effect) -> Vocabulary:
        """These names and the parameters of one effect."""
        units = parameter_units(effect)
        own = {name: unit.dimension for name, unit in units.items()}
        known = {**own, **self.dimensions, **own}
        return replace(self, linear=self.linear | set(own), dimensions=known, parameters=units)

    def linear_form(self, text: str) -> LinearForm:
        """An equation in mm as a linear form.

        Raises InputError for what cannot be read, unknown names, terms that are not linear in the
        components and parameters, and wrong units.
        """
        node = parse(text)
        covariates = filter(is_covariate, names(node))
        check_known(node, [*self.dimensions, *covariates])
        check_finite(node, self.values)
        form = linear_form(node, self.linear, self.parameters)
        taken = self.linear | self.constants
        # A component has no unit per kelvin or step of a column: beside one any may be meant.
        columns = own_columns(names(node), taken)
        known = {n: internal(own) for n, own in self.dimensions.items() if own is not None}
        parameters = self.parameters
        check_dimension(node, internal(LENGTH), known, parameters=parameters, columns=columns)
        return form


def _linear_forms(
    equations: Mapping[Any, str] | None, vocabulary: Vocabulary, faults: Faults, path: YamlPath
) -> dict[str, LinearForm]:
    """Each sound equation as a linear form; the faults of the others go to `faults`."""
    forms = {}
    for name, text in (equations or {}).items():
        with faults.collected((*path, name)):
            forms[name] = vocabulary.linear_form(text)
    return forms
