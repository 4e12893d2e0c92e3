"""The files of a virtual machine, and what holds where the request does not state it: readings of
components, one of them as the run of a laser, the points of parts, in a measuring room or without
one, and a drift test.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mtu_cli.files.contract import is_identifier
from mtu_cli.files.headers import POINTS
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, error, listed, located
from mtu_cli.formats.renishaw import UNITS as RUN_UNITS
from mtu_cli.language import Node, parse
from mtu_cli.model import simulate as virtual
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

DEFAULT_POSITIONS = 8
GIVE_POSITIONS = "--positions LOW:HIGH:COUNT"
Climate = tuple[virtual.DriftPlan, virtual.Sensors]


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What is asked for: `files` of the kinds `lbb`, `laser`, `cmm` and `drift`.

    Readings run in `passes` through `positions` (mm) by axis, along others over the extent of the
    `part`; a laser reads one `component`. `parts` are measured in the `rooms` (degC) in turn. Of
    the drift `test`, which has the sensors of the rooms, positions and settled drifts (in the unit
    of the component) are those that are stated.
    """

    files: Mapping[str, Path]
    passes: int
    positions: Mapping[str, FloatArray]
    component: str | None
    part: LoadedPart | None
    parts: virtual.PartsPlan | None
    rooms: Sequence[float]
    test: virtual.DriftPlan | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateResult:
    """Columns by kind of file, a laser's in its file's unit; a drift test and its sensors."""

    columns: Mapping[str, virtual.Columns]
    climate: Climate | None
    warnings: Sequence[Finding]


def simulate(
    model: MachineModel, machine: LoadedMachine, request: Request, seed: int
) -> SimulateResult:
    """The files of a request, each from a random stream of its own.

    Raises InputError for an axis without positions; a laser without a component, or in a file of
    another unit; settled drifts that do not go with the positions or with the sensors; and what
    `simulate_points` raises.
    """
    files, columns, climate = request.files, dict[str, virtual.Columns](), None
    if "lbb" in files:
        columns["lbb"] = _readings(model, request, seed)
    if "laser" in files:
        if request.component is None:
            what, expected = "what the laser reads", "--laser-component NAME"
            raise error("missing-input", what=what, expected=expected)
        readings = _readings(model, request, seed, request.component)
        columns["laser"] = _laser_run(readings, files["laser"].suffix.lower()[1:])
    if request.test is not None:
        test = _drift_test(request.test, model, machine)
        climate = test, virtual.sensors_for(model.drifts(), test, seed)
    if "cmm" in files:
        columns["cmm"] = _points(model, request, climate if request.rooms else None, seed)
    if "drift" in files and climate is not None:
        columns["drift"] = virtual.simulate_drift(model.drifts(), *climate, seed)
    # Components that are in no equation are not simulated.
    unused = [x for x in machine.warnings if x.code == "unused" and x.facts["what"] == "component"]
    return SimulateResult(columns=columns, climate=climate, warnings=unused)


def axes_read(model: MachineModel, files: Collection[str], component: str | None) -> set[str]:
    """The axes along which the readings of some files are, a laser's of one component."""
    only = {"lbb": None, "laser": component}
    read = (virtual.components_read(model, only[kind]) for kind in only.keys() & files)
    return {x.of for components in read for x in components if x.of is not None}


def equation(option: str, name: str, text: str) -> Node:
    """An equation of an option, of an error or of a covariate; raises InputError for a faulty one,
    and for a covariate that is called as a column that points have anyway.
    """
    if option == "--covariate" and (name in (*POINTS.columns, *AXES) or not is_identifier(name)):
        place = {"value": name, "expected": "another name, such as T_spindle_degC"}
        raise error("wrong-type", path=option, kind="the name of a further column", **place)
    with located(path=f"{option} {name}", value=text):
        return parse(text)


def _readings(
    model: MachineModel, request: Request, seed: int, only: str | None = None
) -> virtual.Columns:
    """Readings at the positions that are stated, along other axes over the extent of the part."""
    positions = dict(request.positions)
    axes = axes_read(model, ["laser" if only else "lbb"], only)
    if rest := sorted(axes - positions.keys()):
        if request.part is None:
            what, expected = f"the range along {listed(rest)}", f"{GIVE_POSITIONS}, or a part (-p)"
            raise error("missing-input", what=what, expected=expected)
        _, points, _ = feature_points(request.part, model)
        for axis in rest:
            column = points[:, AXES.index(axis)]
            low, high = np.nanmin(column), np.nanmax(column)
            if not low < high:
                reason = f"the part does not extend along {axis}"
                raise error("not-applicable", reason=reason, expected=GIVE_POSITIONS)
            positions[axis] = np.linspace(low, high, DEFAULT_POSITIONS)
    return virtual.simulate_readings(model, seed, request.passes, positions, only)


def _laser_run(readings: virtual.Columns, file_format: str) -> virtual.Columns:
    """The readings of one component in the unit of the instrument's file."""
    unit, file_unit = UNITS[readings["unit"][0]], UNITS[RUN_UNITS[file_format]]
    if unit.dimension != file_unit.dimension:
        name, held = readings["component"][0], file_unit.name
        reason = f"{name} is read in {unit.name}, and a .{file_format} file holds {held}"
        expected = "a file .rtl of lengths, .rta of angles"
        raise error("not-applicable", reason=reason, expected=expected)
    errors = readings["error"] * (unit.to_internal / file_unit.to_internal)
    return readings | {"error": errors, "unit": np.full(len(errors), file_unit.name)}


def _drift_test(
    stated: virtual.DriftPlan, model: MachineModel, loaded: LoadedMachine
) -> virtual.DriftPlan:
    """The test at the positions, mm, that are stated, else at those of the gradients, else in the
    middle of the axis; with settled drifts in mm and rad.
    """
    if not any(drift.sensors for drift in model.drifts()):
        reason = "no component of the equations has a thermal model with a sensor"
        expected = "a `thermal` key in a component of the equations"
        raise error("not-applicable", file=loaded.source.shown, reason=reason, expected=expected)
    machine, positions, settled = loaded.machine, dict(stated.positions), {}
    for drift in model.drifts():
        name, component = drift.component, machine.components[drift.component]
        if name in positions:
            option = f"--drift-positions {name}"
            if len(np.unique(positions[name])) < len(positions[name]):
                raise error("appears-twice", what=f"a position of {option}")
        elif component.thermal is not None and component.thermal.positions_mm is not None:
            positions[name] = np.array(component.thermal.positions_mm)
        elif drift.of is None:
            positions[name] = np.array([np.nan])
        elif drift.position_range is not None:
            positions[name] = np.linspace(*drift.position_range, drift.degree + 1)
        else:
            positions[name] = np.array([np.mean(machine.travels.get(drift.of, 0.0))])
    for name, values in stated.settled.items():
        if len(values) != len(positions[name]):
            place = {"path": f"--settled-drift {name}", "found": f"{len(values)} values"}
            expected = f"one at each of {len(positions[name])} positions"
            raise error("wrong-count", **place, expected=expected)
        settled[name] = values * UNITS[machine.components[name].unit].to_internal
    return replace(stated, positions=positions, settled=settled)


def _points(
    model: MachineModel, request: Request, climate: Climate | None, seed: int
) -> virtual.Columns:
    """The points of parts; in rooms of a `climate` with the temperatures that its sensors read."""
    part, plan = request.part, request.parts
    assert part is not None
    assert plan is not None
    ids, points, _ = feature_points(part, model)
    if climate is not None:
        rooms = np.resize(request.rooms, plan.parts)
        plan = replace(plan, given=virtual.settled(*climate, rooms, seed))
    columns = virtual.simulate_points(model, ids, points, plan, seed)
    if climate is not None:
        # The noise of the sensors is drawn for each point.
        columns |= virtual.as_read(*climate, columns, seed, part=1)
    # Points of calibrated circles lie on the diameter that they have at their temperature.
    return virtual.grown(columns, ids, points, part.part.circles)
