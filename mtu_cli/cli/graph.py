"""`mtu graph check`, `simulate` and `sweep`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.graph_options import loaded_graph, outputs_wanted, varied
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.model.graph.measurement_graph import MeasurementGraph
from mtu_cli.model.settings import Settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def run(options: Options) -> None:
    """Runs one of the graph's commands on its file."""
    analyse = {"check": check, "simulate": simulate, "sweep": sweep}[options.command]
    # A graph has no study: the file that the call names stands where a machine's would, so that
    # none is looked for.
    values = {**options.values, "machine": options.file}
    execute(Options(f"graph-{options.command}", values), analyse)


def check(inputs: Inputs, settings: Settings) -> Outcome:
    """Whether the graph is sound, and its firing order."""
    from mtu_cli.analyses.graph.check import check_graph
    from mtu_cli.reports import graph_check as report

    graph = loaded_graph(inputs)
    result = check_graph(graph)
    return Outcome(
        results=lambda: report.document(result),
        tables=lambda: report.table(result),
        rows=lambda: report.csv_rows(result),
        figure=lambda: _drawing(graph),
    )


def simulate(inputs: Inputs, settings: Settings) -> Outcome:
    """The places asked for, by Monte Carlo and to first order."""
    from mtu_cli.analyses.graph.simulate import simulate_graph
    from mtu_cli.reports import graph_simulate as report

    result = simulate_graph(loaded_graph(inputs), settings, outputs_wanted(inputs.options))
    return Outcome(
        results=lambda: report.document(result, settings.coverage_factor),
        tables=lambda: report.table(result, settings.digits),
        rows=lambda: report.csv_rows(result, settings.coverage_factor),
        figure=lambda: _figure("simulated", result),
        warnings=report.warnings(result),
    )


def sweep(inputs: Inputs, settings: Settings) -> Outcome:
    """One place over the grid of --vary, and as the file has it."""
    from mtu_cli.analyses.graph.simulate import simulate_graph
    from mtu_cli.analyses.graph.sweep import PARAMETERS, sweep_graph
    from mtu_cli.reports import graph_simulate, graph_sweep

    grid = varied(inputs.options, PARAMETERS)
    graph = loaded_graph(inputs)
    of = inputs.options.of
    result = sweep_graph(graph, settings, of, grid)
    base = simulate_graph(graph, _all_done(settings, len(result.grid)), [of])
    return Outcome(
        results=lambda: {
            **graph_simulate.document(base, settings.coverage_factor),
            **graph_sweep.document(result),
            "converged": base.converged and result.converged,
        },
        tables=lambda: graph_sweep.table(result, settings.digits),
        rows=lambda: graph_sweep.csv_rows(result),
        figure=lambda: _figure("swept", result),
        warnings=graph_sweep.warnings(result),
    )


def _all_done(settings: Settings, count: int) -> Settings:
    """Settings of what follows a grid: its bar stays full."""
    tell = settings.progress
    return replace(
        settings, progress=None if tell is None else lambda done, total: tell(count, count)
    )


def _drawing(graph: MeasurementGraph) -> Figure:
    from mtu_cli.cli.graph_draw import drawn, net_for

    return drawn(net_for(graph))


def _figure(name: str, result: Any) -> Figure:
    from mtu_cli.reports import graph_figure

    figure: Figure = getattr(graph_figure, name)(result)
    return figure
