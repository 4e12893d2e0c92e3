"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mtu_cli.findings import Finding, counted, finding, listed
from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.model.graph.places import Output
from mtu_cli.model.graph.trials import GraphTrials, evaluation, first_order
from mtu_cli.model.settings import Settings, validation_warnings
from mtu_cli.stats.coverage import few_blocks_factor, numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.streams import stream
from mtu_cli.stats.validation import CONVERGED_TO, Validation
from mtu_cli.units import UM

MOST = 2_500_000
"""Trials where the count adapts, at most."""
PILOT = 4096
"""Trials that tell which outputs vary, and which follow their first-order form."""
LINEAR = 0.5
"""Share of u that the first-order u must have to say anything of it."""
STILL = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
DRAWN = 2**16
"""Trials kept for the histogram."""
ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""Share of the dimensions that rounding may make of a nominal of 0."""
NOTHING = 1e-6
"""Share of u below which a nominal is not told from 0."""


@dataclass(frozen=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `rounding`: of the nominal. `se_*`: standard errors of the Monte Carlo.
    `converged`: to the digits of u asked for. `chance`: all trials are 0 or 1, and their mean is
    the chance of 1. `validation` None where it is fixed, jumps, or its first-order form is nil.
    `samples`: the first trials; without `trials` it does not vary. `k`: coverage factor.
    """

    output: Output
    nominal: float
    rounding: float
    first_order_u: float
    shares: dict[str, float]
    k: float
    mean: float
    u: float = 0.0
    interval: tuple[float, float]
    shortest: tuple[float, float]
    se_mean: float = 0.0
    se_u: float = 0.0
    trials: int = 0
    converged: bool = True
    chance: bool = False
    validation: Validation | None = None
    samples: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def fixed(self) -> bool:
        """Whether it does not vary."""
        return self.trials == 0

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
    def at_zero(self) -> bool:
        """Whether the nominal is 0 for all that can be told."""
        return abs(self.nominal) <= max(self.rounding, NOTHING * self.u)

    @property
    def relative_se(self) -> float:
        """Relative standard error of u; infinite where u is 0."""
        return self.se_u / self.u if self.u > 0.0 else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSimulation:
    """All coordinates asked for, of as many `trials` as that took; `digits` of u asked for."""

    graph: MeasurementGraph
    coordinates: tuple[SimulatedCoordinate, ...]
    digits: int

    @property
    def trials(self) -> int:
        """Of those that vary."""
        return max((item.trials for item in self.coordinates), default=0)

    @property
    def converged(self) -> bool:
        """Whether all have."""
        return all(item.converged for item in self.coordinates)

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

    @property
    def warnings(self) -> list[Finding]:
        """What does not vary or has no first order; clause 8; what has not converged."""
        found = []
        if self.coordinates and all(item.fixed for item in self.coordinates):
            found.append(finding("unrelated", output="the result", names=["anything uncertain"]))
        nil = [x for x in self.coordinates if not (x.fixed or x.chance or x.first_order_u)]
        if nil:
            reason = "the first-order uncertainty is 0, u is of second order"
            what = {"quantity": "shares by source", "names": [str(item.output) for item in nil]}
            found.append(finding("not-estimable", **what, reason=reason))
        units: dict[tuple[str, float], list[tuple[str, Validation]]] = {}
        for item in self.coordinates:
            if item.validation is not None:
                shown = {"mm": ("um", UM), "rad": ("rad", 1.0)}.get(item.output.unit, ("", 1.0))
                units.setdefault(shown, []).append((str(item.output), item.validation))
        for (unit, size), judged in units.items():
            names, outcomes = zip(*judged, strict=True)
            found += validation_warnings(names, outcomes, unit, size)
        short = [item for item in self.coordinates if not item.converged]
        if short:
            what_of = (f"{item.output} ({known_to(item.relative_se)})" for item in short)
            found.append(not_converged(self.trials, self.digits, f"for {listed(what_of)}"))
        return found


def known_to(relative_se: float) -> str:
    """How far trials have come."""
    if math.isinf(relative_se):
        return "all trials are the same"
    return f"standard error of u {100 * relative_se:.2g} %"


def not_converged(trials: int, digits: int, what: str) -> Finding:
    """The warning of so many trials; `what`: of which places, or how far they have come."""
    goal = f"{counted(digits, 'significant digit')} of u (JCGM 101, 7.9.4), {what}"
    return finding("not-converged", trials=trials, goal=goal)


def simulate_graph(
    graph: MeasurementGraph, settings: Settings, of: Sequence[str] = ()
) -> GraphSimulation:
    """Propagates the uncertainty of probings and constants through the graph."""
    found = simulate_outputs(graph, graph.outputs(of), settings, most=MOST)
    return GraphSimulation(graph=graph, coordinates=tuple(found), digits=settings.digits)


def simulate_outputs(
    graph: MeasurementGraph,
    outputs: Sequence[Output],
    settings: Settings,
    *,
    most: int,
    ends: bool = True,
) -> list[SimulatedCoordinate]:
    """Outputs by Monte Carlo, at most so many trials where the count adapts, and to first order;
    whether they have their digits is judged by mean and u and, with `ends`, by the interval.

    What goes through a step may vary in so few trials that a pilot sees none of them: it counts as
    varying, whatever the pilot says, and as not converged while all its trials are the same.
    """
    whole = evaluation(graph, outputs)
    linear, jumps = first_order(whole), whole.jumps
    pilot = GraphTrials(whole, linear).draw(stream(settings.seed, 1), PILOT).values.std(axis=1)
    varies = jumps | (pilot > STILL * whole.sizes) | (linear.u > 0.0)
    straight = (linear.u >= LINEAR * pilot) & (linear.u > 0.0)
    rows = {int(i): row for row, i in enumerate(np.flatnonzero(varies))}
    run = None
    if rows:
        # Where first order does not hold clause 8 needs no fifth of the tolerance (8.2) to say so.
        fraction = CONVERGED_TO if straight[varies].all() else 1.0
        part = evaluation(graph, [outputs[i] for i in rows])
        model = GraphTrials(part, first_order(part))
        run = settings.run(model, keep=DRAWN, fraction=fraction, most=most)
    found = []
    for i, item in enumerate(outputs):
        given: dict[str, Any] = {
            "output": item,
            "nominal": float(linear.nominal[i]),
            "rounding": ROUNDING * float(whole.sizes[i]),
            "first_order_u": float(linear.u[i]),
            "shares": {source: float(values[i]) for source, values in linear.shares.items()},
            "k": settings.coverage_factor,
        }
        if run is None or i not in rows:
            both = (given["nominal"], given["nominal"])
            given |= {"mean": given["nominal"], "interval": both, "shortest": both}
        else:
            given |= _trials(run, rows[i], settings, ends=ends, jumps=bool(jumps[i]))
            if linear.u[i] > 0.0 and not jumps[i]:
                first = (given["nominal"], given["first_order_u"], np.inf)
                given["validation"] = settings.validate(*first, run, rows[i])
        found.append(SimulatedCoordinate(**given))
    return found


def _trials(
    run: MonteCarloResult, row: int, settings: Settings, *, ends: bool, jumps: bool
) -> dict[str, Any]:
    """What the trials say of one output."""
    samples, u = run.samples[row], float(run.u[row])
    ratio = ratios(run, settings.digits, ends=ends)[row]
    return {
        "mean": float(run.mean[row]),
        "u": u,
        "se_mean": float(run.se_mean[row]),
        "se_u": float(run.se_u[row]),
        "interval": (float(run.low[row]), float(run.high[row])),
        "shortest": (float(run.shortest_low[row]), float(run.shortest_high[row])),
        "trials": run.trials,
        "converged": bool(ratio <= 1.0 and not (jumps and u == 0.0)),
        "chance": bool(jumps and np.isin(samples, (0.0, 1.0)).all()),
        "samples": samples,
    }


def ratios(run: MonteCarloResult, digits: int, *, ends: bool) -> FloatArray:
    """Twice the largest standard error of each output (n,) over its numerical tolerance.

    Of mean and u and, with `ends`, of both ends of the interval: 1 or below is what 7.9.4 wants
    for `digits` significant digits of u. Twice is for many blocks, Student's t for fewer
    (`few_blocks_factor`). An output without any error has 0.
    """
    errors = [run.se_mean, run.se_u] + [run.se_low, run.se_high] * ends
    twice = 2.0 * few_blocks_factor(run.blocks) * np.max(errors, axis=0)
    tolerance = np.array([numerical_tolerance(float(u), digits) for u in run.u])
    found = np.full(len(twice), np.inf)
    np.divide(twice, tolerance, out=found, where=tolerance > 0.0)
    return np.where(twice > 0.0, found, 0.0)
