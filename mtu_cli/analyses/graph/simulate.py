"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.graph.first_order import FirstOrder, first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.graph.trials import GraphTrials
from mtu_cli.model.settings import PROBABILITY, Settings, Warned
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo
from mtu_cli.stats.streams import stream
from mtu_cli.stats.validation import Validation

PILOT = 4096
"""Trials that tell which outputs follow their first-order form."""
LINEAR = 0.5
"""Share of u that the first-order u must have for the adaptive count to wait for clause 8."""
ROUNDING = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
DRAWN = 2**16
"""Trials kept for the histogram."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `fixed`: it does not vary. `validation` None where it is fixed or its
    first-order form is nil. `samples`: the first trials.
    """

    output: Output
    nominal: float
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

    With an adaptive count, outputs that hardly follow a first-order form (a direction cosine
    near 1, a distance near 0) are run apart, to the tolerance of JCGM 101:2008, 7.9.4 itself:
    clause 8 has nothing to compare there, and no control variate helps.
    """
    outputs = graph.outputs(of)
    whole = evaluation(graph, outputs)
    linear = first_order(whole)
    fixed, bent = _survey(GraphTrials(whole, linear), linear, settings.seed, outputs)
    varying = np.flatnonzero(~fixed)
    together = settings.trials is not None
    groups = [varying] if together else [np.flatnonzero(~fixed & ~bent), np.flatnonzero(bent)]
    found: dict[int, SimulatedCoordinate] = {
        int(i): _fixed(outputs[i], linear, int(i)) for i in np.flatnonzero(fixed)
    }
    for group in groups:
        if len(group):
            bare = bool(bent[group].all()) and not together
            run = _run(graph, [outputs[i] for i in group], settings, to_tolerance=bare)
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


def _survey(
    model: GraphTrials, linear: FirstOrder, seed: int, outputs: Sequence[Output]
) -> tuple[np.ndarray, np.ndarray]:
    """Which outputs (n,) do not vary, and which hardly follow their first-order form."""
    values = model.draw(stream(seed, 1), PILOT).values
    u = values.std(axis=1)
    size = max(1.0, float(np.max(np.abs(model.evaluation.inputs.mean), initial=0.0)))
    scale = np.array([size if item.unit == "mm" else 1.0 for item in outputs])
    fixed = (u <= ROUNDING * scale) & (linear.u == 0.0)
    return fixed, ~fixed & ~(linear.u >= LINEAR * u)


def _run(
    graph: MeasurementGraph, outputs: Sequence[Output], settings: Settings, *, to_tolerance: bool
) -> MonteCarloResult:
    part = evaluation(graph, outputs)
    model = GraphTrials(part, first_order(part))
    if not to_tolerance:
        return settings.run(model, keep=DRAWN)
    return monte_carlo(
        model,
        seed=settings.seed,
        probability=PROBABILITY,
        digits=settings.digits,
        threads=settings.threads,
        keep=DRAWN,
        progress=settings.progress,
    )


def _shares(linear: FirstOrder, index: int) -> dict[str, float]:
    return {source: float(values[index]) for source, values in linear.shares.items()}


def _fixed(output: Output, linear: FirstOrder, index: int) -> SimulatedCoordinate:
    value = float(linear.nominal[index])
    return SimulatedCoordinate(
        output=output,
        nominal=value,
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
