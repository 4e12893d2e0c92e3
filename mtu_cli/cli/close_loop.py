"""`mtu close-loop`: what is judged, what the machine is written with, and what is warned of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli import __version__
from mtu_cli.analyses import close_loop as loop
from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect, TableResult
from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.cli.emit import Outcome, written_files
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import drift_estimates, modelled
from mtu_cli.files.extend_machine import ExtendedMachine, extended_machine
from mtu_cli.files.write import report_bytes
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.language import to_text
from mtu_cli.language.tree import Number
from mtu_cli.model.effect_library import effect_library
from mtu_cli.model.effect_parameters import all_together, effect_warnings, searched_warnings
from mtu_cli.model.estimates import EffectEstimates
from mtu_cli.model.fit import (
    MachineFit,
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
    machine_warnings,
)
from mtu_cli.model.reading_residuals import reading_tables
from mtu_cli.model.residuals import ResidualTable, residual_table
from mtu_cli.model.settings import Settings
from mtu_cli.reports import close_loop as report
from mtu_cli.reports import fit_components
from mtu_cli.reports.document import envelope
from mtu_cli.reports.fields import plain
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, UNITS

ALPHA, MAX_EFFECTS = 0.05, 4


def close_loop(inputs: Inputs, settings: Settings) -> Outcome:
    """Asks measured data what the model lacks, and adds it to the machine."""
    chosen = inputs.chosen
    library = effect_library(inputs.files("effects"))
    tables, earlier, warnings = _tables(inputs, chosen.datum or "none")
    inputs.sources.extend(library.sources)
    result = loop.close_loop(
        tables,
        library,
        alpha=chosen.alpha or ALPHA,
        max_effects=MAX_EFFECTS if chosen.max_effects is None else chosen.max_effects,
        exclude=dict.fromkeys(inputs.options.exclude or ()),
        seed=settings.seed,
        progress=settings.progress,
    )
    files, of_files = _written(inputs, earlier, settings, result)
    found = f"verdict {result.verdict}: {listed(e.name for e in result.effects) or 'no name fits'}"
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=[*warnings, *result.warnings, *of_files],
        gates={
            "found": lambda _: found if result.verdict != "none" else None,
            "unexplained": lambda _: found if result.verdict == "unexplained" else None,
        },
        files=lambda: files,
    )


def _tables(
    inputs: Inputs, datum: Any
) -> tuple[tuple[ResidualTable, ...], EffectEstimates | None, list[Finding]]:
    """Measured minus predicted, what a components report says of effects, and what to warn of.

    Where points are measured, readings are what the components are fitted to; else they are
    what is judged, against a components report or the machine file.
    """
    machine = inputs.machine
    if inputs.files("cmm"):
        result = modelled(inputs)
        table, more = residual_table(result.model, inputs.points, inputs.at, datum)
        return (table,), result.estimates.effects, [*result.warnings, *more]
    readings, known = inputs.readings, inputs.reports.components
    if readings is None:
        raise inputs.missing("--cmm FILE, --lbb FILE or --laser FILE", "cmm", "lbb", "laser")
    before, warnings = estimates_from_fit(machine, None), searched_warnings(machine)
    if known is not None:
        before = estimates_from_report(machine, known)
        warnings += effect_warnings(machine, before.effects, known.source.shown)
    unused = [f"--at {name}" for name in inputs.at] + ["--datum"] * (datum != "none")
    why = ": readings are judged, no points of parts (--cmm) are given"
    warnings += [finding("option-not-used", path=name, why=why) for name in unused]
    thermal, doubts = drift_estimates(inputs)
    tables, odd = reading_tables(machine, replace(before, thermal=thermal), readings)
    warnings = [*machine_warnings(machine, before), *warnings, *doubts, *odd]
    return tables, before.effects, warnings


# What is written.


def _written(
    inputs: Inputs, earlier: EffectEstimates | None, settings: Settings, result: CloseLoopResult
) -> tuple[dict[Path, bytes], list[Finding]]:
    """The files of --write-machine and --write-components, none where neither is asked for, and
    what to warn of. Raises InputError for effects that no machine file can hold.
    """
    asked = written_files(inputs.options)
    if not {"write_machine", "write_components"} & asked.keys():
        return {}, []
    pairs = [(effect, item) for item in result.tables for effect in item.effects]
    kept = [(effect, item) for effect, item in pairs if not effect.not_written]
    extended = extended_machine(inputs.machine, [_entry(inputs, *pair) for pair in kept])
    files = {}
    if path := asked.get("write_machine"):
        files[path] = extended.content
    if path := asked.get("write_components"):
        files[path] = _components(inputs, earlier, settings, extended, joint(kept))
    warnings = [
        finding("effect-not-written", effect=effect.name, reason=effect.not_written)
        for effect, _ in pairs
        if effect.not_written
    ]
    if names := [effect.name for effect, _ in kept if len(effect.class_names) > 1]:
        warnings.append(finding("written-class", names=names))
    if names := [effect.name for effect, item in kept if item.verdict == "unexplained"]:
        warnings.append(finding("written-unexplained", names=names))
    if not kept:
        warnings.append(finding("nothing-added"))
    return files, [*warnings, *extended.warnings]


def _entry(inputs: Inputs, effect: FoundEffect, item: TableResult) -> dict[str, Any]:
    """An effect as the machine file has it; a smooth one is a component with a table of its own."""
    rows, candidate, components = effect.written, effect.candidate, {}
    if (table := effect.table) is not None:
        scale = UNITS[item.table.unit].to_internal
        components[effect.component] = {
            "of": table.along,
            "unit": item.table.unit,
            "shape": "table",
            "at_mm": table.knots.tolist(),
            "coefficients": (table.values / scale).tolist(),
            "covariance": ((table.covariance + table.covariance.T) / 2 / scale**2).tolist(),
            "roughness_um2_per_mm3": table.roughness / scale**2,
            "between_um2": table.between / scale**2,
        }
    parameters = [effect.parameters[i] for i in rows]
    f = np.array([PARAMETER_UNITS[p.unit].to_internal for p in parameters])
    C = effect.covariance[np.ix_(rows, rows)] / np.outer(f, f)
    columns = [x for x in effect.used if x not in {*components, *(p.name for p in parameters)}]
    judged = ("cmm",) if inputs.files("cmm") else ("lbb", "laser")
    sources = [source for source in inputs.sources if source.role in judged]
    found = {
        "by": f"mtu close-loop {__version__}",
        "files": [{"path": source.shown, "sha256": source.sha256} for source in sources],
        "p_familywise": float(effect.p_familywise),
    }
    if item.table.component is not None:
        # What readings of it are no scatter any more.
        found["component"] = item.table.component
    if len(effect.class_names) > 1:
        found["class"] = list(effect.class_names)
    return {
        "name": effect.name,
        "family": candidate.family,
        "axis": candidate.axis,
        "covariate": effect.covariate,
        "says": candidate.says,
        "parameters": {
            p.name: {"value": float(p.value / scale), "u": float(p.u / scale), "unit": p.unit}
            for p, scale in zip(parameters, f, strict=True)
        },
        "components": components,
        "covariance": ((C + C.T) / 2).tolist() or None,
        "equations": _through_component(inputs, item.table.component, effect.equations),
        "seen": item.table.ranges(columns),
        "found": found,
    }


def _through_component(
    inputs: Inputs, component: str | None, equations: Mapping[str, str]
) -> dict[str, str]:
    """An effect in the machine's equations: one of a component's readings by its lever arms.

    With E the equation and c the component, c + f adds (dE/dc) f.
    """
    if component is None:
        return dict(equations)
    (text,) = equations.values()
    forms = inputs.machine.forms.items()
    levers = {key: x.coefficients[component] for key, x in forms if component in x.coefficients}
    return {
        key: text if lever == Number(1.0, lever.column) else f"({to_text(lever)})*({text})"
        for key, lever in levers.items()
    }


def joint(kept: Sequence[tuple[FoundEffect, TableResult]]) -> FloatArray:
    """The covariance over the parameters of effects one after the other, in internal units: of
    those that were estimated together by their table's.
    """

    def block(
        one: FoundEffect, item: TableResult, other: FoundEffect, its: TableResult
    ) -> FloatArray:
        if one is other:
            return one.covariance[np.ix_(one.written, one.written)]
        if item is its and one.table is None and other.table is None:
            return item.covariance[np.ix_(one.rows, other.rows)]
        return np.zeros((len(one.written), len(other.written)))

    if not kept:
        return np.zeros((0, 0))
    whole = np.block([[block(*pair, *other) for other in kept] for pair in kept])
    return np.asarray((whole + whole.T) / 2)


def _components(
    inputs: Inputs,
    earlier: EffectEstimates | None,
    settings: Settings,
    extended: ExtendedMachine,
    covariance: FloatArray,
) -> bytes:
    """The fit-components report of the call's components, with the effects of the machine: of
    readings what these leave of them is fitted.
    """
    known, machine = inputs.reports.components, extended.machine
    warnings: Sequence[Finding] = ()
    if known is not None:
        results = dict(known.document["results"])
    else:
        readings = inputs.readings
        none = MachineFit(components={}, joint=())
        fit = none if readings is None else fit_machine(machine, readings)
        says = {name: x.says for name, x in machine.machine.components.items() if x.says}
        estimates = estimates_from_fit(machine, fit)
        fitted = fit_result(machine.machine.name, fit, estimates, says=says)
        results, warnings = fit_components.document(fitted).record(), fitted.warnings
    effects = all_together(machine, earlier, extended.parameters, covariance)
    results.pop("effects", None)
    if effects is not None:
        f = np.array([unit.to_internal for unit in effects.units])
        results["effects"] = {
            "parameters": list(effects.names),
            "units": [unit.name for unit in effects.units],
            "values": plain(effects.values / f),
            "covariance": plain(effects.covariance / np.outer(f, f)),
        }
    given: dict[str, Any] = {"inputs": inputs.sources, "settings": settings, "warnings": warnings}
    return report_bytes(envelope("fit-components", results=results, **given))
