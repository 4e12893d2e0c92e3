"""Of what is a measurement graph made, in which order does it fire, and whence comes a variance?"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.graph.net import MeasurementGraph, Rounds
from mtu_cli.model.graph.places import Output
from mtu_cli.model.graph.trials import evaluation, first_order


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphCheck:
    """A sound graph: numbers of places by kind, `rounds` of transitions as the token rule fires
    them, `probings` in one cycle, and the places reported.
    """

    name: str
    kinds: dict[str, int]
    rounds: Rounds
    probings: int
    reported: tuple[str, ...]


def check_graph(graph: MeasurementGraph) -> GraphCheck:
    """What a graph is made of, once its file has been found sound."""
    measured = [item for item in graph.graph.transitions if item.do == "meas"]
    return GraphCheck(
        name=graph.graph.name,
        kinds=dict(Counter(place.kind for place in graph.graph.places.values())),
        rounds=graph.rounds,
        probings=sum(item.repeats or graph.graph.repeats for item in measured),
        reported=graph.reported,
    )


def one_unit(graph: MeasurementGraph, of: str, *, single: bool = False) -> tuple[Output, ...]:
    """The outputs of a place.

    Raises InputError for an unknown place, one whose coordinates have different units, and, where
    a `single` one is wanted, one of several coordinates.
    """
    outputs = graph.outputs([of])
    if len({item.unit for item in outputs}) > 1 or (single and len(outputs) > 1):
        names, reason = ", ".join(map(str, outputs)), "the place has several coordinates"
        raise error("not-applicable", reason=reason, value=of, expected=f"one of: {names}")
    return outputs


def shares_by_place(graph: MeasurementGraph, of: str) -> dict[str, float]:
    """Shares of the first-order variance of `of` by the place where they come in, summing to 1;
    of a place with several coordinates, of the sum of their variances.

    Raises InputError as `one_unit` does, and where the first-order variance is 0.
    """
    linear = first_order(evaluation(graph, one_unit(graph, of)))
    total = float(np.sum(linear.u**2))
    if total == 0:
        reason = "the first-order uncertainty is 0: no shares of variance"
        raise error("not-applicable", reason=reason, value=of, expected="another place")
    return {
        name: float(np.nansum(values * linear.u**2) / total)
        for name, values in linear.by_place.items()
    }
