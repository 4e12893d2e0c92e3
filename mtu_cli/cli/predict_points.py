"""`mtu predict-points`."""

from __future__ import annotations

from mtu_cli.analyses.predict_points import predict_places, predict_points
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.options import Options
from mtu_cli.model.settings import Settings
from mtu_cli.model.volume import grid_of, grid_warnings


def run(options: Options) -> None:
    """Predicts the error of every feature."""
    execute(options, analyse)


def analyse(inputs: Inputs, settings: Settings) -> Outcome:
    from mtu_cli.reports import predict_points as report
    from mtu_cli.reports import volume_map

    found = modelled(inputs)
    grid = inputs.options.grid
    if grid is None:
        result = predict_points(found.model, inputs.part, settings, inputs.at)
    else:
        ids, places = grid_of(inputs.machine, found.model, grid)
        told = grid_warnings(inputs.machine, found.model, grid)
        result = predict_places(found.model, ids, places, settings, inputs.at, told)
    return Outcome(
        results=lambda: report.document(result, with_covariance=bool(inputs.options.covariance)),
        tables=lambda: report.table(result, settings.digits),
        rows=lambda: report.csv_rows(result),
        figure=lambda: report.figure(result) if grid is None else volume_map.figure(result),
        warnings=[*found.warnings, *result.warnings, *report.warnings(result)],
    )
