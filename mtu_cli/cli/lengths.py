"""`mtu lengths`."""

from __future__ import annotations

from mtu_cli.analyses.lengths import LengthsResult, predict_lengths
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.gates import read_gates
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled, one_direction
from mtu_cli.cli.options import Options
from mtu_cli.files.csv_table import number
from mtu_cli.findings import error
from mtu_cli.model.settings import Settings

GATE = "nonconforming"


def run(options: Options) -> None:
    """Predicts feature-to-feature lengths."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import lengths as report

    limit = _limit(inputs.options.fail_if)
    found = modelled(inputs)
    result = predict_lengths(found.model, inputs.part, settings, inputs.at)
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: report.table(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result, settings.digits),
        warnings=[
            *found.warnings,
            *inputs.part.warnings,
            *one_direction(inputs, found.model),
            *result.warnings,
            *report.warnings(result),
        ],
        gate=None if limit is None else _nonconforming(result, limit),
    )


def _limit(given: str | None) -> float | None:
    """The largest allowed probability of a part that does not conform."""
    expected = "nonconforming=P with P from 0 to below 1, such as 0.01 for 1 %"
    gates = read_gates(given, lambda gate: gate.startswith(f"{GATE}="), expected)
    if len(gates) > 1:
        raise error("appears-twice", what=f"--fail-if {GATE}", value=given, expected="one of them")
    if gates and _share(gates[0]) is None:
        raise error("out-of-range", path=f"--fail-if {GATE}", value=gates[0], expected=expected)
    return _share(gates[0]) if gates else None


def _share(gate: str) -> float | None:
    """P of ``nonconforming=P``; None where it is none."""
    limit = number(gate.partition("=")[2])
    return limit if limit is not None and 0 <= limit < 1 else None


def _nonconforming(result: LengthsResult, limit: float) -> str | None:
    checked = [(x.id, x.conformance) for x in result.lengths if x.conformance is not None]
    if not checked:
        raise error("gate-undefined", gate=GATE, expected="tolerance_um at a length of the part")
    found = [(name, 1 - c.probability) for name, c in checked if 1 - c.probability > limit]
    if result.joint_conformance is not None and 1 - result.joint_conformance[0] > limit:
        found.append(("the whole part", 1 - result.joint_conformance[0]))
    if not found:
        return None
    listed = ", ".join(f"{name} {100 * p:.{2 if p < 0.995 else 4}g} %" for name, p in found)
    return f"probability of a nonconforming part above {100 * limit:g} %: {listed}"
