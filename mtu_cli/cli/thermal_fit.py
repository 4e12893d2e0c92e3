"""`mtu thermal-fit`."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.thermal_fit import METHODS, Check, thermal_fit
from mtu_cli.analyses.thermal_fit.result import ThermalFit
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, counted, error, finding, suggestion
from mtu_cli.model.settings import Settings
from mtu_cli.stats.threads import one_blas_thread

OUTLYING = ("outlying-reading", "sensor-spike")
"""Checks that name single rows."""
REFERENCE_WITHOUT_MACHINE = 20.0
"""ISO 1."""


def run(options: Options) -> None:
    """Reads drift readings, fits and reports thermal models."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import thermal_fit as report

    method = inputs.options.model
    if method not in METHODS:
        raise error("unknown-name", what="model", value=method, **suggestion(method, METHODS))
    if not inputs.files("drift"):
        inputs.only("drift", "--drift")
    fit = fitted(inputs, method)
    warnings = inputs.machine.warnings if inputs.files("machine") else ()
    return Outcome(
        results=lambda: report.document(fit),
        tables=lambda: report.tables(fit),
        rows=lambda: report.rows(fit),
        figure=lambda: report.figure(fit),
        warnings=[*warnings, *fit.warnings, *_without_outliers(inputs, method)],
    )


def _without_outliers(inputs: Inputs, method: str) -> list[Finding]:
    """What the models are without the rows that the checks call outlying, which stay in the fit."""
    readings = inputs.drift
    rows = {(each.file, row) for each in inputs.suspicions if each.code in OUTLYING
            for row in each.facts["rows"]}  # fmt: skip
    if not rows:
        return []
    files = [readings.sources[i].shown for i in readings.file_index.tolist()]
    keep = [place not in rows for place in zip(files, readings.row.tolist(), strict=True)]
    fit = _fitted(inputs, readings.where(np.array(keep)), method)
    found = []
    for name, drift in fit.components.items():
        held = drift.held_out
        before, after = (held.before, held.after) if held else (drift.rms_before, drift.rms_after)
        facts = {"component": name, "count": counted(len(rows), "outlying row")}
        facts |= {"before": drift.shown(before), "after": drift.shown(after)}
        found.append(finding("without-outliers", **facts, rms="held-out rms" if held else "rms"))
    return found


def fitted(inputs: Inputs, method: str, check: Check | None = None) -> ThermalFit:
    """The thermal models of a call's drift readings; `check` as for `thermal_fit`."""
    return _fitted(inputs, inputs.drift, method, check)


def _fitted(
    inputs: Inputs, readings: Readings, method: str, check: Check | None = None
) -> ThermalFit:
    machine = inputs.machine.machine if inputs.files("machine") else None
    with one_blas_thread():
        return thermal_fit(
            [readings],
            None
            if machine is None
            else {name: (item.of, item.unit) for name, item in machine.components.items()},
            reference=(
                REFERENCE_WITHOUT_MACHINE if machine is None else machine.reference_temperature_degC
            ),
            method=method,
            check=check,
        )
