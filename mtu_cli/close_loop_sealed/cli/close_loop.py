"""`mtu close-loop`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.emit import Gate, Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import drift_estimates, modelled
from mtu_cli.close_loop_sealed.bridge import loop_warning
from mtu_cli.close_loop_sealed.cli.close_loop_choices import UNEXPLAINED, Choices, read_choices
from mtu_cli.close_loop_sealed.cli.close_loop_files import FoundOn, Known, written
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable, residual_table
from mtu_cli.close_loop_sealed.model.seen_ranges import column_ranges, seen_ranges
from mtu_cli.findings import Finding, listed
from mtu_cli.model.effect_parameters import effect_warnings, searched_warnings
from mtu_cli.model.fit import (
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
    machine_warnings,
)
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.close_loop_sealed.analyses.loop import CloseLoopResult

CLASS = "class"
OF_READINGS = {"parts": "passes", "columns": "positions"}
"""What rows and columns are called in a machine that was found from readings."""


def close_loop(inputs: Inputs, settings: Settings) -> Outcome:
    """Asks measured data what the model lacks, and adds it to the machine."""
    from mtu_cli.close_loop_sealed.analyses.loop import close_loop as closed
    from mtu_cli.close_loop_sealed.model.effect_library import effect_library
    from mtu_cli.close_loop_sealed.reports import close_loop as report

    choices = read_choices(inputs)
    library = effect_library(inputs.files("effects"))
    tables, found, warnings = _tables(inputs, choices)
    travel = inputs.machine.machine.travels
    tables = tuple(replace(table, travel=travel) for table in tables)
    inputs.sources.extend(library.sources)
    result = closed(
        tables,
        library,
        alpha=choices.alpha,
        max_effects=choices.max_effects,
        exclude=choices.exclude,
        seed=settings.seed,
        progress=settings.progress,
    )
    results = report.document(result)
    worth = _worth(result, results)
    files = written(
        inputs, found, settings, result.effects, result.covariance, worth, _found_on(result)
    )
    return Outcome(
        results=lambda: results,
        tables=lambda detail: report.table(result),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result),
        warnings=[
            *warnings,
            *result.warnings,
            *files.warnings,
            *_doubts(result, bool(files.files)),
        ],
        gates=gates_of(result),
        files=lambda: files.files,
    )


def gates_of(result: CloseLoopResult) -> dict[str, Gate]:
    """Undeclared effects, named or not, meet `found`, but for what is no more than a hint; a
    remainder without a name meets both.
    """
    from mtu_cli.close_loop_sealed.reports.close_loop import gate_text

    return {
        "found": lambda _: gate_text(result) if result.is_found else None,
        UNEXPLAINED: lambda _: gate_text(result) if result.verdict == UNEXPLAINED else None,
    }


def _found_on(result: CloseLoopResult) -> list[FoundOn]:
    """Of each effect the ranges of the columns of its equations, and of others that it holds in."""
    return [
        FoundOn(
            seen=seen_ranges(item.table, effect.equations, {own for own, *_ in effect.parameters}),
            within=column_ranges(item.table, effect.holds_within),
        )
        for item in result.tables
        for effect in item.effects
    ]


def _doubts(result: CloseLoopResult, written: bool) -> list[Finding]:
    """Of a machine that holds an effect which is one of several, or only a hint. One that stands
    by itself is neither, whatever has no name beside it.
    """
    if not written:
        return []
    from mtu_cli.close_loop_sealed.analyses.loop.shown import own_verdict

    own: dict[str, list[str]] = {}
    for item in result.tables:
        for effect in item.effects:
            if effect.equations:
                of = f"{item.table.component} " if item.table.component else ""
                own.setdefault(own_verdict(effect, item), []).append(f"{of}{effect.name}")
    hints = "what is written"
    if len(own) > 1:
        hints = f"of what is written {listed(own.get(UNEXPLAINED, []))}"
    doubts = {
        UNEXPLAINED: f"{hints} is a hint: something may be there that no effect describes",
        CLASS: "of effects that this data cannot tell apart, the likeliest is written",
    }
    return [
        loop_warning(code=f"written-{verdict}", message=text)
        for verdict, text in doubts.items()
        if verdict in own
    ]


def _worth(result: CloseLoopResult, results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Of each effect the error before and after, of its own component where there are several.

    It is in sample where `by` is None: nothing could be held out.
    """
    found = []
    for item, scored in zip(result.tables, results["tables"] or [results], strict=True):
        rms = f"rms_{item.table.unit}"
        own = {key: {rms: scored[key][rms]} for key in ("before", "after")}
        by = item.held_out_by
        if item.table.component is not None and by is not None:
            by = OF_READINGS.get(by, by)
        found += [{"by": by, **own}] * len(item.effects)
    return found


def _tables(
    inputs: Inputs, choices: Choices
) -> tuple[tuple[ResidualTable, ...], Known, list[Finding]]:
    """Measured minus predicted, what it was predicted from, and what to warn of.

    Where points are measured, readings are what the components are fitted to; else they are
    what is judged, against a components report or the machine file.
    """
    if inputs.files("cmm"):
        found = modelled(inputs)
        table, more = residual_table(found.model, inputs.points, inputs.at, choices.datum)
        return (table,), Known(estimates=found.estimates, fit=found.fit), [*found.warnings, *more]
    readings = inputs.readings
    if readings is None:
        raise inputs.missing("--cmm FILE, --lbb FILE or --laser FILE", "cmm", "lbb", "laser")
    machine = inputs.machine
    warnings = searched_warnings(machine)
    report = inputs.reports.components
    if report is not None:
        before = estimates_from_report(machine, report)
        warnings += effect_warnings(machine, before.effects, report.source.shown)
        known = Known(estimates=before, fit=None)
    else:
        before = estimates_from_fit(machine, None)
        fit = fit_machine(machine, readings)
        known = Known(estimates=estimates_from_fit(machine, fit), fit=fit)
    warnings = [*machine_warnings(machine, before), *warnings]
    warnings += _not_used(inputs, choices)
    thermal, doubts = drift_estimates(inputs)
    tables, odd = reading_tables(machine, replace(before, thermal=thermal), readings)
    return tables, known, [*warnings, *doubts, *odd]


def _not_used(inputs: Inputs, choices: Choices) -> list[Finding]:
    """Of what is asked for and means nothing without measured points."""
    asked = {
        "--datum": choices.datum != "none",
        **{f"--at {name}": True for name in inputs.at},
    }
    text = "is not used: readings are judged, no points of parts (--cmm) are given"
    return [
        loop_warning(code="option-not-used", message=f"{option} {text}")
        for option, given in asked.items()
        if given
    ]
