"""A virtual machine: points of the parts that it makes.

Every random quantity has its own stream, so that asking for more parts does not change the
readings, nor more repeats the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.files.covariates import (
    PLACE,
    as_temperature,
    column_dimensions,
    looks_like_temperature,
    own_columns,
)
from mtu_cli.files.headers import LARGEST_READING
from mtu_cli.files.part import Circle
from mtu_cli.findings import Finding, InputError, error, finding, listed, nearest, suggestion
from mtu_cli.language import Node, check_dimension, evaluate, parse
from mtu_cli.language import names as names_of
from mtu_cli.model.effect_ranges import LARGE_MM, STEEP
from mtu_cli.model.geometry import GeometryError, fit_circle
from mtu_cli.model.machine_model import (
    AXES,
    Design,
    MachineModel,
    design,
    sensors_of,
    theta,
)
from mtu_cli.model.simulate_readings import PassDraws, pass_draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

PARTS_STREAM, CMM_STREAM, SCATTER_STREAM, OTHER_AXES_STREAM = 1, 2, 3, 8
"""Further ones: 0 of readings, 4 of the climate, 6 of drifts."""
LARGEST_MM = 1e6
"""No machine is a kilometre long."""
TAKEN = {
    *("part", "feature", "operation", "repeat", "sequence", "time", "time_min"),
    *(f"{start}{axis}" for axis in AXES for start in ("", "dir_")),
    *(f"{start}{axis}_mm" for axis in AXES for start in ("", "nominal_")),
}
"""Columns that points have anyway: no covariate may be called so."""


def errors_by_axis(
    option: str, texts: Sequence[str], axes: Sequence[str]
) -> tuple[tuple[str, Node], ...]:
    """Equations named Ex, Ey or Ez, by their axis, which is one of `axes`."""
    known = [f"E{axis}" for axis in axes]
    equations = [named_equation(option, text) for text in texts]
    for name, _ in equations:
        if name not in known:
            hint = suggestion(name, known)
            raise error("unknown-name", path=option, what="equation", value=name, **hint)
    return tuple((name[1:], node) for name, node in equations)


def covariate_equations(option: str, texts: Sequence[str]) -> tuple[tuple[str, Node], ...]:
    """Declared covariates; none may take a column that the points have anyway."""
    found: dict[str, Node] = {}
    for text in texts:
        name, node = named_equation(option, text, column=True)
        if name in TAKEN or name in found:
            place = {"path": option, "value": text, "taken": "a column of the points"}
            raise error("name-taken", **place, expected="another name, such as T_spindle_degC")
        found[name] = node
    return tuple(found.items())


def named_equation(option: str, text: str, *, column: bool = False) -> tuple[str, Node]:
    """Name and equation of an error in mm, or of a `column` in the unit that its name tells.

    The numbers of an equation may have units: ``0.004*dir_x`` are mm. Without a number in it a
    term must be what the equation is, as in a machine file.

    Raises InputError for what is no such text, for a column that looks like a sensor's and is
    none, and for terms of another dimension.
    """
    name, colon, equation = text.partition(":")
    blanks, name = " " * len(name + colon), name.strip()
    if not (colon and name.isascii() and name.isidentifier()):
        example = "'T_spindle_degC: 20 + 2*(sequence - 1)'" if column else "'Ex: 0.004*dir_x'"
        place = {"path": option, "value": text, "expected": f"{example}, say"}
        raise error("wrong-type", kind="NAME: EQUATION", **place)
    if column and looks_like_temperature(name):
        # What reads the points would refuse the column.
        place = {"value": name, "expected": as_temperature(name) or "T_<sensor>_degC"}
        raise error("wrong-type", path=option, kind="the name of a temperature", **place)
    try:
        # Blanks for the name: columns count from the start of the option's text.
        tree = parse(blanks + equation)
        wanted = column_dimensions(name) if column else PLACE
        check_dimension(tree, wanted, own_columns(names_of(tree), ()), free=True)
    except InputError as fault:
        place = {"path": f"{option} {name}", "value": text}
        raise InputError(each.at(**place) for each in fault.findings) from None
    return name, tree


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """One part, counted from 1: features `ids` (n,) at `points` (n, 3) mm under `values` (n,)."""

    part: int
    ids: Sequence[str]
    points: FloatArray
    values: Mapping[str, FloatArray]

    def named(self, index: int) -> str:
        """A feature of this part in words."""
        return f"in part {self.part} at feature {self.ids[index]!r}"


def values_of(option: str, node: Node, visits: Visits, least: float, most: float) -> FloatArray:
    """Values (n,) of an equation, an error or a standard deviation in mm, or a covariate.

    Raises InputError for an unknown name, and for a value that no points file could hold.
    """
    known = {axis: visits.points[:, k] for k, axis in enumerate(AXES)} | dict(visits.values)
    names = names_of(node)
    for name in names:
        if name not in known:
            meant = nearest(name, known)
            expected = f"one of {listed(known, 12)}, or a covariate (--covariate '{name}: ...')"
            place = {"path": option, "column": names[name], "meant": meant, "expected": expected}
            raise error("unknown-name", what="name", value=name, **place)
    found = np.array(np.broadcast_to(np.asarray(evaluate(node, known), float), len(visits.ids)))
    if not np.isfinite(found).all():
        i = int(np.argmin(np.isfinite(found)))
        at = ", ".join(f"{name} = {known[name][i]:g}" for name in names)
        raise error(
            "no-finite-value",
            what="the equation",
            path=option,
            where=f" at {at} {visits.named(i)}".rstrip(),
            expected="an equation that has one at every feature",
        )
    beyond = (found < least) | (found > most)
    if beyond.any():
        i = int(np.argmax(beyond))
        unit = " mm" if most == LARGEST_MM else ""
        expected = f"at most {most:g}{unit} in size"
        if found[i] < least == 0:
            expected = "a standard deviation of 0 or more, mm"
        place = {"path": f"{option} {visits.named(i)}", "value": f"{found[i]:g}"}
        raise error("out-of-range", **place, expected=expected)
    return found


def check_places(points: FloatArray, ids: Sequence[str], axes: Sequence[str]) -> None:
    """Raises InputError for a feature of which the part does not say where it is along an axis."""
    unknown = np.isnan(points[:, [AXES.index(axis) for axis in axes]])
    if unknown.any():
        i, k = np.argwhere(unknown)[0]
        raise error(
            "missing-key",
            key=f"{axes[k]}_mm",
            path=f"features.{ids[i]}",
            expected=f"{axes[k]}_mm of every feature in the part file",
        )


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

    A part has one draw of every component's D, those read together one of theirs, and of its
    offset, a feature one draw of every component's s_repeat, a repeat one of the CMM's.

    Raises InputError for an equation that uses an unknown name, or has no value or one out of
    range at a feature; for a covariate of the machine that nothing gives; for a place that the
    part does not state.
    """
    first = _visits(ids, points, plan, 0)
    sensors = sensors_of(model)
    missing = []
    for name in model.covariates():
        if name not in first.values:
            expected = f"--covariate '{name}: EQUATION'"
            expected += ", or --cmm-room DEGC" if name in sensors else ""
            what = f"a value of {name} for the machine {model.name!r}"
            missing.append(finding("missing-input", what=what, names=[name], expected=expected))
    if missing:
        raise InputError(missing)
    n, axes = len(ids), _written(model)
    check_places(points, ids, axes)
    visits = [_visits(ids, points, plan, part) for part in range(plan.parts)]
    covariates = [own.values for own in visits]
    passes = pass_draws(model)
    # Without covariates in the equations the places alone make the design, of every part.
    fixed = None if model.covariates() else design(model, points, {})
    measured = [
        _measured(model, plan, own, seed, fixed or design(model, points, own.values), passes)
        for own in visits
    ]
    repeats = [len(own) for own in measured]
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
            values = np.concatenate(
                [values_of(name, node, each, -LARGEST_MM, LARGEST_MM) for each in visits]
            )
            row = int(np.argmax(np.abs(values)))
            if abs(values[row]) > max(LARGE_MM, STEEP * extent):
                part, feature = divmod(row, len(ids))
                facts = {"effect": name, "value_mm": float(values[row])}
                facts |= {"where": f" {visits[part].named(feature)}"}
                expected = "mm, 0.003 for 3 um"
                warnings.append(finding("effect-too-large", **facts, expected=expected))
    return warnings


def _measured(
    model: MachineModel, plan: PartsPlan, visits: Visits, seed: int, rows: Design, passes: PassDraws
) -> FloatArray:
    """Measured coordinates (repeats, n, axes) of one part's features, mm: `rows` are the design at
    them, `passes` what parts differ by.
    """
    first, more = plan.first_repeats
    part, points = visits.part - 1, visits.points
    n, a, repeats = len(points), len(model.axes), more if part < first else plan.repeats
    rng = stream(seed, PARTS_STREAM, part)
    noise, levers, normal = np.zeros((n, a)), rows.levers.reshape(n, a, -1), []
    for t, term in enumerate(model.terms):
        normal.append(rng.standard_normal(len(term.estimate.coefficients)))
        scatter = rng.standard_normal(n) * term.estimate.s_repeat
        noise += levers[:, :, t] * scatter[:, None]
    state = theta(model) + np.concatenate(passes.of(normal))
    errors: FloatArray = (rows.J @ state + rows.remainder).reshape(n, a) + noise
    errors += plan.part_offset * rng.standard_normal(a)
    effects, deviations = np.zeros((n, a)), np.zeros((n, a))
    for axis, node in plan.effects:
        own = values_of(f"--effect E{axis}", node, visits, -LARGEST_MM, LARGEST_MM)
        effects[:, model.axes.index(axis)] += own
    for axis, node in plan.scatter:
        own = values_of(f"--scatter E{axis}", node, visits, 0.0, LARGEST_MM)
        deviations[:, model.axes.index(axis)] += own
    errors += effects
    errors += deviations * stream(seed, SCATTER_STREAM, part).standard_normal((n, a))
    cmm = stream(seed, CMM_STREAM, part).standard_normal((repeats, n, a)) * plan.cmm_u
    axes = _written(model)
    measured = np.tile(points[:, [AXES.index(axis) for axis in axes]], (repeats, 1, 1))
    with_equation = [axes.index(axis) for axis in model.axes]
    measured[:, :, with_equation] = measured[:, :, with_equation] + errors + cmm
    others = [i for i in range(len(axes)) if i not in with_equation]
    of_others = stream(seed, OTHER_AXES_STREAM, part).standard_normal((repeats, n, len(others)))
    measured[:, :, others] += plan.cmm_u * of_others
    return measured


def _written(model: MachineModel) -> tuple[str, ...]:
    """The coordinates of a points file: x and y, which every such file has, and those that the
    machine has an equation for.
    """
    return tuple(axis for axis in AXES if axis in {"x", "y", *model.axes})


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
        option, most = f"--covariate {name}", LARGEST_READING
        values[name] = values_of(option, node, visits, -most, most)
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


def growth(
    found: SimulatedPoints, ids: Sequence[str], points: FloatArray, circles: Sequence[Circle]
) -> FloatArray:
    """What the circles' features stand off their nominal places, (n, axes) in mm.

    They stand on the diameter D(T) of the calibration: p - c grows by D(T)/D0 - 1, with c the
    centre and D0 the diameter of the circle through the nominal features `ids` at `points`
    (features, 3); D between calibrated temperatures is linear, beyond them constant. A circle
    whose temperature no covariate gives stays nominal.

    Raises InputError for features that do not determine their circle.
    """
    columns = ["xyz".index(axis) for axis in found.axes]
    code = np.array([ids.index(name) for name in found.feature])
    moved = np.zeros_like(found.measured)
    for circle in circles:
        if circle.calibrated_mm is None or circle.temperature not in found.covariates:
            continue
        own = [ids.index(name) for name in circle.features]
        try:
            ring = fit_circle(points[own])
        except GeometryError as error:
            raise InputError(
                finding(
                    "too-little-data",
                    what=f"no circle goes through the nominal points of {circle.id!r}: {error}",
                )
            ) from None
        known = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(found.covariates[circle.temperature], known[:, 0], known[:, 1])
        rows = np.isin(code, own)
        away = (points[code] - ring.centre)[:, columns]
        moved[rows] = (away * (diameter / (2.0 * ring.radius) - 1.0)[:, None])[rows]
    return moved
