"""Measurement graphs for tests: from text, and the shipped ones."""

from __future__ import annotations

from pathlib import Path

from support import CONFIGS

from mtu_cli.files.graph import load_graph
from mtu_cli.model.graph.trials import MeasurementGraph, build_graph
from mtu_cli.model.graph.units import examine

SHIPPED = sorted((CONFIGS / "graphs").glob("*.yaml"))
HEAD = "schema: mtu/graph/1\nname: example\n"


def shipped(name: str) -> MeasurementGraph:
    """A shipped graph by the name of its file."""
    return build_graph(load_graph(CONFIGS / "graphs" / f"{name}.yaml", examine))


def graph_of(folder: Path, text: str) -> MeasurementGraph:
    """A graph of the rest of a file: what follows its name."""
    path = folder / "graph.yaml"
    path.write_text(HEAD + text, "utf-8")
    return build_graph(load_graph(path, examine))
