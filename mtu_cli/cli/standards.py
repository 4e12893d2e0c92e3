"""The tests of ISO 230: positioning (`mtu iso230`) and circles (`mtu circular`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.values import above_zero, assignments, known_name
from mtu_cli.files.source import report_bytes
from mtu_cli.files.study import InstrumentBudget, load_study
from mtu_cli.findings import error, listed
from mtu_cli.model.settings import Settings
from mtu_cli.reports.document import envelope

XML_BLANKS = b"\xef\xbb\xbf \t\r\n"


def iso230(inputs: Inputs, settings: Settings) -> Outcome:
    """Positioning figures of every component read at targets, or a plan of targets."""
    from mtu_cli.analyses import iso230 as analysis
    from mtu_cli.reports.standards import positioning

    options = inputs.options
    standard = known_name("--standard", "standard", options.standard, analysis.STANDARDS)
    if (options.plan is None) != (options.pitch is None):
        option, other = ("--plan", "--pitch") if options.pitch is None else ("--pitch", "--plan")
        raise error("incomplete", what=option, other=other, expected=f"{other} MM, too")
    if options.plan is not None:
        result = analysis.Iso230Result(axes={}, plan=analysis.plan(options.plan, options.pitch))
        return Outcome.of(positioning(result, settings.digits))
    readings = inputs.readings
    if readings is None:
        raise inputs.missing("--laser FILE or --lbb FILE", "laser", "lbb")
    figures = list(analysis.STANDARDS[standard])
    names = [f"{x.name}.{each}" for x in analysis.axes_of(readings)[0] for each in figures]
    limits = assignments(
        "--limit", options.limit, "NAME=VALUE", f"{figures[0]}=10",
        lambda name, text: above_zero(f"--limit {name}", text), [*figures, *names], "figure",
    )  # fmt: skip
    result = analysis.evaluate_all(
        readings,
        budget=_budget(inputs),
        before=inputs.before,
        limits=limits,
        k=settings.coverage_factor,
        seed=settings.seed,
        standard=standard,
    )
    # What the checks of all readings have reported is not repeated.
    outliers = {x.facts["what"] for x in inputs.suspicions if x.code == "outlying-value"}
    warnings = [x for x in result.warnings
                if x.code != "outlying-value" or x.facts["what"] not in outliers]  # fmt: skip
    result = replace(result, warnings=tuple(warnings))

    def nonconforming(_: float) -> str | None:
        if not result.decisions:
            raise error("gate-undefined", gate="nonconforming", expected="--limit A=10, say")
        failures = [f"{x.name} of {axis.name} {abs(x.value) / x.size:.4g} {x.unit}"
                    for axis, x in result.decisions if x.verdict == "nonconforming"]  # fmt: skip
        return f"beyond the limit by ISO 14253-1: {listed(failures)}" if failures else None

    document, gates = positioning(result, settings.digits), {"nonconforming": nonconforming}
    return Outcome.of(document, warnings=result.warnings, gates=gates)


def _budget(inputs: Inputs) -> InstrumentBudget | None:
    """The instrument's budget: of --budget, else of the study."""
    path = inputs.options.budget
    if path is None:
        return inputs.study.study.budget if inputs.study else None
    loaded = load_study(path, "budget")
    inputs.sources.append(loaded.source)
    if loaded.study.budget is None:
        expected = "budget: {device_U_um_per_m: 0.5, ...}"
        raise error("missing-key", file=loaded.source.shown, key="budget", expected=expected)
    return loaded.study.budget


def circular(inputs: Inputs, settings: Settings) -> Outcome:
    """A circular test: figures of its traces and their causes, or the features of a ballbar."""
    from mtu_cli.analyses.circular import CircularResult, diagnose
    from mtu_cli.files.readings import PLANES, WAYS, read_traces
    from mtu_cli.reports import standards as report

    options = inputs.options
    ways = _words(
        options.direction, lambda x: known_name("--direction", "direction", x.lower(), WAYS)
    )
    planes = _words(options.plane, lambda x: known_name("--plane", "plane", x.upper(), PLANES))
    feeds = _words(options.feed, partial(above_zero, "--feed"))
    pitches = _words(options.pitch, partial(above_zero, "--pitch"))
    if len(pitches) > 2:
        count = f"{len(pitches)} values"
        raise error("wrong-count", path="--pitch", found=count, expected="one, or one of each axis")
    paths = options.file
    xml = [path.is_file() and path.read_bytes().lstrip(XML_BLANKS)[:1] == b"<" for path in paths]
    if any(xml):
        if not all(xml):
            names = "traces and a ballbar's stated features"
            raise error("exclusive", names=names, expected="a call for each")
        return _ballbar(inputs, settings, paths, planes)
    radius = [] if options.radius is None else [options.radius]
    traces = read_traces(paths, direction=ways, feed=feeds, radius=radius, plane=planes)
    inputs.sources.extend(traces.sources)
    target = options.write_components
    if target is not None and not traces.plane:
        expected = "--plane XY, YZ or ZX, or a column 'plane'"
        raise error("missing-input", what="the plane", expected=expected)
    result: CircularResult = diagnose(traces, (pitches[0], pitches[-1]) if pitches else None)

    files = {}
    if target is not None:
        record = envelope("fit-components", inputs=traces.sources, settings=settings,
                          results=report.components(result), warnings=result.warnings)  # fmt: skip
        files[target] = report_bytes(record)
    document = report.circular(result, settings.digits)
    return Outcome.of(document, warnings=result.warnings, files=lambda: files)


def _words(text: str | None, convert: Callable[[str], Any]) -> list[Any]:
    """The values of an option with commas."""
    return [convert(each.strip()) for each in text.split(",")] if text else []


def _ballbar(
    inputs: Inputs, settings: Settings, paths: Iterable[Path], planes: Sequence[str]
) -> Outcome:
    """The features that a ballbar states, in its own units and with its own signs."""
    from mtu_cli.formats.base import raw_file
    from mtu_cli.formats.renishaw import features_of
    from mtu_cli.reports.standards import stated_document

    if inputs.options.write_components:
        expected = "a CSV of traces: the sign of stated features is not known"
        raise error("missing-input", what="a trace", expected=expected)
    contents = {}
    for path in paths:
        file = raw_file(path, "traces")
        inputs.sources.append(file.source)
        content = contents[file.source.shown] = features_of(file)
        test_plane = str(content.get("test_plane") or "")
        for plane in planes:
            if test_plane and plane != test_plane.upper():
                raise file.error("contradicts", path="TEST_PLANE", value=test_plane,
                                 other=f"--plane {plane}")  # fmt: skip
    return Outcome.of(stated_document(contents, settings.digits))
