"""A machine with all its components known, term by term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.files.covariates import expected_temperature, no_temperature
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.yaml_file import path_text
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.language import LinearForm, Node, names
from mtu_cli.language.tree import Call
from mtu_cli.model.basis import Basis, PolynomialBasis, ThermalBasis
from mtu_cli.model.effect_parameters import DeclaredEffect, declared_effects, effects_of
from mtu_cli.model.estimates import ComponentEstimate, Estimates, JointPasses
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.model.thermal_terms import leftover_estimate, temperature_estimate

AXES = ("x", "y", "z")
MOST_SENSORS = 4
"""Missing temperatures that are told one by one, or by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One component (or effect parameter), what its coefficients multiply, and its lever arm
    in each equation.
    """

    estimate: ComponentEstimate
    basis: Basis
    levers: dict[str, Node]


def polynomial_term(estimate: ComponentEstimate, levers: dict[str, Node]) -> Term:
    """The term of a component that is a polynomial of its axis."""
    basis = PolynomialBasis(of=estimate.of, degree=estimate.degree)
    return Term(estimate=estimate, basis=basis, levers=levers)


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineModel:
    """A machine with all its components known.

    `axes` are the axes that have an equation, `terms` the components in the order of theta,
    `remainders` what the equations hold beside components, `constants` name -> (value, u),
    `effects` what the machine file declares as such; `places` (file, line, path) of the equations
    by the effect that they are of ("": the machine's own) and axis.
    """

    name: str
    axes: tuple[str, ...]
    terms: tuple[Term, ...]
    remainders: dict[str, tuple[Node, ...]]
    constants: dict[str, tuple[float, float]]
    joint: tuple[JointPasses, ...]
    effects: tuple[DeclaredEffect, ...] = ()
    places: Mapping[tuple[str, str], tuple[str, int | None, str]] = field(default_factory=dict)

    def covariates(self) -> tuple[str, ...]:
        """Names that the equations use beside positions, constants and components."""
        used: dict[str, int] = {}
        for term in self.terms:
            used |= dict.fromkeys(term.basis.inputs(), 0)
            for lever in term.levers.values():
                used |= names(lever)
        for nodes in self.remainders.values():
            for node in nodes:
                used |= names(node)
        known = {*AXES, *self.constants}
        return tuple(sorted(name for name in used if name not in known))

    def drifts(self) -> tuple[ThermalEstimate, ...]:
        """The thermal models among the terms."""
        bases = [term.basis for term in self.terms]
        return tuple(basis.estimate for basis in bases if isinstance(basis, ThermalBasis))

    def position_constants(self) -> dict[str, float]:
        """Coordinates that a constant of the machine fixes."""
        return {name: self.constants[name][0] for name in AXES if name in self.constants}


def build_model(machine: LoadedMachine, estimates: Estimates) -> MachineModel:
    """Joins a machine file and the estimates of its components.

    Raises InputError for a component of the equations that has neither readings nor
    coefficients, or too few readings for an uncertainty, with the line of the machine file.
    """
    effects = effects_of(machine, estimates.effects)
    parts = [_Part(form=machine.forms, rename={})]
    parts += [
        _Part(form=form, rename=rename)
        for form, rename in zip(machine.effect_forms, effects.renames, strict=True)
    ]
    found = estimates.components | effects.components
    axes = tuple(axis for axis in AXES if any(f"E{axis}" in part.form for part in parts))
    levers = _levers(parts)
    terms = [polynomial_term(found[name], levers[name]) for name in found if name in levers]
    _check_terms(machine, terms, [name for name in levers if name not in found])
    return MachineModel(
        name=machine.machine.name,
        axes=axes,
        terms=(*terms, *_thermal_terms(estimates, levers)),
        remainders=_remainders(parts, axes),
        constants={
            name: (constant.value, constant.u)
            for name, constant in machine.machine.constants.items()
        },
        joint=(*estimates.joint, *effects.joint),
        effects=declared_effects(machine),
        places=_places(machine),
    )


def _places(machine: LoadedMachine) -> dict[tuple[str, str], tuple[str, int | None, str]]:
    paths: dict[tuple[str, str], tuple[str | int, ...]] = {
        ("", name[1:]): ("equations", name) for name in machine.machine.equations
    }
    for index, effect in enumerate(machine.machine.effects):
        for name in effect.equations:
            paths[effect.name, name[1:]] = ("effects", index, "equations", name)
    shown = machine.source.shown
    return {key: (shown, machine.line_of(*path), path_text(path)) for key, path in paths.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """Linear forms of the machine's equations or of an effect, whose parameters are renamed."""

    form: Mapping[str, LinearForm]
    rename: Mapping[str, str]


def _levers(parts: Sequence[_Part]) -> dict[str, dict[str, Node]]:
    """Lever arm by component and axis; an effect may hold a component of the equations."""
    levers: dict[str, dict[str, Node]] = {}
    for part in parts:
        for equation, linear in part.form.items():
            for name, lever in linear.coefficients.items():
                own = levers.setdefault(part.rename.get(name, name), {})
                own[equation[1:]] = _added(own.get(equation[1:]), lever)
    return levers


def _remainders(parts: Sequence[_Part], axes: Sequence[str]) -> dict[str, tuple[Node, ...]]:
    """What equations and effects hold beside components, by axis."""
    forms = {axis: [part.form.get(f"E{axis}") for part in parts] for axis in axes}
    return {
        axis: tuple(
            linear.remainder
            for linear in own
            if linear is not None and linear.remainder is not None
        )
        for axis, own in forms.items()
    }


def _check_terms(machine: LoadedMachine, terms: Sequence[Term], missing: Sequence[str]) -> None:
    problems = [_no_estimate(machine, name) for name in missing]
    problems += [
        _no_uncertainty(machine, term.estimate.name) for term in terms if not _is_known(term)
    ]
    if not terms and not problems:
        reason = "no equation contains a component"
        problems = [finding("not-applicable", reason=reason, file=machine.source.shown)]
    if problems:
        raise InputError(problems)


def _thermal_terms(estimates: Estimates, levers: Mapping[str, dict[str, Node]]) -> list[Term]:
    """Drift of the components that stand in an equation, and what its model leaves of it."""
    terms = []
    for name, drift in estimates.thermal.items():
        if not levers.get(name):
            continue
        terms += [
            Term(
                estimate=temperature_estimate(drift),
                basis=ThermalBasis(estimate=drift),
                levers=levers[name],
            ),
            polynomial_term(leftover_estimate(drift), levers[name]),
        ]
    return terms


def _added(lever: Node | None, more: Node) -> Node:
    return more if lever is None else Call("+", (lever, more), more.column)


def _no_estimate(machine: LoadedMachine, name: str) -> Finding:
    return finding(
        "missing-input",
        what=f"an estimate of {name}",
        estimate_of=name,
        file=machine.source.shown,
        line=machine.line_of("components", name),
        path=f"components.{name}",
        expected="readings of it (--lbb, --laser), coefficients here, or a components report (-c)",
    )


def _is_known(term: Term) -> bool:
    """Whether the component has an uncertainty: not where nothing is left over for scatter."""
    return bool(np.isfinite(term.estimate.covariance).all() and np.isfinite(term.estimate.s_repeat))


def _no_uncertainty(machine: LoadedMachine, name: str) -> Finding:
    return finding(
        "too-little-data",
        what=f"as many readings of {name!r} as coefficients",
        file=machine.source.shown,
        line=machine.line_of("components", name),
        path=f"components.{name}",
        expected="more readings of it, best in several passes",
    )


MEANT = {"sequence": ", the number of the part, or of the pass of readings, in their order"}
"""What a column is that a file may have under another name, or not at all."""


def check_covariates(model: MachineModel, given: Mapping[str, object]) -> None:
    """Raises InputError naming every covariate that the equations need and nobody gave."""
    _check_temperatures(model, given)
    missing = [name for name in model.covariates() if name not in given]
    if not missing:
        return
    drifts = sensors_of(model)
    sensors = [name for name in missing if name in drifts]
    together = sensors if len(sensors) > MOST_SENSORS else []
    groups = [together, *([name] for name in missing if name not in together)]
    raise InputError(_needed(model, drifts, names, given) for names in groups if names)


def _needed(
    model: MachineModel,
    drifts: Mapping[str, Sequence[str]],
    names: Sequence[str],
    given: Mapping[str, object],
) -> Finding:
    """Covariates that the equations, or the drift of components, need and nobody gave."""
    owner = f"the machine {model.name!r}"
    if names[0] in drifts:
        of = dict.fromkeys(name for sensor in names for name in drifts[sensor])
        owner = f"the drift of {listed(of)}"
    expected = f"--at {names[0]}=VALUE{MEANT.get(names[0], '')}"
    if len(names) > 1:
        expected += " and so on, or --at 'T_*_degC=VALUE' for all of them"
    expected += _given(given)
    each = "each of " if len(names) > 1 else ""
    what = f"a value of {each}{listed(names)} for {owner}"
    return finding("missing-input", what=what, names=list(names), expected=expected)


def _given(given: Mapping[str, object]) -> str:
    return f"; given: {', '.join(given)}" if given else ""


def _check_temperatures(model: MachineModel, given: Mapping[str, object]) -> None:
    for sensor in sensors_of(model):
        values = np.atleast_1d(np.asarray(given.get(sensor, 0.0), float))
        faulty = no_temperature(values)
        if faulty.any():
            value = float(values[faulty][0])
            raise error(
                "out-of-range",
                path=sensor,
                value=f"{value:g}",
                expected=expected_temperature(value),
            )


def sensors_of(model: MachineModel) -> dict[str, tuple[str, ...]]:
    """The components whose drift needs a sensor, by sensor."""
    found: dict[str, tuple[str, ...]] = {}
    for drift in model.drifts():
        for sensor in drift.sensors:
            found[sensor] = (*found.get(sensor, ()), drift.component)
    return found
