"""A virtual machine: points of the parts that it makes.

Every random quantity has its own stream, so that asking for more parts does not change the
readings, nor more repeats the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.language import Node, evaluate
from mtu_cli.language import names as names_of
from mtu_cli.model.design import design, theta
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import normal_draw, stream

IntArray = np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsPlan:
    """How parts are made and measured.

    `repeats` CMM measurements a feature with standard uncertainty `cmm_u` (mm), or, of the
    first parts, `first_repeats` = (parts, repeats); `scatter` (axis, equation) adds a random
    error of that standard deviation (mm) to each feature of each part; `operation` names how
    the features were made; a random offset of every part with standard deviation `part_offset`
    (mm); features are machined in the part's order, every `reverse_every`-th part in the
    opposite one (0: never), each taking `minutes`. `effects` are (axis, equation in mm),
    `covariates` (name, equation), `given` columns (parts, features) such as temperatures.
    """

    parts: int
    repeats: int
    cmm_u: float
    part_offset: float
    reverse_every: int
    minutes: float
    first_repeats: tuple[int, int] = (0, 0)
    scatter: tuple[tuple[str, Node], ...] = ()
    operation: str | None = None
    effects: tuple[tuple[str, Node], ...] = ()
    covariates: tuple[tuple[str, Node], ...] = ()
    given: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedPoints:
    """Columns of a points file; one row per (part, feature, repeat).

    `measured` (n, axes) in mm; `covariates` hold sequence, time, directions and any declared.
    """

    axes: tuple[str, ...]
    operation: str | None
    part: tuple[str, ...]
    feature: tuple[str, ...]
    repeat: IntArray
    measured: FloatArray
    covariates: dict[str, FloatArray]


def simulate_points(
    model: MachineModel,
    ids: Sequence[str],
    points: FloatArray,
    plan: PartsPlan,
    seed: int,
) -> SimulatedPoints:
    """CMM points of `plan.parts` parts with features `ids` at `points` (n, 3), mm.

    A part has one draw of every component's D and of its offset, a feature one draw of every
    component's s_repeat, a repeat one of the CMM's.

    Raises InputError for an effect that uses an unknown name or has no finite value, and for
    a covariate of the machine that nothing gives.
    """
    _check_covariates(model, points, plan)
    n = len(ids)
    covariates = [_covariates(points, plan, part) for part in range(plan.parts)]
    measured = [
        _one_part(model, points, plan, values, part, seed) for part, values in enumerate(covariates)
    ]
    repeats = [len(own) for own in measured]
    axes = _written(model)
    return SimulatedPoints(
        axes=axes,
        operation=plan.operation,
        part=tuple(str(p + 1) for p, r in enumerate(repeats) for _ in range(r * n)),
        feature=tuple(ids) * sum(repeats),
        repeat=np.concatenate([np.repeat(np.arange(1, r + 1), n) for r in repeats]),
        measured=np.concatenate([own.reshape(-1, len(axes)) for own in measured]),
        covariates={
            key: np.concatenate(
                [np.tile(values[key], r) for values, r in zip(covariates, repeats, strict=True)]
            )
            for key in covariates[0]
        },
    )


def _one_part(
    model: MachineModel,
    points: FloatArray,
    plan: PartsPlan,
    values: Mapping[str, FloatArray],
    part: int,
    seed: int,
) -> FloatArray:
    """Measured coordinates (repeats, n, axes) of one part's features, mm."""
    first, more = plan.first_repeats
    repeats = more if part < first else plan.repeats
    rng = stream(seed, 1, part)
    errors = _part_errors(model, points, values, rng)
    errors += plan.part_offset * rng.standard_normal(errors.shape[1])
    errors += _effects(model, points, plan.effects, values)
    errors += _scatter(model, points, plan.scatter, values, stream(seed, 3, part))
    cmm = stream(seed, 2, part).standard_normal((repeats, *errors.shape)) * plan.cmm_u
    axes = _written(model)
    measured = np.tile(points[:, [AXES.index(axis) for axis in axes]], (repeats, 1, 1))
    own = [axes.index(axis) for axis in model.axes]
    measured[:, :, own] = measured[:, :, own] + errors + cmm
    others = [i for i in range(len(axes)) if i not in own]
    noise = stream(seed, 8, part).standard_normal((repeats, len(points), len(others)))
    measured[:, :, others] += plan.cmm_u * noise
    return measured


def _written(model: MachineModel) -> tuple[str, ...]:
    """The coordinates of a points file: x and y, which every such file has, and those that the
    machine has an equation for.
    """
    return tuple(axis for axis in AXES if axis in {"x", "y", *model.axes})


def _check_covariates(model: MachineModel, points: FloatArray, plan: PartsPlan) -> None:
    given = _covariates(points, plan, 0)
    missing = [name for name in model.covariates() if name not in given]
    if missing:
        sensors = {sensor for drift in model.drifts() for sensor in drift.sensors}
        raise InputError(
            [
                Problem(
                    what=f"the equations of {model.name!r} need the covariate {name!r}",
                    expected=f"--covariate '{name}: EQUATION'"
                    + (", or --cmm-room DEGC" if name in sensors else ""),
                )
                for name in missing
            ]
        )


def _covariates(points: FloatArray, plan: PartsPlan, part: int) -> dict[str, FloatArray]:
    """Sequence, time and approach directions of one part's features, and the declared ones."""
    n = len(points)
    backward = plan.reverse_every > 0 and (part + 1) % plan.reverse_every == 0
    visits = np.arange(n)[::-1] if backward else np.arange(n)
    values: dict[str, FloatArray] = {
        "sequence": np.full(n, part + 1.0),
        "time_min": np.empty(n),
    }
    values["time_min"][visits] = (part * n + np.arange(n)) * plan.minutes
    for k, axis in enumerate(AXES):
        if np.isfinite(points[:, k]).all() and np.ptp(points[:, k]) > 0:
            values[f"dir_{axis}"] = _directions(points[:, k], visits)
    values |= {name: columns[part] for name, columns in plan.given.items()}
    for name, node in plan.covariates:
        values[name] = _value(name, node, points, values)
    return values


def _directions(coordinate: FloatArray, visits: IntArray) -> FloatArray:
    """Sign of the last move along an axis, in the order of visits; the first move is positive."""
    result = np.ones(len(coordinate))
    last, sign = None, 1.0
    for i in visits:
        if last is not None and coordinate[i] != last:
            sign = 1.0 if coordinate[i] > last else -1.0
        last = coordinate[i]
        result[i] = sign
    return result


def _value(
    what: str, node: Node, points: FloatArray, values: Mapping[str, FloatArray]
) -> FloatArray:
    place = {axis: points[:, k] for k, axis in enumerate(AXES)} | dict(values)
    unknown = [name for name in names_of(node) if name not in place]
    if unknown:
        raise InputError(
            Problem(
                what=f"the equation of {what!r} uses the unknown name {unknown[0]!r}",
                column=names_of(node)[unknown[0]],
                expected=", ".join(place),
            )
        )
    found = np.broadcast_to(np.asarray(evaluate(node, place), float), (len(points),))
    if not np.isfinite(found).all():
        raise InputError(Problem(what=f"the equation of {what!r} has no finite value"))
    return np.array(found)


def _part_errors(
    model: MachineModel,
    points: FloatArray,
    values: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> FloatArray:
    """Errors (n, axes) of one part's features."""
    given: dict[str, FloatArray | float] = dict(values)
    rows = design(model, points, given)
    state = theta(model)
    n, a = len(points), len(model.axes)
    noise = np.zeros((n, a))
    levers = rows.levers.reshape(n, a, -1)
    for t, (term, columns) in enumerate(zip(model.terms, rows.columns, strict=True)):
        state[columns] += normal_draw(rng, term.estimate.pass_covariance)
        visits = rng.standard_normal(n) * term.estimate.s_repeat
        noise += levers[:, :, t] * visits[:, None]
    errors: FloatArray = (rows.J @ state + rows.remainder).reshape(n, a) + noise
    return errors


def _scatter(
    model: MachineModel,
    points: FloatArray,
    scatter: Sequence[tuple[str, Node]],
    values: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> FloatArray:
    deviations = np.abs(_effects(model, points, scatter, values))
    drawn: FloatArray = deviations * rng.standard_normal(deviations.shape)
    return drawn


def _effects(
    model: MachineModel,
    points: FloatArray,
    effects: Sequence[tuple[str, Node]],
    values: Mapping[str, FloatArray],
) -> FloatArray:
    total = np.zeros((len(points), len(model.axes)))
    for axis, node in effects:
        total[:, model.axes.index(axis)] += _value(f"E{axis}", node, points, values)
    return total
