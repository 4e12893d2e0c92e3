"""A machine with all its components known: its terms, and the design matrix at points.

E = J theta + remainder. What a component's coefficients multiply are powers of a position, or those
times temperatures.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.files.machine import Effect, LoadedMachine
from mtu_cli.findings import Finding, InputError, error, finding, listed, nearest
from mtu_cli.language import LinearForm, Node, evaluate, names
from mtu_cli.language.tree import Call, Number
from mtu_cli.model.effect_parameters import EFFECT_MARK, effects_of, renames
from mtu_cli.model.estimates import ComponentEstimate, Estimates, JointPasses, ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray, polynomial
from mtu_cli.stats.serial import first_order_lag

Covariates = Mapping[str, FloatArray | float]
AXES = ("x", "y", "z")
TIME = "time_min"
LARGEST = 1e30
"""Of a lever arm or error in mm: squares of larger ones are no numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One component (or effect parameter) and its lever arm in each equation; of the temperatures'
    part of a `drift` the coefficients multiply p^m u_s, powers first.
    """

    estimate: ComponentEstimate
    levers: dict[str, Node]
    drift: ThermalEstimate | None = None

    def columns(
        self, place: Mapping[str, FloatArray], covariates: Covariates, n: int
    ) -> FloatArray:
        """What the coefficients multiply (n, k) at n places."""
        drift, axis = self.drift, self.estimate.of
        position = np.zeros(n) if axis is None else place[axis]
        if drift is None:
            return self.estimate.shape.columns(position)
        powers = polynomial(position, drift.degree)
        rise = temperatures(drift, covariates, n) - drift.reference
        return (powers[:, :, None] * rise[:, None, :]).reshape(n, -1)


def drift_terms(drift: ThermalEstimate, levers: dict[str, Node]) -> tuple[Term, Term]:
    """The drift by its temperatures, powers first, then sensors; and the leftover of its model:
    mean 0, one draw for all points of a part.
    """
    by_temperature = ComponentEstimate(
        name=f"{drift.component}.temperature",
        of=drift.of,
        unit=drift.unit,
        coefficients=drift.coefficients.reshape(-1),
        covariance=drift.covariance,
        pass_covariance=np.zeros_like(drift.covariance),
        pass_dof=drift.coefficient_dof,
        # What does not depend on the position holds beyond the positions where it was read.
        position_range=drift.position_range if drift.degree else None,
    )
    leftover = ComponentEstimate(
        name=f"{drift.component}.leftover",
        of=drift.of,
        unit=drift.unit,
        coefficients=np.zeros(len(drift.leftover)),
        covariance=np.zeros_like(drift.leftover),
        pass_covariance=drift.leftover,
        pass_dof=drift.leftover_dof,
    )
    return (
        Term(estimate=by_temperature, levers=levers, drift=drift),
        Term(estimate=leftover, levers=levers),
    )


def temperatures(drift: ThermalEstimate, covariates: Covariates, n: int) -> FloatArray:
    """Temperatures (n, s) of a drift's sensors, lagged where the rows are a history: one
    temperature for all rows, or rows without times, count as settled. What lags is the mean over
    the rows of a moment; a sensor without lag has the value of each row.
    """
    result = np.empty((n, len(drift.sensors)))
    for s, sensor in enumerate(drift.sensors):
        result[:, s] = covariates[sensor]
    times = row_times(covariates)
    if times is not None and drift.time_constants.any():
        order = np.argsort(times, kind="stable")
        constants, index = np.unique(drift.time_constants, return_inverse=True)
        lagged = first_order_lag(result[order], times[order], constants)
        result[order] = lagged[index, :, np.arange(result.shape[1])].T
    return result


def row_times(covariates: Covariates) -> FloatArray | None:
    """Times (n,) of the rows, min; None where they are no history."""
    times = covariates.get(TIME, np.nan)
    return np.asarray(times, float) if np.ndim(times) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineModel:
    """A machine with all its components known: `axes` that have an equation, `terms` in the order
    of theta, `remainders` what the equations hold but components, `constants` name -> (value,
    u), `effects` what the machine file declares as such.
    """

    name: str
    axes: tuple[str, ...]
    terms: tuple[Term, ...]
    remainders: dict[str, tuple[Node, ...]]
    constants: dict[str, tuple[float, float]] = field(default_factory=dict)
    joint: tuple[JointPasses, ...] = ()
    effects: tuple[Effect, ...] = ()
    file: str | None = None

    @property
    def columns(self) -> tuple[slice, ...]:
        """Of each term among all coefficients."""
        ends = np.cumsum([len(term.estimate.coefficients) for term in self.terms]).tolist()
        return tuple(slice(start, end) for start, end in pairwise([0, *ends]))

    def covariates(self) -> tuple[str, ...]:
        """Names that the equations use except positions, constants and components."""
        sensors = {sensor for drift in self.drifts() for sensor in drift.sensors}
        used = sensors.union(*map(self.names_in, self.axes))
        return tuple(sorted(used - {*AXES, *self.constants}))

    def names_in(self, axis: str) -> set[str]:
        """Names that the lever arms and the remainder of an equation use."""
        nodes = [term.levers[axis] for term in self.terms if axis in term.levers]
        return {name for node in (*nodes, *self.remainders[axis]) for name in names(node)}

    def drifts(self) -> tuple[ThermalEstimate, ...]:
        """The thermal models among the terms."""
        return tuple(term.drift for term in self.terms if term.drift is not None)

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
    parameters, tables, of_effects = effects_of(machine, estimates.effects)
    parts: list[Part] = [(machine.forms, {})]
    parts += zip(machine.effect_forms, map(renames, machine.machine.effects), strict=True)
    by_name = estimates.components | parameters | tables
    levers = _levers(parts)
    terms = [
        Term(estimate=by_name[name], levers=levers[name]) for name in by_name if name in levers
    ]
    _check_terms(machine, terms, [name for name in levers if name not in by_name])
    for name, drift in estimates.thermal.items():
        if levers.get(name):
            terms += drift_terms(drift, levers[name])
    joint = (*estimates.joint, *of_effects)
    return replace(_joined(machine, parts, terms, joint), effects=tuple(machine.machine.effects))


def _joined(
    machine: LoadedMachine,
    parts: Sequence[Part],
    terms: Sequence[Term],
    joint: tuple[JointPasses, ...],
) -> MachineModel:
    constants = machine.machine.constants.items()
    forms = {axis: [form[f"E{axis}"] for form, _ in parts if f"E{axis}" in form] for axis in AXES}
    axes = tuple(axis for axis in AXES if forms[axis])
    return MachineModel(
        name=machine.machine.name,
        axes=axes,
        terms=tuple(terms),
        remainders={
            axis: tuple(form.remainder for form in forms[axis] if form.remainder is not None)
            for axis in axes
        },
        constants={name: (constant.value, constant.u) for name, constant in constants},
        joint=joint,
        file=machine.source.shown,
    )


def effect_alone(machine: LoadedMachine, index: int) -> MachineModel:
    """What one of the machine's effects adds, its parameters as the file states them."""
    effect = machine.machine.effects[index]
    part: Part = (machine.effect_forms[index], renames(effect))
    parameters, tables, of_effects = effects_of(machine, None)
    components, levers = parameters | tables, _levers([part])
    if missing := sorted(levers.keys() - components.keys()):
        reason = f"the effect {effect.name!r} holds {listed(missing)}: it adds nothing by itself"
        raise error("not-applicable", reason=reason)
    terms = [Term(estimate=components[name], levers=arms) for name, arms in levers.items()]
    joint = tuple(x for x in of_effects if set(x.components) <= levers.keys())
    return _joined(machine, [part], terms, joint)


def component_alone(
    name: str, axis: str, estimate: ComponentEstimate | None, drift: ThermalEstimate | None = None
) -> MachineModel:
    """A machine whose only error, along `axis`, is that of one component."""
    lever: dict[str, Node] = {axis: Number(1.0, 0)}
    terms = [] if estimate is None else [Term(estimate=estimate, levers=lever)]
    if drift is not None:
        terms += drift_terms(drift, lever)
    return MachineModel(name=name, axes=(axis,), terms=tuple(terms), remainders={axis: ()})


def _levers(parts: Sequence[Part]) -> dict[str, dict[str, Node]]:
    """Lever arm by component and axis; an effect may hold a component of the equations."""
    levers: dict[str, dict[str, Node]] = {}
    for form, rename in parts:
        for equation, linear in form.items():
            for name, lever in linear.coefficients.items():
                arms = levers.setdefault(rename.get(name, name), {})
                total, axis = arms.get(equation[1:]), equation[1:]
                arms[axis] = lever if total is None else Call("+", (total, lever), lever.column)
    return levers


def _check_terms(machine: LoadedMachine, terms: Sequence[Term], missing: Sequence[str]) -> None:
    """Raises InputError for `missing` components and those of too few readings for a scatter."""
    if not terms and not missing:
        file, reason = machine.source.shown, "no equation contains a component"
        raise error("not-applicable", reason=reason, file=file)
    sources = "readings (--lbb, --laser), coefficients here, or a components report (-c)"
    sources += ", which is read in place of readings; with -m no study is read"
    few, problems = "more readings of it, best in several passes", []
    places = {name: machine.place("components", name) for name in missing}
    if missing := sorted(missing, key=lambda name: places[name]["line"] or 0):
        what, place = f"an estimate of {listed(missing)}", places[missing[0]]
        problems.append(finding("missing-input", what=what, expected=sources, **place))
    for item in (term.estimate for term in terms):
        if not (np.isfinite(item.covariance).all() and np.isfinite(item.s_repeat)):
            place = machine.place("components", item.name)
            what = f"as many readings of {item.name!r} as coefficients"
            problems.append(finding("too-little-data", what=what, expected=few, **place))
    if problems:
        raise InputError(problems)


def missing_covariates(
    model: MachineModel,
    values: Collection[str],
    columns: Collection[str] | None = None,
    *,
    ask: str = "--at {}=VALUE",
    of_sensor: str = "",
    **place: Any,
) -> list[Finding]:
    """A finding of each covariate that the equations need and that has none of the `values`;
    `place` is of the file whose `columns` it should be one of. `ask` is the option that gives it,
    `of_sensor` what else gives a temperature of a drift.
    """
    drifts, problems = sensors_of(model), []
    for name in model.covariates():
        if name in values:
            continue
        expected = ask.format(name) + of_sensor * (name in drifts)
        if columns is not None:
            there = "".join(f" (there is {near!r})" for near in nearest(name, columns))
            place["column"], expected = name, f"a column of this name{there}, or {expected}"
        drift = f"the drift of {listed(drifts.get(name, ()))}"
        owner = drift if name in drifts else f"the machine {model.name!r}"
        facts = {"what": f"a value of {name} for {owner}", "names": [name], "expected": expected}
        problems.append(finding("missing-input", **facts, **place))
    return problems


def sensors_of(model: MachineModel) -> dict[str, tuple[str, ...]]:
    """The components whose drift needs a sensor, by sensor."""
    result: dict[str, tuple[str, ...]] = {}
    for drift in model.drifts():
        for sensor in drift.sensors:
            result[sensor] = (*result.get(sensor, ()), drift.component)
    return result


class Design(NamedTuple):
    """The machine at n points, rows (point, axis), points first: `J` (n*a, K) in theta, `levers`
    (n*a, c) of each term, `remainder` (n*a,) and the errors `mean` = J theta + remainder in mm.
    """

    J: FloatArray
    levers: FloatArray
    remainder: FloatArray
    mean: FloatArray


def places_of(model: MachineModel, points: FloatArray) -> dict[str, FloatArray]:
    """Coordinates (n,) by axis, those that a constant fixes at its value."""
    fixed = model.position_constants()
    return {
        axis: np.full(len(points), fixed[axis]) if axis in fixed else points[:, i]
        for i, axis in enumerate(AXES)
    }


def design(model: MachineModel, points: FloatArray, covariates: Covariates) -> Design:
    """J, lever arms and remainder at `points` (n, 3) in mm (nan where a coordinate is unknown).

    Row (i, axis) holds dE_axis/dtheta at point i: lever arm times powers of the component's
    position. Gilsinn & Ling 2004, eq. (1), or any other set of linear equations.

    Raises InputError where a needed coordinate is unknown or a value is not finite.
    """
    place, n, a = places_of(model, points), len(points), len(model.axes)
    values: dict[str, FloatArray | float] = {name: c for name, (c, _) in model.constants.items()}
    values |= place
    values |= {name: covariates[name] for name in model.covariates()}
    columns = model.columns
    J, levers = np.zeros((n, a, columns[-1].stop)), np.zeros((n, a, len(columns)))
    for t, term in enumerate(model.terms):
        rows = term.columns(place, covariates, n)
        for i, axis in enumerate(model.axes):
            if axis in term.levers:
                levers[:, i, t] = evaluate(term.levers[axis], values)
                # An infinite lever arm is reported below, in words.
                with np.errstate(invalid="ignore"):
                    J[:, i, columns[t]] = levers[:, i, t, None] * rows
    remainder = np.zeros((n, a))
    for i, axis in enumerate(model.axes):
        for node in model.remainders[axis]:
            remainder[:, i] += evaluate(node, values)
    with np.errstate(invalid="ignore"):
        beyond = ~(np.abs(J) < LARGEST)
        bad = beyond.any(axis=2) | ~(np.abs(remainder) < LARGEST)
    for i, k in np.argwhere(bad)[:1]:
        # The first equation and point without a finite value, or its effect.
        owners = [term.estimate.name for term in model.terms for _ in term.estimate.coefficients]
        first = owners[int(np.argmax(beyond[i, k]))] if beyond[i, k].any() else ""
        effect = first.rpartition(EFFECT_MARK)[0]
        path = f"effects.{effect}" if effect else f"equations.E{model.axes[k]}"
        problem = _not_finite(model, model.axes[k], points[i])
        raise InputError(replace(problem, file=model.file, path=path))
    flat, rest = J.reshape(n * a, -1), remainder.reshape(n * a)
    return Design(flat, levers.reshape(n * a, -1), rest, flat @ theta(model) + rest)


def coordinates_of(model: MachineModel, axis: str) -> tuple[str, ...]:
    """The coordinates that the equation of an axis is of, without those that a constant fixes."""
    used = model.names_in(axis) | {x.estimate.of for x in model.terms if axis in x.levers}
    return tuple(name for name in AXES if name in used and name not in model.constants)


def _not_finite(model: MachineModel, axis: str, point: FloatArray) -> Finding:
    """The finding of the equation of an axis that has no value at `point` (3,), mm."""
    at = {name: point[AXES.index(name)] for name in coordinates_of(model, axis)}
    coordinates = [f"{name}={value:g}" for name, value in at.items() if not np.isnan(value)]
    where = f" at {', '.join(coordinates)}" if coordinates else ""
    expected = "an equation that is defined at every feature (no division by 0, no root or "
    expected += "logarithm of a negative number, no exponential of millimetres)"
    if unknown := [name for name, value in at.items() if np.isnan(value)]:
        where += f" without a {unknown[0]}"
        expected = f"{unknown[0]}_mm in the part or nominal_{unknown[0]}_mm of the points, or a "
        expected += "constant of the machine"
    what = f"the equation E{axis} of {model.name!r}"
    return finding("no-finite-value", what=what, where=where, expected=expected)


def without_coordinate(
    model: MachineModel, points: FloatArray, named: Callable[[int], tuple[str, dict[str, Any]]]
) -> Finding | None:
    """That some of `points` (n, 3) lack a coordinate that an equation needs; None where none does.
    `named` gives the feature of a point, and its place in a file.
    """
    for axis in model.axes:
        columns = [AXES.index(name) for name in coordinates_of(model, axis)]
        lacking = np.flatnonzero(np.isnan(points[:, columns]).any(axis=1))
        if len(lacking):
            name, place = named(int(lacking[0]))
            problem = _not_finite(model, axis, points[lacking[0]])
            rest = f" (and {len(lacking) - 1} more)" if len(lacking) > 1 else ""
            where = f"{problem.facts['where']}, of feature {name!r}{rest}"
            return replace(problem, facts={**problem.facts, "where": where}, **place)
    return None


def theta(model: MachineModel) -> FloatArray:
    """The coefficients of all terms, one after the other, (K,)."""
    return np.concatenate([term.estimate.coefficients for term in model.terms])
