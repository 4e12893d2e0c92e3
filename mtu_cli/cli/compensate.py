"""`mtu compensate`: readings or stated errors to a control's table, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mtu_cli.analyses import compensate as analysis
from mtu_cli.analyses.iso230 import places_read
from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import BESIDE
from mtu_cli.cli.values import above_zero, assignments, known_name
from mtu_cli.files.readings import Readings
from mtu_cli.files.source import check_text, read_source
from mtu_cli.findings import InputError, error
from mtu_cli.formats.control import CONTROLLERS, NAMES
from mtu_cli.formats.control.errors import Controller, ErrorTable, Parameters
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.model.settings import Settings
from mtu_cli.model.stated_errors import Stated, known_names, stated
from mtu_cli.model.visits import passes_read
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.units import LENGTH, UNITS

DIRECTIONS = ("both", "mean", "forward")
DWELL_S = 3.0
ROTARY = "c"
"""The axis of readings with position_deg, where --set axis does not name it."""


def compensate(inputs: Inputs, settings: Settings) -> Outcome:
    """The table of a control, or with --read the errors in one."""
    options = inputs.options
    feed = above_zero("--feed", str(options.feed))
    if options.for_ is None:
        raise error("missing-input", what="the control", expected="--for CONTROLLER")
    known_name("--for", "controller", options.for_, NAMES)
    control = CONTROLLERS.get(options.for_)
    defaults = DEFAULTS if control is None else control.parameters
    overrides = assignments(
        "--set", options.set, "NAME=VALUE", "axis=X", lambda _, x: x, defaults, "parameter"
    )
    parameters = {**defaults, **overrides}
    if control is None:
        return _skew(inputs, parameters)
    if options.read:
        table = _read(inputs, options.read, control, parameters)
        result = analysis.CompensateResult(
            component=options.read.name, controller=control, asked=table, held=table,
            direction="both" if table.both else "mean",
        )  # fmt: skip
        return Outcome.reported(inputs, result)
    known_name("--direction", "direction", options.direction, DIRECTIONS)
    if not options.component:
        raise error("missing-input", what="the component", expected="--component NAME")
    frame = analysis.Frame(zero=options.machine_zero, reverse=bool(options.reverse_axis))
    request = analysis.TableRequest(
        direction=options.direction, positions=_positions(inputs), reference=options.reference,
        frame=frame,
    )  # fmt: skip
    names = _names(inputs)
    errors, axis, first = _errors(inputs, names, request, overrides.get("axis", ROTARY).lower())
    _name_axis(inputs, names[0], axis, first, control, parameters, overrides)
    if options.current:
        request = replace(request, current=_read(inputs, options.current, control, parameters))
    # Type 0 where --set names none: a file does not show its type.
    parameters["type"] = parameters.get("type") or "0"
    plan = result = analysis.compensate(
        errors, control, parameters, request, component=" + ".join(names),
        seed=settings.seed, trials=settings.trials,
    )  # fmt: skip
    if readings := inputs.verify if options.verify else None:
        file = ", ".join(source.shown for source in readings.sources)
        if names[0] not in readings.components:
            components = ", ".join(readings.components)
            reason = f"--verify holds readings of {components}, not of {names[0]}"
            raise error("not-applicable", reason=reason, file=file)
        columns = _columns(readings, _rows(readings, names[0]), axis)
        try:
            result = analysis.verify(result, *columns)
        except InputError as fault:
            raise InputError([each.at(file=file) for each in fault.findings]) from None

    files, table = dict[Path, bytes](), options.to_file
    if table:
        files[table] = result.text.encode()
    if table and not control.comment:
        companion = table.with_name(f"{table.name}{BESIDE['to_file'][0]}")
        values = " ".join(f"{name}={value}" for name, value in parameters.items() if value)
        notes = (control.says, frame.says, f"This table: {values}.")
        files[companion] = "".join(f"{note}\n" for note in notes).encode()
    if options.to_nc:
        program = analysis.moves_program(plan, feed, DWELL_S, axis.upper(), frame)
        files[options.to_nc] = program.encode()
    return Outcome.reported(inputs, result, files=lambda: files)


def _names(inputs: Inputs) -> list[str]:
    """The components to compensate, the one with readings first: the others are added to it."""
    names = list(inputs.options.component)
    first = [name for name in names if len(_rows(inputs.readings, name))]
    if first[1:]:
        reason = f"there are readings of {' and '.join(first)}: those of one are compensated"
        raise error("not-applicable", reason=reason, expected="one of them")
    return first + [name for name in names if name not in first]


def _name_axis(
    inputs: Inputs, name: str, axis: str, first: Stated | None, control: Controller,
    parameters: dict[str, str], overrides: Parameters,
) -> None:  # fmt: skip
    """The axis and the ISO 230-1 name of the component, where the control wants them: `parameters`
    hold those of X, and axes that a control numbers are counted on from it.
    """
    of_x = "" if "axis" in overrides else parameters.get("axis", "")
    if of_x.startswith("X"):
        parameters["axis"] = axis.upper() + of_x[1:]
    elif of_x:
        parameters["axis"] = f"{of_x[:-1]}{int(of_x[-1]) + 'xyzabc'.index(axis)}"
    output = axis if first is None else first.output
    if "error" in parameters and not parameters["error"]:
        component = inputs.machine.machine.components.get(name)
        iso_name = "" if first is not None and first.angle else f"E{output}{axis}".upper()
        parameters["error"] = (component and component.iso) or iso_name
    elif output != axis and not control.listing:
        reason = f"{name} is an error in {output} along {axis}: no table of one axis"
        raise error("not-applicable", reason=reason, expected="--for isg-csv, etalon or table")


def _positions(inputs: Inputs) -> tuple[float, float, float] | None:
    options = inputs.options
    grid = (options.from_, options.to, options.step)
    if all(each is None for each in grid):
        return None
    if None in grid:
        raise error("incomplete", what="one of --from, --to, --step", other="the other two")
    low, high, step = grid
    count = (high - low) / step if step > 0 else -1.0
    if not 1 <= count <= 10_000 or abs(count - round(count)) > 1e-6:
        value = f"{low:g} to {high:g} by {step:g} mm"
        expected = "--to above --from by a whole number of steps, at most 10000"
        raise error("out-of-range", path="--step", value=value, expected=expected)
    return grid


def _errors(
    inputs: Inputs, names: Sequence[str], request: analysis.TableRequest, rotary: str
) -> tuple[analysis.AxisErrors, str, Stated | None]:
    """Errors by readings of the first name, else of the machine, plus the others; the axis, and
    the first component as stated (None of a rotary axis).
    """
    machine, readings = inputs.machine, inputs.readings
    component, rows = machine.machine.components.get(names[0]), _rows(readings, names[0])
    if readings and places_read(readings)[1][rows].any():
        if names[1:]:
            reason = f"{names[0]} is of a rotary axis: nothing is added to its readings"
            raise error("not-applicable", reason=reason)
        angle = component is not None and UNITS[component.unit].dimension != LENGTH
        columns = _columns(readings, rows, rotary)
        return analysis.axis_errors(*columns, angle=angle, rotary=True), rotary, None
    rest = [stated(machine, name) for name in names]
    first, axis = rest[0], rest[0].axis
    if any(each.axis != axis for each in rest):
        raise error("not-applicable", reason=f"{', '.join(names)} are not along one axis")
    if readings and len(rows):
        errors = analysis.axis_errors(*_columns(readings, rows, axis), angle=first.angle)
        rest = rest[1:]
    else:
        if request.places is None:
            at = first.default_positions(machine)
        else:
            at = request.frame.of_machine(request.places)
        none = np.zeros((2, len(at)))
        errors = analysis.AxisErrors(
            targets=at, means=none, expected=none, angle=first.angle, read=False,
            known=np.zeros((none.size,) * 2),
        )  # fmt: skip
    for each in rest:
        errors = errors.plus(*each.errors_at(machine, errors.targets))
    return errors, axis, first


def _rows(readings: Readings | None, name: str) -> IntArray:
    """The readings of a component."""
    if readings is None or name not in readings.components:
        return np.zeros(0, int)
    return np.flatnonzero(readings.code == readings.components.index(name))


def _columns(
    readings: Readings, rows: IntArray, axis: str
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Position (mm, of a rotary axis deg), direction, error and run of some readings."""
    position = places_read(readings)[0][rows]
    if np.isnan(position).any():
        place = readings.place(rows[np.argmax(np.isnan(position))]) | {"column": "position_mm"}
        raise error("empty-cell", expected="a position", **place)
    group, passes = passes_read(readings, rows, axis)
    direction = readings.direction[rows].astype(np.int64)
    return position, direction, readings.error[rows], passes.runs[group]


def _read(inputs: Inputs, path: Path, control: Controller, parameters: Parameters) -> ErrorTable:
    """A table that exists; raises InputError with the file's name."""
    text, file = _text(inputs, path)
    try:
        return control.read_back(text, parameters)
    except InputError as fault:
        raise InputError([each.at(file=file) for each in fault.findings]) from None


def _text(inputs: Inputs, path: Path) -> tuple[str, str]:
    """The text of a control's file, and its name."""
    source, content = read_source(path, "table")
    inputs.sources.append(source)
    check_text(content, source.shown)
    return content.decode("utf-8-sig"), source.shown


def _skew(inputs: Inputs, parameters: dict[str, str]) -> Outcome:
    """The three lengths of Klipper from an angle between two axes, read back."""
    from mtu_cli.reports.compensate import skew_document

    options, quantum = inputs.options, skew_quantum(parameters)
    if options.read:
        text, file = _text(inputs, options.read)
        return Outcome.of(skew_document(file, read_skew(text), quantum))
    name = (options.component or [""])[0]
    known_name("--component", "component", name, known_names(inputs.machine))
    entry = inputs.machine.machine.components.get(name)
    if entry is None or entry.of is not None or UNITS[entry.unit].dimension == LENGTH:
        expected = "a component without `of`, such as axy"
        raise error("not-applicable", reason=f"{name} is no angle between two axes",
                    expected=expected)  # fmt: skip
    readings, rows = inputs.readings, _rows(inputs.readings, name)
    if entry.coefficients is not None:
        angle = entry.coefficients[0] * UNITS[entry.unit].to_internal
    elif readings is not None and len(rows):
        angle = float(readings.error[rows].mean())
    else:
        expected = "readings of it, or coefficients in the machine file"
        raise error("missing-input", what=f"an estimate of {name}", expected=expected)
    text = write_skew(angle, parameters)
    readback = read_skew(text)
    if abs(readback - angle) > quantum / 2:
        raise error("not-writable", reason=f"read back it is {readback:.9g} rad, not {angle:.9g}")
    files = {options.to_file: text.encode()} if options.to_file else {}
    return Outcome.of(skew_document(name, readback, quantum), files=lambda: files)
