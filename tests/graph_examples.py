"""Measurement graphs for tests: from text, and the shipped ones."""

from pathlib import Path

from support import CONFIGS

from mtu_cli.model.graph.net import MeasurementGraph, load_graph

SHIPPED = sorted((CONFIGS / "graphs").glob("*.yaml"))
HEAD = "schema: mtu/graph/1\nname: example\n"


def shipped(name: str) -> MeasurementGraph:
    return load_graph(CONFIGS / "graphs" / f"{name}.yaml")


def graph_of(folder: Path, text: str) -> MeasurementGraph:
    """A graph of the rest of a file: what follows its name."""
    path = folder / "graph.yaml"
    path.write_text(HEAD + text, "utf-8")
    return load_graph(path)
