"""A virtual machine: readings of its components, points of the parts that it makes, and drift tests
with their climate.

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
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.geometry import GeometryError, fit_circle
from mtu_cli.model.machine_model import (
    AXES,
    Design,
    MachineModel,
    design,
    missing_covariates,
    theta,
)
from mtu_cli.model.prediction import component_blocks
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root, drawable_passes
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

READINGS_STREAM, PARTS_STREAM, CMM_STREAM, SCATTER_STREAM, OTHER_AXES_STREAM = 0, 1, 2, 3, 8
"""Further ones: 4 of the climate, 6 of drifts."""
LARGEST_MM = 1e6
"""No machine is a kilometre long."""
Equations = tuple[tuple[str, Node], ...]
Columns = dict[str, np.ndarray]
"""Of a CSV of the contract, by their names there; directions are 1, -1 or 0 (not stated)."""


def pass_root(model: MachineModel) -> FloatArray:
    """F (K, K), F F' the pass-to-pass covariance of all coefficients, in the order of theta,
    without the negative part that an estimate of D may have (`drawable_passes`).
    """
    K = model.columns[-1].stop
    # Seen from the coefficients themselves.
    blocks = component_blocks(model, np.eye(K), np.zeros((K, len(model.terms))))
    roots = [x.G @ covariance_root(drawable_passes(x.D, x.C)) @ x.G.T for x in blocks]
    return np.asarray(np.sum(roots, axis=0))


def simulate_readings(
    model: MachineModel,
    seed: int,
    *,
    passes: int,
    directions: tuple[int, ...],
    positions: Mapping[str, FloatArray],
    only: str | None = None,
) -> Columns:
    """Readings of every component, or of `only` one, in `passes` in each of the `directions` at the
    `positions` (mm) of its axis: its polynomial, a draw of D a pass, jointly for components with
    shared passes, s_repeat a reading. A component without an axis is read once a pass, forward
    only; the parameters of declared effects have no readings. Errors are in each component's unit.
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
    rows: list[tuple[str, float, int, int, float, str]] = []
    for estimate, runs, noise, at in zip(estimates, places, drawn, model.columns, strict=True):
        if EFFECT_MARK in estimate.name or only not in (None, estimate.name):
            continue
        for number, i in np.ndindex(passes, len(runs)):
            sign, where = runs[i]
            b = estimate.coefficients + deviations[number, i, at]
            values = estimate.shape.columns(where) @ b + estimate.s_repeat * noise[number, i]
            rows += [
                (estimate.name, float(p), number + 1, sign, float(e), estimate.unit.name)
                for p, e in zip(where, values / estimate.unit.to_internal, strict=True)
            ]
    names = ("component", "position_mm", "pass", "direction", "error", "unit")
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


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
) -> Columns:
    """CMM points of `plan.parts` parts with features `ids` at `points` (n, 3), mm, with sequence,
    time, directions and any declared covariates. A part has one draw of every component's D,
    jointly for shared passes, and of its offset, a feature one of every component's s_repeat, a
    repeat one of the CMM's.

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
    coordinates = np.concatenate([x.reshape(-1, len(axes)) for x in measured])
    operation = {} if plan.operation is None else {"operation": [plan.operation] * len(coordinates)}
    columns = {
        "part": [str(part.number) for part, r in each for _ in range(r * n)],
        "feature": [*ids] * sum(repeats),
        "repeat": np.concatenate([np.repeat(np.arange(1, r + 1), n) for r in repeats]),
        **operation,
        **{f"{axis}_mm": values for axis, values in zip(axes, coordinates.T, strict=True)},
    }
    for name in parts[0].values:
        columns[name] = np.concatenate([np.tile(part.values[name], r) for part, r in each])
    return {name: np.asarray(values) for name, values in columns.items()}


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


def grown(
    simulated: Columns, ids: Sequence[str], points: FloatArray, circles: Sequence[Circle]
) -> Columns:
    """The points with the circles as large as calibrated: p - c grows by D(T)/D0 - 1, with c the
    centre and D0 the diameter of the circle through the nominal features `ids` at `points`
    (features, 3), mm; D(T) is linear between calibrated temperatures, beyond them constant. A
    circle whose temperature is no covariate stays nominal.

    Raises InputError for features that do not determine their circle.
    """
    code = np.array([ids.index(name) for name in simulated["feature"]])
    shift = np.zeros((len(code), len(AXES)))
    for circle in circles:
        if circle.calibrated_mm is None or circle.temperature not in simulated:
            continue
        ring_ids = [ids.index(name) for name in circle.features]
        try:
            ring = fit_circle(points[ring_ids])
        except GeometryError as fault:
            what = f"no circle goes through the nominal points of {circle.id!r}: {fault}"
            raise error("too-little-data", what=what) from None
        table = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(simulated[circle.temperature], table[:, 0], table[:, 1])
        rows = np.isin(code, ring_ids)
        away = points[code] - ring.centre
        shift[rows] = (away * (diameter / (2.0 * ring.radius) - 1.0)[:, None])[rows]
    moved = {f"{axis}_mm": shift[:, k] for k, axis in enumerate(AXES)}
    return {name: x + moved[name] if name in moved else x for name, x in simulated.items()}


WOBBLE_MEMORY_MIN = 15.0
"""Correlation time of draughts and of the air conditioning's swings."""
_CLIMATE_STREAM, _DRIFT_STREAM = 4, 6
_REACHED = 1e-6
"""Share of a requested drift that the sensors' shares may miss it by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftPlan:
    """A drift test: temperatures in degC, times in min.

    The room goes from `low` to `high` and back with the lag `room_lag`; on top of it `room_wobble`
    for all and `sensor_wobble` for each sensor, standard deviations of Ornstein-Uhlenbeck
    processes. Sensors follow with lags spread over `sensor_lag` (lowest, highest; evenly in the
    logarithm), with shares of the room's rise of 1 +- `sensor_spread`, and read with the standard
    deviation `sensor_noise`. While parts are measured the room is settled, with draughts of the
    standard deviation `parts_wobble` at each sensor.

    `cycles` warm-ups and cool-downs in turn, read every `interval` for `minutes`, then `soak`
    without readings; each component at its `positions` (mm, by name; nan where it has no axis).
    `noise` is a reading's standard deviation by dimension of the unit, mm and rad. `settled` (mm or
    rad, by component) are the drifts at the positions once the room has settled at `high`. `twins`
    (name, sensor): a second sensor at the same place, with independent noise.
    """

    reference: float
    low: float = 20.0
    high: float = 26.0
    room_lag: float = 30.0
    room_wobble: float = 0.5
    sensor_lag: tuple[float, float] = (5.0, 25.0)
    sensor_spread: float = 0.05
    sensor_wobble: float = 0.8
    sensor_noise: float
    parts_wobble: float = 0.1
    cycles: int
    minutes: float = 190.0
    interval: float
    soak: float = 120.0
    positions: Mapping[str, FloatArray]
    noise: Mapping[int, float]
    settled: Mapping[str, FloatArray]
    twins: tuple[tuple[str, str], ...] = ()

    @property
    def moments(self) -> int:
        """Readings of one place in one cycle."""
        return int(np.floor(self.minutes / self.interval * (1 + 1e-12))) + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Names, lags (s,) in min and shares (s,) of the room's rise above the reference."""

    names: tuple[str, ...]
    lags: FloatArray
    shares: FloatArray


def followed(plan: DriftPlan, sensors: Sensors, targets: FloatArray, seed: int) -> FloatArray:
    """Noise-free temperatures (n, s) every interval while the room is driven to `targets` (n,);
    room and sensors start settled at the reference.
    """
    n, reference, step = len(targets), plan.reference, plan.interval
    times = np.arange(n, dtype=np.float64) * step
    q = np.exp(-step / WOBBLE_MEMORY_MIN)

    def lagged(signal: FloatArray, lag: float) -> FloatArray:
        return first_order_lag(signal[:, None], times, np.array([lag]))[0, :, 0]

    def wobble(deviation: float, *place: int) -> FloatArray:
        """An Ornstein-Uhlenbeck process from 0: w_i = q w_(i-1) + sqrt(1 - q^2) deviation z_i."""
        z = stream(seed, _CLIMATE_STREAM, *place).standard_normal(max(n - 1, 0))
        values = [0.0]
        for kick in (deviation * np.sqrt(1.0 - q * q) * z).tolist():
            values.append(q * values[-1] + kick)
        return np.array(values)

    driven = lagged(np.concatenate([[reference], targets[1:]]), plan.room_lag)
    room = driven + wobble(plan.room_wobble, 1)
    air = [
        reference + share * (room - reference) + wobble(plan.sensor_wobble, 2, s)
        for s, share in enumerate(sensors.shares)
    ]
    return np.column_stack([lagged(T, lag) for T, lag in zip(air, sensors.lags, strict=True)])


def settled(plan: DriftPlan, sensors: Sensors, rooms: FloatArray, seed: int) -> FloatArray:
    """Noise-free temperatures (r, s) with the room settled at each of `rooms`, degC, each with
    independent draughts.
    """
    draughts = np.empty((len(rooms), len(sensors.names)))
    for r, s in np.ndindex(draughts.shape):
        draughts[r, s] = stream(seed, _CLIMATE_STREAM, 3, r, s).standard_normal()
    rise = sensors.shares * (rooms[:, None] - plan.reference)
    return plan.reference + rise + plan.parts_wobble * draughts


def as_read(
    plan: DriftPlan, sensors: Sensors, true: Mapping[str, FloatArray], seed: int, part: int = 0
) -> dict[str, FloatArray]:
    """What the sensors read: the true temperatures, twins included, each with its own noise."""
    places = {name: name for name in sensors.names} | dict(plan.twins)
    return {
        name: true[place]
        + plan.sensor_noise
        * stream(seed, _CLIMATE_STREAM, 5, part, c).standard_normal(len(true[place]))
        for c, (name, place) in enumerate(places.items())
    }


def sensors_for(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> Sensors:
    """The sensors of all drifts; shares moved as little as the requested drifts ask for: with the
    seeded shares a0, gradients G (places, s) and rise R = high - reference the settled drifts are
    R G a. The requested ones are d for a = a0 + G^+ (d/R - G a0), the solution nearest to a0.

    Raises InputError where the sensors cannot give the requested drifts.
    """
    names = tuple(sorted({sensor for drift in drifts for sensor in drift.sensors}))
    draws = np.array([stream(seed, _CLIMATE_STREAM, 0, s).random(2) for s in range(len(names))])
    low, high = plan.sensor_lag
    lags = low + (high - low) * draws[:, 0] if low <= 0 else low * (high / low) ** draws[:, 0]
    a0 = shares = 1.0 + plan.sensor_spread * (2.0 * draws[:, 1] - 1.0)
    rise = plan.high - plan.reference

    def gradients(drift: ThermalEstimate) -> FloatArray:
        """G (places, s) in the drift's unit per degC."""
        positions = plan.positions[drift.component]
        place = np.zeros(len(positions)) if drift.degree == 0 else positions
        G = np.zeros((len(positions), len(names)))
        G[:, [names.index(sensor) for sensor in drift.sensors]] = drift.gradients(place).T
        return G / drift.unit.to_internal

    requested = [drift for drift in drifts if drift.component in plan.settled]
    targets = [plan.settled[drift.component] / drift.unit.to_internal for drift in requested]
    if requested and rise != 0:
        G, d = np.vstack([gradients(drift) for drift in requested]), np.concatenate(targets)
        shares = a0 + np.linalg.pinv(G) @ (d / rise - G @ a0)
    for drift, target in zip(requested, targets, strict=True):
        reached = rise * gradients(drift) @ shares
        if np.abs(reached - target).max() > _REACHED * max(1.0, float(np.abs(target).max())):
            asked, near = (" ".join(f"{x:.4g}" for x in y) for y in (target, reached))
            raise error(
                "not-applicable",
                reason=f"--settled-drift: no shares of the sensors in the rise of {rise:.4g} degC "
                f"give {drift.component} the settled drift",
                value=f"{drift.component}: {asked}",
                expected=f"about {near} {drift.unit.name} (nearest to all that is asked): drifts "
                "differ only where the gradients of the sensors do",
            )
    return Sensors(names=names, lags=lags, shares=shares)


def simulate_drift(
    drifts: Sequence[ThermalEstimate], plan: DriftPlan, sensors: Sensors, seed: int
) -> Columns:
    """Readings of every component that drifts, cycle by cycle: warm-ups first, in turn. Errors are
    in each component's unit, temperatures in degC as read.
    """
    period = plan.moments + round(plan.soak / plan.interval)
    cool = np.repeat(np.arange(plan.cycles) % 2, period)
    targets = np.where(cool, plan.low, plan.high)
    true = followed(plan, sensors, targets, seed)
    count = len(true)
    times = np.arange(count, dtype=np.float64) * plan.interval
    read = as_read(plan, sensors, dict(zip(sensors.names, true.T, strict=True)), seed)
    at = (np.arange(count) % period < plan.moments).nonzero()[0].reshape(plan.cycles, -1)
    rows: list[tuple[str, str, float]] = []
    errors: list[FloatArray] = []
    for number, item in enumerate(drifts):
        # A drift follows a sensor's temperature, or its lag.
        columns = true[:, [sensors.names.index(sensor) for sensor in item.sensors]]
        lagged = first_order_lag(columns, times, item.time_constants).diagonal(axis1=0, axis2=2)
        temperatures = dict(zip(item.sensors, lagged.T, strict=True))
        # The leftover, one draw a cycle, and the noise of every reading.
        shape = plan.cycles, len(item.leftover)
        draws = stream(seed, _DRIFT_STREAM, 0, number).standard_normal(shape)
        noise = plan.noise[item.unit.dimension]
        for p, position in enumerate(plan.positions[item.component]):
            place = np.nan_to_num(position)
            root = place ** np.arange(shape[1]) @ covariance_root(item.leftover)
            error = item.drift(np.full(count, place), temperatures)
            error = error + (draws @ root)[np.arange(count) // period]
            error += noise * stream(seed, _DRIFT_STREAM, 1, number, p).standard_normal(count)
            rows.append((item.component, item.unit.name, position))
            errors.append((error / item.unit.to_internal)[at])
    table = np.stack(errors, axis=1)
    components, units, positions = (np.array(each) for each in zip(*rows, strict=True))

    def spread(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, table.shape).ravel()

    return {
        "component": spread(components[:, None]),
        "position_mm": spread(positions[:, None]),
        "cycle": spread(np.arange(plan.cycles)[:, None, None] + 1),
        "time_min": spread(times[at][:, None]),
        "error": table.ravel(),
        "unit": spread(units[:, None]),
        **{name: spread(values[at][:, None]) for name, values in read.items()},
    }
