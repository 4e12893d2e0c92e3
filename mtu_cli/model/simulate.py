"""A virtual machine: readings of its components, and points of the parts that it makes.

Every random quantity has its own stream: more parts do not change the readings, nor more repeats
the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.files.headers import LARGEST_READING
from mtu_cli.files.part import Circle
from mtu_cli.findings import InputError, error
from mtu_cli.language import Node, check_known, evaluate
from mtu_cli.language import names as names_of
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.geometry import GeometryError, fit_circle
from mtu_cli.model.machine_model import (
    AXES,
    Design,
    MachineModel,
    design,
    missing_covariates,
    theta,
)
from mtu_cli.model.variance import component_blocks, drawable_passes
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.least_squares import FloatArray

READINGS_STREAM, PARTS_STREAM, CMM_STREAM, SCATTER_STREAM, OTHER_AXES_STREAM = 0, 1, 2, 3, 8
"""Further ones: 4 of the climate, 6 of drifts."""
LARGEST_MM = 1e6
"""No machine is a kilometre long."""
Equations = tuple[tuple[str, Node], ...]


def pass_root(model: MachineModel) -> FloatArray:
    """F (K, K), F F' the pass-to-pass covariance of all coefficients, in the order of theta,
    without the negative part that an estimate of D may have (`variance.drawable_passes`).

    Raises InputError for passes whose covariance is unknown.
    """
    columns = model.columns
    K = columns[-1].stop
    result, every = np.zeros((K, K)), np.arange(K)
    place = {term.estimate.name: every[at] for term, at in zip(model.terms, columns, strict=True)}
    for block in component_blocks(model, np.zeros((0, K)), np.zeros((0, len(columns)))):
        if not np.isfinite(block.D).all():
            raise error(
                "too-little-data",
                what="the readings do not determine it",
                path=f"the pass-to-pass covariance of {block.names[0]}",
                expected="a report of readings in several passes",
            )
        index = np.concatenate([place[name] for name in block.names])
        result[np.ix_(index, index)] = covariance_root(drawable_passes(block.D, block.C))
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedReadings:
    """Columns of a readings file; `error` in each component's own unit."""

    component: tuple[str, ...]
    unit: tuple[str, ...]
    position: FloatArray
    pass_number: np.ndarray
    direction: np.ndarray
    error: FloatArray


def simulate_readings(
    model: MachineModel,
    seed: int,
    *,
    passes: int,
    directions: tuple[int, ...],
    positions: Mapping[str, FloatArray],
    only: str | None = None,
) -> SimulatedReadings:
    """Readings of every component, or of `only` one, in `passes` in each of the `directions` at the
    `positions` (mm) of its axis: its polynomial, a draw of D a pass, jointly for components with
    shared passes, s_repeat a reading. A component without an axis is read once a pass, forward
    only; the parameters of declared effects have no readings.
    """
    estimates = [term.estimate for term in model.terms]
    # Direction and positions of each run through them in a pass.
    places = [
        [(0, np.zeros(1))]
        if estimate.of is None
        else [(sign, positions[estimate.of][::sign]) for sign in directions]
        for estimate in estimates
    ]
    # Of coefficients (passes, directions, k), and of readings (passes, directions, n); a component
    # without an axis is read in the first direction alone.
    each = max(len(runs) for runs in places)
    drawn, normal = [], []
    for c, (estimate, runs) in enumerate(zip(estimates, places, strict=True)):
        k, size = len(estimate.coefficients), (passes, len(runs))
        draws = stream(seed, READINGS_STREAM, c).standard_normal((*size, k + len(runs[0][1])))
        drawn.append(draws[..., k:])
        normal.append(np.broadcast_to(draws[..., :k], (passes, each, k)))
    deviations = np.concatenate(normal, axis=-1) @ pass_root(model).T
    rows: list[tuple[str, str, float, int, int, float]] = []
    for estimate, runs, noise, at in zip(estimates, places, drawn, model.columns, strict=True):
        if EFFECT_MARK in estimate.name or only not in (None, estimate.name):
            continue
        for number, i in np.ndindex(passes, len(runs)):
            sign, where = runs[i]
            b = estimate.coefficients + deviations[number, i, at]
            values = estimate.shape.columns(where) @ b + estimate.s_repeat * noise[number, i]
            rows += [
                (estimate.name, estimate.unit.name, float(p), number + 1, sign, float(e))
                for p, e in zip(where, values / estimate.unit.to_internal, strict=True)
            ]
    component, unit, position, number_, direction, errors = zip(*rows, strict=True)
    return SimulatedReadings(
        component=component,
        unit=unit,
        position=np.array(position),
        pass_number=np.array(number_),
        direction=np.array(direction),
        error=np.array(errors),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsPlan:
    """How parts are made and measured: `repeats` CMM measurements a feature with standard
    uncertainty `cmm_u` (mm) or, of the first parts, `first_repeats` = (parts, repeats); `scatter`
    (axis, equation) a random error of that standard deviation (mm) of each feature; `part_offset`
    (mm) that of a random offset of every part. Features are machined in the part's order, every
    `reverse_every`-th part in the opposite one (0: never), each taking `minutes`. `effects` are
    (axis, equation in mm), `covariates` (name, equation), `given` columns (parts, features) such as
    temperatures.
    """

    parts: int
    repeats: int
    cmm_u: float
    reverse_every: int
    minutes: float
    part_offset: float = 0.0
    first_repeats: tuple[int, int] = (0, 0)
    scatter: Equations = ()
    operation: str | None = None
    effects: Equations = ()
    covariates: Equations = ()
    given: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedPoints:
    """Columns of a points file, one row per (part, feature, repeat): `measured` (n, axes) in mm;
    `covariates` hold sequence, time, directions and any declared.
    """

    axes: tuple[str, ...]
    operation: str | None
    part: tuple[str, ...]
    feature: tuple[str, ...]
    repeat: np.ndarray
    measured: FloatArray
    covariates: dict[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One part, counted from 1: features `ids` (n,) at `points` (n, 3) mm under `values` (n,)."""

    number: int
    ids: Sequence[str]
    points: FloatArray
    values: Mapping[str, FloatArray]

    def evaluated(self, option: str, node: Node, least: float, most: float) -> FloatArray:
        """Values (n,) of an equation, an error or a standard deviation in mm, or a covariate.

        Raises InputError for an unknown name, and for a value that no points file could hold.
        """
        values = {axis: self.points[:, k] for k, axis in enumerate(AXES)} | dict(self.values)
        try:
            check_known(node, values)
        except InputError as fault:
            raise InputError(each.at(path=option) for each in fault.findings) from None
        result = np.array(np.broadcast_to(np.asarray(evaluate(node, values), float), len(self.ids)))
        faulty = ~((least <= result) & (result <= most))
        if not faulty.any():
            return result
        i = int(np.argmax(faulty))
        where = f"in part {self.number} at feature {self.ids[i]!r}"
        if np.isfinite(result[i]):
            unit = " mm" if most == LARGEST_MM else ""
            size = f"{'0 to' if least == 0 else 'at most'} {most:g}{unit}"
            facts = {"path": f"{option} {where}", "value": f"{result[i]:g}"}
            raise error("out-of-range", **facts, expected=size + " in size" * (least < 0))
        at = ", ".join(f"{name} = {values[name][i]:g}" for name in names_of(node))
        expected = "an equation that has one at every feature"
        what = {"what": "the equation", "where": f" at {at} {where}", "expected": expected}
        raise error("no-finite-value", path=option, **what)


def _parts(ids: Sequence[str], points: FloatArray, plan: PartsPlan) -> list[Part]:
    """Sequence, time and approach directions of every part's features, and the declared ones."""
    n, result = len(points), []
    for part in range(plan.parts):
        backward = plan.reverse_every > 0 and (part + 1) % plan.reverse_every == 0
        order = np.arange(n)[:: -1 if backward else 1]
        values = {"sequence": np.full(n, part + 1.0), "time_min": np.empty(n)}
        values["time_min"][order] = (part * n + np.arange(n)) * plan.minutes
        for k, axis in enumerate(AXES):
            if np.isfinite(points[:, k]).all() and np.ptp(points[:, k]) > 0:
                # The sign of the last move along an axis; the first is positive.
                moves = np.r_[1.0, np.sign(np.diff(points[order, k]))]
                last = np.maximum.accumulate(np.where(moves != 0, np.arange(n), 0))
                values[f"dir_{axis}"] = np.empty(n)
                values[f"dir_{axis}"][order] = moves[last]
        values |= {name: columns[part] for name, columns in plan.given.items()}
        result.append(Part(number=part + 1, ids=ids, points=points, values=values))
        for name, node in plan.covariates:
            # One may use those before it.
            option, most = f"--covariate {name}", LARGEST_READING
            values[name] = result[-1].evaluated(option, node, -most, most)
    return result


def simulate_points(
    model: MachineModel, ids: Sequence[str], points: FloatArray, plan: PartsPlan, seed: int
) -> SimulatedPoints:
    """CMM points of `plan.parts` parts with features `ids` at `points` (n, 3), mm. A part has one
    draw of every component's D, jointly for shared passes, and of its offset, a feature one of
    every component's s_repeat, a repeat one of the CMM's.

    Raises InputError for an equation that uses an unknown name, or has no value or one out of range
    at a feature; for a covariate of the machine without a value; for a place that the part does not
    state.
    """
    parts = _parts(ids, points, plan)
    ask, rooms = "--covariate '{}: EQUATION'", ", or --cmm-room DEGC"
    if missing := missing_covariates(model, parts[0].values, ask=ask, of_sensor=rooms):
        raise InputError(missing)
    root, n, axes = pass_root(model), len(ids), _written(model)
    for i, k in np.argwhere(np.isnan(points[:, [AXES.index(axis) for axis in axes]]))[:1]:
        key, path = f"{axes[k]}_mm", f"features.{ids[i]}"
        raise error("missing-key", key=key, path=path, expected=f"{key} of every feature")
    # Without covariates in the equations one design, of the places, holds for every part.
    fixed = None if model.covariates() else design(model, points, {})
    measured = [
        _measured(model, plan, part, seed, fixed or design(model, points, part.values), root)
        for part in parts
    ]
    repeats = [len(x) for x in measured]
    each = list(zip(parts, repeats, strict=True))
    return SimulatedPoints(
        axes=axes,
        operation=plan.operation,
        part=tuple(str(part.number) for part, r in each for _ in range(r * n)),
        feature=tuple(ids) * sum(repeats),
        repeat=np.concatenate([np.repeat(np.arange(1, r + 1), n) for r in repeats]),
        measured=np.concatenate([x.reshape(-1, len(axes)) for x in measured]),
        covariates={
            name: np.concatenate([np.tile(part.values[name], r) for part, r in each])
            for name in parts[0].values
        },
    )


def _measured(
    model: MachineModel, plan: PartsPlan, part: Part, seed: int, rows: Design, root: FloatArray
) -> FloatArray:
    """Measured coordinates (repeats, n, axes) of one part's features, mm, by their design."""
    (first, more), index = plan.first_repeats, part.number - 1
    n, a, repeats = len(part.ids), len(model.axes), more if index < first else plan.repeats
    rng = stream(seed, PARTS_STREAM, index)
    noise, levers, normal = np.zeros((n, a)), rows.levers.reshape(n, a, -1), []
    for t, term in enumerate(model.terms):
        normal.append(rng.standard_normal(len(term.estimate.coefficients)))
        scatter = rng.standard_normal(n) * term.estimate.s_repeat
        noise += levers[:, :, t] * scatter[:, None]
    state = theta(model) + root @ np.concatenate(normal)
    errors: FloatArray = (rows.J @ state + rows.remainder).reshape(n, a) + noise
    errors += plan.part_offset * rng.standard_normal(a)

    def summed(option: str, equations: Equations, least: float) -> FloatArray:
        total = np.zeros((n, a))
        for axis, node in equations:
            values = part.evaluated(f"{option} E{axis}", node, least, LARGEST_MM)
            total[:, model.axes.index(axis)] += values
        return total

    errors += summed("--effect", plan.effects, -LARGEST_MM)
    deviations = summed("--scatter", plan.scatter, 0.0)
    errors += deviations * stream(seed, SCATTER_STREAM, index).standard_normal((n, a))
    cmm = stream(seed, CMM_STREAM, index).standard_normal((repeats, n, a)) * plan.cmm_u
    axes = _written(model)
    measured = np.tile(part.points[:, [AXES.index(axis) for axis in axes]], (repeats, 1, 1))
    measured[:, :, [axes.index(axis) for axis in model.axes]] += errors + cmm
    rest = [i for i, axis in enumerate(axes) if axis not in model.axes]
    of_rest = stream(seed, OTHER_AXES_STREAM, index).standard_normal((repeats, n, len(rest)))
    measured[:, :, rest] += plan.cmm_u * of_rest
    return measured


def _written(model: MachineModel) -> tuple[str, ...]:
    """Coordinates of a points file: x, y, and those that the machine has an equation for."""
    return tuple(axis for axis in AXES if axis in {"x", "y", *model.axes})


def growth(
    simulated: SimulatedPoints, ids: Sequence[str], points: FloatArray, circles: Sequence[Circle]
) -> FloatArray:
    """The circles' features minus their nominal places, (n, axes) in mm: p - c grows by
    D(T)/D0 - 1, with c the centre and D0 the diameter of the circle through the nominal features
    `ids` at `points` (features, 3); D(T) is linear between calibrated temperatures, beyond them
    constant. A circle whose temperature is no covariate stays nominal.

    Raises InputError for features that do not determine their circle.
    """
    columns = [AXES.index(axis) for axis in simulated.axes]
    code = np.array([ids.index(name) for name in simulated.feature])
    shift = np.zeros_like(simulated.measured)
    for circle in circles:
        if circle.calibrated_mm is None or circle.temperature not in simulated.covariates:
            continue
        ring_ids = [ids.index(name) for name in circle.features]
        try:
            ring = fit_circle(points[ring_ids])
        except GeometryError as fault:
            what = f"no circle goes through the nominal points of {circle.id!r}: {fault}"
            raise error("too-little-data", what=what) from None
        table = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(simulated.covariates[circle.temperature], table[:, 0], table[:, 1])
        rows = np.isin(code, ring_ids)
        away = (points[code] - ring.centre)[:, columns]
        shift[rows] = (away * (diameter / (2.0 * ring.radius) - 1.0)[:, None])[rows]
    return shift
