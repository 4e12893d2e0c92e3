"""`mtu compare`."""

from __future__ import annotations

from mtu_cli.analyses.compare import CompareResult, compare
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.options import Options
from mtu_cli.errors import did_you_mean, fault
from mtu_cli.model.datum import DATUMS
from mtu_cli.model.settings import Settings

GATES = ("biased", "under-predicted")


def run(options: Options) -> None:
    """Sets the prediction beside measured parts."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import compare as report

    gate = inputs.options.fail_if
    if gate is not None and gate not in GATES:
        raise fault("unknown gate", value=gate, expected=" or ".join(GATES))
    study = inputs.study.study.settings if inputs.study else None
    datum = inputs.options.datum or (study.datum if study else None) or "none"
    if datum not in DATUMS:
        raise fault("unknown datum", value=datum, expected=did_you_mean(datum, DATUMS))
    found = modelled(inputs)
    result = compare(found.model, inputs.part, inputs.points, settings, datum, inputs.at)
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: report.table(result),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result),
        warnings=[*found.warnings, *result.warnings, *report.warnings(result)],
        gate=None if gate is None else _met(result, gate),
    )


def _met(result: CompareResult, gate: str) -> str | None:
    found = [
        " ".join(word for word in label if word)
        for compared in (result.features, result.lengths)
        if compared is not None
        for label, verdict in zip(compared.labels, compared.verdicts, strict=True)
        if verdict == gate
    ]
    if not found:
        return None
    more = f" and {len(found) - 6} more" if len(found) > 6 else ""
    return f"{', '.join(found[:6])}{more}"
