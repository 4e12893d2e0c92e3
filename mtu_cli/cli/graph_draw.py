"""`mtu graph draw`: the graph as a picture or as text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mtu_cli.analyses.graph.shares import shares_by_place
from mtu_cli.cli.execute import Outcome, execute
from mtu_cli.cli.graph_options import loaded_graph
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.findings import error
from mtu_cli.model.graph.measurement_graph import MeasurementGraph
from mtu_cli.model.settings import Settings
from mtu_cli.reports.figures import SUFFIXES, figure_bytes
from mtu_cli.reports.graph_net import Net, net_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEXTS = ("dot", "mmd", "pl")


def run(options: Options) -> None:
    """Draws the graph of a file to --to."""
    target: Path = options.to
    suffix = _suffix(target)
    if suffix not in (*SUFFIXES, *TEXTS):
        known = ", ".join(f".{item}" for item in (*SUFFIXES, *TEXTS))
        raise error("wrong-ending", option="--to", kind=known, value=str(target))
    values = {**options.values, "machine": options.file, "write_to": target, "quiet": True}
    execute(Options("graph-draw", values), draw)


def draw(inputs: Inputs, settings: Settings) -> Outcome:
    """The file at --to, and nothing else."""
    options = inputs.options
    graph = loaded_graph(inputs)
    net = net_for(graph, options.of)
    return Outcome(
        results=dict,
        tables=tuple,
        rows=lambda: ((), ()),
        figure=lambda: drawn(net),
        files=lambda: {options.to: _content(graph, net, _suffix(options.to))},
    )


def drawn(net: Net) -> Figure:
    """The picture of a net."""
    from mtu_cli.reports.graph_drawing import drawing

    return drawing(net)


def net_for(graph: MeasurementGraph, of: str | None = None) -> Net:
    """The net to draw, with the shares of the variance of `of`."""
    shares = None if of is None else shares_by_place(graph, of)
    return net_of(graph.graph, graph.loaded.reported, of, shares)


def _suffix(target: Path) -> str:
    return target.suffix.lower().removeprefix(".")


def _content(graph: MeasurementGraph, net: Net, suffix: str) -> bytes:
    from mtu_cli.reports import graph_text

    match suffix:
        case "dot":
            return graph_text.dot(net).encode()
        case "mmd":
            return graph_text.mermaid(net).encode()
        case "pl":
            return graph_text.assertions(net, graph.graph, graph.nominal).encode()
    return figure_bytes(drawn(net), suffix)
