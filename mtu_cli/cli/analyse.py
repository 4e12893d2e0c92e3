"""The commands on readings, predictions and measured parts: from a call's files to a machine with
estimates of all its components, what each command makes of it, and when its gates are met.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mtu_cli.analyses.fit_components import FitResult, fit_result
from mtu_cli.cli.load import Inputs
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.reports_read import report_from
from mtu_cli.files.source import read_source, report_bytes
from mtu_cli.findings import Finding, error, listed
from mtu_cli.model import fit as fitting
from mtu_cli.model.covariates import given_covariates
from mtu_cli.model.estimates import Estimates, ThermalEstimate
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.reports import fit_components as reporting
from mtu_cli.result import Gate, Result
from mtu_cli.stats.threads import one_blas_thread

if TYPE_CHECKING:
    from mtu_cli.analyses.thermal_fit import ThermalFit

REFERENCE_WITHOUT_MACHINE = 20.0
"""ISO 1."""
LIMITS = ("reversal", "passes-drift", "instruments-disagree")
"""Warnings of what u of a part holds nothing of; a misfit is among its repeatability."""
DOUBTS = ("no-better", "not-held-out")
"""Warnings of a thermal-fit report: nothing says that its model holds for the next warm-up."""


def modelled(inputs: Inputs, extra: Collection[str] = ()) -> tuple[MachineModel, list[Finding]]:
    """The model of a call, and warnings. A components report wins over readings, readings over the
    machine file. Covariates that the command needs `extra`, beside those of the model, may be given
    with --at.

    Raises InputError for components without an estimate.
    """
    machine, report, fit = inputs.machine, inputs.reports.components, None
    if report is not None:
        estimates = fitting.estimates_from_report(machine, report)
    elif inputs.readings is not None:
        result = fitted(inputs, machine)
        fit, estimates = result.fit, _as_reported(machine, result)
    else:
        estimates = fitting.estimates_from_fit(machine, None)
    thermal, drift_warnings = drift_estimates(inputs)
    warnings = [*fitting.machine_warnings(machine, estimates), *drift_warnings]
    model = build_model(machine, replace(estimates, thermal=thermal))
    # What u of a part does not contain, from the fit or from the report of it.
    terms = {term.estimate.name for term in model.terms}
    if report is not None:
        warnings += fitting.not_read(report, _digests(inputs, "lbb", "laser"))
        warnings += fitting.reported_warnings(report, LIMITS, terms)
    for item in () if fit is None else fitting.fit_warnings(fit):
        if item.code not in LIMITS or item.facts["component"] in terms:
            warnings += [item] * (item.code != "lack-of-fit")
    inputs.at, unused = given_covariates(model, inputs.at, extra)
    return model, [*warnings, *unused]


def fitted(inputs: Inputs, machine: LoadedMachine) -> FitResult:
    """The components of a machine, by the readings of the call where it has any."""
    fit, k = fitting.fit_machine(machine, inputs.readings), inputs.settings.coverage_factor
    says = {name: item.says for name, item in machine.machine.components.items() if item.says}
    estimates = fitting.estimates_from_fit(machine, fit)
    return fit_result(machine.machine.name, fit, estimates, says=says, coverage_factor=k)


def _as_reported(machine: LoadedMachine, fit: FitResult) -> Estimates:
    """The estimates as a report holds them: readings and their report then give the same bits."""
    record = {"schema": "mtu/fit-components/1", "results": reporting.document(fit).record()}
    content = report_bytes(record)
    return fitting.estimates_from_report(machine, report_from(machine.source, json.loads(content)))


def drift_estimates(inputs: Inputs) -> tuple[dict[str, ThermalEstimate], list[Finding]]:
    """A thermal-fit report wins over drift readings, those over the machine file."""
    machine = inputs.machine
    estimates = fitting.thermal_from_machine_file(machine)
    report = inputs.reports.thermal
    if report is not None:
        doubts = fitting.reported_warnings(report, DOUBTS, report.components)
        doubts += fitting.not_read(report, _digests(inputs, "drift"))
        return fitting.thermal_from_report(machine, report), doubts
    if inputs.files("drift"):
        fit = fitted_drift(inputs, "auto")
        return estimates | {x.name: x.estimate for x in fit.components.values()}, [*fit.warnings]
    return estimates, []


def fitted_drift(inputs: Inputs, method: str) -> ThermalFit:
    """The thermal models of the drift readings."""
    from mtu_cli.analyses.thermal_fit import thermal_fit

    readings, zeroed = inputs.drift, inputs.choices.zeroed or "auto"
    components, reference = None, REFERENCE_WITHOUT_MACHINE
    if inputs.files("machine"):
        machine = inputs.machine.machine
        components = {name: (item.of, item.unit) for name, item in machine.components.items()}
        reference = machine.reference_temperature_degC
    with one_blas_thread():
        return thermal_fit(readings, components, reference=reference, method=method, zeroed=zeroed)


def _digests(inputs: Inputs, *roles: str) -> dict[Path, str]:
    """The SHA-256 of the files of these roles, by path."""
    paths = [(path, role) for role in roles for path in inputs.files(role)]
    return {path: read_source(path, role)[0].sha256 for path, role in paths}


def fit_components(inputs: Inputs) -> Result:
    machine = inputs.machine
    if inputs.readings is None:
        raise inputs.missing("--lbb FILE or --laser FILE", "lbb", "laser")
    result = fitted(inputs, machine)
    warnings = [
        *fitting.machine_warnings(machine, result.estimates),
        *fitting.fit_warnings(result.fit),
    ]
    reason = f"drift in {', '.join(result.drifts)}" if result.drifts else None
    return Result.reported(inputs, result, warnings, gates={"drift": lambda _: reason})


def thermal_fit(inputs: Inputs) -> Result:
    fit = fitted_drift(inputs, inputs.options.model)
    return Result.reported(inputs, fit, inputs.machine.warnings if inputs.files("machine") else ())


def predict_points(inputs: Inputs) -> Result:
    """Errors of the features of a part, or of a grid over the machine's travels."""
    from mtu_cli.analyses import predictions as analysis
    from mtu_cli.model.features import grid_of
    from mtu_cli.reports import predictions as report

    (model, warnings), grid = modelled(inputs), inputs.options.grid
    if grid is None:
        result = analysis.predict_points(model, inputs.part, inputs.settings, inputs.at)
    else:
        ids, places = grid_of(inputs.machine, model, grid)
        result = analysis.predict_places(model, ids, places, inputs.settings, inputs.at)
    matrix = bool(inputs.options.covariance)
    document = report.points(result, inputs.settings.digits, with_covariance=matrix)
    gates = _conformance_gate(result.conformances, "position_um at a feature")
    return Result(inputs, document, [*warnings, *result.warnings], gates=gates)


def lengths(inputs: Inputs) -> Result:
    from mtu_cli.analyses.predictions import predict_lengths

    model, warnings = modelled(inputs)
    result = predict_lengths(model, inputs.part, inputs.settings, inputs.at)
    whole = {"the whole part": result.joint_conformance} if result.joint_conformance else {}
    gates = _conformance_gate(result.conformances | whole, "tolerance_um at a length")
    return Result.reported(inputs, result, warnings, gates=gates)


def orthogonality(inputs: Inputs) -> Result:
    from mtu_cli.analyses.predictions import predict_orthogonality

    model, warnings = modelled(inputs)
    result = predict_orthogonality(model, inputs.part, inputs.settings, inputs.at)
    gates = _conformance_gate(result.conformances, "tolerance_arcsec at an angle")
    return Result.reported(inputs, result, warnings, gates=gates)


def _conformance_gate(conformances: Mapping[str, Any], key: str) -> dict[str, Gate]:
    """The gate of a prediction by its `conformances` by name, which need a `key` of the part."""

    def nonconforming(limit: float) -> str | None:
        if not conformances:
            raise error("gate-undefined", gate="nonconforming", expected=f"{key} of the part")
        risks = {name: 1 - item.probability for name, item in conformances.items()}
        failures = [
            f"{name} {100 * p:.{2 if p < 0.995 else 4}g} %"
            for name, p in risks.items()
            if p > limit
        ]
        what = f"probability of a nonconforming part above {100 * limit:g} %"
        return f"{what}: {', '.join(failures)}" if failures else None

    return {"nonconforming": nonconforming}


def anova(inputs: Inputs) -> Result:
    from mtu_cli.analyses.anova import analyse_variance

    method, datum = inputs.options.method, inputs.choices.datum or "none"
    result = analyse_variance(inputs.points, inputs.part_if_any, method, inputs.settings, datum)

    def unusual(_: float) -> str | None:
        if result.unusual is None:
            raise error("gate-undefined", gate="unusual", expected="four or more measured parts")
        outliers = listed(item.part for item in result.unusual)
        return f"outliers among the parts: {outliers}" if result.unusual else None

    return Result.reported(inputs, result, gates={"unusual": unusual})


def compare(inputs: Inputs) -> Result:
    from mtu_cli.analyses.compare import compare as analysis

    model, warnings = modelled(inputs)
    datum = inputs.choices.datum or "none"
    result = analysis(model, inputs.part, inputs.points, inputs.settings, datum, inputs.at)

    def failed(fault: Any, _: float) -> str | None:
        failures = result.failures(fault)
        if failures is None:
            expected = (
                "two or more parts, in which features or lengths of the part were measured, "
                "and a machine that was read in enough passes"
            )
            raise error("gate-undefined", gate=fault, expected=expected)
        return listed(failures) if failures else None

    gates = {fault: partial(failed, fault) for fault in ("biased", "under-predicted")}
    return Result.reported(inputs, result, warnings, gates=gates)


def correct(inputs: Inputs) -> Result:
    from mtu_cli.analyses.correct import correct as analysis

    part = inputs.part_if_any
    rounds: Iterable[Any] = (*part.part.circles, *part.part.spheres) if part else ()
    # A calibrated diameter may need a temperature that no equation uses.
    model, warnings = modelled(inputs, [item.temperature for item in rounds if item.temperature])
    result = analysis(model, part, inputs.points, inputs.settings, inputs.at)
    return Result.reported(inputs, result, warnings)
