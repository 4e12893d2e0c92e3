"""How uncertain are the places of a measurement graph, and how does that follow the probing?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.files.graph_contract import LARGEST_U_UM, MAX_REPEATS
from mtu_cli.findings import Finding, counted, error, finding, listed
from mtu_cli.model.graph.net import MeasurementGraph, Output
from mtu_cli.model.graph.propagation import STILL, GraphTrials
from mtu_cli.model.settings import Settings, validation_warnings
from mtu_cli.stats.coverage import (
    PROBABILITY,
    coverage_factor,
    few_blocks_factor,
    numerical_tolerance,
)
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.monte_carlo import Validation, validated
from mtu_cli.units import UM

MOST = 2_500_000
"""Trials where the count adapts, at most."""
LINEAR = 0.5
"""Share of u that the first-order u must have to represent it."""
DRAWN = 2**16
"""Trials kept for the histogram."""
ENDS = ("mean", "low", "high", "shortest_low", "shortest_high")


@dataclass(frozen=True, kw_only=True)
class SimulatedCoordinate:
    """One coordinate of a place, in its own unit. `shares` of its first-order variance by source
    (nan where that is 0). `se_*`: standard errors of the Monte Carlo. `converged`: to the digits of
    u asked for. `validation` None where it is fixed, or its first-order form is nil. `samples`: the
    first trials; without `trials` it does not vary. `k`: coverage factor.
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
        nil = [x for x in self.coordinates if not (x.fixed or x.first_order_u)]
        if nil:
            reason = "the first-order uncertainty is 0, u is of second order"
            what = {"quantity": "shares by source", "names": [str(item.output) for item in nil]}
            result.append(finding("not-estimable", **what, reason=reason))
        units: dict[tuple[str, float], list[tuple[str, Validation]]] = {}
        for item in self.coordinates:
            if item.validation is not None:
                scale = {"mm": ("um", UM), "rad": ("rad", 1.0)}.get(item.output.unit, ("", 1.0))
                units.setdefault(scale, []).append((str(item.output), item.validation))
        for (unit, size), validations in units.items():
            names, outcomes = zip(*validations, strict=True)
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
    """
    model = GraphTrials(graph, outputs)
    nominal, first_u, shares = model.nominal.tolist(), model.u.tolist(), model.shares()
    k = coverage_factor(PROBABILITY)
    run, verdicts = validated(
        lambda fraction: settings.run(model, keep=DRAWN, fraction=fraction, most=most),
        [(y, u, k) for y, u in zip(nominal, first_u, strict=True)],
        settings.digits,
        settings.trials is None,
    )
    # Twice the largest standard error over its numerical tolerance: 1 or below is what 7.9.4 wants.
    # Twice is for many blocks, Student's t for fewer.
    errors = [run.se_mean, run.se_u] + [run.se_low, run.se_high] * ends
    twice = 2.0 * few_blocks_factor(run.blocks) * np.max(errors, axis=0)
    result = []
    for i, item in enumerate(outputs):
        y, u = nominal[i], float(run.u[i])
        fixed = first_u[i] == 0.0 and u <= STILL * float(model.sizes[i])
        stats = dict.fromkeys(ENDS, y) if fixed else {x: float(getattr(run, x)[i]) for x in ENDS}
        coordinate = SimulatedCoordinate(
            output=item,
            nominal=y,
            first_order_u=first_u[i],
            shares={source: float(values[i]) for source, values in shares.items()},
            k=settings.coverage_factor,
            mean=stats["mean"],
            u=0.0 if fixed else u,
            interval=(stats["low"], stats["high"]),
            shortest=(stats["shortest_low"], stats["shortest_high"]),
            se_mean=0.0 if fixed else float(run.se_mean[i]),
            se_u=0.0 if fixed else float(run.se_u[i]),
            trials=0 if fixed else run.trials,
            converged=fixed or bool(twice[i] <= numerical_tolerance(u, settings.digits)),
            validation=verdicts[i] if first_u[i] > 0.0 else None,
            samples=run.samples[i],
        )
        result.append(coordinate)
    return result


MOST_OF_GRID = 2**18
"""Trials of a point of the grid where the count adapts, at most."""
REPEATS = "repeats"
PARAMETERS = ("axis_um", "probe_um", "perpendicular_um", REPEATS)
LARGEST_GRID = 10_000
EXACT = 1e-4
"""Share of the first-order variance below which a formula needs no further term."""
LETTERS = "abcdef"


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """u^2 as a sum of terms, fitted to g grid points: its `form`, in um where the output is a
    length. `u` (g,) in the unit of the output, `error_percent` (g,) = 100 (formula/Monte Carlo -
    1). `monte_carlo_percent`: relative standard error of a Monte Carlo u (root mean square).
    """

    form: str
    coefficients: dict[str, float]
    u: FloatArray
    error_percent: FloatArray
    monte_carlo_percent: float

    @property
    def max_error_percent(self) -> float:
        """The largest error."""
        return float(np.max(np.abs(self.error_percent)))


@dataclass(frozen=True, kw_only=True)
class GridPoint(SimulatedCoordinate):
    """What came of one setting `at`. `converged`: mean and u. `formula_u` and `error_percent`
    (formula less Monte Carlo) are nan where no formula could be fitted.
    """

    at: dict[str, float]
    formula_u: float = math.nan
    error_percent: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The grid of one output, and the formula fitted to it, or why there is none; `base` as the
    file has it. `digits`: those of u that were asked for.
    """

    output: Output
    base: GraphSimulation
    digits: int
    varied: dict[str, tuple[float, ...]]
    grid: tuple[GridPoint, ...]
    formula: Formula | None
    no_formula: str

    @property
    def converged(self) -> bool:
        """Whether all trials have."""
        return self.base.converged and all(point.converged for point in self.grid)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Grid points that have not converged; no formula."""
        notes = []
        if short := [item for item in self.grid if not item.converged]:
            where = f"at {len(short)} of {len(self.grid)} points of the grid"
            notes.append(not_converged(max(x.trials for x in short), self.digits, where))
        if self.formula is None:
            notes.append(finding("no-formula", reason=self.no_formula))
        return tuple(notes)


def sweep_graph(
    graph: MeasurementGraph, settings: Settings, of: str, varied: Mapping[str, Sequence[float]]
) -> Sweep:
    """Runs the Monte Carlo at every combination of the values in `varied`, and fits a formula.

    `varied`: values of axis_um, probe_um and perpendicular_um of the graph (what a transition
    states otherwise stays), and of repeats, at every measurement. Every combination has random
    numbers of its own: common ones would hide the Monte Carlo's error in the coefficients.

    Raises InputError for a place with several coordinates, or values out of range.
    """
    (output,) = one_unit(graph, of, single=True)
    _check(varied)
    values = {name: tuple(map(float, numbers)) for name, numbers in varied.items()}
    points = [dict(zip(values, at, strict=True)) for at in itertools.product(*values.values())]
    grid, file = [], graph.graph
    for number, at in enumerate(points):
        key = (1 << 20, number)
        state = np.random.SeedSequence(settings.seed, spawn_key=key).generate_state(2)
        point_settings = replace(settings, seed=int(state[0]) << 32 | int(state[1]), progress=None)
        if settings.progress is not None:
            settings.progress(number, len(points))
        # The same net under other uncertainties of probing, um, and another number of probings.
        probing = {name: value for name, value in at.items() if name != REPEATS}
        changes: dict[str, object] = {"uncertainty": file.uncertainty.model_copy(update=probing)}
        if REPEATS in at:
            transitions = [x.model_copy(update={"repeats": None}) for x in file.transitions]
            changes |= {"repeats": int(at[REPEATS]), "transitions": transitions}
        part = replace(graph, graph=file.model_copy(update=changes))
        (point,) = simulate_outputs(part, [output], point_settings, most=MOST_OF_GRID, ends=False)
        grid.append(GridPoint(at=at, **vars(point)))
    u, se_u, linear_u = np.array([(x.u, x.se_u, x.first_order_u) for x in grid]).T
    columns = {name: np.array([item.at[name] for item in grid]) for name in values}
    outcome = fit_formula(columns, u, se_u, linear_u, output.unit)
    formula, why = (None, outcome) if isinstance(outcome, str) else (outcome, "")
    if formula is not None:
        both = zip(grid, formula.u, formula.error_percent, strict=True)
        grid = [replace(x, formula_u=float(u), error_percent=float(e)) for x, u, e in both]
    # What follows the grid leaves its bar full.
    base = simulate_graph(graph, replace(settings, progress=None), [of])
    return Sweep(
        output=output, base=base, digits=settings.digits, varied=values, grid=tuple(grid),
        formula=formula, no_formula=why,
    )  # fmt: skip


def _check(varied: Mapping[str, Sequence[float]]) -> None:
    for name, values in varied.items():
        counted = name == REPEATS
        least, largest = (1.0, MAX_REPEATS) if counted else (0.0, LARGEST_U_UM)
        kind = "whole numbers" if counted else "numbers"
        for value in values:
            if not least <= value <= largest or (counted and value % 1.0):
                expected = f"{kind} from {least:g} to {largest:g}"
                path = f"--vary {name}"
                raise error("out-of-range", path=path, value=f"{value:g}", expected=expected)
    count = math.prod(len(values) for values in varied.values())
    if count > LARGEST_GRID:
        expected = f"at most {LARGEST_GRID} combinations"
        raise error("out-of-range", path="--vary", value=str(count), expected=expected)


def fit_formula(
    at: Mapping[str, FloatArray], u: FloatArray, se_u: FloatArray, linear_u: FloatArray, unit: str
) -> Formula | str:
    """u = sqrt(a probe_um^2 + b axis_um^2 + ...), the form of Stryczek, eq. (31).

    Least squares of u^2 with weights 1/u^4, that is, of relative errors. With a varied number of
    probings the probe's term is divided by it. A constant is added, and 1/repeats, where the
    first-order u needs them: for sources that are not varied. Where the first-order u is nil, all
    terms enter.

    A text where there is no formula: why.
    """
    varied = {name: values for name, values in at.items() if np.ptp(values) > 0}
    if not varied:
        return "nothing varies"
    if not np.all(u > 0):
        return "u is 0 somewhere"
    first_order = bool(np.all(linear_u >= LINEAR * u))
    if first_order and np.ptp(linear_u) <= EXACT * linear_u.max():
        return f"u does not depend on {', '.join(varied)}"
    n, scale = len(u), 1.0 / UM if unit == "mm" else 1.0
    per, over = ("/repeats", varied[REPEATS]) if REPEATS in varied else ("", np.ones(n))
    squares = dict.fromkeys((f"probe_um^2{per}", "axis_um^2", "perpendicular_um^2"), np.ones(n))
    squares[f"probe_um^2{per}"] = over
    every = {
        term: varied[name] ** 2 / divisor
        for term, divisor in squares.items()
        if (name := term.partition("^")[0]) in varied
    }
    needed = {*every, "" if "probe_um" in varied else "1/repeats"} - {""}
    every |= {"1/repeats": 1.0 / over, "": np.ones(n)} if per else {"": np.ones(n)}
    if first_order and n >= len(every):
        X = np.column_stack([*every.values()]) / (linear_u[:, None] * scale) ** 2
        share = np.abs(X * least_squares(X, np.ones(n)).coefficients).max(axis=0)
        pairs = zip(every.items(), share, strict=True)
        every = {x: column for (x, column), part in pairs if x in needed or part > EXACT}
    symbol = {"mm": "u_um", "rad": "u_rad"}.get(unit, "u")
    joint = [f"*{term}".replace("*1/", "/").removesuffix("*") for term in every]
    form = f"{symbol} = sqrt({' + '.join(map(''.join, zip(LETTERS, joint, strict=False)))})"
    if n < len(every):
        return f"{n} grid points are too few for its {len(every)} terms, {form}"
    X = np.column_stack([*every.values()]) / (u[:, None] * scale) ** 2
    result = least_squares(X, np.ones(n)).coefficients
    relative_error = np.sqrt(np.maximum(X @ result, 0.0)) - 1.0
    return Formula(
        form=form,
        coefficients=dict(zip(LETTERS, map(float, result), strict=False)),
        u=u * (1 + relative_error),
        error_percent=100 * relative_error,
        monte_carlo_percent=100 * float(np.sqrt(np.mean((se_u / u) ** 2))),
    )
