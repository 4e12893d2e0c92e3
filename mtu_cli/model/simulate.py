"""A virtual machine: points of the parts that it makes.

Every random quantity has its own stream, so that asking for more parts does not change the
readings, nor more repeats the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node
from mtu_cli.model.design import Design, design, theta
from mtu_cli.model.effect_ranges import LARGE_MM, STEEP
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.simulate_equations import (
    Visits,
    check_coordinates,
    covariate_values,
    deviation_values,
    error_values,
)
from mtu_cli.model.simulate_readings import PassDraws, pass_draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

IntArray = np.ndarray
Equations = Sequence[tuple[str, Node]]


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

    A part has one draw of every component's D, those read together one of theirs, and of its
    offset, a feature one draw of every component's s_repeat, a repeat one of the CMM's.

    Raises InputError for an equation that uses an unknown name, or has no value or one out of
    range at a feature; for a covariate of the machine that nothing gives; for coordinates that
    no points file could hold.
    """
    _check_covariates(model, _visits(ids, points, plan, 0))
    n = len(ids)
    visits = [_visits(ids, points, plan, part) for part in range(plan.parts)]
    covariates = [own.values for own in visits]
    measured = _measured(model, plan, visits, seed)
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


def large_errors(plan: PartsPlan, ids: Sequence[str], points: FloatArray) -> list[Finding]:
    """Asks for the unit of every effect and scatter that is above `LARGE_MM` at some feature, and
    above `STEEP` of how far apart the features `ids` at `points` (n, 3) mm are.
    """
    visits = [_visits(ids, points, plan, part) for part in range(plan.parts)]
    known = np.nan_to_num(points)
    extent = float(max(np.abs(known).max(), np.ptp(known, axis=0).max()))
    warnings = []
    for option, equations in (("--effect", plan.effects), ("--scatter", plan.scatter)):
        for axis, node in equations:
            name = f"{option} E{axis}"
            values = np.concatenate([error_values(name, node, each) for each in visits])
            row = int(np.argmax(np.abs(values)))
            if abs(values[row]) > max(LARGE_MM, STEEP * extent):
                part, feature = divmod(row, len(ids))
                facts = {"effect": name, "value_mm": float(values[row])}
                facts |= {"where": f" {visits[part].named(feature)}"}
                expected = "mm, 0.003 for 3 um"
                warnings.append(finding("effect-too-large", **facts, expected=expected))
    return warnings


def _measured(
    model: MachineModel, plan: PartsPlan, visits: Sequence[Visits], seed: int
) -> list[FloatArray]:
    """Measured coordinates (repeats, n, axes) of every part's features, mm."""
    passes = pass_draws(model)
    # Without covariates in the equations the places alone make the design, of every part.
    fixed = None if model.covariates() else design(model, visits[0].points, {})
    return [
        _one_part(model, plan, own, seed, (fixed or design(model, own.points, own.values), passes))
        for own in visits
    ]


def _one_part(
    model: MachineModel,
    plan: PartsPlan,
    visits: Visits,
    seed: int,
    machine: tuple[Design, PassDraws],
) -> FloatArray:
    """Measured coordinates (repeats, n, axes) of one part's features, mm.

    `machine` is the design at them, and what parts differ by.
    """
    first, more = plan.first_repeats
    part, points = visits.part - 1, visits.points
    repeats = more if part < first else plan.repeats
    rng = stream(seed, 1, part)
    errors = _part_errors(model, *machine, rng)
    errors += plan.part_offset * rng.standard_normal(errors.shape[1])
    errors += _effects(model, plan.effects, visits)
    errors += _scatter(model, plan.scatter, visits, stream(seed, 3, part))
    cmm = stream(seed, 2, part).standard_normal((repeats, *errors.shape)) * plan.cmm_u
    axes = _written(model)
    measured = np.tile(points[:, [AXES.index(axis) for axis in axes]], (repeats, 1, 1))
    own = [axes.index(axis) for axis in model.axes]
    measured[:, :, own] = measured[:, :, own] + errors + cmm
    others = [i for i in range(len(axes)) if i not in own]
    noise = stream(seed, 8, part).standard_normal((repeats, len(points), len(others)))
    measured[:, :, others] += plan.cmm_u * noise
    check_coordinates(measured, axes, visits)
    return measured


def _written(model: MachineModel) -> tuple[str, ...]:
    """The coordinates of a points file: x and y, which every such file has, and those that the
    machine has an equation for.
    """
    return tuple(axis for axis in AXES if axis in {"x", "y", *model.axes})


def _check_covariates(model: MachineModel, visits: Visits) -> None:
    missing = [name for name in model.covariates() if name not in visits.values]
    if missing:
        sensors = {sensor for drift in model.drifts() for sensor in drift.sensors}
        raise InputError(
            [
                finding(
                    "missing-input",
                    what=f"a value of {name} for the machine {model.name!r}",
                    names=[name],
                    expected=f"--covariate '{name}: EQUATION'"
                    + (", or --cmm-room DEGC" if name in sensors else ""),
                )
                for name in missing
            ]
        )


def _visits(ids: Sequence[str], points: FloatArray, plan: PartsPlan, part: int) -> Visits:
    """Sequence, time and approach directions of one part's features, and the declared ones."""
    n = len(points)
    backward = plan.reverse_every > 0 and (part + 1) % plan.reverse_every == 0
    order = np.arange(n)[::-1] if backward else np.arange(n)
    values: dict[str, FloatArray] = {
        "sequence": np.full(n, part + 1.0),
        "time_min": np.empty(n),
    }
    values["time_min"][order] = (part * n + np.arange(n)) * plan.minutes
    for k, axis in enumerate(AXES):
        if np.isfinite(points[:, k]).all() and np.ptp(points[:, k]) > 0:
            values[f"dir_{axis}"] = _directions(points[:, k], order)
    values |= {name: columns[part] for name, columns in plan.given.items()}
    visits = Visits(part=part + 1, ids=ids, points=points, values=values)
    for name, node in plan.covariates:
        # One may use those before it.
        values[name] = covariate_values(f"--covariate {name}", node, visits)
    return visits


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


def _part_errors(
    model: MachineModel,
    rows: Design,
    passes: PassDraws,
    rng: np.random.Generator,
) -> FloatArray:
    """Errors (n, axes) of one part's features."""
    a = len(model.axes)
    n = len(rows.J) // a
    noise = np.zeros((n, a))
    levers = rows.levers.reshape(n, a, -1)
    normal = []
    for t, term in enumerate(model.terms):
        normal.append(rng.standard_normal(len(term.estimate.coefficients)))
        visits = rng.standard_normal(n) * term.estimate.s_repeat
        noise += levers[:, :, t] * visits[:, None]
    state = theta(model) + np.concatenate(passes.of(normal))
    errors: FloatArray = (rows.J @ state + rows.remainder).reshape(n, a) + noise
    return errors


def _effects(model: MachineModel, effects: Equations, visits: Visits) -> FloatArray:
    total = np.zeros((len(visits.ids), len(model.axes)))
    for axis, node in effects:
        total[:, model.axes.index(axis)] += error_values(f"--effect E{axis}", node, visits)
    return total


def _scatter(
    model: MachineModel, scatter: Equations, visits: Visits, rng: np.random.Generator
) -> FloatArray:
    deviations = np.zeros((len(visits.ids), len(model.axes)))
    for axis, node in scatter:
        own = deviation_values(f"--scatter E{axis}", node, visits)
        deviations[:, model.axes.index(axis)] += own
    drawn: FloatArray = deviations * rng.standard_normal(deviations.shape)
    return drawn
