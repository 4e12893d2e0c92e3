"""`mtu predict-points`."""

from __future__ import annotations

from mtu_cli.analyses.predict_points import predict_points
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.parameters import Options
from mtu_cli.model.settings import Settings


def run(options: Options) -> None:
    """Predicts the error of every feature."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import predict_points as report

    found = modelled(inputs)
    result = predict_points(found.model, inputs.part, settings, inputs.at)
    return Outcome(
        results=lambda: report.document(result, with_covariance=bool(inputs.options.covariance)),
        tables=lambda: report.table(result),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result),
        warnings=[*found.warnings, *result.warnings, *report.warnings(result)],
    )
