"""Measurement graph files (``mtu/graph/1``): read, and checked whole."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.files.contracts import Findings, check_contract
from mtu_cli.files.graph_contract import Graph
from mtu_cli.files.graph_steps import Step, resolve
from mtu_cli.files.graph_structure import check_net, firing_order, marked, sinks
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, read_yaml

Rounds = Sequence[Sequence[Step]]
Examine = Callable[[Graph, Rounds, Findings], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedGraph:
    """A checked graph file; `rounds` are its transitions in firing order."""

    source: Source
    graph: Graph
    rounds: tuple[tuple[Step, ...], ...]
    document: YamlDocument

    @property
    def steps(self) -> tuple[Step, ...]:
        """All transitions in firing order."""
        return tuple(step for fired in self.rounds for step in fired)

    @property
    def reported(self) -> tuple[str, ...]:
        """The places to report: those of the file, or else those that end the graph."""
        return tuple(self.graph.report) or tuple(sinks(self.graph))

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file."""
        return self.document.line_of(*path)


def load_graph(path: Path, examine: Examine | None = None) -> LoadedGraph:
    """Reads and checks a graph file.

    `examine` sees the sound part in firing order and adds what only calculating tells (a
    construction that is degenerate at nominal), so that all faults are told at once.

    Raises InputError with all problems of the file, each with its line.
    """
    document = read_yaml(path, "graph")
    found: list[list[Step]] = []

    def check(graph: Graph, findings: Findings) -> None:
        graph = _sound(graph)
        steps = resolve(graph, findings)
        check_net(graph, findings)
        found.extend(firing_order(_first_makers(steps), marked(graph.places)))
        if examine is not None:
            examine(graph, found, findings)

    graph = check_contract(document, Graph, "graph", check)
    return LoadedGraph(
        source=document.source,
        graph=graph,
        rounds=tuple(tuple(fired) for fired in found),
        document=document,
    )


def _sound(graph: Graph) -> Graph:
    """The graph with nothing where a part of it is faulty as a whole."""
    parts: dict[str, object] = {
        "places": graph.places or {},
        "transitions": graph.transitions or [],
        "report": graph.report or [],
        "correlations": graph.correlations or [],
    }
    return graph.model_copy(update=parts)


def _first_makers(steps: Sequence[Step]) -> list[Step]:
    """Without those that make a place a second time: the faults behind it are not theirs."""
    made: set[str] = set()
    kept = []
    for step in steps:
        if made.isdisjoint(step.outputs):
            kept.append(step)
        made.update(step.outputs)
    return kept
