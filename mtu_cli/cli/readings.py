"""What readings of a machine say: `mtu fit-components` and `mtu thermal-fit`."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.fit_components import FitResult, fit_result
from mtu_cli.analyses.thermal_fit import METHODS
from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import fitted_drift
from mtu_cli.cli.values import known_name
from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.fit import estimates_from_fit, fit_machine, machine_warnings
from mtu_cli.model.fit_warnings import fit_warnings
from mtu_cli.model.settings import Settings

OUTLYING = ("outlying-value", "sensor-spike")
"""Checks that name single rows."""


def fit_components(inputs: Inputs, settings: Settings) -> Outcome:
    """Readings to the components of a machine."""
    from mtu_cli.reports import fit_components as report

    machine, readings = inputs.machine, inputs.readings
    if readings is None:
        raise inputs.missing("--lbb FILE or --laser FILE", "lbb", "laser")
    fit = fit_machine(machine, readings)
    estimates = estimates_from_fit(machine, fit)
    says = {name: item.says for name, item in machine.machine.components.items() if item.says}
    k = settings.coverage_factor
    result = fit_result(machine.machine.name, fit, estimates, says=says, coverage_factor=k)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=[
            *machine_warnings(machine, estimates),
            *fit_warnings(fit, inputs.suspicions),
            *result.warnings,
        ],
        gates={"drift": lambda _: _drifting(result)},
    )


def _drifting(result: FitResult) -> str | None:
    """Passes that drift in one direction, or differ by more than repeatability: what has a star
    in the table.
    """
    kinds = {"drift": "pass to pass", "trend": "trend"}
    found = {
        f"{name} ({text})": None
        for test, text in kinds.items()
        for name, component in result.components.items()
        for instrument in component.instruments
        if test in instrument.tests and instrument.tests[test].significant
    }
    return f"drift in {', '.join(found)}" if found else None


def thermal_fit(inputs: Inputs, settings: Settings) -> Outcome:
    """Drift readings with temperatures to thermal models."""
    from mtu_cli.reports import thermal_fit as report

    method = inputs.options.model
    known_name("--model", "model", method, METHODS)
    fit = fitted_drift(inputs, inputs.drift, method)
    warnings = inputs.machine.warnings if inputs.files("machine") else ()
    return Outcome.of(
        report.document(fit, settings.digits),
        warnings=[*warnings, *fit.warnings, *_without_outliers(inputs, method)],
    )


def _without_outliers(inputs: Inputs, method: str) -> list[Finding]:
    """What the models are without the rows that the checks call outlying, which stay in the fit."""
    readings = inputs.drift
    outlying = [each for each in inputs.suspicions if each.code in OUTLYING]
    rows = {(each.file, row) for each in outlying for row in each.facts["rows"]}
    if not rows:
        return []
    files = [readings.sources[i].shown for i in readings.file_index.tolist()]
    keep = [place not in rows for place in zip(files, readings.row.tolist(), strict=True)]
    fit = fitted_drift(inputs, readings.where(np.array(keep)), method)
    found = []
    for name, drift in fit.components.items():
        held = drift.held_out
        before, after = (held.before, held.after) if held else (drift.rms_before, drift.rms_after)
        facts = {"component": name, "count": counted(len(rows), "outlying row")}
        facts |= {"before": drift.shown(before), "after": drift.shown(after)}
        found.append(finding("without-outliers", **facts, rms="held-out rms" if held else "rms"))
    return found
