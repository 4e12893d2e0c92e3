"""`mtu simulate`: readings, points and drift readings of a virtual machine, from its options."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli import __version__
from mtu_cli.cli.analyse import modelled
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import CLIMATE, DRIFT, OPTIONS, POINTS, READINGS, option_name
from mtu_cli.cli.values import MOST_STEPS, SPAN, assignments, ends, known_name, number_of, within
from mtu_cli.files.contract import A_NAME, is_identifier, is_name
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.headers import POINTS as POINTS_TABLE
from mtu_cli.files.source import SYNTHETIC
from mtu_cli.findings import InputError, error, finding, listed
from mtu_cli.formats.base import Imported
from mtu_cli.formats.renishaw import UNITS as RUN_UNITS
from mtu_cli.formats.renishaw import run_file
from mtu_cli.language import Node, parse
from mtu_cli.model import simulate as virtual
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.reports.simulate import Synthetic, drift_file, points_file, readings_file
from mtu_cli.result import Listing, Result
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS

DEFAULT_POSITIONS = 8


def simulate(inputs: Inputs) -> Result:
    """The files of the --write options, each from a random stream of its own."""
    options = inputs.options
    paths = options.written
    if not paths:
        expected = "--write-lbb, --write-laser, --write-cmm or --write-drift FILE"
        raise error("usage", reason="simulate has no output", expected=expected)
    if options.operation is not None and not is_name(options.operation):
        place = {"path": "--operation", "value": options.operation, "expected": A_NAME}
        raise error("wrong-type", kind="a name", **place)
    model = modelled(inputs)[0]
    # Components that are in no equation are not simulated.
    of_machine = [each for each in inputs.machine.warnings if each.code == "unused"]
    warnings = [each for each in of_machine if each.facts["what"] == "component"]
    panels = set().union(*(_panels(inputs, name) for name in paths))
    why = ": none of the files that are written depends on it"
    warnings += [
        finding("option-not-used", path=option_name(name), why=why)
        for name in _given(inputs)
        if OPTIONS[name].panel not in panels and OPTIONS[name].default is None
    ]
    tables = {name: MAKERS[name](inputs, model) for name in paths}
    first = next(iter(tables.values()))
    document = Listing(
        [f"{path}: {tables[name].count} synthetic rows" for name, path in paths.items()],
        {name.removeprefix("write_"): table.values() for name, table in tables.items()},
        (tuple(first.columns), [*zip(*first.values().values(), strict=True)]),
    )
    files = {
        path: tables[name].text(_heading(inputs, name)).encode() for name, path in paths.items()
    }
    return Result(inputs, document, warnings, files=files)


def _panels(inputs: Inputs, name: str) -> set[str]:
    """The panels of the options on which a file depends, by the option that names it."""
    panels = {"write_cmm": {POINTS}, "write_drift": {DRIFT, CLIMATE}}.get(name, {READINGS})
    return panels | ({CLIMATE} if name == "write_cmm" and inputs.options.cmm_room else set())


def _given(inputs: Inputs) -> dict[str, list[Any]]:
    """The values of the options of files, of those that have any."""
    values = {x: v for x, v in inputs.options.values.items() if OPTIONS[x].panel and v is not None}
    return {name: v if isinstance(v, list) else [v] for name, v in values.items() if v != []}


def _heading(inputs: Inputs, name: str) -> str:
    """Comment lines that mark the file as synthetic, with the options that made it."""
    seed, panels = inputs.settings.seed, _panels(inputs, name)
    arguments = [
        f"{option_name(name)} {shlex.quote(' '.join(str(item).split()))}"
        for name, values in _given(inputs).items()
        if OPTIONS[name].panel in panels
        for item in values
    ]
    first = f"{SYNTHETIC}, no machine made it: mtu simulate {__version__}, seed {seed}"
    return f"{first}\n# {' '.join(arguments)}\n"


def _laser(inputs: Inputs, model: MachineModel) -> Synthetic:
    """The readings of one component as a run file in the instrument's unit."""
    name, kind = inputs.options.laser_component, inputs.options.write_laser.suffix.lower()[1:]
    if name is None:
        raise error("missing-input", what="what the laser reads", expected="--laser-component NAME")
    names = {x.estimate.name for x in model.terms if EFFECT_MARK not in x.estimate.name}
    known_name("--laser-component", "component", name, sorted(names))
    readings = _readings(inputs, model, name)
    unit, file_unit = UNITS[readings["unit"][0]], UNITS[RUN_UNITS[kind]]
    if unit.dimension != file_unit.dimension:
        reason = f"{name} is read in {unit.name}, and a .{kind} file holds {file_unit.name}"
        expected = "a file .rtl of lengths, .rta of angles"
        raise error("not-applicable", reason=reason, expected=expected)
    synthetic = readings_file(readings)
    readings["direction"] = np.where(readings["direction"] > 0, "forward", "reverse")
    readings["error"] *= unit.to_internal / file_unit.to_internal
    columns = {column: values.tolist() for column, values in readings.items()}
    content = run_file(Imported(format=kind, columns=columns))
    return replace(synthetic, body=content.decode("cp1252"))


def _readings(inputs: Inputs, model: MachineModel, only: str | None = None) -> virtual.Columns:
    estimates = [term.estimate for term in model.terms if EFFECT_MARK not in term.estimate.name]
    axes = {each.of for each in estimates if each.of is not None and only in (None, each.name)}
    positions = _positions(inputs, model, axes)
    # Of other components only the draws matter, not where they are read.
    other = next(iter(positions.values()), np.zeros(1))
    return virtual.simulate_readings(
        model,
        inputs.settings.seed,
        passes=inputs.options.passes,
        directions=(1, -1),
        positions={axis: positions.get(axis, other) for axis in AXES},
        only=only,
    )


def _positions(inputs: Inputs, model: MachineModel, axes: set[str]) -> dict[str, FloatArray]:
    """Positions (n,) in mm by axis: of --positions, else over the part's extent."""
    option, text = "--positions", inputs.options.positions
    travels = inputs.machine.machine.travels
    example = "0:140:8, say, or x=0:140:8,y=0:90:5"

    def grid(_: str, span: str) -> FloatArray:
        low, high, count = ends(option, span, SPAN, example, ordered=True)
        return np.linspace(low, high, int(count))

    result: dict[str, FloatArray] = {}
    if text is not None and "=" in text:
        form = f"AXIS={SPAN}"
        result = assignments(option, text.split(","), form, example, grid, AXES, "axis")
    elif text is not None:
        result = dict.fromkeys(axes, grid("", text))
    for axis in sorted(axes & result.keys() & travels.keys()):
        within(option, result[axis], travels[axis], f"mm of {axis}")
    if axes <= result.keys():
        return result
    rest = sorted(axes - result.keys())
    if not inputs.files("part"):
        expected = f"{option} {SPAN}, or a part (-p)"
        raise error("missing-input", what=f"the range along {listed(rest)}", expected=expected)
    _, points, _ = feature_points(inputs.part, model)
    for axis in rest:
        column = points[:, AXES.index(axis)]
        low, high = np.nanmin(column), np.nanmax(column)
        if not low < high:
            reason = f"the part does not extend along {axis}"
            raise error("not-applicable", reason=reason, expected=f"{option} {SPAN}")
        result[axis] = np.linspace(low, high, DEFAULT_POSITIONS)
    return result


def _points(inputs: Inputs, model: MachineModel) -> Synthetic:
    """The points of parts that the machine makes."""
    options, seed = inputs.options, inputs.settings.seed
    ids, points, _ = feature_points(inputs.part, model)
    option, text, first = "--first-repeats", options.first_repeats, (0, 0)
    if text is not None:
        parts, repeats = ends(option, text, "PARTS:REPEATS", "4:5", whole=True)
        within(option, (parts, repeats), (1, MOST_STEPS))
        first = int(parts), int(repeats)
    same = ("parts", "repeats", "reverse_every", "minutes", "operation")
    plan = virtual.PartsPlan(
        **{name: options.values[name] for name in same},
        cmm_u=options.cmm_u_um * 1e-3,
        first_repeats=first,
        scatter=_equations("--scatter", options.scatter, model),
        effects=_equations("--effect", options.effect, model),
        covariates=_equations("--covariate", options.covariate),
    )
    if options.cmm_room:
        drifts, test = _drift_test(inputs, model)
        sensors = virtual.sensors_for(drifts, test, seed)
        rooms = np.resize(options.cmm_room, plan.parts)
        temperatures = virtual.settled(test, sensors, rooms, seed)
        columns = dict(zip(sensors.names, temperatures.T, strict=True))
        columns |= {name: columns[of] for name, of in test.twins}
        table = {name: np.repeat(each[:, None], len(ids), axis=1) for name, each in columns.items()}
        plan = replace(plan, given=table)
    result = virtual.simulate_points(model, ids, points, plan, seed)
    if options.cmm_room:
        # The noise of the sensors is drawn for each point.
        result |= virtual.as_read(test, sensors, result, seed, part=1)
    # Points of calibrated circles lie on the diameter that they have at their temperature.
    return points_file(virtual.grown(result, ids, points, inputs.part.part.circles))


def _drift(inputs: Inputs, model: MachineModel) -> Synthetic:
    """The readings of a drift test."""
    (drifts, plan), seed = _drift_test(inputs, model), inputs.settings.seed
    sensors = virtual.sensors_for(drifts, plan, seed)
    return drift_file(virtual.simulate_drift(drifts, plan, sensors, seed), sensors)


def _equations(
    option: str, texts: Iterable[str] | None, model: MachineModel | None = None
) -> virtual.Equations:
    """Errors in mm by their axis, which the `model` has; without it covariates by their name."""
    names = None if model is None else [f"E{axis}" for axis in model.axes]

    def node_of(name: str, text: str) -> Node:
        # No covariate may be called as a column that points have anyway.
        if names is None and (name in (*POINTS_TABLE.columns, *AXES) or not is_identifier(name)):
            place = {"value": name, "expected": "another name, such as T_spindle_degC"}
            raise error("wrong-type", path=option, kind="the name of a further column", **place)
        try:
            return parse(text)
        except InputError as fault:
            place = {"path": f"{option} {name}", "value": text}
            raise InputError(each.at(**place) for each in fault.findings) from None

    form, example = "NAME: EQUATION", "'Ex: 0.004*dir_x'"
    equations = assignments(option, texts, form, example, node_of, names, "equation")
    return tuple((name[names is not None :], node) for name, node in equations.items())


MAKERS: dict[str, Callable[[Inputs, MachineModel], Synthetic]] = {
    "write_lbb": lambda *of: readings_file(_readings(*of)),
    "write_laser": _laser,
    "write_cmm": _points,
    "write_drift": _drift,
}
"""What makes each file, by the option that names it."""


def _drift_test(
    inputs: Inputs, model: MachineModel
) -> tuple[tuple[ThermalEstimate, ...], virtual.DriftPlan]:
    """The thermal models, and the drift test of the options."""
    options, machine, drifts = inputs.options, inputs.machine.machine, model.drifts()
    if not drifts:
        place = {"file": inputs.machine.source.shown}
        reason = "no component of the equations has a thermal model"
        expected = "a `thermal` key in a component of the equations"
        raise error("not-applicable", **place, reason=reason, expected=expected)
    positions = _drift_positions(inputs, drifts)
    settled_values = _by_component("--settled-drift", options.settled_drift, drifts)
    for name, values in settled_values.items():
        if len(values) != len(positions[name]):
            expected = f"one at each of {len(positions[name])} positions"
            place = {"path": f"--settled-drift {name}", "expected": expected}
            raise error("wrong-count", found=f"{len(values)} values", **place)
    units = {name: UNITS[machine.components[name].unit].to_internal for name in settled_values}

    sensors = {sensor for drift in drifts for sensor in drift.sensors}

    def sensor_of(name: str, sensor: str) -> str:
        known_name("--twin", "sensor", sensor, sorted(sensors))
        if name in sensors or not is_temperature(name):
            place = {"path": "--twin", "value": name, "expected": "a new one, such as T_18_degC"}
            raise error("wrong-type", kind="the name of a further sensor", **place)
        return sensor

    form, example = "NAME: SENSOR", "'T_18_degC: T_02_degC'"
    # Second sensors at the places of others.
    twins = assignments("--twin", options.twin, form, example, sensor_of)
    plan = virtual.DriftPlan(
        reference=machine.reference_temperature_degC,
        sensor_noise=options.sensor_noise_degc,
        cycles=options.cycles,
        interval=options.interval_min,
        positions=positions,
        noise={LENGTH: options.reading_noise_um * UM, ANGLE: options.reading_noise_arcsec * ARCSEC},
        settled={name: values * units[name] for name, values in settled_values.items()},
        twins=tuple(twins.items()),
    )
    return drifts, plan


def _drift_positions(inputs: Inputs, drifts: Sequence[ThermalEstimate]) -> dict[str, FloatArray]:
    """Where drift is read, mm: by the option, else where gradients are, else mid-axis."""
    machine = inputs.machine.machine
    positions = _by_component("--drift-positions", inputs.options.drift_positions, drifts)
    result: dict[str, FloatArray] = {}
    for drift in drifts:
        name, thermal = drift.component, machine.components[drift.component].thermal
        travel = machine.travels.get(drift.of or "")
        if name in positions:
            result[name], option = positions[name], f"--drift-positions {name}"
            if len(np.unique(result[name])) < len(result[name]):
                raise error("appears-twice", what=f"a position of {option}")
            if travel is not None:
                within(option, result[name], travel, f"mm of {drift.of}")
        elif thermal is not None and thermal.positions_mm is not None:
            result[name] = np.array(thermal.positions_mm)
        elif drift.of is None:
            result[name] = np.array([np.nan])
        elif drift.position_range is not None:
            result[name] = np.linspace(*drift.position_range, drift.degree + 1)
        else:
            result[name] = np.array([np.mean(travel) if travel else 0.0])
    return result


def _by_component(
    option: str, texts: Iterable[str] | None, drifts: Iterable[ThermalEstimate]
) -> dict[str, FloatArray]:
    """'NAME: NUMBERS' of several components, in their own units."""

    def numbers(name: str, text: str) -> FloatArray:
        items = text.replace(",", " ").split()
        return np.array([number_of(f"{option} {name}", item) for item in items])

    names, what = [drift.component for drift in drifts], "component with a thermal model"
    return assignments(option, texts, "NAME: NUMBERS", "'pos_y: 0 75 200'", numbers, names, what)
