"""`mtu close-loop`: what is tested, the files with the effects, and what is warned of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli import __version__
from mtu_cli.analyses import close_loop as loop
from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect, TableResult
from mtu_cli.cli.analyse import drift_estimates, fitted, modelled
from mtu_cli.cli.load import Inputs
from mtu_cli.files.extend_machine import by_lever_arms, extended_machine
from mtu_cli.files.source import report_bytes
from mtu_cli.findings import Finding, finding, listed, plain
from mtu_cli.model.effect_library import effect_library
from mtu_cli.model.effect_parameters import joint_effects
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, machine_warnings
from mtu_cli.model.residuals import ResidualTable, reading_tables, residual_table
from mtu_cli.reports import close_loop as report
from mtu_cli.reports import fit_components
from mtu_cli.reports.document import envelope
from mtu_cli.result import Result
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS, UNITS

ALPHA, MAX_EFFECTS = 0.05, 4


def close_loop(inputs: Inputs) -> Result:
    """The effects in measured data that the model lacks, added to the machine."""
    choices = inputs.choices
    library = effect_library(inputs.files("effects"))
    tables, warnings = _tables(inputs, choices.datum or "none")
    inputs.entered(library)
    result = loop.close_loop(
        tables,
        library,
        alpha=choices.alpha or ALPHA,
        max_effects=MAX_EFFECTS if choices.max_effects is None else choices.max_effects,
        exclude=dict.fromkeys(inputs.options.exclude or ()),
        seed=inputs.settings.seed,
        progress=inputs.settings.progress,
    )
    files, of_files = _written_files(inputs, result)
    names = [effect.name for item in result.tables for effect in item.effects]
    reason = f"verdict {result.verdict}: {listed(names) or 'no name fits'}"
    return Result(
        inputs,
        report.document(result, inputs.settings.digits),
        [*warnings, *result.warnings, *of_files],
        gates={
            "found": lambda _: reason if result.verdict != "none" else None,
            "unexplained": lambda _: reason if result.verdict == "unexplained" else None,
        },
        files=files,
    )


def _tables(inputs: Inputs, datum: Any) -> tuple[tuple[ResidualTable, ...], list[Finding]]:
    """Measured minus predicted, and what to warn of.

    Where points are measured, readings are what the components are fitted to; else they are
    what is tested, against a components report or the machine file.
    """
    machine = inputs.machine
    if inputs.files("cmm"):
        model, warnings = modelled(inputs)
        table, findings = residual_table(model, inputs.points, inputs.at, datum)
        return (table,), [*warnings, *findings]
    readings, fit_report = inputs.readings, inputs.reports.components
    if readings is None:
        raise inputs.missing("--cmm FILE, --lbb FILE or --laser FILE", "cmm", "lbb", "laser")
    if fit_report is None:
        before = estimates_from_fit(machine, None)
    else:
        before = estimates_from_report(machine, fit_report)
    unused = [f"--at {name}" for name in inputs.at] + ["--datum"] * (datum != "none")
    why = ": readings are judged, no points of parts (--cmm) are given"
    warnings = [finding("option-not-used", path=name, why=why) for name in unused]
    thermal, doubts = drift_estimates(inputs)
    tables, odd = reading_tables(machine, replace(before, thermal=thermal), readings)
    return tables, [*machine_warnings(machine, before), *warnings, *doubts, *odd]


# What is written.


def _written_files(
    inputs: Inputs, result: CloseLoopResult
) -> tuple[dict[Path, bytes], list[Finding]]:
    """The files of --write-machine and --write-components, none without these options, and
    what to warn of. Raises InputError for effects that no machine file can hold.
    """
    paths = inputs.options.written
    if not {"write_machine", "write_components"} & paths.keys():
        return {}, []
    pairs = [(effect, item) for item in result.tables for effect in item.effects]
    additions = [(effect, item) for effect, item in pairs if not effect.not_written]
    extended = extended_machine(inputs.machine, [_entry(inputs, *pair) for pair in additions])
    files = {}
    if path := paths.get("write_machine"):
        files[path] = extended.content
    if path := paths.get("write_components"):
        earlier, known, of_fit = None, inputs.reports.components, list[Finding]()
        if known is not None:
            results = dict(known.document["results"])
            earlier = estimates_from_report(inputs.machine, known).effects
        else:
            # The components are fitted to readings less the effects of the machine.
            fit = fitted(inputs, extended.machine)
            results = fit_components.document(fit).record()
            of_fit += fit.warnings
        effects = joint_effects(extended.machine, earlier, extended.parameters, joint(additions))
        results.pop("effects", None)
        if effects is not None:
            f = np.array([unit.to_internal for unit in effects.units])
            results["effects"] = {
                "parameters": list(effects.names),
                "units": [unit.name for unit in effects.units],
                "values": plain(effects.values / f),
                "covariance": plain(effects.covariance / np.outer(f, f)),
            }
        facts: dict[str, Any] = {"inputs": inputs.sources, "warnings": of_fit}
        content = envelope("fit-components", settings=inputs.settings, results=results, **facts)
        files[path] = report_bytes(content)
    warnings = [
        finding("effect-not-written", effect=effect.name, reason=effect.not_written)
        for effect, _ in pairs
        if effect.not_written
    ]
    if names := [effect.name for effect, _ in additions if len(effect.class_names) > 1]:
        warnings.append(finding("written-class", names=names))
    return files, [*warnings, *extended.warnings]


def _entry(inputs: Inputs, effect: FoundEffect, item: TableResult) -> dict[str, Any]:
    """An effect as the machine file has it; a smooth one is a component with a table."""
    parameters, candidate, components = effect.written, effect.candidate, {}
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
    f = np.array([PARAMETER_UNITS[p.unit].to_internal for p in parameters])
    C = joint([(effect, item)]) / np.outer(f, f)
    columns = [x for x in effect.used if x not in {*components, *(p.name for p in parameters)}]
    roles = ("cmm",) if inputs.files("cmm") else ("lbb", "laser")
    sources = [source for source in inputs.sources if source.role in roles]
    provenance = {
        "by": f"mtu close-loop {__version__}",
        "files": [{"path": source.shown, "sha256": source.sha256} for source in sources],
        "p_familywise": float(effect.p_familywise),
    }
    if item.table.component is not None:
        # The component in whose readings it was found.
        provenance["component"] = item.table.component
    if len(effect.class_names) > 1:
        provenance["class"] = list(effect.class_names)
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
        "covariance": C.tolist() or None,
        "equations": by_lever_arms(inputs.machine, item.table.component, effect.equations),
        "seen": item.table.ranges(columns),
        "found": provenance,
    }


def joint(additions: Sequence[tuple[FoundEffect, TableResult]]) -> FloatArray:
    """The joint covariance of the parameters of the effects in order, in internal units: of
    those estimated jointly that of their table.
    """
    rows = [[p.row for p in effect.written] for effect, _ in additions]
    ends = np.cumsum([0, *map(len, rows)]).tolist()
    whole = np.zeros((ends[-1], ends[-1]))
    places = [slice(*pair) for pair in pairwise(ends)]
    for (i, (one, item)), (j, (other, peer)) in product(enumerate(additions), repeat=2):
        if i == j or (item is peer and one.table is None and other.table is None):
            whole[places[i], places[j]] = item.covariance[np.ix_(rows[i], rows[j])]
    return np.asarray((whole + whole.T) / 2)
