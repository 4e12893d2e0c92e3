"""A machine with all its components known: its terms, and the design matrix at points.

E = J theta + remainder. What a component's coefficients multiply are powers of a position, or those
times temperatures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mtu_cli.files.covariates import expected_temperature, no_temperature
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.yaml_file import path_text
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.language import LinearForm, Node, evaluate, names
from mtu_cli.language.tree import Call
from mtu_cli.model.basis import Powers, Shape
from mtu_cli.model.effect_parameters import (
    EFFECT_MARK,
    DeclaredEffect,
    declared_effects,
    effects_of,
)
from mtu_cli.model.estimates import (
    ComponentEstimate,
    Estimates,
    JointPasses,
    ThermalEstimate,
    leftover_estimate,
    temperature_estimate,
)
from mtu_cli.stats.lag import farthest_at_once, lag_of_moments
from mtu_cli.stats.least_squares import FloatArray

Covariates = Mapping[str, FloatArray | float]
TIME = "time_min"
AGREE_DEGC = 0.5
"""Readings of one sensor at one moment differ by less: what differs by more is another time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionBasis:
    """Columns of the position along `of`; without an axis the constant alone."""

    of: str | None
    shape: Shape

    def rows(self, place: Mapping[str, FloatArray], covariates: Covariates, n: int) -> FloatArray:
        """The columns (n, k) at n places."""
        return np.ones((n, 1)) if self.of is None else self.shape.columns(place[self.of])


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalBasis:
    """Powers of the position times temperature rises: p^m u_s, powers first."""

    estimate: ThermalEstimate

    def rows(self, place: Mapping[str, FloatArray], covariates: Covariates, n: int) -> FloatArray:
        """The columns (n, powers * sensors) at n places, with each sensor's lag."""
        estimate = self.estimate
        powers = PositionBasis(of=estimate.of, shape=Powers(estimate.degree)).rows(
            place, covariates, n
        )
        rise = self.temperatures(covariates, n) - estimate.reference
        product: FloatArray = (powers[:, :, None] * rise[:, None, :]).reshape(n, -1)
        return product

    def temperatures(self, covariates: Covariates, n: int) -> FloatArray:
        """Temperatures (n, s), lagged where the model says so and the rows tell a history.

        One temperature for all rows, or rows without times, count as settled. What lags is the
        mean over the rows of a moment; a sensor without lag is every row's own.

        Raises InputError for rows of a moment that cannot both be right.
        """
        found = np.empty((n, len(self.estimate.sensors)))
        for s, sensor in enumerate(self.estimate.sensors):
            found[:, s] = covariates[sensor]
        times = row_times(covariates)
        if times is None or not self.estimate.time_constants.any():
            return found
        apart = disagreement(self.estimate, covariates)
        if apart is not None:
            sensor, i, j = apart
            first, second = (float(np.asarray(covariates[sensor])[k]) for k in (i, j))
            raise error(
                "contradicts",
                path=sensor,
                other=f"{first:g} degC at the same time ({times[i]:g} min)",
                value=f"{second:g} degC",
                expected=f"one temperature a moment: {TIME} that runs on over all rows",
            )
        order = np.argsort(times, kind="stable")
        constants, index = np.unique(self.estimate.time_constants, return_inverse=True)
        lagged = lag_of_moments(found[order], times[order], constants)
        found[order] = lagged[index, :, np.arange(found.shape[1])].T
        return found


def row_times(covariates: Covariates) -> FloatArray | None:
    """Times (n,) of the rows, min; None where they tell no history."""
    times = covariates.get(TIME)
    return None if times is None or np.ndim(times) == 0 else np.asarray(times, float)


def disagreement(drift: ThermalEstimate, covariates: Covariates) -> tuple[str, int, int] | None:
    """(sensor, row, row): two rows of one time whose temperatures cannot both be right, for the
    drift lags behind them; None where no times are given, or all rows of every moment agree.
    """
    times = row_times(covariates)
    for sensor, tau in zip(drift.sensors, drift.time_constants.tolist(), strict=True):
        value = np.asarray(covariates[sensor], float)
        if times is not None and tau > 0 and value.ndim:
            i, j, apart = farthest_at_once(value, times)
            if apart > AGREE_DEGC:
                return sensor, i, j
    return None


Basis = PositionBasis | ThermalBasis


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


def component_term(estimate: ComponentEstimate, levers: dict[str, Node]) -> Term:
    """The term of a component that is a polynomial or a table of its axis."""
    basis = PositionBasis(of=estimate.of, shape=estimate.shape)
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
        levers = [lever for term in self.terms for lever in term.levers.values()]
        nodes = [node for own in self.remainders.values() for node in own]
        used = {name for node in (*levers, *nodes) for name in names(node)}
        used |= {sensor for drift in self.drifts() for sensor in drift.sensors}
        return tuple(sorted(used - {*AXES, *self.constants}))

    def drifts(self) -> tuple[ThermalEstimate, ...]:
        """The thermal models among the terms."""
        bases = [term.basis for term in self.terms]
        return tuple(basis.estimate for basis in bases if isinstance(basis, ThermalBasis))

    def position_constants(self) -> dict[str, float]:
        """Coordinates that a constant of the machine fixes."""
        return {name: self.constants[name][0] for name in AXES if name in self.constants}


Part = tuple[Mapping[str, LinearForm], Mapping[str, str]]
"""Linear forms of the machine's equations or of an effect, whose parameters are renamed."""


def build_model(machine: LoadedMachine, estimates: Estimates) -> MachineModel:
    """Joins a machine file and the estimates of its components.

    Raises InputError for a component of the equations that has neither readings nor
    coefficients, or too few readings for an uncertainty, with the line of the machine file.
    """
    effects = effects_of(machine, estimates.effects)
    parts: list[Part] = [(machine.forms, {})]
    parts += zip(machine.effect_forms, effects.renames, strict=True)
    found = estimates.components | effects.components
    axes = tuple(axis for axis in AXES if any(f"E{axis}" in form for form, _ in parts))
    levers = _levers(parts)
    terms = [component_term(found[name], levers[name]) for name in found if name in levers]
    _check_terms(machine, terms, [name for name in levers if name not in found])
    paths: dict[tuple[str, str], tuple[str | int, ...]] = {
        ("", name[1:]): ("equations", name) for name in machine.machine.equations
    }
    for index, effect in enumerate(machine.machine.effects):
        for name in effect.equations:
            paths[effect.name, name[1:]] = ("effects", index, "equations", name)
    shown, entries = machine.source.shown, machine.machine.constants.items()
    forms = {axis: [form[f"E{axis}"] for form, _ in parts if f"E{axis}" in form] for axis in axes}
    return MachineModel(
        name=machine.machine.name,
        axes=axes,
        terms=(*terms, *_thermal_terms(estimates, levers)),
        remainders={
            axis: tuple(form.remainder for form in own if form.remainder is not None)
            for axis, own in forms.items()
        },
        constants={name: (constant.value, constant.u) for name, constant in entries},
        joint=(*estimates.joint, *effects.joint),
        effects=declared_effects(machine),
        places={
            key: (shown, machine.line_of(*path), path_text(path)) for key, path in paths.items()
        },
    )


def _levers(parts: Sequence[Part]) -> dict[str, dict[str, Node]]:
    """Lever arm by component and axis; an effect may hold a component of the equations."""
    levers: dict[str, dict[str, Node]] = {}
    for form, rename in parts:
        for equation, linear in form.items():
            for name, lever in linear.coefficients.items():
                own = levers.setdefault(rename.get(name, name), {})
                known, axis = own.get(equation[1:]), equation[1:]
                own[axis] = lever if known is None else Call("+", (known, lever), lever.column)
    return levers


def _check_terms(machine: LoadedMachine, terms: Sequence[Term], missing: Sequence[str]) -> None:
    """Raises InputError for `missing` components, and for one without an uncertainty: not where
    nothing is left over for scatter.
    """
    problems = []
    known = [item.estimate for item in terms]
    faults = [("missing-input", name) for name in missing]
    faults += [
        ("too-little-data", item.name)
        for item in known
        if not (np.isfinite(item.covariance).all() and np.isfinite(item.s_repeat))
    ]
    for code, name in faults:
        line = machine.line_of("components", name)
        place = {"file": machine.source.shown, "line": line, "path": f"components.{name}"}
        facts: dict[str, object] = {
            "what": f"as many readings of {name!r} as coefficients",
            "expected": "more readings of it, best in several passes",
        }
        if code == "missing-input":
            expected = "readings of it (--lbb, --laser), coefficients here, or a components report"
            facts = {"what": f"an estimate of {name}", "estimate_of": name}
            facts["expected"] = f"{expected} (-c)"
        problems.append(finding(code, **place, **facts))
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
            component_term(leftover_estimate(drift), levers[name]),
        ]
    return terms


MEANT = {"sequence": ", the number of the part, or of the pass of readings, in their order"}
"""What a column is that a file may have under another name, or not at all."""


def check_covariates(model: MachineModel, given: Mapping[str, object]) -> None:
    """Raises InputError naming every covariate that the equations need and nobody gave."""
    drifts = sensors_of(model)
    for sensor in drifts:
        values = np.atleast_1d(np.asarray(given.get(sensor, 0.0), float))
        faulty = no_temperature(values)
        if faulty.any():
            value = float(values[faulty][0])
            place = {"path": sensor, "value": f"{value:g}"}
            raise error("out-of-range", **place, expected=expected_temperature(value))
    missing = [name for name in model.covariates() if name not in given]
    sensors = [name for name in missing if name in drifts]
    together = sensors if len(sensors) > MOST_SENSORS else []
    groups = [together, *([name] for name in missing if name not in together)]
    problems = []
    for own in filter(None, groups):
        owner = f"the machine {model.name!r}"
        if own[0] in drifts:
            of = dict.fromkeys(name for sensor in own for name in drifts[sensor])
            owner = f"the drift of {listed(of)}"
        expected = f"--at {own[0]}=VALUE{MEANT.get(own[0], '')}"
        if len(own) > 1:
            expected += " and so on, or --at 'T_*_degC=VALUE' for all of them"
        if given:
            expected += f"; given: {', '.join(given)}"
        what = f"a value of {'each of ' if len(own) > 1 else ''}{listed(own)} for {owner}"
        problems.append(finding("missing-input", what=what, names=own, expected=expected))
    if problems:
        raise InputError(problems)


def sensors_of(model: MachineModel) -> dict[str, tuple[str, ...]]:
    """The components whose drift needs a sensor, by sensor."""
    found: dict[str, tuple[str, ...]] = {}
    for drift in model.drifts():
        for sensor in drift.sensors:
            found[sensor] = (*found.get(sensor, ()), drift.component)
    return found


LARGEST = 1e30
"""Of a lever arm or error in mm: squares of larger ones are no numbers."""


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


def places(model: MachineModel, points: FloatArray) -> dict[str, FloatArray]:
    """Coordinates (n,) by axis, those that a constant fixes at its value."""
    fixed = model.position_constants()
    return {
        axis: np.full(len(points), fixed[axis]) if axis in fixed else points[:, i]
        for i, axis in enumerate(AXES)
    }


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
    place = places(model, points)
    values |= place
    values |= {name: covariates[name] for name in model.covariates()}
    n, a = len(points), len(model.axes)
    widths = [len(term.estimate.coefficients) for term in model.terms]
    starts = np.concatenate([[0], np.cumsum(widths)]).astype(int)
    J = np.zeros((n, a, starts[-1]))
    levers = np.zeros((n, a, len(model.terms)))
    for t, term in enumerate(model.terms):
        rows = term.basis.rows(place, covariates, n)
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


def _check_finite(
    model: MachineModel, J: FloatArray, remainder: FloatArray, points: FloatArray
) -> None:
    with np.errstate(invalid="ignore"):
        bad = ~((np.abs(J) < LARGEST).all(axis=2) & (np.abs(remainder) < LARGEST))
    if not bad.any():
        return
    i, a = np.argwhere(bad)[0]
    problem = not_finite(model, model.axes[a], points[i])
    owners = [
        term.estimate.name.rpartition(EFFECT_MARK)[0]
        for term in model.terms
        for _ in term.estimate.coefficients
    ]
    with np.errstate(invalid="ignore"):
        first = np.flatnonzero(~(np.abs(J[i, a]) < LARGEST))
    owner = owners[first[0]] if len(first) else ""
    if (place := model.places.get((owner, model.axes[a]))) is not None:
        problem = replace(problem, file=place[0], line=place[1], path=place[2])
    raise InputError(problem)


def coordinates_of(model: MachineModel, axis: str) -> tuple[str, ...]:
    """The coordinates that the equation of an axis is of, without those that a constant fixes."""
    used: set[str] = set()
    for term in model.terms:
        if axis in term.levers:
            used |= {*names(term.levers[axis]), term.estimate.of or ""}
    for node in model.remainders[axis]:
        used |= set(names(node))
    return tuple(name for name in AXES if name in used and name not in model.constants)


def not_finite(model: MachineModel, axis: str, point: FloatArray) -> Finding:
    """The finding of the equation of an axis that has no value at `point` (3,), mm."""
    used = coordinates_of(model, axis)
    unknown = [name for k, name in enumerate(AXES) if np.isnan(point[k]) and name in used]
    known = [f"{name}={point[AXES.index(name)]:g}" for name in used if name not in unknown]
    where = f" at {', '.join(known)}" if known else ""
    if unknown:
        where += f" without a {unknown[0]}"
        expected = f"{unknown[0]}_mm in the part or nominal_{unknown[0]}_mm of the points, or a "
        expected += "constant of the machine"
    else:
        expected = "an equation that is defined at every feature (no division by 0, no root or "
        expected += "logarithm of a negative number, no exponential of millimetres)"
    what = f"the equation E{axis} of {model.name!r}"
    return finding("no-finite-value", what=what, where=where, expected=expected)


def of_feature(problem: Finding, name: str, more: int, **place: Any) -> Finding:
    """The same finding of a feature, and of so many more, at its place in a file."""
    others = f" (and {more} more)" if more else ""
    where = f"{problem.facts['where']}, of feature {name!r}{others}"
    return replace(problem, facts={**problem.facts, "where": where}, **place)


def without_coordinate(
    model: MachineModel, points: FloatArray
) -> tuple[np.ndarray, Finding] | None:
    """Which of `points` (n, 3) lack a coordinate that an equation needs, and the Problem of the
    first of them; None where none does.
    """
    for axis in model.axes:
        columns = [AXES.index(name) for name in coordinates_of(model, axis)]
        lacking = np.flatnonzero(np.isnan(points[:, columns]).any(axis=1))
        if len(lacking):
            return lacking, not_finite(model, axis, points[lacking[0]])
    return None


def theta(model: MachineModel) -> FloatArray:
    """The coefficients of all terms, one after the other, (K,)."""
    return np.concatenate([term.estimate.coefficients for term in model.terms])
