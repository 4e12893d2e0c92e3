"""`mtu compare`."""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.analyses.compare import Compared, CompareResult, compare
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.gates import read_gates
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.options import Options
from mtu_cli.findings import error, listed
from mtu_cli.model.settings import Settings

BIASED, UNDER = "biased", "under-predicted"
GATES = (BIASED, UNDER)
EXPECTED = f"{' or '.join(GATES)}, or both: --fail-if {','.join(GATES)}"


def run(options: Options) -> None:
    """Sets the prediction beside measured parts."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import compare as report

    gates = read_gates(inputs.options.fail_if, GATES.__contains__, EXPECTED)
    found = modelled(inputs)
    datum = inputs.datum
    result = compare(found.model, inputs.part, inputs.points, settings, datum, inputs.at)
    met = list(dict.fromkeys(name for gate in gates for name in _met(result, gate)))
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: report.table(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result),
        warnings=[*found.warnings, *result.warnings],
        gate=listed(met) if met else None,
    )


def _met(result: CompareResult, gate: str) -> list[str]:
    """The items that meet a gate: parts too few to tell bias from scatter meet both."""
    kinds = [kind for kind in (result.features, result.lengths) if kind is not None]
    answers = [
        (label, faulty, unclear)
        for kind in kinds
        for label, faulty, unclear in zip(
            kind.labels, _answers(kind, gate), kind.inconsistent, strict=True
        )
    ]
    if all(faulty is None and unclear is None for _, faulty, unclear in answers):
        raise error(
            "gate-undefined",
            gate=gate,
            expected="two or more parts, in which features or lengths of the part were measured, "
            "and a machine that was read in enough passes",
        )
    single = [
        " ".join(word for word in label if word)
        for label, faulty, unclear in answers
        if faulty or unclear
    ]
    return [*single, *_met_together(result, gate)]


def _met_together(result: CompareResult, gate: str) -> list[str]:
    """Operations whose features scatter too much all together, where none does by itself."""
    found = [item for item in result.features.at_once if item.verdict == gate and item.others]
    return [f"{item.operation} features all together".strip() for item in found]


def _answers(kind: Compared, gate: str) -> Sequence[bool | None]:
    return kind.biased if gate == BIASED else kind.under_predicted
