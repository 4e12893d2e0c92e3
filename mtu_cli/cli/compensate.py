"""`mtu compensate`: readings or stated errors to a control's table, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.compensate import (
    AxisErrors,
    CompensateResult,
    Frame,
    Wanted,
    axis_errors,
    moves_program,
    verify,
)
from mtu_cli.analyses.compensate import (
    compensate as analysis,
)
from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import option_name
from mtu_cli.cli.values import assigned, known_name
from mtu_cli.files.source import check_text, read_source
from mtu_cli.findings import InputError, error
from mtu_cli.formats.control import CONTROLLERS, KLIPPER, NAMES
from mtu_cli.formats.control.errors import Controller, ErrorTable
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.model.passes import passes_read
from mtu_cli.model.settings import Settings
from mtu_cli.model.stated_errors import (
    axis_of,
    default_positions,
    known_names,
    output_of,
    stated_errors,
)
from mtu_cli.units import LENGTH, UNITS

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

DIRECTIONS = ("both", "mean", "forward")
PLACES = ("from_", "to", "step", "reference", "machine_zero")
"""Options that are positions."""
FEED, DWELL_S = 1000.0, 3.0


def compensate(inputs: Inputs, settings: Settings) -> Outcome:
    """The table of a control, or with --read what one says."""
    from mtu_cli.reports import compensate as report

    options = inputs.options
    for name in PLACES:
        if not np.isfinite(options.values.get(name) or 0.0):
            place = {"path": option_name(name), "value": str(options.values[name])}
            raise error("out-of-range", **place, expected="a finite position, mm")
    if options.for_ is None:
        raise error("missing-input", what="the control", expected="--for CONTROLLER")
    known_name("--for", "controller", options.for_, NAMES)
    defaults = DEFAULTS if options.for_ == KLIPPER else CONTROLLERS[options.for_].parameters
    given = assigned(
        "--set", options.set, "=", "NAME=VALUE", "axis=X", lambda _, x: x, defaults, "parameter"
    )
    if options.for_ == KLIPPER:
        return _skew(inputs, {**defaults, **given})
    control, parameters = CONTROLLERS[options.for_], {**defaults, **given}
    if options.read:
        table = _read(inputs, options.read, control, parameters)
        result = report.listing(control, table, str(options.read.name))
        return Outcome.of(report.document(result, settings.digits))
    if options.direction is not None:
        known_name("--direction", "direction", options.direction, DIRECTIONS)
    # Type 0 is written where nothing is said; a file does not show which it is.
    current = _read(inputs, options.current, control, parameters) if options.current else None
    parameters = {**parameters, "type": parameters.get("type") or "0"}
    frame = Frame(zero=options.machine_zero or 0.0, reverse=bool(options.reverse_axis))
    wanted = Wanted(
        direction=options.direction,
        positions=_positions(inputs),
        reference=options.reference,
        frame=frame,
        current=current,
    )
    names = options.component or []
    if not names:
        raise error("missing-input", what="the component", expected="--component NAME")
    errors, axis = _errors(inputs, names, wanted)
    parameters = _named_axis(inputs, names[0], axis, control, parameters, given)
    label = " + ".join(names)
    result = analysis(
        errors, control, parameters, wanted, component=label, seed=settings.seed,
        trials=settings.trials,
    )  # fmt: skip
    if options.verify:
        result = _verified(inputs, result, wanted, names[0], axis)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=result.warnings,
        files=lambda: _files(inputs, result, control, axis, frame),
    )


def _named_axis(
    inputs: Inputs,
    name: str,
    axis: str,
    control: Controller,
    parameters: dict[str, str],
    given: dict[str, str],
) -> dict[str, str]:
    """The axis letter and the ISO 230-1 name of the component, where the control wants them."""
    found = dict(parameters)
    component = inputs.machine.machine.components.get(name)
    if "axis" not in given and parameters.get("axis") == "X":
        found["axis"] = axis.upper()
    output = output_of(inputs.machine, name, axis)
    if "error" in parameters and not parameters["error"]:
        length = component is None or UNITS[component.unit].dimension == LENGTH
        own = f"E{output}{axis}".upper() if length else ""
        found["error"] = (component and component.iso) or own
    elif output != axis and not control.listing:
        reason = f"{name} is an error in {output} along {axis}: no table of one axis"
        raise error("not-applicable", reason=reason, expected="--for isg-csv, etalon or table")
    return found


def _positions(inputs: Inputs) -> tuple[float, float, float] | None:
    options = inputs.options
    given = (options.from_, options.to, options.step)
    if all(each is None for each in given):
        return None
    if None in given:
        raise error("incomplete", what="one of --from, --to, --step", other="the other two")
    low, high, step = given
    count = (high - low) / step if step > 0 else -1.0
    if not 1 <= count <= 10_000 or abs(count - round(count)) > 1e-6:
        value = f"{low:g} to {high:g} by {step:g} mm"
        expected = "--to above --from by a whole number of steps, at most 10000"
        raise error("out-of-range", path="--step", value=value, expected=expected)
    return given


def _errors(inputs: Inputs, names: list[str], wanted: Wanted) -> tuple[AxisErrors, str]:
    """Of the first name readings where there are any, else what the machine file states; of the
    others what it states, added.
    """
    machine = inputs.machine
    for name in names:
        axis_of(machine, name)
    axes = {axis_of(machine, name) for name in names}
    if len(axes) > 1:
        raise error("not-applicable", reason=f"{', '.join(names)} are not along one axis")
    axis, first = axes.pop(), names[0]
    readings = inputs.readings if inputs.files("lbb") or inputs.files("laser") else None
    errors = None if readings is None else _of_readings(readings, first, axis, inputs)
    if errors is None:
        positions = default_positions(machine, first, axis)
        if wanted.positions is not None:
            low, high, step = wanted.positions
            at = low + step * np.arange(round((high - low) / step) + 1) - wanted.frame.zero
            positions = np.asarray(-at[::-1] if wanted.frame.reverse else at)
        rest, T = names, len(positions)
        angle = machine.machine.components.get(first)
        errors = AxisErrors(
            targets=positions,
            means=np.zeros((2, T)),
            ways=1,
            runs=1,
            known=np.zeros((2 * T, 2 * T)),
            angle=angle is not None and UNITS[angle.unit].dimension != LENGTH,
            read=False,
        )
    else:
        rest = names[1:]
    for name in rest:
        own = stated_errors(machine, name, errors.targets)
        known = own.covariance if errors.known is None else errors.known + own.covariance
        ways = 2 if own.turns else errors.ways
        errors = replace(errors, means=errors.means + own.values, ways=ways, known=known)
    return errors, axis


def _of_readings(readings: Readings, name: str, axis: str, inputs: Inputs) -> AxisErrors | None:
    if name not in readings.components:
        return None
    rows = np.flatnonzero(readings.code == readings.components.index(name))
    if not len(rows):
        return None
    group, passes = passes_read(readings, rows, axis)
    angle = UNITS[inputs.machine.machine.components[name].unit].dimension != LENGTH
    return axis_errors(
        readings.position_mm[rows],
        readings.direction[rows].astype(np.int64),
        readings.error[rows],
        passes.runs[group],
        angle=angle,
    )


def _read(inputs: Inputs, path: Path, control: Controller, parameters: Any) -> ErrorTable:
    """A table that exists; raises InputError with the file's name."""
    source, content = read_source(path, "table")
    inputs.sources.append(source)
    check_text(content, source.shown)
    try:
        return control.read_back(content.decode("utf-8-sig"), parameters)
    except InputError as fault:
        raise InputError([each.at(file=source.shown) for each in fault.findings]) from None


def _verified(
    inputs: Inputs, result: CompensateResult, wanted: Wanted, name: str, axis: str
) -> CompensateResult:
    from mtu_cli.files.readings import read_readings

    known = inputs.machine.machine.components
    readings = read_readings([(inputs.options.verify, "laser")], known, for_fit=False)
    inputs.sources.extend(readings.sources)
    rows = np.arange(len(readings))
    if name in readings.components:
        rows = np.flatnonzero(readings.code == readings.components.index(name))
    group, passes = passes_read(readings, rows, axis)
    assert result.errors is not None
    applied = wanted.frame.applied(result.held, result.errors.targets)
    if wanted.current is not None:
        applied = applied - wanted.frame.applied(wanted.current, result.errors.targets)
    verified = verify(
        result,
        applied,
        readings.position_mm[rows],
        readings.direction[rows].astype(np.int64),
        readings.error[rows],
        passes.runs[group],
    )
    return replace(result, verified=verified)


def _files(
    inputs: Inputs, result: CompensateResult, control: Controller, axis: str, frame: Frame
) -> dict[Path, bytes]:
    """The table, beside it what cannot stand in it, and the program of the moves."""
    options, found = inputs.options, {}
    if options.to_file:
        found[options.to_file] = result.text.encode()
        if not control.comment:
            beside = options.to_file.with_name(f"{options.to_file.name}.txt")
            found[beside] = f"{control.says}\n{frame.says}\n".encode()
    if options.to_nc:
        program = moves_program(result, FEED, DWELL_S, axis.upper())
        found[options.to_nc] = program.encode()
    return found


def _skew(inputs: Inputs, parameters: dict[str, str]) -> Outcome:
    """The three lengths of Klipper from an angle between two axes, read back."""
    from mtu_cli.reports import compensate as report

    options, quantum = inputs.options, skew_quantum(parameters)
    if options.read:
        source, content = read_source(options.read, "table")
        inputs.sources.append(source)
        check_text(content, source.shown)
        return Outcome.of(report.skew_document(source.shown, read_skew(content.decode()), quantum))
    name = (options.component or [""])[0]
    machine = inputs.machine
    known_name("--component", "component", name, known_names(machine))
    entry = machine.machine.components.get(name)
    if entry is None or entry.of is not None or UNITS[entry.unit].dimension == LENGTH:
        reason = f"{name} is no angle between two axes"
        raise error(
            "not-applicable", reason=reason, expected="a component without `of`, such as axy"
        )
    if entry.coefficients is not None:
        angle = entry.coefficients[0] * UNITS[entry.unit].to_internal
    else:
        readings = inputs.readings
        if readings is None or name not in readings.components:
            expected = "readings of it, or coefficients in the machine file"
            raise error("missing-input", what=f"an estimate of {name}", expected=expected)
        rows = readings.code == readings.components.index(name)
        angle = float(readings.error[rows].mean())
    text = write_skew(angle, parameters)
    held = read_skew(text)
    if abs(held - angle) > quantum / 2:
        raise error("not-writable", reason=f"read back it is {held:.9g} rad, not {angle:.9g}")
    return Outcome.of(
        report.skew_document(name, held, quantum),
        files=lambda: {options.to_file: text.encode()} if options.to_file else {},
    )
