"""Is a measurement graph whole, and in which order does it fire?"""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.files.graph import Step
from mtu_cli.model.graph.measurement_graph import MeasurementGraph


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphCheck:
    """A sound graph: places by kind, `rounds` of transitions as the token rule fires them,
    `probings` in one cycle, and the places reported.
    """

    name: str
    kinds: dict[str, int]
    rounds: tuple[tuple[Step, ...], ...]
    probings: int
    reported: tuple[str, ...]


def check_graph(graph: MeasurementGraph) -> GraphCheck:
    """What a graph is made of, once its file has been found sound."""
    kinds: dict[str, int] = {}
    for place in graph.graph.places.values():
        kinds[place.kind] = kinds.get(place.kind, 0) + 1
    measured = [item for item in graph.graph.transitions if item.do == "meas"]
    return GraphCheck(
        name=graph.graph.name,
        kinds=kinds,
        rounds=graph.loaded.rounds,
        probings=sum(item.repeats or graph.graph.repeats for item in measured),
        reported=graph.loaded.reported,
    )
