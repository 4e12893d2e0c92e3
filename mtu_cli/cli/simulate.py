"""`mtu simulate`: what its options state, and its files, which name the options that made them."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli import __version__
from mtu_cli.analyses import simulate as analysis
from mtu_cli.cli.analyse import modelled
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import CLIMATE, DRIFT, OPTIONS, POINTS, READINGS, Options, option_name
from mtu_cli.cli.values import MOST_STEPS, SPAN, assignments, ends, known_name, number_of, within
from mtu_cli.files.contract import A_NAME, is_name
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.source import SYNTHETIC
from mtu_cli.findings import error, finding
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.simulate import DriftPlan, Equations, PartsPlan
from mtu_cli.reports.simulate import file_of
from mtu_cli.result import Listing, Result
from mtu_cli.stats.least_squares import FloatArray

PANELS = {"lbb": {READINGS}, "laser": {READINGS}, "cmm": {POINTS}, "drift": {DRIFT, CLIMATE}}


def simulate(inputs: Inputs) -> Result:
    """The files of the --write options, each below the options that made it."""
    options, seed = inputs.options, inputs.settings.seed
    paths = {name.removeprefix("write_"): path for name, path in options.written.items()}
    if not paths:
        expected = "--write-lbb, --write-laser, --write-cmm or --write-drift FILE"
        raise error("usage", reason="simulate has no output", expected=expected)
    if options.operation is not None and not is_name(options.operation):
        place = {"path": "--operation", "value": options.operation, "expected": A_NAME}
        raise error("wrong-type", kind="a name", **place)
    model = modelled(inputs)[0]
    result = analysis.simulate(model, inputs.machine, _request(inputs, model, paths), seed)
    lines, results, files = [], {}, {}
    for kind, path in paths.items():
        text, results[kind] = file_of(kind, result)
        files[path] = (_heading(_given(options, [kind]), seed) + text).encode()
        lines.append(f"{path}: {len(next(iter(results[kind].values())))} synthetic rows")
    first = next(iter(results.values()))
    document = Listing(lines, results, (tuple(first), [*zip(*first.values(), strict=True)]))
    used, why = _given(options, paths), ": none of the files that are written depends on it"
    unused = [
        finding("option-not-used", path=option_name(name), why=why)
        for name in _given(options, PANELS)
        if name not in used and OPTIONS[name].default is None
    ]
    return Result(inputs, document, [*result.warnings, *unused], files=files)


def _given(options: Options, kinds: Collection[str]) -> dict[str, Any]:
    """The values of the options on which files of these kinds depend, of those that have any."""
    panels = {panel for kind in kinds for panel in PANELS[kind]}
    panels |= {CLIMATE} if "cmm" in kinds and options.cmm_room else set()
    given = {name: value for name, value in options.values.items() if value not in (None, [])}
    return {name: value for name, value in given.items() if OPTIONS[name].panel in panels}


def _heading(given: Mapping[str, Any], seed: int) -> str:
    """Comment lines that mark a file as synthetic, with the options that made it."""
    arguments = [
        f"{option_name(name)} {shlex.quote(' '.join(str(item).split()))}"
        for name, value in given.items()
        for item in (value if isinstance(value, list) else [value])
    ]
    first = f"{SYNTHETIC}, no machine made it: mtu simulate {__version__}, seed {seed}"
    return f"{first}\n# {' '.join(arguments)}\n"


def _request(inputs: Inputs, model: MachineModel, files: Mapping[str, Path]) -> analysis.Request:
    """What the options state on which the files depend."""
    options, travels = inputs.options, inputs.machine.machine.travels
    component, rooms = options.laser_component, options.cmm_room if "cmm" in files else None
    axes = analysis.axes_read(model, files, component)
    positions = _positions(options.positions) if {"lbb", "laser"} & files.keys() else {}
    for axis in sorted(axes & positions.keys() & travels.keys()):
        within("--positions", positions[axis], travels[axis], f"mm of {axis}")
    unstated = axes - positions.keys()
    return analysis.Request(
        files=files,
        passes=options.passes,
        positions=positions,
        component=component,
        part=inputs.part_if_any if unstated else inputs.part if "cmm" in files else None,
        parts=_parts(options, model) if "cmm" in files else None,
        rooms=rooms or (),
        test=_drift_test(inputs, model) if "drift" in files or rooms else None,
    )


def _positions(text: str | None) -> dict[str, FloatArray]:
    """The positions (n,) in mm that are stated, by axis."""
    option, form, example = "--positions", f"AXIS={SPAN}", "0:140:8, say, or x=0:140:8,y=0:90:5"

    def grid(_: str, span: str) -> FloatArray:
        low, high, count = ends(option, span, SPAN, example, ordered=True)
        return np.linspace(low, high, int(count))

    if text is not None and "=" not in text:
        return dict.fromkeys(AXES, grid("", text))
    return assignments(option, text and text.split(","), form, example, grid, AXES, "axis")


def _parts(options: Options, model: MachineModel) -> PartsPlan:
    """How the parts are made and measured."""

    def equations(option: str, texts: Any, names: Collection[str] | None = None) -> Equations:
        form, example = "NAME: EQUATION", "'Ex: 0.004*dir_x'"
        read = partial(analysis.equation, option)
        return assignments(option, texts, form, example, read, names, "equation")

    option, text, first = "--first-repeats", options.first_repeats, (0, 0)
    if text is not None:
        parts, repeats = ends(option, text, "PARTS:REPEATS", "4:5", whole=True)
        within(option, (parts, repeats), (1, MOST_STEPS))
        first = int(parts), int(repeats)
    same = ("parts", "repeats", "cmm_u_um", "reverse_every", "minutes", "operation")
    of_errors = [f"E{axis}" for axis in model.axes]
    return PartsPlan(
        **{name: options.values[name] for name in same},
        first_repeats=first,
        scatter=equations("--scatter", options.scatter, of_errors),
        effects=equations("--effect", options.effect, of_errors),
        covariates=equations("--covariate", options.covariate),
    )


def _drift_test(inputs: Inputs, model: MachineModel) -> DriftPlan:
    """The drift test as far as it is stated; without drifts, which is a fault, nothing is read."""
    options, machine = inputs.options, inputs.machine.machine
    drifts = {drift.component: drift for drift in model.drifts()}
    sensors = sorted({sensor for drift in drifts.values() for sensor in drift.sensors})

    def numbers(option: str, texts: Iterable[str] | None) -> dict[str, FloatArray]:
        def value(name: str, text: str) -> FloatArray:
            items = text.replace(",", " ").split()
            return np.array([number_of(f"{option} {name}", item) for item in items])

        form, what = "NAME: NUMBERS", "component with a thermal model"
        return assignments(option, drifts and texts, form, "'pos_y: 0 75 200'", value, drifts, what)

    def sensor_of(name: str, sensor: str) -> str:
        known_name("--twin", "sensor", sensor, sensors)
        if name in sensors or not is_temperature(name):
            place = {"path": "--twin", "value": name, "expected": "a new one, such as T_18_degC"}
            raise error("wrong-type", kind="the name of a further sensor", **place)
        return sensor

    positions = numbers("--drift-positions", options.drift_positions)
    for name, values in positions.items():
        if (axis := drifts[name].of) in machine.travels:
            within(f"--drift-positions {name}", values, machine.travels[axis], f"mm of {axis}")
    form, example = "NAME: SENSOR", "'T_18_degC: T_02_degC'"
    same = ("cycles", "interval_min", "reading_noise_um", "reading_noise_arcsec")
    return DriftPlan(
        **{name: options.values[name] for name in (*same, "sensor_noise_degc")},
        reference=machine.reference_temperature_degC,
        positions=positions,
        settled=numbers("--settled-drift", options.settled_drift),
        twins=assignments("--twin", drifts and options.twin, form, example, sensor_of),
    )
