"""`mtu graph draw`: the graph as a picture or as text."""

from __future__ import annotations

from pathlib import Path

from mtu_cli.analyses.graph.shares import shares_by_place
from mtu_cli.cli.options import Options
from mtu_cli.errors import fault
from mtu_cli.files.graph_file import load_graph
from mtu_cli.files.write import check_targets, write_files
from mtu_cli.model.graph.examine import examine
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, build_graph
from mtu_cli.reports.figures import SUFFIXES, figure_bytes
from mtu_cli.reports.graph_net import Net, net_of

TEXTS = ("dot", "mmd", "pl")


def run(options: Options) -> None:
    """Draws the graph of a file to --to."""
    target: Path = options.to
    suffix = target.suffix.lower().removeprefix(".")
    if suffix not in (*SUFFIXES, *TEXTS):
        known = ", ".join(f".{item}" for item in (*SUFFIXES, *TEXTS))
        raise fault("--to cannot draw this kind of file", value=str(target), expected=known)
    check_targets([target])
    loaded = load_graph(options.file, examine)
    graph = build_graph(loaded)
    content = _content(graph, net_for(graph, options.of), suffix)
    write_files({target: content}, inputs=[loaded.source.path])


def net_for(graph: MeasurementGraph, of: str | None = None) -> Net:
    """The net to draw, with the shares of the variance of `of`."""
    shares = None if of is None else shares_by_place(graph, of)
    return net_of(graph.graph, graph.loaded.reported, of, shares)


def _content(graph: MeasurementGraph, net: Net, suffix: str) -> bytes:
    from mtu_cli.reports import graph_text

    match suffix:
        case "dot":
            return graph_text.dot(net).encode()
        case "mmd":
            return graph_text.mermaid(net).encode()
        case "pl":
            return graph_text.assertions(net, graph.graph, graph.nominal).encode()
    from mtu_cli.reports.graph_drawing import drawing

    return figure_bytes(drawing(net), suffix)
