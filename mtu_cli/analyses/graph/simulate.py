"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.graph.trials import SIMULATED, Errors, TrialRuns, Trials, not_converged
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.graph.places import Output
from mtu_cli.model.graph.trials import FirstOrder, MeasurementGraph, evaluation, first_order
from mtu_cli.model.settings import Settings, validation_warnings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.validation import Validation
from mtu_cli.units import UM

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
    `k`: coverage factor.
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
    k: float

    @property
    def U(self) -> float:
        """Expanded uncertainty k u."""
        return self.k * self.u

    @property
    def deviation(self) -> float:
        """Mean less nominal."""
        return self.mean - self.nominal

    @property
    def deviations(self) -> tuple[float, float]:
        """The interval less the nominal."""
        return self.interval[0] - self.nominal, self.interval[1] - self.nominal

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

    @property
    def places(self) -> dict[str, dict[str, SimulatedCoordinate]]:
        """The coordinates by name of the place and of the coordinate."""
        found: dict[str, dict[str, SimulatedCoordinate]] = {}
        for item in self.coordinates:
            found.setdefault(item.output.place, {})[item.output.coordinate] = item
        return found

    @property
    def sources(self) -> tuple[str, ...]:
        """All sources of variance."""
        return tuple(dict.fromkeys(name for item in self.coordinates for name in item.shares))


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
    coordinates = tuple(
        _coordinate(item, i, linear, runs, trials)
        for i, (item, trials) in enumerate(zip(outputs, runs.run(), strict=True))
    )
    return GraphSimulation(
        graph=graph,
        coordinates=coordinates,
        trials=max((item.trials for item in coordinates), default=0),
        digits=settings.digits,
        converged=all(item.converged for item in coordinates),
        warnings=tuple(_warnings(coordinates, settings.digits)),
    )


def _coordinate(
    output: Output, index: int, linear: FirstOrder, runs: TrialRuns, trials: Trials
) -> SimulatedCoordinate:
    u = float(linear.u[index])
    return SimulatedCoordinate(
        output=output,
        nominal=float(linear.nominal[index]),
        rounding=ROUNDING * float(linear.sizes[index]),
        mean=trials.mean,
        u=trials.u,
        interval=trials.interval,
        shortest=trials.shortest,
        errors=trials.errors,
        trials=trials.count,
        converged=trials.converged,
        first_order_u=u,
        shares={source: float(values[index]) for source, values in linear.shares.items()},
        fixed=trials.run is None,
        chance=trials.chance,
        validation=None if u <= 0 or trials.chance else runs.verdict(index),
        samples=np.full(1, trials.mean) if trials.run is None else trials.run.samples[trials.at],
        k=runs.settings.coverage_factor,
    )


def _warnings(coordinates: Sequence[SimulatedCoordinate], digits: int) -> list[Finding]:
    nil = [
        str(item.output)
        for item in coordinates
        if not (item.fixed or item.chance) and item.first_order_u == 0
    ]
    warnings = []
    if coordinates and all(item.fixed for item in coordinates):
        warnings.append(finding("unrelated", output="the result", names=["anything uncertain"]))
    if nil:
        reason = "the first-order uncertainty is 0, u is of second order"
        warnings.append(
            finding("not-estimable", quantity="shares by source", names=nil, reason=reason)
        )
    return [*warnings, *_judged(coordinates), *_not_converged(coordinates, digits)]


def _judged(coordinates: Sequence[SimulatedCoordinate]) -> list[Finding]:
    """What clause 8 rejects or cannot judge: of lengths, of angles, and of all else."""
    units = {"mm": ("um", UM), "rad": ("rad", 1.0)}
    by_unit: dict[tuple[str, float], list[tuple[str, Validation]]] = {}
    for item in coordinates:
        if item.validation is not None:
            shown = units.get(item.output.unit, ("", 1.0))
            by_unit.setdefault(shown, []).append((str(item.output), item.validation))
    return [
        each
        for (unit, size), judged in by_unit.items()
        for each in validation_warnings([x for x, _ in judged], [x for _, x in judged], unit, size)
    ]


def _not_converged(coordinates: Sequence[SimulatedCoordinate], digits: int) -> list[Finding]:
    """Outputs that ended, as asked or at their largest count, before they had their digits."""
    short = [item for item in coordinates if not item.converged]
    return [
        not_converged(
            count,
            digits,
            f"for {listed(_known_to(item) for item in short if item.trials == count)}",
        )
        for count in dict.fromkeys(item.trials for item in short)
    ]


def _known_to(item: SimulatedCoordinate) -> str:
    """What there is instead: ``d2 (standard error of u 1.5 %)``."""
    if item.chance:
        return f"{item.output} (chance {item.mean:.2g}, standard error {item.errors.mean:.2g})"
    if not math.isfinite(item.errors.u):
        return f"{item.output} (no trial made it jump, and none rules out that it may)"
    percent = 100 * item.errors.u / item.u if item.u > 0 else math.nan
    return f"{item.output} (standard error of u {percent:.2g} %)"
