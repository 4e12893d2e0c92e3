"""How uncertain are the places of a measurement graph, and why?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import Finding, counted, error, finding, listed
from mtu_cli.model.graph.net import MeasurementGraph, Output
from mtu_cli.model.graph.propagation import STILL, GraphTrials
from mtu_cli.model.settings import Settings, validation_warnings
from mtu_cli.stats.coverage import few_blocks_factor, numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import CONVERGED_TO, Validation
from mtu_cli.units import UM

MOST = 2_500_000
"""Trials where the count adapts, at most."""
LINEAR = 0.5
"""Share of u that the first-order u must have to say anything of it."""
DRAWN = 2**16
"""Trials kept for the histogram."""
STATISTICS = ("mean", "u", "se_mean", "se_u", "low", "high", "shortest_low", "shortest_high")


@dataclass(frozen=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `se_*`: standard errors of the Monte Carlo. `converged`: to the digits of
    u asked for. `chance`: all trials are 0 or 1, and their mean is the chance of 1. `validation`
    None where it is fixed, jumps, or its first-order form is nil. `samples`: the first trials;
    without `trials` it does not vary. `k`: coverage factor.
    """

    output: Output
    nominal: float
    first_order_u: float
    shares: dict[str, float]
    k: float
    mean: float
    u: float
    interval: tuple[float, float]
    shortest: tuple[float, float]
    se_mean: float
    se_u: float
    trials: int
    converged: bool
    chance: bool
    validation: Validation | None
    samples: FloatArray

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
        result: dict[str, dict[str, SimulatedCoordinate]] = {}
        for item in self.coordinates:
            result.setdefault(item.output.place, {})[item.output.coordinate] = item
        return result

    @property
    def sources(self) -> tuple[str, ...]:
        """All sources of variance."""
        return tuple(dict.fromkeys(name for item in self.coordinates for name in item.shares))

    @property
    def warnings(self) -> list[Finding]:
        """What does not vary or has no first order; clause 8; what has not converged."""
        result = []
        if self.coordinates and all(item.fixed for item in self.coordinates):
            result.append(finding("unrelated", output="the result", names=["anything uncertain"]))
        nil = [x for x in self.coordinates if not (x.fixed or x.chance or x.first_order_u)]
        if nil:
            reason = "the first-order uncertainty is 0, u is of second order"
            what = {"quantity": "shares by source", "names": [str(item.output) for item in nil]}
            result.append(finding("not-estimable", **what, reason=reason))
        units: dict[tuple[str, float], list[tuple[str, Validation]]] = {}
        for item in self.coordinates:
            if item.validation is not None:
                shown = {"mm": ("um", UM), "rad": ("rad", 1.0)}.get(item.output.unit, ("", 1.0))
                units.setdefault(shown, []).append((str(item.output), item.validation))
        for (unit, size), judged in units.items():
            names, outcomes = zip(*judged, strict=True)
            result += validation_warnings(names, outcomes, unit, size)
        short = [item for item in self.coordinates if not item.converged]
        if short:
            where = f"for {listed(str(item.output) for item in short)}"
            result.append(not_converged(self.trials, self.digits, where))
        return result


def not_converged(trials: int, digits: int, what: str) -> Finding:
    """The warning of so many trials; `what`: of which places, or where."""
    goal = f"{counted(digits, 'significant digit')} of u (JCGM 101, 7.9.4), {what}"
    return finding("not-converged", trials=trials, goal=goal)


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
    linear = GraphTrials(graph, one_unit(graph, of))
    weights = linear.u**2 / (np.sum(linear.u**2) or 1.0)
    if not np.any(weights):
        reason = "the first-order uncertainty is 0: no shares of variance"
        raise error("not-applicable", reason=reason, value=of, expected="another place")
    shares = linear.shares(by_place=True)
    return {name: float(np.nansum(values * weights)) for name, values in shares.items()}


def simulate_graph(
    graph: MeasurementGraph, settings: Settings, of: Sequence[str] = ()
) -> GraphSimulation:
    """Propagates the uncertainty of probings and constants through the graph."""
    result = simulate_outputs(graph, graph.outputs(of), settings)
    return GraphSimulation(graph=graph, coordinates=tuple(result), digits=settings.digits)


def simulate_outputs(
    graph: MeasurementGraph,
    outputs: Sequence[Output],
    settings: Settings,
    *,
    most: int = MOST,
    ends: bool = True,
) -> list[SimulatedCoordinate]:
    """Outputs by Monte Carlo, at most so many trials where the count adapts, and to first order;
    whether they have their digits is judged by mean and u and, with `ends`, by the interval.

    Where clause 8 is not settled by then, the count goes on to a fifth of the tolerance (8.2). What
    goes through a step may vary in so few trials that none is seen: it has not converged while all
    its trials are the same.
    """
    model = GraphTrials(graph, outputs)
    nominal, first_u, shares = model.nominal.tolist(), model.u.tolist(), model.shares()
    judged = [i for i, u in enumerate(first_u) if u > 0.0 and not model.jumps[i]]
    verdicts: dict[int, Validation] = {}
    for fraction in (1.0, CONVERGED_TO):
        run = settings.run(model, keep=DRAWN, fraction=fraction, most=most)
        for i in judged:
            verdicts[i] = settings.validate(nominal[i], first_u[i], np.inf, run, i)
        if settings.trials or all(item.settled for item in verdicts.values()):
            break
    errors, result = ratios(run, settings.digits, ends=ends), []
    for i, item in enumerate(outputs):
        jumps, made = bool(model.jumps[i]), {name: getattr(run, name)[i] for name in STATISTICS}
        fixed = first_u[i] == 0.0 and not jumps and made["u"] <= STILL * float(model.sizes[i])
        if fixed:
            made = {**dict.fromkeys(STATISTICS, nominal[i]), "u": 0.0, "se_mean": 0.0, "se_u": 0.0}
        made = {name: float(value) for name, value in made.items()}
        coordinate = SimulatedCoordinate(
            output=item,
            nominal=nominal[i],
            first_order_u=first_u[i],
            shares={source: float(values[i]) for source, values in shares.items()},
            k=settings.coverage_factor,
            mean=made["mean"],
            u=made["u"],
            interval=(made["low"], made["high"]),
            shortest=(made["shortest_low"], made["shortest_high"]),
            se_mean=made["se_mean"],
            se_u=made["se_u"],
            trials=0 if fixed else run.trials,
            converged=fixed or bool(errors[i] <= 1.0 and not (jumps and made["u"] == 0.0)),
            chance=bool(jumps and np.isin(run.samples[i], (0.0, 1.0)).all()),
            validation=verdicts.get(i),
            samples=run.samples[i],
        )
        result.append(coordinate)
    return result


def ratios(run: MonteCarloResult, digits: int, *, ends: bool) -> FloatArray:
    """Twice the largest standard error of each output (n,) over its numerical tolerance.

    Of mean and u and, with `ends`, of both ends of the interval: 1 or below is what 7.9.4 wants
    for `digits` significant digits of u. Twice is for many blocks, Student's t for fewer
    (`few_blocks_factor`). An output without any error has 0.
    """
    errors = [run.se_mean, run.se_u] + [run.se_low, run.se_high] * ends
    twice = 2.0 * few_blocks_factor(run.blocks) * np.max(errors, axis=0)
    tolerance = np.array([numerical_tolerance(float(u), digits) for u in run.u])
    result: FloatArray = np.where(twice > 0.0, np.inf, 0.0)
    np.divide(twice, tolerance, out=result, where=tolerance > 0.0)
    return result
