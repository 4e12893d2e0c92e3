"""The machine as a design matrix: E = J theta + remainder at any set of points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.language import LinearForm, Node, evaluate, names
from mtu_cli.language.tree import Binary
from mtu_cli.model.effect_parameters import EFFECT_MARK, effect_estimates
from mtu_cli.model.estimates import ComponentEstimate, Estimates, JointPasses
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import polynomial

AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One component (or effect parameter) and its lever arm in each equation."""

    estimate: ComponentEstimate
    levers: dict[str, Node]


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineModel:
    """A machine with all its components known.

    `axes` are the axes that have an equation, `terms` the components in the order of theta,
    `remainders` what the equations hold beside components, `constants` name -> (value, u).
    """

    name: str
    axes: tuple[str, ...]
    terms: tuple[Term, ...]
    remainders: dict[str, tuple[Node, ...]]
    constants: dict[str, tuple[float, float]]
    joint: tuple[JointPasses, ...]

    def covariates(self) -> tuple[str, ...]:
        """Names that the equations use beside positions, constants and components."""
        used: dict[str, int] = {}
        for term in self.terms:
            for lever in term.levers.values():
                used |= names(lever)
        for nodes in self.remainders.values():
            for node in nodes:
                used |= names(node)
        known = {*AXES, *self.constants}
        return tuple(sorted(name for name in used if name not in known))

    def position_constants(self) -> dict[str, float]:
        """Coordinates that a constant of the machine fixes."""
        return {name: self.constants[name][0] for name in AXES if name in self.constants}


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The machine at n points: rows are (point, axis), points first.

    `J` (n*a, K) in theta, `columns` of each term in it, `levers` (n*a, c) of each term,
    `remainder` (n*a,) in mm.
    """

    J: FloatArray
    levers: FloatArray
    remainder: FloatArray
    columns: tuple[slice, ...]


def build_model(machine: LoadedMachine, estimates: Estimates) -> MachineModel:
    """Joins a machine file and the estimates of its components.

    Raises InputError for a component of the equations that has neither readings nor
    coefficients, or too few readings for an uncertainty, with the line of the machine file.
    """
    forms: list[dict[str, LinearForm]] = [machine.forms]
    found = dict(estimates.components)
    joint = list(estimates.joint)
    renames: list[dict[str, str]] = [{}]
    for effect, form in zip(machine.machine.effects, machine.effect_forms, strict=True):
        rename = {name: f"{effect.name}{EFFECT_MARK}{name}" for name in effect.parameters}
        parameters, together = effect_estimates(effect, rename)
        found |= parameters
        joint += together
        forms.append(form)
        renames.append(rename)
    axes = tuple(axis for axis in AXES if any(f"E{axis}" in form for form in forms))
    levers: dict[str, dict[str, Node]] = {name: {} for name in found}
    remainders: dict[str, list[Node]] = {axis: [] for axis in axes}
    missing: dict[str, None] = {}
    for form, rename in zip(forms, renames, strict=True):
        for equation, linear in form.items():
            axis = equation[1:]
            for name, lever in linear.coefficients.items():
                full = rename.get(name, name)
                if full in levers:
                    levers[full][axis] = _added(levers[full].get(axis), lever)
                else:
                    missing[full] = None
            if linear.remainder is not None:
                remainders[axis].append(linear.remainder)
    terms = [Term(estimate=found[name], levers=lever) for name, lever in levers.items() if lever]
    problems = [_no_estimate(machine, name) for name in missing]
    problems += [
        _no_uncertainty(machine, term.estimate.name) for term in terms if not _is_known(term)
    ]
    if not terms and not problems:
        problems = [Problem(what="no equation holds a component", file=machine.source.shown)]
    if problems:
        raise InputError(problems)
    return MachineModel(
        name=machine.machine.name,
        axes=axes,
        terms=tuple(terms),
        remainders={axis: tuple(nodes) for axis, nodes in remainders.items()},
        constants={
            name: (constant.value, constant.u)
            for name, constant in machine.machine.constants.items()
        },
        joint=tuple(joint),
    )


def _added(lever: Node | None, more: Node) -> Node:
    """An effect may hold a component of the equations: its lever arms add up."""
    return more if lever is None else Binary("+", lever, more, more.column)


def _no_estimate(machine: LoadedMachine, name: str) -> Problem:
    return Problem(
        what=f"the component {name!r} has neither readings nor coefficients",
        file=machine.source.shown,
        line=machine.line_of("components", name),
        path=f"components.{name}",
        expected="readings of it (--lbb, --laser), coefficients here, or a components report (-c)",
    )


def _is_known(term: Term) -> bool:
    """Whether the component has an uncertainty: not where nothing is left over for scatter."""
    return bool(np.isfinite(term.estimate.covariance).all() and np.isfinite(term.estimate.s_repeat))


def _no_uncertainty(machine: LoadedMachine, name: str) -> Problem:
    return Problem(
        what=f"the component {name!r} has as many readings as coefficients: its uncertainty "
        "cannot be had",
        file=machine.source.shown,
        line=machine.line_of("components", name),
        path=f"components.{name}",
        expected="more readings of it, best in several passes",
    )


def check_covariates(model: MachineModel, given: Mapping[str, object]) -> None:
    """Raises InputError naming every covariate that the equations need and nobody gave."""
    missing = [name for name in model.covariates() if name not in given]
    if missing:
        raise InputError(
            [
                Problem(
                    what=f"the equations of {model.name!r} need the covariate {name!r}",
                    expected=f"--at {name}=VALUE"
                    + (f"; given: {', '.join(given)}" if given else ""),
                )
                for name in missing
            ]
        )


def design(
    model: MachineModel, points: FloatArray, covariates: Mapping[str, FloatArray | float]
) -> Design:
    """J, lever arms and remainder at `points` (n, 3) in mm (nan where a coordinate is unknown).

    Row (i, axis) holds dE_axis/dtheta at point i: lever arm times powers of the component's
    position. Gilsinn & Ling 2004, eq. (1), or any other set of linear equations.

    Raises InputError where a needed coordinate is unknown or a value is not finite.
    """
    values: dict[str, FloatArray | float] = {
        name: pair[0] for name, pair in model.constants.items()
    }
    place = {axis: points[:, i] for i, axis in enumerate(AXES)} | {
        axis: np.full(len(points), value) for axis, value in model.position_constants().items()
    }
    values |= place
    values |= {name: covariates[name] for name in model.covariates()}
    n, a = len(points), len(model.axes)
    widths = [len(term.estimate.coefficients) for term in model.terms]
    starts = np.concatenate([[0], np.cumsum(widths)]).astype(int)
    J = np.zeros((n, a, starts[-1]))
    levers = np.zeros((n, a, len(model.terms)))
    for t, term in enumerate(model.terms):
        rows = _powers(term.estimate, place, n)
        for i, axis in enumerate(model.axes):
            if axis in term.levers:
                levers[:, i, t] = evaluate(term.levers[axis], values)
                # An infinite lever arm is reported by _check_finite, in words.
                with np.errstate(invalid="ignore"):
                    J[:, i, starts[t] : starts[t + 1]] = levers[:, i, t, None] * rows
    remainder = np.zeros((n, a))
    for i, axis in enumerate(model.axes):
        for node in model.remainders[axis]:
            remainder[:, i] += evaluate(node, values)
    _check_finite(model, J, remainder, points)
    return Design(
        J=J.reshape(n * a, -1),
        levers=levers.reshape(n * a, -1),
        remainder=remainder.reshape(n * a),
        columns=tuple(slice(starts[t], starts[t + 1]) for t in range(len(widths))),
    )


def _powers(estimate: ComponentEstimate, place: Mapping[str, FloatArray], n: int) -> FloatArray:
    if estimate.of is None:
        return np.ones((n, 1))
    return polynomial(place[estimate.of], estimate.degree)


def _check_finite(
    model: MachineModel, J: FloatArray, remainder: FloatArray, points: FloatArray
) -> None:
    bad = ~(np.isfinite(J).all(axis=2) & np.isfinite(remainder))
    if not bad.any():
        return
    i, a = np.argwhere(bad)[0]
    axis = model.axes[a]
    used: set[str] = set()
    for term in model.terms:
        if axis in term.levers:
            used |= {*names(term.levers[axis]), term.estimate.of or ""}
    for node in model.remainders[axis]:
        used |= set(names(node))
    unknown = [
        name
        for k, name in enumerate(AXES)
        if np.isnan(points[i, k]) and name in used and name not in model.constants
    ]
    place = ", ".join(f"{name}={points[i, k]:g}" for k, name in enumerate(AXES) if name in used)
    raise InputError(
        Problem(
            what=f"the equation E{axis} of {model.name!r} has no finite value at {place}",
            expected=(
                f"a value for {unknown[0]} (z_mm in the part, or a constant of the machine)"
                if unknown
                else "an equation that is defined at every feature (no division by 0, no root or "
                "logarithm of a negative number)"
            ),
        )
    )


def theta(model: MachineModel) -> FloatArray:
    """The coefficients of all terms, one after the other, (K,)."""
    return np.concatenate([term.estimate.coefficients for term in model.terms])
