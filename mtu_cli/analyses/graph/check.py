"""Is a measurement graph whole, in which order does it fire, and whence comes a variance?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.graph.trials import MeasurementGraph, evaluation, first_order


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


def shares_by_place(graph: MeasurementGraph, of: str) -> dict[str, float]:
    """Shares of the first-order variance of `of` by the place where they come in, summing to 1;
    of a place with several coordinates, of the sum of their variances.

    Raises InputError for an unknown place, one whose coordinates have different units, or where
    the first-order variance is 0.
    """
    outputs = graph.outputs([of])
    if len({item.unit for item in outputs}) > 1:
        names, reason = ", ".join(map(str, outputs)), "the place has several coordinates"
        raise error("not-applicable", reason=reason, value=of, expected=f"one of: {names}")
    linear = first_order(evaluation(graph, outputs))
    total = float(np.sum(linear.u**2))
    if total == 0:
        reason = "the first-order uncertainty is 0: no shares of variance"
        raise error("not-applicable", reason=reason, value=of, expected="another place")
    return {
        name: float(np.nansum(values * linear.u**2) / total)
        for name, values in linear.by_place.items()
    }
