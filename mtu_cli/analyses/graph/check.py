"""Is a measurement graph whole, and in which order does it fire?"""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.model.graph.measurement_graph import MeasurementGraph


@dataclass(frozen=True, slots=True, kw_only=True)
class Fired:
    """A transition: the round in which it fires, what it does, and the places around it."""

    round: int
    do: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphCheck:
    """A sound graph: places by kind, `rounds` of transitions as the token rule fires them,
    `probings` in one cycle, and the places reported.
    """

    name: str
    kinds: dict[str, int]
    rounds: tuple[tuple[Fired, ...], ...]
    probings: int
    reported: tuple[str, ...]

    @property
    def places(self) -> int:
        """Number of places."""
        return sum(self.kinds.values())

    @property
    def transitions(self) -> tuple[Fired, ...]:
        """All transitions in the order in which they fire."""
        return tuple(step for fired in self.rounds for step in fired)


def check_graph(graph: MeasurementGraph) -> GraphCheck:
    """What a graph is made of, once its file has been found sound."""
    kinds: dict[str, int] = {}
    for place in graph.graph.places.values():
        kinds[place.kind] = kinds.get(place.kind, 0) + 1
    measured = [item for item in graph.graph.transitions if item.do == "meas"]
    return GraphCheck(
        name=graph.graph.name,
        kinds=kinds,
        rounds=tuple(
            tuple(
                Fired(round=i, do=x.do, inputs=tuple(x.inputs), outputs=tuple(x.outputs))
                for x in fired
            )
            for i, fired in enumerate(graph.loaded.rounds, 1)
        ),
        probings=sum(item.repeats or graph.graph.repeats for item in measured),
        reported=graph.loaded.reported,
    )
