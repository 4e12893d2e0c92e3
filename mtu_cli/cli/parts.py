"""What measured parts say of each other and of the machine: `mtu anova`, `compare`, `correct`."""

from __future__ import annotations

from functools import partial
from typing import cast

from mtu_cli.analyses.anova import METHODS, AnovaResult, Method, analyse_variance
from mtu_cli.analyses.compare import CompareResult
from mtu_cli.analyses.compare import compare as compare_parts
from mtu_cli.analyses.compare.evidence import FEWEST_PARTS
from mtu_cli.analyses.correct import correct as correct_points
from mtu_cli.analyses.correct import unused_warmth
from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import modelled
from mtu_cli.cli.values import known_name
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import error, listed
from mtu_cli.model.settings import Settings


def anova(inputs: Inputs, settings: Settings) -> Outcome:
    """The scatter of measured parts, split."""
    from mtu_cli.reports import anova as report

    method = inputs.options.method
    known_name("--method", "method", method, METHODS)
    points, part = inputs.points, _part(inputs)
    datum = inputs.chosen.datum or "none"
    result = analyse_variance(points, part, cast(Method, method), settings, datum)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=result.warnings,
        gates={"unusual": lambda _: _unusual(result)},
    )


def _part(inputs: Inputs) -> LoadedPart | None:
    return inputs.part if inputs.files("part") else None


def _unusual(result: AnovaResult) -> str | None:
    if result.unusual is None:
        raise error("gate-undefined", gate="unusual", expected="four or more measured parts")
    outliers = listed(item.part for item in result.unusual)
    return f"outliers among the parts: {outliers}" if result.unusual else None


def compare(inputs: Inputs, settings: Settings) -> Outcome:
    """Predicted against measured parts."""
    from mtu_cli.reports import compare as report

    found = modelled(inputs)
    datum = inputs.chosen.datum or "none"
    result = compare_parts(found.model, inputs.part, inputs.points, settings, datum, inputs.at)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=[*found.warnings, *result.warnings],
        gates={gate: partial(_failing, result, gate) for gate in ("biased", "under-predicted")},
    )


def _failing(result: CompareResult, gate: str, limit: float) -> str | None:
    """The items that meet a gate, and operations whose pooled features do. Of parts too few to
    distinguish bias from scatter a mean that is off meets both.
    """
    met: list[str] = []
    judged = False
    for kind in (result.features, result.lengths):
        if kind is None:
            continue
        verdicts = kind.biased if gate == "biased" else kind.under_predicted
        few = kind.one_way.parts < FEWEST_PARTS
        for i, label in enumerate(kind.labels):
            answers = (verdicts[i], kind.biased[i]) if few[i] else (verdicts[i],)
            judged |= any(answer is not None for answer in answers)
            if any(answers):
                met.append(" ".join(word for word in label if word))
    if not judged:
        expected = (
            "two or more parts, in which features or lengths of the part were measured, "
            "and a machine that was read in enough passes"
        )
        raise error("gate-undefined", gate=gate, expected=expected)
    pooled = [item for item in result.feature_summaries if item.pooled_fault == gate]
    met += [f"{item.operation} features pooled".strip() for item in pooled]
    return listed(met) if met else None


def correct(inputs: Inputs, settings: Settings) -> Outcome:
    """Measured points minus the modelled error."""
    from mtu_cli.reports import correct as report

    reference = inputs.machine.machine.reference_temperature_degC
    part = _part(inputs)
    rounds = (*part.part.circles, *part.part.spheres) if part else ()
    # What no equation needs a calibrated diameter may.
    found = modelled(inputs, [item.temperature for item in rounds if item.temperature])
    result = correct_points(found.model, part, inputs.points, settings, inputs.at)
    warmth = unused_warmth(found.model, inputs.points, reference)
    warnings = [*found.warnings, *warmth, *result.warnings]
    return Outcome.of(report.document(result, settings.digits), warnings=warnings)
