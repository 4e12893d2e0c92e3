"""What a machine file must fulfil beyond the shape of its values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal

from mtu_cli.errors import closest, counted
from mtu_cli.files.contracts import Findings, duplicates, is_identifier, present
from mtu_cli.files.covariance import covariance_fault
from mtu_cli.files.covariates import HOTTEST_DEGC, expected_temperature, is_covariate
from mtu_cli.files.machine_contract import Component, Effect, Machine
from mtu_cli.files.machine_equations import POSITIONS
from mtu_cli.files.thermal_contract import check_thermal
from mtu_cli.files.yaml_file import YamlPath
from mtu_cli.language.functions import MACHINE_FUNCTIONS

PASSES = "a covariance of passes"
TOLERANCE = 1e-9
"""Of a standard deviation beside its square, relative: what calculation leaves beyond digits."""


def check_names(machine: Machine, findings: Findings) -> None:
    """Names of constants, covariates, components and parameters: usable, and used once."""
    taken = dict.fromkeys(("pi", *MACHINE_FUNCTIONS), "part of the equation language")
    positions = dict.fromkeys(POSITIONS, "a position")
    covariates = [name for name in machine.covariates or () if isinstance(name, str)]
    constants = findings.keys("constants")
    components = findings.keys("components")
    for index, name in enumerate(covariates):
        _check_name(name, ("covariates", index), taken | positions, findings)
    for index, name, _ in duplicates(enumerate(covariates)):
        findings.add(("covariates", index), "the covariate is listed twice", value=name)
    taken |= dict.fromkeys(covariates, "a covariate")
    for name in findings.given("constants"):
        # One without a value has its own message.
        _check_name(name, ("constants", name), taken, findings)
    taken |= positions | dict.fromkeys(constants, "a constant")
    for name in components:
        _check_name(name, ("components", name), taken, findings)
    taken |= dict.fromkeys(components, "a component")
    for index, effect in present(machine.effects):
        for name in effect.parameters:
            _check_name(name, ("effects", index, "parameters", name), taken, findings)
    named = [(index, effect.name) for index, effect in present(machine.effects)]
    for index, name, _ in duplicates(named):
        findings.add(("effects", index, "name"), "a second effect of this name", value=name)
    for name, axis in (machine.axes or {}).items():
        if axis.travel_mm[0] >= axis.travel_mm[1]:
            findings.add(
                ("axes", name, "travel_mm"),
                "wrong value",
                value=axis.travel_mm,
                expected="the lower end first",
            )


def _check_name(name: str, path: YamlPath, taken: dict[str, str], findings: Findings) -> None:
    if not is_identifier(name):
        findings.add(
            path,
            "not a name that equations can use",
            value=name,
            expected="letters, digits and _, no digit first",
        )
    elif name in taken:
        findings.add(path, f"the name is taken: it is {taken[name]}", value=name)
    elif is_covariate(name) and path[0] != "covariates":
        findings.add(path, "the name is taken: it is a covariate", value=name)


def check_reference(machine: Machine, findings: Findings) -> None:
    """The temperature that drifts count from: one that a machine can have."""
    reference = machine.reference_temperature_degC
    if reference is not None and abs(reference) > HOTTEST_DEGC:
        findings.add(
            ("reference_temperature_degC",),
            "no temperature of a machine",
            value=f"{reference:g}",
            expected=expected_temperature(reference),
        )


def check_components(machine: Machine, findings: Findings) -> None:
    """Degrees, sizes and matrices of the components."""
    for name, component in (machine.components or {}).items():
        path: YamlPath = ("components", name)
        if component.of is None and component.degree != 0:
            findings.add(
                (*path, "degree"),
                "a component without `of` is a constant",
                value=component.degree,
                expected="degree 0, or `of: x`",
            )
        else:
            _check_sizes(component, path, findings)
        if component.u_future is not None:
            for key in ("s_repeat", "pass_covariance", "covariance"):
                if getattr(component, key) is not None:
                    findings.add((*path, key), "given beside u_future, which stands for it")
        if component.thermal is not None:
            axis = None if component.of is None else (machine.axes or {}).get(component.of)
            travel = None if axis is None else axis.travel_mm
            check_thermal(component.thermal, component.of, travel, (*path, "thermal"), findings)


def _check_sizes(component: Component, path: YamlPath, findings: Findings) -> None:
    size = component.degree + 1
    if component.coefficients is not None and len(component.coefficients) != size:
        kind = f"of degree {component.degree}" if component.of else "without `of`"
        findings.add(
            (*path, "coefficients"),
            f"{counted(len(component.coefficients), 'coefficient')} of a component {kind}",
            expected=f"{size}",
        )
    # The degree that is not written follows from the coefficients.
    one = component.of is not None and component.coefficients is not None and size == 1
    why = ": one coefficient makes a component without a slope" if one else ""
    if component.covariance is not None:
        _check_matrix(component.covariance, size, (*path, "covariance"), findings, why)
    if component.pass_covariance is not None:
        passes = min(2, size)
        _check_matrix(component.pass_covariance, passes, (*path, "pass_covariance"), findings, why)
        if component.pass_dof == 0 and any(map(any, component.pass_covariance)):
            expected = "more than 0, or no key: known exactly"
            what = f"{PASSES} without degrees of freedom"
            findings.add((*path, "pass_dof"), what, value=0, expected=expected)


def check_effect_axis(effect: Effect, index: int, findings: Findings) -> None:
    """What an effect is of: axes of the machine, none twice, or a component."""
    axis, components = effect.axis, findings.keys("components")
    if axis is None or axis in components:
        return
    if not axis or len(set(axis)) < len(axis) or not set(axis) <= set(POSITIONS):
        near = closest(axis, components)
        findings.add(
            ("effects", index, "axis"),
            "not an axis",
            value=axis,
            expected="x, y or z, or several of them, such as xy for an angle, or the name of a "
            f"component{f': {near!r}?' if near else ''}",
        )


def check_effect_covariance(effect: Effect, index: int, findings: Findings) -> None:
    """The covariance of an effect's parameters, in their order."""
    if effect.covariance is None:
        return
    path: YamlPath = ("effects", index)
    before = len(findings.problems)
    _check_matrix(effect.covariance, len(effect.parameters), (*path, "covariance"), findings)
    if len(findings.problems) > before:
        return
    for i, (name, parameter) in enumerate(effect.parameters.items()):
        variance = effect.covariance[i][i]
        if "u" in parameter.model_fields_set and not _same_u(parameter.u, variance):
            findings.add(
                (*path, "parameters", name, "u"),
                "at odds with the effect's covariance, which stands for it",
                value=parameter.u,
                expected=f"{math.sqrt(variance):.6g}, or another covariance, or none",
            )


def _same_u(u: float, variance: float) -> bool:
    """Whether u^2 is the variance, as far as the digits go that both are written with."""
    low, high = max(0.0, variance - _half_digit(variance)), variance + _half_digit(variance)
    slack = _half_digit(u) + TOLERANCE * u
    return math.sqrt(low) - slack <= u <= math.sqrt(high) + slack


def _half_digit(value: float) -> float:
    """Half of the last digit of a number as it is written; nothing of 0, which is exact."""
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return 0.5 * 10.0 ** min(int(exponent), 0) if value else 0.0


def _check_matrix(
    rows: Sequence[Sequence[float]], size: int, path: YamlPath, findings: Findings, why: str = ""
) -> None:
    lengths = [len(row) for row in rows]
    if lengths != [size] * size:
        *less, most = sorted(set(lengths)) or [0]
        widths = "/".join(map(str, [*less, counted(most, "number")]))
        what = f"{counted(len(rows), 'row')} of {widths}"
        findings.add(path, what, expected=f"{counted(size, 'row')} of {size}{why}")
        return
    fault = covariance_fault(rows, size)
    if fault is not None:
        findings.add(path, fault, value=rows, expected="a covariance matrix")
