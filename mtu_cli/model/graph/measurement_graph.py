"""A checked graph, ready to be evaluated on any number of trials at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.graph import LoadedGraph
from mtu_cli.files.graph_contract import Graph
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.model.graph.inputs import Inputs
from mtu_cli.model.graph.nominal import (
    Computed,
    Values,
    named_scalars,
    nominal_values,
    not_finite,
)
from mtu_cli.model.graph.outputs import Output, outputs_of, read
from mtu_cli.model.graph.units import place_units
from mtu_cli.stats.least_squares import FloatArray

LARGEST = 1e150
"""Beyond it the square of a value is not finite."""


@dataclass(frozen=True, kw_only=True)
class MeasurementGraph:
    """`nominal` holds every place (m = 1), `computed` the computing transitions in firing
    order, `units` the unit of every place.
    """

    loaded: LoadedGraph
    graph: Graph
    nominal: Values
    computed: tuple[Computed, ...]
    units: dict[str, str]

    def outputs(self, names: Iterable[str] = ()) -> tuple[Output, ...]:
        """Outputs by name; without names those that the file reports."""
        wanted = tuple(names) or self.loaded.reported
        return outputs_of(wanted, self.graph.places, self.units)

    def needed(self, outputs: Sequence[Output]) -> tuple[set[str], tuple[Computed, ...]]:
        """Start places and transitions that stand behind some outputs."""
        wanted = {item.place for item in outputs}
        steps = []
        for item in reversed(self.computed):
            if wanted.intersection(item.step.outputs):
                steps.append(item)
                wanted.update(item.step.inputs)
        made = {name for item in self.computed for name in item.step.outputs}
        return wanted - made, tuple(reversed(steps))

    def with_probing(self, graph: Graph) -> MeasurementGraph:
        """The same net under other uncertainties of probing."""
        return replace(self, graph=graph)


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What stands behind some outputs, and nothing else, as a function of the random inputs."""

    outputs: tuple[Output, ...]
    inputs: Inputs
    steps: tuple[Computed, ...]
    nominal: Values
    loaded: LoadedGraph

    @property
    def sizes(self) -> FloatArray:
        """What the rounding of each output (n,) is a share of: the part's largest coordinate for
        a length, 1 for an angle or a ratio.
        """
        part = float(np.max(np.abs(self.inputs.mean), initial=1.0))
        return np.array([1.0 if item.unit in ("1", "rad") else part for item in self.outputs])

    def run(self, X: FloatArray, into: FloatArray | None = None) -> FloatArray:
        """Outputs (n, m) for inputs X (k, m)."""
        values = self.inputs.values(X)
        for step in self.steps:
            step.run(values)
        return read(values, self.outputs, self.nominal, into)

    def raise_not_finite(self, X: FloatArray) -> None:
        """Raises InputError for the first transition that has no finite value at all inputs X."""
        values = self.inputs.values(X)
        for item in self.steps:
            with np.errstate(all="ignore"):
                item.run(values)
            made = [values[name].reshape(-1, X.shape[1]) for name in item.step.outputs]
            bad = np.any(~(np.abs(np.concatenate(made)) < LARGEST), axis=0)
            if np.any(bad):
                raise InputError([self._not_finite(item, values, bad)])

    def _not_finite(self, item: Computed, values: Values, bad: NDArray[np.bool_]) -> Finding:
        step, count = item.step, int(np.count_nonzero(bad))
        why = ""
        if step.formula is not None:
            at = named_scalars(step.formula, values, int(np.argmax(bad)))
            why = f": {not_finite(step.formula, at)}"
        return finding(
            "no-finite-value",
            what=f"{step.do} of {listed(step.outputs)}",
            where=f" below {LARGEST:g} in {count} of {len(bad)} Monte Carlo trials{why}",
            expected="a step that is defined for all values its inputs may take: bounded "
            "distributions or smaller uncertainties where it needs them",
            **place_of_step(self.loaded, step.index),
        )


def build_graph(loaded: LoadedGraph) -> MeasurementGraph:
    """Raises InputError for constructions that are degenerate at nominal."""
    nominal, computed, faults = nominal_values(loaded.graph.places, loaded.rounds)
    if faults:
        raise InputError(own.at(**place_of_step(loaded, index)) for index, own in faults)
    return MeasurementGraph(
        loaded=loaded,
        graph=loaded.graph,
        nominal=nominal,
        computed=tuple(computed),
        units=place_units(loaded.graph, loaded.steps),
    )


def place_of_step(loaded: LoadedGraph, index: int) -> dict[str, Any]:
    """Where a transition stands in its file."""
    line = loaded.line_of("transitions", index)
    return {"file": loaded.source.shown, "line": line, "path": f"transitions[{index}]"}


def evaluation(graph: MeasurementGraph, outputs: Sequence[Output]) -> Evaluation:
    """The part of the graph that some outputs need."""
    start, steps = graph.needed(outputs)
    return Evaluation(
        outputs=tuple(outputs),
        inputs=Inputs(graph.graph, start),
        steps=steps,
        nominal=graph.nominal,
        loaded=graph.loaded,
    )
