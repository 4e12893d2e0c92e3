"""The tests of ISO 230: positioning (`mtu iso230`) and circles (`mtu circular`)."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.values import above_zero, assigned, known_name
from mtu_cli.files.source import begins_with
from mtu_cli.findings import error, listed
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.analyses.iso230 import Iso230Result
    from mtu_cli.files.study import InstrumentBudget


def iso230(inputs: Inputs, settings: Settings) -> Outcome:
    """Positioning figures of every component read at targets, or a plan of targets."""
    from mtu_cli.analyses import iso230 as analysis
    from mtu_cli.reports import iso230 as report

    options = inputs.options
    standard = options.standard or analysis.STANDARDS[0]
    known_name("--standard", "standard", standard, analysis.STANDARDS)
    if (options.plan is None) != (options.pitch is None):
        given, lacks = ("--plan", "--pitch") if options.pitch is None else ("--pitch", "--plan")
        raise error("incomplete", what=given, other=lacks, expected=f"{lacks} MM, too")
    if options.plan is not None:
        plan = analysis.plan(options.plan, options.pitch)
        result = analysis.Iso230Result(axes={}, plan=plan)
        return Outcome.of(report.document(result, settings.digits))
    readings = inputs.readings
    if readings is None:
        raise inputs.missing("--laser FILE or --lbb FILE", "laser", "lbb")
    figures = list(analysis.FIGURES)
    names = [f"{x.name}.{each}" for x in analysis.tests_of(readings)[0] for each in figures]
    result = analysis.evaluate_all(
        readings,
        budget=_budget(inputs),
        before=inputs.before,
        limits=assigned(
            "--limit",
            options.limit,
            "=",
            "NAME=VALUE",
            "A=10",
            lambda name, text: above_zero(f"--limit {name}", text),
            [*figures, *names],
            "figure",
        ),
        k=settings.coverage_factor,
        seed=settings.seed,
        standard=standard,
    )
    # What the checks of all readings have reported is not said twice.
    known = {x.facts["what"] for x in inputs.suspicions if x.code == "outlying-value"}
    warnings = [x for x in result.warnings
                if x.code != "outlying-value" or x.facts["what"] not in known]  # fmt: skip
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=warnings,
        gates={"nonconforming": lambda _: _nonconforming(result)},
    )


def _budget(inputs: Inputs) -> InstrumentBudget | None:
    """The instrument's budget: of --budget, else of the study."""
    from mtu_cli.files.study import load_study

    path = inputs.options.budget
    if path is None:
        return inputs.study.study.budget if inputs.study else None
    loaded = load_study(path, "budget")
    inputs.sources.append(loaded.source)
    if loaded.study.budget is None:
        expected = "budget: {device_U_um_per_m: 0.5, ...}"
        raise error("missing-key", file=loaded.source.shown, key="budget", expected=expected)
    return loaded.study.budget


def _nonconforming(result: Iso230Result) -> str | None:
    """Figures that are proven not to conform."""
    if not result.decisions:
        raise error("gate-undefined", gate="nonconforming", expected="--limit A=10, say")
    found = [
        f"{x.figure} of {x.component} {x.value / x.size:.4g} {x.unit}"
        for x in result.decisions
        if x.verdict == "nonconforming"
    ]
    return f"beyond the limit by ISO 14253-1: {listed(found)}" if found else None


def circular(inputs: Inputs, settings: Settings) -> Outcome:
    """A circular test: figures of its traces and their causes, beside what a ballbar states."""
    from mtu_cli.analyses.circular import diagnose
    from mtu_cli.files.traces import PLANES, WAYS, Traces, read_traces, words
    from mtu_cli.reports import circular as report

    options = inputs.options
    ways = words(options.direction, str.lower)
    plane = options.plane.upper() if options.plane else None
    for way in ways:
        known_name("--direction", "direction", way, WAYS)
    if plane is not None:
        known_name("--plane", "plane", plane, PLANES)
    feeds = words(options.feed, partial(above_zero, "--feed"))
    pitches = words(options.pitch, partial(above_zero, "--pitch"))
    if len(pitches) > 2:
        found = f"{len(pitches)} values"
        raise error("wrong-count", path="--pitch", found=found, expected="one, or one of each axis")
    files = options.file if isinstance(options.file, list | tuple) else [options.file]
    features, stated = _ballbar(inputs, [path for path in files if _is_xml(path)])
    files = [path for path in files if not _is_xml(path)]
    if plane and stated and plane != stated:
        place = {"path": "--plane", "value": plane, "expected": stated}
        raise error("contradicts", other="the ballbar's file", **place)
    traces = Traces(traces=(), plane=plane or stated, radius=math.nan, sources=())
    if files:
        traces = read_traces(files, direction=ways, feed=feeds, radius=options.radius,
                             plane=plane or stated)  # fmt: skip
        inputs.sources.extend(traces.sources)
    target = options.write_components
    if target is not None and not (files and traces.plane):
        what, expected = "the plane", "--plane XY, YZ or ZX, or a column 'plane'"
        if not files:
            what, expected = "a trace", "a CSV of traces: the sign of stated features is not known"
        raise error("missing-input", what=what, expected=expected)
    result = diagnose(traces, (pitches[0], pitches[-1]) if pitches else None, features)

    def components() -> dict[Path, bytes]:
        from mtu_cli.files.write import report_bytes
        from mtu_cli.reports.document import envelope

        if target is None:
            return {}
        found = envelope(
            "fit-components",
            inputs=traces.sources,
            settings=settings,
            results=report.components(result),
            warnings=result.warnings,
        )
        return {target: report_bytes(found)}

    document = report.document(result, settings.digits)
    return Outcome.of(document, warnings=result.warnings, files=components)


def _is_xml(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0 and begins_with(path, "<")


def _ballbar(
    inputs: Inputs, paths: list[Path]
) -> tuple[dict[str, dict[str, dict[str, Any]]], str | None]:
    """The features that a ballbar states, by file and feature, and their plane."""
    from mtu_cli.formats.base import raw_file
    from mtu_cli.formats.renishaw import features_of

    result, planes = {}, dict[str, str]()
    for path in paths:
        file = raw_file(path, "traces")
        inputs.sources.append(file.source)
        known = features_of(file)
        result[file.source.shown] = known["features"]
        if "test_plane" in known:
            planes.setdefault(known["test_plane"].upper(), file.source.shown)
    if len(planes) > 1:
        (one, _), (other, file_) = [*planes.items()][:2]
        raise error("contradicts", file=file_, other="another file", value=other, expected=one)
    return result, next(iter(planes), None)
