"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.graph.trial_runs import SIMULATED, TrialRuns
from mtu_cli.analyses.graph.trials import Errors, Trials
from mtu_cli.findings import Finding, finding
from mtu_cli.model.graph.first_order import FirstOrder, first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.validation import Validation

ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""Share of the dimensions that rounding may make of a nominal of 0."""
NOTHING = 1e-6
"""Share of u below which a nominal is not told from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `rounding`: of the nominal. `fixed`: it does not vary. `chance`: it is 0
    or 1, and its `mean` the chance of 1. `converged`: to the digits of u asked for. `validation`
    None where it is fixed, a chance, or its first-order form is nil. `samples`: the first trials.
    """

    output: Output
    nominal: float
    rounding: float
    mean: float
    u: float
    interval: tuple[float, float]
    shortest: tuple[float, float]
    errors: Errors
    trials: int
    converged: bool
    first_order_u: float
    shares: dict[str, float]
    fixed: bool
    chance: bool
    validation: Validation | None
    samples: FloatArray

    @property
    def se_u(self) -> float:
        """Standard error of u."""
        return self.errors.u

    @property
    def at_zero(self) -> bool:
        """Whether the nominal is 0 for all that can be told."""
        return abs(self.nominal) <= max(self.rounding, NOTHING * self.u)


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSimulation:
    """All coordinates asked for; `trials` is the largest count that one of them took, `digits`
    those of u that were asked for.
    """

    graph: MeasurementGraph
    coordinates: tuple[SimulatedCoordinate, ...]
    trials: int
    digits: int
    converged: bool
    warnings: tuple[Finding, ...]


def simulate_graph(
    graph: MeasurementGraph, settings: Settings, of: Sequence[str] = ()
) -> GraphSimulation:
    """Propagates the uncertainty of probings and constants through the graph.

    With an adaptive count every output ends by itself (see `TrialRuns`).
    """
    outputs = graph.outputs(of)
    whole = evaluation(graph, outputs)
    linear = first_order(whole)
    runs = TrialRuns(graph, whole, linear, settings, SIMULATED)
    found = runs.run()
    coordinates = tuple(
        _coordinate(item, linear, i, runs, found[i]) if i in found else _fixed(item, linear, i)
        for i, item in enumerate(outputs)
    )
    return GraphSimulation(
        graph=graph,
        coordinates=coordinates,
        trials=max((item.trials for item in coordinates), default=0),
        digits=settings.digits,
        converged=all(item.converged for item in coordinates),
        warnings=tuple(_warnings(coordinates)),
    )


def _shares(linear: FirstOrder, index: int) -> dict[str, float]:
    return {source: float(values[index]) for source, values in linear.shares.items()}


def _fixed(output: Output, linear: FirstOrder, index: int) -> SimulatedCoordinate:
    value = float(linear.nominal[index])
    return SimulatedCoordinate(
        output=output,
        nominal=value,
        rounding=ROUNDING * float(linear.sizes[index]),
        mean=value,
        u=0.0,
        interval=(value, value),
        shortest=(value, value),
        errors=Errors(mean=0.0, u=0.0, low=0.0, high=0.0),
        trials=0,
        converged=True,
        first_order_u=0.0,
        shares=_shares(linear, index),
        fixed=True,
        chance=False,
        validation=None,
        samples=np.full(1, value),
    )


def _coordinate(
    output: Output, linear: FirstOrder, index: int, runs: TrialRuns, own: Trials
) -> SimulatedCoordinate:
    u = float(linear.u[index])
    return SimulatedCoordinate(
        output=output,
        nominal=float(linear.nominal[index]),
        rounding=ROUNDING * float(linear.sizes[index]),
        mean=own.mean,
        u=own.u,
        interval=own.interval,
        shortest=own.shortest,
        errors=own.errors,
        trials=own.run.trials,
        converged=own.converged,
        first_order_u=u,
        shares=_shares(linear, index),
        fixed=False,
        chance=own.chance,
        validation=runs.verdict(index) if u > 0 and not own.chance else None,
        samples=own.run.samples[own.at],
    )


def _warnings(coordinates: Sequence[SimulatedCoordinate]) -> list[Finding]:
    nil = [
        str(item.output)
        for item in coordinates
        if not (item.fixed or item.chance) and item.first_order_u == 0
    ]
    warnings = []
    if coordinates and all(item.fixed for item in coordinates):
        warnings.append(finding("nothing-varies"))
    if nil:
        reason = "the first-order uncertainty is 0, u is of second order"
        warnings.append(
            finding("not-estimable", quantity="shares by source", names=nil, reason=reason)
        )
    return warnings
