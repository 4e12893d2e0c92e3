"""The tests of axes, and what follows: `mtu iso230`, `mtu circular`, and the tables of controls
(`mtu compensate`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mtu_cli.analyses import compensate as analysis
from mtu_cli.analyses import iso230 as positioning
from mtu_cli.analyses.axis_errors import angle_between, errors_of, known_names, readings_along
from mtu_cli.analyses.circular import diagnose
from mtu_cli.cli.analyse import fitted
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import BESIDE
from mtu_cli.cli.values import assignments, known_name, number_of
from mtu_cli.files.readings import PLANES, WAYS, read_traces
from mtu_cli.files.source import check_text, read_source, report_bytes, shown_path
from mtu_cli.files.study import InstrumentBudget, load_study
from mtu_cli.findings import Finding, error, finding, listed, located
from mtu_cli.formats.base import raw_file
from mtu_cli.formats.control import CONTROLLERS, NAMES
from mtu_cli.formats.control.klipper import DEFAULTS, read_skew, skew_quantum, write_skew
from mtu_cli.formats.renishaw import features_of
from mtu_cli.reports.compensate import skew_document
from mtu_cli.reports.document import envelope
from mtu_cli.reports.standards import components, stated_document
from mtu_cli.result import Result

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
    result = diagnose(traces, pitches)

    files = {}
    if target is not None:
        record = envelope("fit-components", inputs=traces.sources, settings=inputs.settings,
                          results=components(result), warnings=result.warnings)  # fmt: skip
        files[target] = report_bytes(record)
    return Result.reported(inputs, result, files=files)


def _ballbar(inputs: Inputs, paths: Iterable[Path], planes: Sequence[str]) -> Result:
    """The features that a ballbar states, in its own units and with its own signs."""
    if inputs.options.write_components:
        expected = "a CSV of traces: the sign of stated features is not known"
        raise error("missing-input", what="a trace", expected=expected)
    files = [inputs.entered(raw_file(path, "traces")) for path in paths]
    contents = {file.source.shown: features_of(file, planes) for file in files}
    return Result(inputs, stated_document(contents, inputs.settings.digits))


def compensate(inputs: Inputs) -> Result:
    """The table of a control, or with --read the errors in one."""
    options = inputs.options
    if options.for_ is None:
        raise error("missing-input", what="the control", expected="--for CONTROLLER")
    known_name("--for", "controller", options.for_, NAMES)
    control = CONTROLLERS.get(options.for_)
    defaults = DEFAULTS if control is None else control.parameters
    given = assignments(
        "--set", options.set, "NAME=VALUE", "axis=X", lambda _, x: x, defaults, "parameter"
    )
    if options.read and options.written.keys() & {"to_file", "to_nc"}:
        names = "--read and --to-file or --to-nc"
        raise error("exclusive", names=names, expected="a call for each")
    if control is None:
        return _skew(inputs, {**defaults, **given})
    if options.read:
        table = _read(inputs, options.read, control.read_back, {**defaults, **given})
        return Result.reported(inputs, analysis.as_read(options.read.name, control, table))
    if not options.component:
        raise error("missing-input", what="the component", expected="--component NAME")
    grid = (options.from_, options.to, options.step)
    places = None if grid == (None, None, None) else analysis.grid(*grid)
    frame = analysis.Frame(zero=options.machine_zero, reverse=options.reverse_axis)
    at = None if places is None else frame.of_machine(places)
    errors, summands = errors_of(
        inputs.machine, inputs.readings, options.component, at, given.get("axis", ROTARY).lower()
    )
    first = summands[0]
    parameters = analysis.named_parameters(inputs.machine, first, control, given)
    current = options.current and _read(inputs, options.current, control.read_back, parameters)
    # Type 0 where --set names none: a file does not show its type.
    parameters["type"] = parameters.get("type") or "0"
    warnings, budget = list[Finding](), _budget(inputs)
    if errors.read and budget is not None and budget.already_at_20 is False:
        reason = f"the table holds the errors as they were read, at {budget.T_mean_degC:g} degC"
        facts = {"what": "the correction to 20 degC", "names": ["budget"], "reason": reason}
        warnings.append(finding("not-used", **facts))
    plan = result = analysis.compensate(
        errors, control, parameters, frame, component=" + ".join(x.name for x in summands),
        direction=options.direction, places=places, reference=options.reference,
        current=current, seed=inputs.settings.seed, trials=inputs.settings.trials,
    )  # fmt: skip
    if readings := inputs.verify:
        file = ", ".join(source.shown for source in readings.sources)
        if first.name not in readings.components:
            components = ", ".join(readings.components)
            reason = f"--verify holds readings of {components}, not of {first.name}"
            raise error("not-applicable", reason=reason, file=file)
        with located(file=file):
            result = analysis.verify(result, *readings_along(readings, first.name, first.axis))

    files, table = dict[Path, bytes](), options.to_file
    if table:
        files[table] = result.text.encode()
    if table and not control.comment:
        companion = table.with_name(f"{table.name}{BESIDE['to_file'][0]}")
        files[companion] = analysis.notes(control, frame, parameters).encode()
    if options.to_nc:
        program = analysis.moves_program(plan, options.feed, DWELL_S, first.axis.upper(), frame)
        files[options.to_nc] = program.encode()
    return Result.reported(inputs, result, warnings, files=files)


def _read(inputs: Inputs, path: Path, reader: Callable[..., Any], *parameters: Any) -> Any:
    """What a control's file holds for its reader; raises InputError with the file's name."""
    source, content = read_source(path, "table")
    inputs.sources.append(source)
    check_text(content, source.shown)
    with located(file=source.shown):
        return reader(content.decode("utf-8-sig"), *parameters)


def _skew(inputs: Inputs, parameters: dict[str, str]) -> Result:
    """The three lengths of Klipper from an angle between two axes, read back."""
    options, quantum = inputs.options, skew_quantum(parameters)
    if options.read:
        angle, name = _read(inputs, options.read, read_skew), shown_path(options.read)
        return Result(inputs, skew_document(name, angle, quantum))
    name = (options.component or [""])[0]
    known_name("--component", "component", name, known_names(inputs.machine))
    angle = angle_between(inputs.machine, fitted(inputs, inputs.machine).estimates, name)
    text = write_skew(angle, parameters)
    files = {options.to_file: text.encode()} if options.to_file else {}
    return Result(inputs, skew_document(name, read_skew(text), quantum), files=files)
