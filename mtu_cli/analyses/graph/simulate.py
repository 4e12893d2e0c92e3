"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.graph.trial_runs import run_trials, survey
from mtu_cli.model.graph.first_order import FirstOrder, first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.settings import Settings, Warned
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation

ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""Share of the dimensions that rounding may make of a nominal of 0."""
NOTHING = 1e-6
"""Share of u below which a nominal is not told from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `rounding`: of the nominal. `fixed`: it does not vary. `validation` None
    where it is fixed or its first-order form is nil. `samples`: the first trials.
    """

    output: Output
    nominal: float
    rounding: float
    mean: float
    u: float
    interval: tuple[float, float]
    shortest: tuple[float, float]
    se_u: float
    trials: int
    converged: bool
    first_order_u: float
    shares: dict[str, float]
    fixed: bool
    validation: Validation | None
    samples: FloatArray

    @property
    def at_zero(self) -> bool:
        """Whether the nominal is 0 for all that can be told."""
        return abs(self.nominal) <= max(self.rounding, NOTHING * self.u)


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSimulation:
    """All coordinates asked for; `trials` is the largest count that one of them took."""

    graph: MeasurementGraph
    coordinates: tuple[SimulatedCoordinate, ...]
    trials: int
    converged: bool
    warnings: tuple[Warned, ...]


def simulate_graph(
    graph: MeasurementGraph, settings: Settings, of: Sequence[str] = ()
) -> GraphSimulation:
    """Propagates the uncertainty of probings and constants through the graph.

    With an adaptive count, outputs that hardly follow a first-order form are run apart.
    """
    outputs = graph.outputs(of)
    whole = evaluation(graph, outputs)
    linear = first_order(whole)
    fixed, bent = survey(graph, whole, linear, settings.seed)
    varying = np.flatnonzero(~fixed)
    together = settings.trials is not None
    groups = [varying] if together else [np.flatnonzero(~fixed & ~bent), np.flatnonzero(bent)]
    found: dict[int, SimulatedCoordinate] = {
        int(i): _fixed(outputs[i], linear, int(i)) for i in np.flatnonzero(fixed)
    }
    for group in groups:
        if len(group):
            members = [outputs[i] for i in group]
            run = run_trials(graph, members, settings, bent=bool(bent[group].all()))
            for at, i in enumerate(group):
                found[int(i)] = _coordinate(outputs[i], linear, int(i), run, at, settings)
    coordinates = tuple(found[i] for i in range(len(outputs)))
    return GraphSimulation(
        graph=graph,
        coordinates=coordinates,
        trials=max((item.trials for item in coordinates), default=0),
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
        se_u=0.0,
        trials=0,
        converged=True,
        first_order_u=0.0,
        shares=_shares(linear, index),
        fixed=True,
        validation=None,
        samples=np.full(1, value),
    )


def _coordinate(
    output: Output,
    linear: FirstOrder,
    index: int,
    run: MonteCarloResult,
    at: int,
    settings: Settings,
) -> SimulatedCoordinate:
    nominal, u = float(linear.nominal[index]), float(linear.u[index])
    return SimulatedCoordinate(
        output=output,
        nominal=nominal,
        rounding=ROUNDING * float(linear.sizes[index]),
        mean=float(run.mean[at]),
        u=float(run.u[at]),
        interval=(float(run.low[at]), float(run.high[at])),
        shortest=(float(run.shortest_low[at]), float(run.shortest_high[at])),
        se_u=float(run.se_u[at]),
        trials=run.trials,
        converged=run.converged,
        first_order_u=u,
        shares=_shares(linear, index),
        fixed=False,
        validation=settings.validate(nominal, u, np.inf, run, at) if u > 0 else None,
        samples=run.samples[at],
    )


def _warnings(coordinates: Sequence[SimulatedCoordinate]) -> list[Warned]:
    nil = [str(item.output) for item in coordinates if not item.fixed and item.first_order_u == 0]
    warnings = []
    if nil:
        more = f" and {len(nil) - 6} more" if len(nil) > 6 else ""
        warnings.append(
            Warned(
                code="first-order-nil",
                message=f"{', '.join(nil[:6])}{more}: the first-order uncertainty is 0 and no use, "
                "the Monte Carlo u is of second order; it has no shares by source",
            )
        )
    return warnings
