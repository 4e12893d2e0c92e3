"""How uncertain are the places of a measurement graph, and how does that follow the probing? To
first order, and by Monte Carlo.

Everything random enters at a place: the scatter of a probing, or a constant with its uncertainty.
All of them are one vector X = mean + F z of k inputs, z independent of mean 0 and variance 1; every
place is an array of trials of it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from mtu_cli.files.graph_contract import LARGEST_U_UM, MAX_REPEATS, Graph
from mtu_cli.findings import Finding, counted, error, finding, listed
from mtu_cli.model.graph.net import MeasurementGraph, Output, start_value
from mtu_cli.model.graph.transitions import Values, rotation
from mtu_cli.model.settings import Settings, validation_warnings
from mtu_cli.stats.blocks import Draws, Quantiles, Workspace
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import (
    PROBABILITY,
    coverage_factor,
    few_blocks_factor,
    numerical_tolerance,
)
from mtu_cli.stats.distributions import Distribution, Kind, shape_moments
from mtu_cli.stats.least_squares import FloatArray, least_squares, quotient
from mtu_cli.stats.monte_carlo import Validation, validated
from mtu_cli.units import UM

LARGEST = 1e150
"""Beyond it the square of a value is not finite."""
ROUNDING = 256 * float(np.finfo(np.float64).eps)
"""Share of the largest coordinate below which a nominal is 0, and a difference no derivative."""
STILL = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
KEPT_BYTES = 16 << 20
PROBING = ("u1_axis", "u2_probe", "u3_perpendicular")
"""Sources of the scatter of a probing, in the terms of Stryczek."""


class Noise(NamedTuple):
    """A probed place or a constant: c inputs with their `covariances` (c, c) by source."""

    place: str
    covariances: dict[str, FloatArray]
    kind: Kind = "normal"


def noises(graph: Graph, names: Collection[str]) -> list[Noise]:
    """The random inputs among the places `names`; normal ones first, in the file's order.

    Of a probing: u_w = sqrt(u1^2 + u2^2 + u3^2) along its direction, u1 across (Stryczek, eq. (1)
    and the text below it). n probings of one place share the errors of the axis and the surface:
    their mean has u2/sqrt(n).
    """
    groups = []
    for item in graph.transitions:
        name = item.out[0]
        if item.do != "meas" or name not in names:
            continue
        stated = item.uncertainty.model_dump(exclude_unset=True) if item.uncertainty else {}
        probing = graph.uncertainty.model_copy(update=stated)
        n = graph.repeats if item.repeats is None else item.repeats
        u1, u2, u3 = (UM * u for u in (probing.axis_um, probing.probe_um, probing.perpendicular_um))
        point = graph.places[name].kind == "point"
        along = np.outer(item.along, item.along) if point and item.along else np.eye(1)
        parts = (u1**2 * np.eye(len(along)), u2**2 / n * along, u3**2 * along)
        groups.append(Noise(name, dict(zip(PROBING, parts, strict=True))))
    for name, place in graph.places.items():
        if name in names and place.u:
            groups.append(Noise(name, {name: np.array([[place.u**2]])}, place.distribution))
    groups = [item for item in groups if any(map(np.any, item.covariances.values()))]
    return sorted(groups, key=lambda item: item.kind != "normal")


class GraphTrials:
    """n `outputs` of a graph, and what stands behind them, as a function of its k random inputs, of
    `mean` (k,), `input_u` (k,) and `factor` F (k, k). To first order: `nominal` (n,), `gradient`
    (n, k) with respect to the inputs, `u` (n,). As a Monte Carlo model: m simulation cycles a
    block, every place of a cycle from one draw of the inputs. The first-order form is drawn along
    and serves as control variate: of the whole distribution where all inputs are normal, of the
    mean and u where some are not.
    """

    def __init__(self, graph: MeasurementGraph, outputs: Iterable[Output]) -> None:
        self.graph, self.outputs = graph, tuple(outputs)
        self.names = tuple(map(str, self.outputs))
        start, self.steps = graph.needed(self.outputs)
        places, self._rows = graph.graph.places, dict[str, slice]()
        self.noises = noises(graph.graph, start)
        factors = [covariance_root(np.sum([*x.covariances.values()], axis=0)) for x in self.noises]
        self.k = sum(map(len, factors))
        self.mean, self.factor, at = np.zeros(self.k), np.zeros((self.k, self.k)), 0
        for item, F in zip(self.noises, factors, strict=True):
            rows = self._rows[item.place] = slice(at, at := at + len(F))
            self.mean[rows] = start_value(places[item.place]).ravel()
            # The symmetric root: F F' = C.
            self.factor[rows, rows] = F
        self._fixed = {n: start_value(places[n]) for n in start if n not in self._rows}
        # Of variance 1 (JCGM 101:2008, 6.4).
        self._shapes = [
            Distribution(kind=x.kind, u=1.0, half_width=shape_moments(x.kind)[0] ** -0.5)
            for x in self.noises
            if x.kind != "normal"
        ]
        self.input_u = np.sqrt(np.sum(self.factor**2, axis=1))
        # What rounding is a share of: the part's largest coordinate for a length, 1 for a ratio.
        part = float(np.max(np.abs(self.mean), initial=1.0))
        self.sizes = np.array([1.0 if x.unit in ("1", "rad") else part for x in self.outputs])
        self.nominal, self.gradient = self._derivatives()
        self._linear = self.gradient @ self.factor
        with np.errstate(over="ignore", invalid="ignore"):
            self.u = np.sqrt(np.sum(self._linear**2, axis=1))
        u = self.u[:, None]
        self.linear_mean, self.linear_variance = self.nominal, self.u**2
        self.linear_quantiles: Quantiles | None = None
        if not self._shapes:
            self.linear_quantiles = lambda p: u * ndtri(p)
        self._work = Workspace()
        # glibc returns memory to the system beyond twice the largest block freed so far
        # (mallopt(3), M_MMAP_THRESHOLD), and every page of it costs a fault when it is allocated
        # again: a third of the time. One large block, freed and never touched, moves that bound,
        # and the memory that one block of trials frees stays for the next.
        np.empty(KEPT_BYTES, dtype=np.uint8)

    def _derivatives(self) -> tuple[FloatArray, FloatArray]:
        """Nominal outputs and their derivatives, by central differences over one standard
        uncertainty of each input, all in one batch (JCGM 100:2008, 5.1.3, note 2). Where one of
        both has no finite value it is 0, and the trials show whether the output has one.
        """
        k, u = self.k, self.input_u
        X = np.repeat(self.mean[:, None], 2 * k + 1, axis=1)
        X[:, 1 : k + 1] += np.diag(u)
        X[:, k + 1 :] -= np.diag(u)
        with np.errstate(all="ignore"):
            values = self.run(X)
            half = 0.5 * (values[:, 1 : k + 1] - values[:, k + 1 :])
        nominal, change = values[:, 0].copy(), np.where(np.isfinite(half), half, 0.0)
        nominal[np.abs(nominal) <= ROUNDING * self.sizes] = 0.0
        floor = ROUNDING * np.maximum(np.abs(nominal), self.sizes)
        change[np.abs(change) <= floor[:, None]] = 0.0
        return nominal, quotient(change, u, 0.0)

    def shares(self, *, by_place: bool = False) -> dict[str, FloatArray]:
        """Shares (n,) of the first-order variance by source: c C_s c' of the covariance C_s that
        the source has over c C c', nan where that is 0 (JCGM 100:2008, 5.1.2); `by_place`: by the
        place where they come in.
        """
        result: dict[str, FloatArray] = {}
        total = np.where(self.u > 0, self.u, np.nan) ** 2
        for item in self.noises:
            c = self.gradient[:, self._rows[item.place]]
            for source, covariance in item.covariances.items():
                name = item.place if by_place else source
                with np.errstate(over="ignore", invalid="ignore"):
                    part = np.einsum("ni,ij,nj->n", c, covariance, c) / total
                result[name] = result.get(name, 0.0) + part
        return result

    def run(self, X: FloatArray, into: FloatArray | None = None) -> FloatArray:
        """Outputs (n, m) for inputs X (k, m); frames are compared with their nominal."""
        values, m = Values(), X.shape[1]
        for name, of in self._rows.items():
            values[name] = X[of] if of.stop - of.start > 1 else X[of.start]
        for name, value in self._fixed.items():
            values[name] = np.broadcast_to(value, (*value.shape[:-1], m))
        for step in self.steps:
            step.run(values)
        rows = np.empty((len(self.outputs), m)) if into is None else into
        for name in {item.place for item in self.outputs if item.kind == "frame"}:
            frame = values[name]
            values[name] = np.concatenate([frame[0], rotation(frame, self.graph.nominal[name])])
        for row, item in zip(rows, self.outputs, strict=True):
            row[:] = values[item.place].reshape(-1, m)[item.index]
        return rows

    def inputs(self, rng: np.random.Generator, m: int) -> tuple[FloatArray, FloatArray]:
        """z (k, m), independent, of mean 0 and variance 1, and the inputs X = mean + F z."""
        z, normal = self._work.array("z", (self.k, m)), self.k - len(self._shapes)
        rng.standard_normal(out=z[:normal])
        for row, shape in zip(z[normal:], self._shapes, strict=True):
            shape.draw(rng, row, self._work)
        X = np.matmul(self.factor, z, out=self._work.array("X", z.shape))
        X += self.mean[:, None]
        return z, X

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        n = len(self.names)
        z, X = self.inputs(rng, m)
        linear = np.matmul(self._linear, z, out=self._work.array("linear", (n, m)))
        linear += self.linear_mean[:, None]
        with np.errstate(all="ignore"):
            values = self.run(X, self._work.array("values", (n, m)))
        # What is not a number compares as neither.
        if not (values.max() < LARGEST and values.min() > -LARGEST):
            values[~(np.abs(values) < LARGEST)] = np.nan
        for i in np.flatnonzero(self.u == 0.0):
            if np.all(np.abs(values[i] - self.nominal[i]) <= STILL * self.sizes[i]):
                values[i] = self.nominal[i]
        return Draws(values=values, linear=linear)


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
) -> Iterator[SimulatedCoordinate]:
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
    for i, item in enumerate(outputs):
        y, u = nominal[i], float(run.u[i])
        fixed = first_u[i] == 0.0 and u <= STILL * float(model.sizes[i])
        stats = dict.fromkeys(ENDS, y) if fixed else {x: float(getattr(run, x)[i]) for x in ENDS}
        yield SimulatedCoordinate(
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
    file has it.
    """

    output: Output
    base: GraphSimulation
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
            trials = max(x.trials for x in short)
            notes.append(not_converged(trials, self.base.digits, where))
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
        output=output, base=base, varied=values, grid=tuple(grid), formula=formula, no_formula=why
    )


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
