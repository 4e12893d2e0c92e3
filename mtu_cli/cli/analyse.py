"""The commands on readings, predictions and measured parts: what each reads, calculates, reports,
and when its gates are met.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.emit import Gate, Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import fitted, fitted_drift, modelled, one_direction
from mtu_cli.cli.values import known_name
from mtu_cli.findings import error, listed
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from mtu_cli.analyses.compare import CompareResult


def fit_components(inputs: Inputs, settings: Settings) -> Outcome:
    """Readings to the components of a machine."""
    from mtu_cli.model.fit import fit_warnings, machine_warnings

    machine = inputs.machine
    if inputs.readings is None:
        raise inputs.missing("--lbb FILE or --laser FILE", "lbb", "laser")
    result = fitted(inputs, machine)
    warnings = [*machine_warnings(machine, result.estimates), *fit_warnings(result.fit)]
    # Passes that drift in one direction, or differ by more than repeatability.
    drifts = [
        f"{name} ({text})"
        for test, text in (("drift", "pass to pass"), ("trend", "trend"))
        for name, component in result.components.items()
        for instrument in component.instruments
        if test in instrument.tests and instrument.tests[test].significant
    ]
    reason = f"drift in {', '.join(dict.fromkeys(drifts))}" if drifts else None
    return Outcome.reported(inputs, result, warnings, gates={"drift": lambda _: reason})


def thermal_fit(inputs: Inputs, settings: Settings) -> Outcome:
    """Drift readings with temperatures to thermal models."""
    from mtu_cli.analyses.thermal_fit import METHODS

    method = known_name("--model", "model", inputs.options.model, METHODS)
    fit = fitted_drift(inputs, method)
    return Outcome.reported(inputs, fit, inputs.machine.warnings if inputs.files("machine") else ())


def predict_points(inputs: Inputs, settings: Settings) -> Outcome:
    """Errors of the features of a part, or of a grid over the machine's travels."""
    from mtu_cli.analyses import predictions as analysis
    from mtu_cli.model.features import grid_of
    from mtu_cli.reports import predictions as report

    modelling, grid = modelled(inputs), inputs.options.grid
    if grid is None:
        result = analysis.predict_points(modelling.model, inputs.part, settings, inputs.at)
    else:
        ids, places = grid_of(inputs.machine, modelling.model, grid)
        result = analysis.predict_places(modelling.model, ids, places, settings, inputs.at)
    matrix = bool(inputs.options.covariance)
    document = report.points(result, settings.digits, with_covariance=matrix)
    conformances = dict(zip(result.prediction.ids, result.conformance, strict=True))
    gates = _conformance_gate(conformances, "position_um at a feature")
    return Outcome.of(document, warnings=[*modelling.warnings, *result.warnings], gates=gates)


def lengths(inputs: Inputs, settings: Settings) -> Outcome:
    """Feature-to-feature lengths."""
    from mtu_cli.analyses.predictions import predict_lengths
    from mtu_cli.reports import predictions as report

    modelling = modelled(inputs)
    result = predict_lengths(modelling.model, inputs.part, settings, inputs.at)
    warnings = [*modelling.warnings, *inputs.part.warnings, *one_direction(inputs, modelling.model)]
    conformances: dict[str, Any] = dict(zip(result.ids, result.conformance, strict=True))
    conformances["the whole part"] = result.joint_conformance
    gates = _conformance_gate(conformances, "tolerance_um at a length")
    document, warnings = report.lengths(result, settings.digits), [*warnings, *result.warnings]
    return Outcome.of(document, warnings=warnings, gates=gates)


def orthogonality(inputs: Inputs, settings: Settings) -> Outcome:
    """Right angles between rows and columns of features."""
    from mtu_cli.analyses.predictions import predict_orthogonality
    from mtu_cli.reports import predictions as report

    modelling = modelled(inputs)
    result = predict_orthogonality(modelling.model, inputs.part, settings, inputs.at)
    warnings = [*modelling.warnings, *one_direction(inputs, modelling.model)]
    conformances = {each.id: each.conformance for each in result.angles}
    gates = _conformance_gate(conformances, "tolerance_arcsec at an angle")
    document = report.orthogonality(result, settings.digits)
    return Outcome.of(document, warnings=[*warnings, *result.warnings], gates=gates)


def _conformance_gate(conformances: dict[str, Any], key: str) -> dict[str, Gate]:
    """The gate of a prediction by its `conformances` by name, which need a `key` of the part."""

    def nonconforming(limit: float) -> str | None:
        risks = {x: 1 - c.probability for x, c in conformances.items() if c is not None}
        if not risks:
            raise error("gate-undefined", gate="nonconforming", expected=f"{key} of the part")
        failures = [
            f"{name} {100 * p:.{2 if p < 0.995 else 4}g} %"
            for name, p in risks.items()
            if p > limit
        ]
        what = f"probability of a nonconforming part above {100 * limit:g} %"
        return f"{what}: {', '.join(failures)}" if failures else None

    return {"nonconforming": nonconforming}


def anova(inputs: Inputs, settings: Settings) -> Outcome:
    """The scatter of measured parts, split."""
    from mtu_cli.analyses.anova import METHODS, analyse_variance

    method = known_name("--method", "method", inputs.options.method, METHODS)
    datum = inputs.choices.datum or "none"
    result = analyse_variance(inputs.points, inputs.part_if_any, method, settings, datum)

    def unusual(_: float) -> str | None:
        if result.unusual is None:
            raise error("gate-undefined", gate="unusual", expected="four or more measured parts")
        outliers = listed(item.part for item in result.unusual)
        return f"outliers among the parts: {outliers}" if result.unusual else None

    return Outcome.reported(inputs, result, gates={"unusual": unusual})


def compare(inputs: Inputs, settings: Settings) -> Outcome:
    """Predicted against measured parts."""
    from mtu_cli.analyses.compare import compare as analysis

    modelling = modelled(inputs)
    datum = inputs.choices.datum or "none"
    result = analysis(modelling.model, inputs.part, inputs.points, settings, datum, inputs.at)
    gates = {gate: partial(_verdict_reason, result, gate) for gate in ("biased", "under-predicted")}
    return Outcome.reported(inputs, result, modelling.warnings, gates=gates)


def _verdict_reason(result: CompareResult, gate: str, limit: float) -> str | None:
    """The items that meet a gate; of few parts a mean that is off meets both."""
    from mtu_cli.analyses.compare import FEWEST_PARTS

    failures: list[str] = []
    judged = False
    for kind in filter(None, (result.features, result.lengths)):
        answers = kind.biased if gate == "biased" else kind.under_predicted
        few = kind.one_way.parts < FEWEST_PARTS
        for label, *flags, small in zip(kind.labels, answers, kind.biased, few, strict=True):
            verdicts = flags[: 1 + bool(small)]
            judged |= any(answer is not None for answer in verdicts)
            failures += [" ".join(filter(None, label))] if any(verdicts) else []
    if not judged:
        expected = (
            "two or more parts, in which features or lengths of the part were measured, "
            "and a machine that was read in enough passes"
        )
        raise error("gate-undefined", gate=gate, expected=expected)
    pooled = [item for item in result.features.summaries if item.pooled_fault == gate]
    failures += [f"{item.operation} features pooled".strip() for item in pooled]
    return listed(failures) if failures else None


def correct(inputs: Inputs, settings: Settings) -> Outcome:
    """Measured points minus the modelled error."""
    from mtu_cli.analyses.correct import correct as analysis
    from mtu_cli.analyses.correct import unused_warmth

    reference = inputs.machine.machine.reference_temperature_degC
    part = inputs.part_if_any
    rounds: Iterable[Any] = (*part.part.circles, *part.part.spheres) if part else ()
    # A calibrated diameter may need a temperature that no equation uses.
    modelling = modelled(inputs, [item.temperature for item in rounds if item.temperature])
    result = analysis(modelling.model, part, inputs.points, settings, inputs.at)
    warmth = unused_warmth(modelling.model, inputs.points, reference)
    return Outcome.reported(inputs, result, [*modelling.warnings, *warmth])
