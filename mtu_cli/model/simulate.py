"""A virtual machine: readings of its components, points of the parts that it makes, and drift tests
with their climate.

Every random quantity has its own stream: more parts do not change the readings, nor more repeats
the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np

from mtu_cli.files.headers import LARGEST_READING
from mtu_cli.files.part import Circle
from mtu_cli.findings import InputError, error, located, suggestion
from mtu_cli.language import Node, check_known, evaluate
from mtu_cli.language import names as names_of
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.estimates import ComponentEstimate, ThermalEstimate
from mtu_cli.model.geometry import GeometryError, fit_circle
from mtu_cli.model.machine_model import AXES, MachineModel, design, missing_covariates, theta
from mtu_cli.model.prediction import component_blocks
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root, drawable_passes
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag
from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM

READINGS_STREAM, PARTS_STREAM, CMM_STREAM, SCATTER_STREAM = 0, 1, 2, 3
CLIMATE_STREAM, DRIFT_STREAM, OTHER_AXES_STREAM = 4, 6, 8
LARGEST_MM = 1e6
"""No machine is a kilometre long."""
Equations = Mapping[str, Node]
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


def components_read(model: MachineModel, only: str | None = None) -> list[ComponentEstimate]:
    """The components that have readings, or `only` one; parameters of declared effects have none.

    Raises InputError for an unknown one.
    """
    estimates = {x.estimate.name: x.estimate for x in model.terms}
    names = sorted(name for name in estimates if EFFECT_MARK not in name)
    if only is not None and only not in names:
        place = {"path": "--laser-component", "what": "component", "value": only}
        raise error("unknown-name", **place, **suggestion(only, names))
    return [estimates[name] for name in ([only] if only else names)]


def simulate_readings(
    model: MachineModel,
    seed: int,
    passes: int,
    positions: Mapping[str, FloatArray],
    only: str | None = None,
) -> Columns:
    """Readings of every component, or of `only` one, in `passes` in each direction at the
    `positions` (mm) of its axis: its polynomial, a draw of D a pass, jointly for components with
    shared passes, s_repeat a reading. A component without an axis is read once a pass, forward
    only. Errors are in each component's unit.
    """
    estimates = [term.estimate for term in model.terms]
    # Of components that are not read only the draws matter, not where they would be read.
    other = next(iter(positions.values()), np.zeros(1))
    # Draws of readings (passes, directions, n) and of coefficients (passes, directions, k); a
    # component without an axis is read in the first direction alone.
    places, drawn, normal = [], [], []
    for c, estimate in enumerate(estimates):
        where = positions.get(estimate.of or "", other)
        # Direction and positions of each run through them in a pass.
        runs = [(1, where), (-1, where[::-1])] if estimate.of else [(0, np.zeros(1))]
        k, size = len(estimate.coefficients), (passes, len(runs))
        draws = stream(seed, READINGS_STREAM, c).standard_normal((*size, k + len(runs[0][1])))
        places.append(runs)
        drawn.append(draws[..., k:])
        normal.append(np.broadcast_to(draws[..., :k], (passes, 2, k)))
    deviations = np.concatenate(normal, axis=-1) @ pass_root(model).T
    rows: list[tuple[str, float, int, int, float, str]] = []
    read = {estimate.name for estimate in components_read(model, only)}
    for estimate, runs, noise, at in zip(estimates, places, drawn, model.columns, strict=True):
        if estimate.name not in read:
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
    uncertainty `cmm_u_um` or, of the first parts, `first_repeats` = (parts, repeats). Features are
    machined in the part's order, every `reverse_every`-th part in the opposite one (0: never), each
    taking `minutes`. Equations: by error (Ex), in mm, `effects` and the standard deviation of a
    random error of each feature, `scatter`; by name `covariates`. `given` are further ones by name,
    values (parts,) such as temperatures.
    """

    parts: int
    repeats: int
    cmm_u_um: float
    reverse_every: int
    minutes: float
    first_repeats: tuple[int, int] = (0, 0)
    scatter: Equations = field(default_factory=dict)
    operation: str | None = None
    effects: Equations = field(default_factory=dict)
    covariates: Equations = field(default_factory=dict)
    given: Mapping[str, FloatArray] = field(default_factory=dict)


def _evaluated(
    option: str, node: Node, values: Columns, ids: Sequence[str], least: float, most: float
) -> FloatArray:
    """An error or a standard deviation in mm, or a covariate (parts, features), by its equation.

    Raises InputError for an unknown name, and for a value that no points file could hold.
    """
    with located(path=option):
        check_known(node, values)
    result = np.broadcast_to(np.asarray(evaluate(node, values), float), values["x"].shape)
    faulty = ~((least <= result) & (result <= most))
    if not faulty.any():
        return result
    part, i = np.argwhere(faulty)[0]
    where = f"in part {part + 1} at feature {ids[i]!r}"
    if np.isfinite(result[part, i]):
        unit = " mm" if most == LARGEST_MM else ""
        size = f"{'0 to' if least == 0 else 'at most'} {most:g}{unit}"
        facts = {"path": f"{option} {where}", "value": f"{result[part, i]:g}"}
        raise error("out-of-range", **facts, expected=size + " in size" * (least < 0))
    at = ", ".join(f"{name} = {values[name][part, i]:g}" for name in names_of(node))
    expected = "an equation that has one at every feature"
    what = {"what": "the equation", "where": f" at {at} {where}", "expected": expected}
    raise error("no-finite-value", path=option, **what)


def _places_and_covariates(ids: Sequence[str], points: FloatArray, plan: PartsPlan) -> Columns:
    """Nominal x, y, z, sequence, time, approach directions, and covariates (parts, features)."""
    part, step = np.indices((plan.parts, len(points)))
    # The feature that is machined in a step, which is the step of a feature, too.
    backward = (part + 1) % plan.reverse_every == 0 if plan.reverse_every else part < 0
    order = np.where(backward, step[:, ::-1], step)
    values: Columns = {x: np.broadcast_to(points[:, k], step.shape) for k, x in enumerate(AXES)}
    values |= {"sequence": part + 1.0, "time_min": (part * len(points) + order) * plan.minutes}
    for axis in AXES:
        if np.isfinite(values[axis]).all() and np.ptp(values[axis]) > 0:
            # The sign of the last move along an axis; the first is positive.
            moves = np.sign(np.diff(values[axis][part, order], prepend=-np.inf))
            last = np.maximum.accumulate(np.where(moves != 0, step, 0), axis=1)
            values[f"dir_{axis}"] = moves[part, last][part, order]
    values |= {name: np.broadcast_to(x[:, None], step.shape) for name, x in plan.given.items()}
    for name, node in plan.covariates.items():
        # One may use those before it.
        option, most = f"--covariate {name}", LARGEST_READING
        values[name] = _evaluated(option, node, values, ids, -most, most)
    return values


def _machined(
    model: MachineModel, ids: Sequence[str], values: Columns, plan: PartsPlan, seed: int
) -> FloatArray:
    """Errors (parts, features, axes) of the features, mm, under the `values` of each."""

    def summed(option: str, equations: Equations, least: float) -> FloatArray:
        total = np.zeros((plan.parts, len(ids), len(model.axes)))
        for name, node in equations.items():
            each = _evaluated(f"{option} {name}", node, values, ids, least, LARGEST_MM)
            total[:, :, model.axes.index(name[1:])] += each
        return total

    effects = summed("--effect", plan.effects, -LARGEST_MM)
    deviations = summed("--scatter", plan.scatter, 0.0)
    root, errors = pass_root(model), np.zeros(effects.shape)
    # Without covariates in the equations one design, of the places, holds for every part.
    covariates = model.covariates()
    for part in range(plan.parts):
        if part == 0 or covariates:
            of_part = {name: x[part] for name, x in values.items()}
            rows = design(model, np.column_stack([of_part[axis] for axis in AXES]), of_part)
            levers = rows.levers.reshape(*errors.shape[1:], -1)
        rng, normal, noise = stream(seed, PARTS_STREAM, part), [], np.zeros(errors.shape[1:])
        for t, term in enumerate(model.terms):
            normal.append(rng.standard_normal(len(term.estimate.coefficients)))
            scatter = rng.standard_normal(len(ids)) * term.estimate.s_repeat
            noise += levers[:, :, t] * scatter[:, None]
        state = theta(model) + root @ np.concatenate(normal)
        errors[part] = (rows.J @ state + rows.remainder).reshape(noise.shape) + noise
        errors[part] += effects[part]
        z = stream(seed, SCATTER_STREAM, part).standard_normal(noise.shape)
        errors[part] += deviations[part] * z
    return errors


def simulate_points(
    model: MachineModel, ids: Sequence[str], points: FloatArray, plan: PartsPlan, seed: int
) -> Columns:
    """CMM points of `plan.parts` parts with features `ids` at `points` (n, 3), mm, with sequence,
    time, directions and any declared covariates. A part has one draw of every component's D,
    jointly for shared passes, a feature one of every component's s_repeat, a repeat one of the
    CMM's.

    Raises InputError for an equation that uses an unknown name, or has no value or one out of range
    at a feature; for a covariate of the machine without a value; for a place that the part does not
    state.
    """
    values = _places_and_covariates(ids, points, plan)
    ask, rooms = "--covariate '{}: EQUATION'", ", or --cmm-room DEGC"
    if missing := missing_covariates(model, values, ask=ask, of_sensor=rooms):
        raise InputError(missing)
    # Coordinates of a points file: x, y, and those that the machine has an equation for.
    axes = [axis for axis in AXES if axis in {"x", "y", *model.axes}]
    for i, k in np.argwhere(np.isnan(points[:, [AXES.index(axis) for axis in axes]]))[:1]:
        key, path = f"{axes[k]}_mm", f"features.{ids[i]}"
        raise error("missing-key", key=key, path=path, expected=f"{key} of every feature")
    errors, measured = _machined(model, ids, values, plan, seed), []
    first, more = plan.first_repeats
    repeats = np.where(np.arange(plan.parts) < first, more, plan.repeats)
    of_model = [AXES.index(axis) for axis in model.axes]
    rest = [AXES.index(axis) for axis in axes if axis not in model.axes]
    n, cmm_u = len(ids), plan.cmm_u_um * UM
    for part, r in enumerate(repeats):
        measured.append(np.tile(points, (r, 1, 1)))
        cmm = stream(seed, CMM_STREAM, part).standard_normal((r, n, len(of_model))) * cmm_u
        measured[part][:, :, of_model] += errors[part] + cmm
        of_rest = stream(seed, OTHER_AXES_STREAM, part).standard_normal((r, n, len(rest)))
        measured[part][:, :, rest] += cmm_u * of_rest
    visits = np.repeat(np.arange(plan.parts), repeats)
    columns = {
        "part": np.repeat(visits + 1, n).astype(str),
        "feature": np.tile(ids, len(visits)),
        "repeat": np.concatenate([np.repeat(np.arange(r) + 1, n) for r in repeats]),
    }
    if plan.operation is not None:
        columns["operation"] = np.full(len(visits) * n, plan.operation)
    coordinates = np.concatenate(measured).reshape(-1, len(AXES))
    columns |= {f"{axis}_mm": coordinates[:, AXES.index(axis)] for axis in axes}
    covariates = {name: x[visits].ravel() for name, x in values.items() if name not in AXES}
    return columns | covariates


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
        try:
            ring = fit_circle(points[[ids.index(name) for name in circle.features]])
        except GeometryError as fault:
            what = f"no circle goes through the nominal points of {circle.id!r}: {fault}"
            raise error("too-little-data", what=what) from None
        table = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(simulated[circle.temperature], table[:, 0], table[:, 1])
        rows = np.isin(simulated["feature"], circle.features)
        away = points[code] - ring.centre
        shift[rows] = (away * (diameter / (2.0 * ring.radius) - 1.0)[:, None])[rows]
    moved = {f"{axis}_mm": shift[:, k] for k, axis in enumerate(AXES)}
    return {name: x + moved[name] if name in moved else x for name, x in simulated.items()}


WOBBLE_MEMORY_MIN = 15.0
"""Correlation time of draughts and of the air conditioning's swings."""
_REACHED = 1e-6
"""Share of a requested drift that the sensors' shares may miss it by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftPlan:
    """A drift test: temperatures in degC, times in min.

    The room goes from `low` to `high` and back with the lag `room_lag`; on top of it `room_wobble`
    for all and `sensor_wobble` for each sensor, standard deviations of Ornstein-Uhlenbeck
    processes. Sensors follow with lags spread over `sensor_lag` (lowest, highest; evenly in the
    logarithm), with shares of the room's rise of 1 +- `sensor_spread`, and read with the standard
    deviation `sensor_noise_degc`. While parts are measured the room is settled, with draughts of
    the standard deviation `parts_wobble` at each sensor.

    `cycles` warm-ups and cool-downs in turn, read every `interval_min` for `minutes`, then `soak`
    without readings; each component at its `positions` (mm, by name; nan where it has no axis). The
    noise is a reading's standard deviation, of lengths and of angles. `settled` (mm or rad, by
    component) are the drifts at the positions once the room has settled at `high`. `twins` are
    second sensors, by name, at the places of others, with independent noise.
    """

    reference: float
    low: float = 20.0
    high: float = 26.0
    room_lag: float = 30.0
    room_wobble: float = 0.5
    sensor_lag: tuple[float, float] = (5.0, 25.0)
    sensor_spread: float = 0.05
    sensor_wobble: float = 0.8
    sensor_noise_degc: float
    parts_wobble: float = 0.1
    cycles: int
    minutes: float = 190.0
    interval_min: float
    soak: float = 120.0
    positions: Mapping[str, FloatArray]
    reading_noise_um: float
    reading_noise_arcsec: float
    settled: Mapping[str, FloatArray]
    twins: Mapping[str, str] = field(default_factory=dict)


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
    n, reference, step = len(targets), plan.reference, plan.interval_min
    times = np.arange(n, dtype=np.float64) * step
    q = np.exp(-step / WOBBLE_MEMORY_MIN)

    def lagged(signal: FloatArray, lag: float) -> FloatArray:
        return first_order_lag(signal[:, None], times, np.array([lag]))[0, :, 0]

    def wobble(deviation: float, *place: int) -> FloatArray:
        """An Ornstein-Uhlenbeck process from 0: w_i = q w_(i-1) + sqrt(1 - q^2) deviation z_i."""
        z = stream(seed, CLIMATE_STREAM, *place).standard_normal(max(n - 1, 0))
        kicks = (deviation * np.sqrt(1.0 - q * q) * z).tolist()
        return np.array([*accumulate(kicks, lambda w, kick: q * w + kick, initial=0.0)])

    driven = lagged(np.concatenate([[reference], targets[1:]]), plan.room_lag)
    room = driven + wobble(plan.room_wobble, 1)
    air = [
        reference + share * (room - reference) + wobble(plan.sensor_wobble, 2, s)
        for s, share in enumerate(sensors.shares)
    ]
    return np.column_stack([lagged(T, lag) for T, lag in zip(air, sensors.lags, strict=True)])


def settled(plan: DriftPlan, sensors: Sensors, rooms: FloatArray, seed: int) -> Columns:
    """Noise-free temperatures (r,) of all sensors, twins included, with the room settled at each of
    `rooms` (r,), degC, each with independent draughts.
    """
    draughts = np.empty((len(rooms), len(sensors.names)))
    for r, s in np.ndindex(draughts.shape):
        draughts[r, s] = stream(seed, CLIMATE_STREAM, 3, r, s).standard_normal()
    rise = sensors.shares * (rooms[:, None] - plan.reference)
    T = plan.reference + rise + plan.parts_wobble * draughts
    columns = dict(zip(sensors.names, T.T, strict=True))
    return columns | {name: columns[place] for name, place in plan.twins.items()}


def as_read(
    plan: DriftPlan, sensors: Sensors, true: Mapping[str, FloatArray], seed: int, part: int = 0
) -> dict[str, FloatArray]:
    """What the sensors read: the true temperatures, twins included, each with its own noise."""
    places = {name: name for name in sensors.names} | dict(plan.twins)
    return {
        name: true[place]
        + plan.sensor_noise_degc
        * stream(seed, CLIMATE_STREAM, 5, part, c).standard_normal(len(true[place]))
        for c, (name, place) in enumerate(places.items())
    }


def sensors_for(drifts: Sequence[ThermalEstimate], plan: DriftPlan, seed: int) -> Sensors:
    """The sensors of all drifts; shares moved as little as the requested drifts ask for: with the
    seeded shares a0, gradients G (places, s) and rise R = high - reference the settled drifts are
    R G a. The requested ones are d for a = a0 + G^+ (d/R - G a0), the solution nearest to a0.

    Raises InputError where the sensors cannot give the requested drifts.
    """
    names = tuple(sorted({sensor for drift in drifts for sensor in drift.sensors}))
    draws = np.array([stream(seed, CLIMATE_STREAM, 0, s).random(2) for s in range(len(names))])
    low, high = plan.sensor_lag
    lags = low * (high / low) ** draws[:, 0]
    a0 = shares = 1.0 + plan.sensor_spread * (2.0 * draws[:, 1] - 1.0)
    rise = plan.high - plan.reference

    def gradients(drift: ThermalEstimate) -> FloatArray:
        """G (places, s) in the drift's unit per degC."""
        place = np.nan_to_num(plan.positions[drift.component])
        G = np.zeros((len(place), len(names)))
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
    # Readings of one place in one cycle.
    moments = int(np.floor(plan.minutes / plan.interval_min * (1 + 1e-12))) + 1
    period = moments + round(plan.soak / plan.interval_min)
    cool = np.repeat(np.arange(plan.cycles) % 2, period)
    targets = np.where(cool, plan.low, plan.high)
    true = followed(plan, sensors, targets, seed)
    count = len(true)
    times = np.arange(count, dtype=np.float64) * plan.interval_min
    read = as_read(plan, sensors, dict(zip(sensors.names, true.T, strict=True)), seed)
    at = (np.arange(count) % period < moments).nonzero()[0].reshape(plan.cycles, -1)
    noise = {LENGTH: plan.reading_noise_um * UM, ANGLE: plan.reading_noise_arcsec * ARCSEC}
    rows: list[tuple[str, str, float]] = []
    errors: list[FloatArray] = []
    for number, item in enumerate(drifts):
        # A drift follows a sensor's temperature, or its lag.
        columns = true[:, [sensors.names.index(sensor) for sensor in item.sensors]]
        lagged = first_order_lag(columns, times, item.time_constants).diagonal(axis1=0, axis2=2)
        temperatures = dict(zip(item.sensors, lagged.T, strict=True))
        # The leftover, one draw a cycle, and the noise of every reading.
        shape = plan.cycles, len(item.leftover)
        draws = stream(seed, DRIFT_STREAM, 0, number).standard_normal(shape)
        for p, position in enumerate(plan.positions[item.component]):
            place = np.nan_to_num(position)
            root = place ** np.arange(shape[1]) @ covariance_root(item.leftover)
            error = item.drift(np.full(count, place), temperatures)
            error = error + (draws @ root)[np.arange(count) // period]
            z = stream(seed, DRIFT_STREAM, 1, number, p).standard_normal(count)
            error += noise[item.unit.dimension] * z
            rows.append((item.component, item.unit.name, position))
            errors.append((error / item.unit.to_internal)[at])
    table = np.stack(errors, axis=1)
    components, units, positions = (np.array(each) for each in zip(*rows, strict=True))
    result = {
        "component": components[:, None],
        "position_mm": positions[:, None],
        "cycle": np.arange(plan.cycles)[:, None, None] + 1,
        "time_min": times[at][:, None],
        "error": table,
        "unit": units[:, None],
        **{name: values[at][:, None] for name, values in read.items()},
    }
    return {name: np.broadcast_to(values, table.shape).ravel() for name, values in result.items()}
