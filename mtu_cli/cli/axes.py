"""The tests of axes, and what follows: `mtu iso230`, `mtu circular`, and the tables of controls
(`mtu compensate`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.analyses import compensate as analysis
from mtu_cli.analyses import iso230 as positioning
from mtu_cli.cli.analyse import fitted
from mtu_cli.cli.emit import Result
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import BESIDE
from mtu_cli.cli.values import assignments, known_name, number_of
from mtu_cli.files.readings import PLANES, WAYS, Readings, read_traces
from mtu_cli.files.source import check_text, read_source, report_bytes, shown_path
from mtu_cli.files.study import InstrumentBudget, load_study
from mtu_cli.findings import InputError, error, listed
from mtu_cli.formats.control import CONTROLLERS, NAMES
from mtu_cli.formats.control.errors import Controller, Parameters
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.model.fit import Stated, known_names, stated
from mtu_cli.model.visits import passes_read
from mtu_cli.reports.document import envelope
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.units import LENGTH, UNITS

XML_BLANKS = b"\xef\xbb\xbf \t\r\n"
DWELL_S = 3.0
ROTARY = "c"
"""The axis of readings with position_deg, where --set axis does not name it."""


def iso230(inputs: Inputs) -> Result:
    options = inputs.options
    if (options.plan is None) != (options.pitch is None):
        option, other = ("--plan", "--pitch") if options.pitch is None else ("--pitch", "--plan")
        raise error("incomplete", what=option, other=other, expected=f"{other} MM, too")
    if options.plan is not None:
        plan = positioning.plan(options.plan, options.pitch)
        result = positioning.Iso230Result(axes={}, plan=plan)
        return Result.reported(inputs, result)
    readings = inputs.readings
    if readings is None:
        raise inputs.missing("--laser FILE or --lbb FILE", "laser", "lbb")
    figures = list(positioning.STANDARDS[options.standard])
    names = [f"{x.name}.{each}" for x in positioning.axes_of(readings)[0] for each in figures]
    limits = assignments(
        "--limit", options.limit, "NAME=VALUE", f"{figures[0]}=10",
        lambda name, text: number_of(f"--limit {name}", text, positive=True),
        [*figures, *names], "figure",
    )  # fmt: skip
    result = positioning.evaluate_all(
        readings,
        budget=_budget(inputs),
        before=inputs.before,
        limits=limits,
        k=inputs.settings.coverage_factor,
        seed=inputs.settings.seed,
        standard=options.standard,
    )
    # What the checks of all readings have reported is not repeated.
    reported = {(x.code, x.facts.get("what")) for x in inputs.suspicions}
    warnings = [x for x in result.warnings if (x.code, x.facts.get("what")) not in reported]
    result = replace(result, warnings=tuple(warnings))

    def nonconforming(_: float) -> str | None:
        if not result.decisions:
            raise error("gate-undefined", gate="nonconforming", expected="--limit A=10, say")
        failures = [f"{x.name} of {axis.name} {abs(x.value) / x.size:.4g} {x.unit}"
                    for axis, x in result.decisions if x.verdict == "nonconforming"]  # fmt: skip
        return f"beyond the limit by ISO 14253-1: {listed(failures)}" if failures else None

    return Result.reported(inputs, result, gates={"nonconforming": nonconforming})


def _budget(inputs: Inputs) -> InstrumentBudget | None:
    """The instrument's budget: of --budget, else of the study."""
    path = inputs.options.budget
    if path is None:
        return inputs.study.study.budget if inputs.study else None
    loaded = inputs.entered(load_study(path, "budget"))
    if loaded.study.budget is None:
        expected = "budget: {device_U_um_per_m: 0.5, ...}"
        raise error("missing-key", file=loaded.source.shown, key="budget", expected=expected)
    return loaded.study.budget


def circular(inputs: Inputs) -> Result:
    """A circular test: figures of its traces and their causes, or the features of a ballbar."""
    from mtu_cli.analyses.circular import diagnose
    from mtu_cli.reports import standards as report

    options = inputs.options

    def words(name: str) -> list[str]:
        text = options.values.get(name)
        return [each.strip() for each in text.split(",")] if text else []

    ways = [known_name("--direction", "direction", x.lower(), WAYS) for x in words("direction")]
    planes = [known_name("--plane", "plane", x.upper(), PLANES) for x in words("plane")]
    feeds, pitches = (
        [number_of(f"--{name}", text, positive=True) for text in words(name)]
        for name in ("feed", "pitch")
    )
    if len(pitches) > 2:
        count = f"{len(pitches)} values"
        raise error("wrong-count", path="--pitch", found=count, expected="one, or one of each axis")
    paths = options.file
    xml = [path.is_file() and path.read_bytes().lstrip(XML_BLANKS)[:1] == b"<" for path in paths]
    if any(xml):
        if not all(xml):
            names = "traces and a ballbar's stated features"
            raise error("exclusive", names=names, expected="a call for each")
        return _ballbar(inputs, paths, planes)
    radius = [] if options.radius is None else [options.radius]
    traces = read_traces(paths, direction=ways, feed=feeds, radius=radius, plane=planes)
    inputs.entered(traces)
    target = options.write_components
    if target is not None and not traces.plane:
        expected = "--plane XY, YZ or ZX, or a column 'plane'"
        raise error("missing-input", what="the plane", expected=expected)
    result = diagnose(traces, (pitches[0], pitches[-1]) if pitches else None)

    files = {}
    if target is not None:
        record = envelope("fit-components", inputs=traces.sources, settings=inputs.settings,
                          results=report.components(result), warnings=result.warnings)  # fmt: skip
        files[target] = report_bytes(record)
    return Result.reported(inputs, result, files=files)


def _ballbar(inputs: Inputs, paths: Iterable[Path], planes: Sequence[str]) -> Result:
    """The features that a ballbar states, in its own units and with its own signs."""
    from mtu_cli.formats.base import raw_file
    from mtu_cli.formats.renishaw import features_of
    from mtu_cli.reports.standards import stated_document

    if inputs.options.write_components:
        expected = "a CSV of traces: the sign of stated features is not known"
        raise error("missing-input", what="a trace", expected=expected)
    contents = {}
    for path in paths:
        file = inputs.entered(raw_file(path, "traces"))
        content = contents[file.source.shown] = features_of(file)
        test_plane = str(content.get("test_plane") or "")
        for plane in planes:
            if test_plane and plane != test_plane.upper():
                raise file.error("contradicts", path="TEST_PLANE", value=test_plane,
                                 other=f"--plane {plane}")  # fmt: skip
    return Result(inputs, stated_document(contents, inputs.settings.digits))


def compensate(inputs: Inputs) -> Result:
    """The table of a control, or with --read the errors in one."""
    options = inputs.options
    feed = number_of("--feed", str(options.feed), positive=True)
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
        table = _read(inputs, options.read, lambda text: control.read_back(text, parameters))
        result = analysis.CompensateResult(
            component=options.read.name, controller=control, asked=table, held=table,
            direction="both" if table.both else "mean",
        )  # fmt: skip
        return Result.reported(inputs, result)
    if not options.component:
        raise error("missing-input", what="the component", expected="--component NAME")
    frame = analysis.Frame(zero=options.machine_zero, reverse=options.reverse_axis)
    request = analysis.TableRequest(
        direction=options.direction, positions=_positions(inputs), reference=options.reference,
        frame=frame,
    )  # fmt: skip
    errors, summands = _errors(inputs, request, overrides.get("axis", ROTARY).lower())
    first = summands[0]
    _name_axis(inputs, first, control, parameters, overrides)
    if options.current:
        current = _read(inputs, options.current, lambda text: control.read_back(text, parameters))
        request = replace(request, current=current)
    # Type 0 where --set names none: a file does not show its type.
    parameters["type"] = parameters.get("type") or "0"
    plan = result = analysis.compensate(
        errors, control, parameters, request, component=" + ".join(x.name for x in summands),
        seed=inputs.settings.seed, trials=inputs.settings.trials,
    )  # fmt: skip
    if readings := inputs.verify:
        file = ", ".join(source.shown for source in readings.sources)
        if first.name not in readings.components:
            components = ", ".join(readings.components)
            reason = f"--verify holds readings of {components}, not of {first.name}"
            raise error("not-applicable", reason=reason, file=file)
        columns = _columns(readings, _rows(readings, first.name), first.axis)
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
        program = analysis.moves_program(plan, feed, DWELL_S, first.axis.upper(), frame)
        files[options.to_nc] = program.encode()
    return Result.reported(inputs, result, files=files)


def _name_axis(
    inputs: Inputs, first: Stated, control: Controller, parameters: dict[str, str],
    overrides: Parameters,
) -> None:  # fmt: skip
    """The axis and the ISO 230-1 name of the component, where the control wants them: `parameters`
    hold those of X, and axes that a control numbers are counted on from it.
    """
    name, axis, output = first.name, first.axis, first.output
    of_x = "" if "axis" in overrides else parameters.get("axis", "")
    if of_x.startswith("X"):
        parameters["axis"] = axis.upper() + of_x[1:]
    elif of_x:
        parameters["axis"] = f"{of_x[:-1]}{int(of_x[-1]) + 'xyzabc'.index(axis)}"
    if "error" in parameters and not parameters["error"]:
        component = inputs.machine.machine.components.get(name)
        iso_name = "" if first.angle else f"E{output}{axis}".upper()
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
    inputs: Inputs, request: analysis.TableRequest, rotary: str
) -> tuple[analysis.AxisErrors, list[Stated]]:
    """Errors by the readings of one component, else by the machine, plus those of the others; and
    what they are of, that component first.
    """
    machine, readings = inputs.machine, inputs.readings
    names = sorted(inputs.options.component, key=lambda name: not len(_rows(readings, name)))
    with_readings = [name for name in names if len(_rows(readings, name))]
    if with_readings[1:]:
        reason = (
            f"there are readings of {' and '.join(with_readings)}: those of one are compensated"
        )
        raise error("not-applicable", reason=reason, expected="one of them")
    component, rows = machine.machine.components.get(names[0]), _rows(readings, names[0])
    if readings and positioning.places_read(readings)[1][rows].any():
        if names[1:]:
            reason = f"{names[0]} is of a rotary axis: nothing is added to its readings"
            raise error("not-applicable", reason=reason)
        angle = component is not None and UNITS[component.unit].dimension != LENGTH
        columns = _columns(readings, rows, rotary)
        summands = [Stated(name=names[0], axis=rotary, output=rotary)]
        return analysis.axis_errors(*columns, angle=angle, rotary=True), summands
    summands = [stated(machine, name) for name in names]
    first, rest = summands[0], summands
    if any(each.axis != first.axis for each in rest):
        raise error("not-applicable", reason=f"{', '.join(names)} are not along one axis")
    if readings and len(rows):
        errors = analysis.axis_errors(*_columns(readings, rows, first.axis), angle=first.angle)
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
    return errors, summands


def _rows(readings: Readings | None, name: str) -> IntArray:
    """The readings of a component."""
    if readings is None or name not in readings.components:
        return np.zeros(0, int)
    return np.flatnonzero(readings.code == readings.components.index(name))


def _columns(
    readings: Readings, rows: IntArray, axis: str
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Position (mm, of a rotary axis deg), direction, error and run of some readings."""
    position = positioning.places_read(readings)[0][rows]
    if np.isnan(position).any():
        place = readings.place(rows[np.argmax(np.isnan(position))]) | {"column": "position_mm"}
        raise error("empty-cell", expected="a position", **place)
    group, passes = passes_read(readings, rows, axis)
    direction = readings.direction[rows].astype(np.int64)
    return position, direction, readings.error[rows], passes.runs[group]


def _read(inputs: Inputs, path: Path, reader: Callable[[str], Any]) -> Any:
    """What a control's file holds for its reader; raises InputError with the file's name."""
    source, content = read_source(path, "table")
    inputs.sources.append(source)
    check_text(content, source.shown)
    try:
        return reader(content.decode("utf-8-sig"))
    except InputError as fault:
        raise InputError([each.at(file=source.shown) for each in fault.findings]) from None


def _skew(inputs: Inputs, parameters: dict[str, str]) -> Result:
    """The three lengths of Klipper from an angle between two axes, read back."""
    from mtu_cli.reports.compensate import skew_document

    options, quantum = inputs.options, skew_quantum(parameters)
    if options.read:
        angle, name = _read(inputs, options.read, read_skew), shown_path(options.read)
        return Result(inputs, skew_document(name, angle, quantum))
    name = (options.component or [""])[0]
    known_name("--component", "component", name, known_names(inputs.machine))
    entry = inputs.machine.machine.components.get(name)
    if entry is None or entry.of is not None or UNITS[entry.unit].dimension == LENGTH:
        expected = "a component without `of`, such as axy"
        raise error("not-applicable", reason=f"{name} is no angle between two axes",
                    expected=expected)  # fmt: skip
    estimate = fitted(inputs, inputs.machine).estimates.components.get(name)
    if estimate is None:
        expected = "readings of it, or coefficients in the machine file"
        raise error("missing-input", what=f"an estimate of {name}", expected=expected)
    angle = float(estimate.coefficients[0])
    text = write_skew(angle, parameters)
    readback = read_skew(text)
    if abs(readback - angle) > quantum / 2:
        raise error("not-writable", reason=f"read back it is {readback:.9g} rad, not {angle:.9g}")
    files = {options.to_file: text.encode()} if options.to_file else {}
    return Result(inputs, skew_document(name, readback, quantum), files=files)
