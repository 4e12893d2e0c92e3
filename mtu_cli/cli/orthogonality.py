"""`mtu orthogonality`."""

from __future__ import annotations

from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled, one_direction
from mtu_cli.cli.options import Options
from mtu_cli.model.settings import Settings


def run(options: Options) -> None:
    """Predicts right angles between rows and columns of features."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import orthogonality as report

    found = modelled(inputs)
    result = predict_orthogonality(found.model, inputs.part, settings, inputs.at)
    return Outcome(
        results=lambda: report.document(result, settings.coverage_factor),
        tables=lambda: report.table(result, settings.coverage_factor, settings.digits),
        rows=lambda: report.csv_rows(result, settings.coverage_factor),
        figure=lambda: report.figure(result),
        warnings=[
            *found.warnings,
            *one_direction(inputs, found.model),
            *result.warnings,
            *report.warnings(result),
        ],
    )
