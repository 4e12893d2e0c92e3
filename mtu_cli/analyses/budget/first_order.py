"""The law of propagation of uncertainty, first and second order: JCGM 100:2008, 5.1.2 and 5.2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.budget.correlation import factor_of
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.analyses.budget.tails import Tail, long_tails
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node, names
from mtu_cli.language.derivative import PLACE, Derivatives, derivatives, taylor
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation

EXTREME = 1e50
"""From here on, and below its reciprocal, an output is divided before it is squared."""
ROUNDED = 1e-16
LEAST_EXPONENT = -300
SHORTEST = 1.05
"""More than its own scatter may make the shortest interval longer than the symmetric one."""
Interval = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """One output: `value` y, `sensitivity` c (n,), `contribution` |c| u (n,), `u`, effective
    degrees of freedom `dof`.

    `share` (n,): c_i u_i sum_j r_ij c_j u_j / u^2, sums to 1; below 0 where a correlation
    makes u smaller. `second_value`, `second_u`: to the second order. nan where a derivative
    does not exist; `faults` says at which functions. `tails`: the sources of few degrees of
    freedom. `scale`: a power of ten by which the output is to be divided before anything
    of it is squared; 1 unless it is very large or very small.
    """

    name: str
    value: float
    sensitivity: FloatArray
    contribution: FloatArray
    u: float
    dof: float
    share: FloatArray
    second_value: float
    second_u: float
    tails: tuple[Tail, ...]
    faults: tuple[Finding, ...]
    scale: float = 1.0


class Line(NamedTuple):
    """An input of an output's budget: c, |c| u and its share of the variance; nan of the share
    where that is 0.
    """

    output: str
    input: InputQuantity
    sensitivity: float
    contribution: float
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """An output by one method; `ends_u` is the u that the ends of the intervals are rounded to."""

    output: str
    unit: str
    method: str
    value: float
    u: float
    dof: float | None = None
    k: float | None = None
    U: float | None = None
    interval: Interval | None = None
    shortest: Interval | None = None
    ends_u: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputBudget:
    """One output: first order, its expanded uncertainty U = k u, and clause 8's verdict on it by
    the trials, row `index` of a `run`, which is `converged` or not.

    `k_probability`: the factor for the coverage probability at the output's effective degrees
    of freedom; k itself is that, unless a factor is given.
    """

    first: FirstOrder
    unit: str
    k: float
    k_probability: float
    validation: Validation
    inputs: tuple[InputQuantity, ...]
    run: MonteCarloResult
    index: int
    converged: bool

    @property
    def expanded(self) -> float:
        """U = k u."""
        return self.k * self.first.u

    @property
    def interval(self) -> Interval:
        """First-order interval y -+ k u for the coverage probability."""
        half = self.k_probability * self.first.u
        return self.first.value - half, self.first.value + half

    @property
    def lines(self) -> tuple[Line, ...]:
        """Every input's part in it."""
        columns = (self.first.sensitivity, self.first.contribution, self.first.share)
        rows = zip(self.inputs, *(map(float, column) for column in columns), strict=True)
        return tuple(Line(self.first.name, *row) for row in rows)

    def of_run(self, name: str) -> float:
        """A statistic of the trials, such as "mean" or "se_u"."""
        return float(getattr(self.run, name)[self.index])

    @property
    def mean(self) -> float:
        """Of the trials; nan without a variance: the mean does not settle then."""
        return self.of_run("mean") if math.isfinite(self.of_run("u")) else math.nan

    @property
    def symmetric(self) -> Interval:
        """Of the trials, with equal chances beyond either end; one value where none varies."""
        if self.of_run("u") == 0.0:
            # Weights of ordered values leave their rounding on equal ones.
            return self.of_run("mean"), self.of_run("mean")
        return self.of_run("low"), self.of_run("high")

    @property
    def has_shortest(self) -> bool:
        """Whether the shortest interval is that: trials too far apart leave one that is longer."""
        width = self.of_run("shortest_high") - self.of_run("shortest_low")
        longest = SHORTEST * (self.of_run("high") - self.of_run("low"))
        return self.of_run("u") == 0.0 or 0.0 <= width <= longest

    @property
    def shortest(self) -> Interval:
        """Of the trials; nan where there is none."""
        if self.of_run("u") == 0.0 or not self.has_shortest:
            return self.symmetric if self.has_shortest else (math.nan, math.nan)
        return self.of_run("shortest_low"), self.of_run("shortest_high")

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """By first order, second order and Monte Carlo."""
        first, trials_u = self.first, self.of_run("u")
        name, unit = first.name, self.unit
        return (
            Estimate(
                output=name,
                unit=unit,
                method="first order",
                value=first.value,
                u=first.u,
                dof=None if math.isnan(first.dof) else first.dof,
                k=self.k,
                U=self.expanded,
                interval=self.interval,
                ends_u=_ends_u(first.u, self.interval),
            ),
            Estimate(
                output=name,
                unit=unit,
                method="second order",
                value=first.second_value,
                u=first.second_u,
            ),
            Estimate(
                output=name,
                unit=unit,
                method="Monte Carlo",
                value=self.mean,
                u=trials_u,
                interval=self.symmetric,
                shortest=self.shortest,
                ends_u=_ends_u(trials_u, self.symmetric),
            ),
        )


def _ends_u(u: float, interval: Interval) -> float:
    """A few trials far out give a u to which an interval of 95 % is nothing: then a quarter of the
    interval's width, which is about u for a normal distribution.
    """
    width = interval[1] - interval[0]
    return u if u <= width or width == 0.0 else 0.25 * width


def first_order(
    loaded: LoadedBudget,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    sources: Sequence[Source],
) -> tuple[FirstOrder, ...]:
    """Every output of the budget.

    Raises InputError where an equation has no finite value at the estimates.
    """
    found, problems = [], []
    for name, tree in loaded.trees.items():
        slopes = _derivatives(tree, inputs)
        if not math.isfinite(slopes.value):
            problems.append(_no_value(loaded, name, slopes))
            continue
        # What overflows is inf or nan, and no uncertainty to the first order then exists.
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            found.append(_output(name, tree, slopes, inputs, covariance, sources))
    if problems:
        raise InputError(problems)
    return tuple(found)


def _no_value(loaded: LoadedBudget, name: str, slopes: Derivatives) -> Finding:
    path = loaded.place(name)
    line = loaded.line_of(*path)
    where = ".".join(str(step) for step in path)
    if slopes.faults:
        return slopes.faults[0].at(file=loaded.source.shown, line=line, path=where)
    return finding(
        "no-finite-value",
        what="the equation",
        where=" at the estimates of its inputs",
        file=loaded.source.shown,
        line=line,
        path=where,
    )


def _derivatives(tree: Node, inputs: Sequence[InputQuantity]) -> Derivatives:
    """With respect to all inputs; those without uncertainty are constants. The others that the
    equation does not have are at no cost: a file may have thousands, an equation has few.
    """
    values = {item.name: item.value for item in inputs}
    uncertain = [item.name for item in inputs if item.u > 0.0]
    slopes = derivatives(tree, values, uncertain)
    n = len(inputs)
    rows = [i for i, item in enumerate(inputs) if item.u > 0.0]
    first, third, second = np.zeros(n), np.zeros(n), np.zeros((n, n))
    first[rows], third[rows] = slopes.first, slopes.third
    second[np.ix_(rows, rows)] = slopes.second
    return Derivatives(
        value=slopes.value, first=first, second=second, third=third, faults=slopes.faults
    )


def _scale(slopes: Derivatives, inputs: Sequence[InputQuantity]) -> float:
    """Power of ten near the largest |c_i| u_i, or near the rounding of the value if larger."""
    sizes = np.abs(slopes.first) * np.array([item.u for item in inputs])
    known = [float(size) for size in sizes if math.isfinite(size)]
    size = max([*known, ROUNDED * abs(slopes.value)])
    if size == 0.0 or 1.0 / EXTREME < size < EXTREME:
        return 1.0
    return 10.0 ** max(math.floor(math.log10(size)), LEAST_EXPONENT)


def _output(
    name: str,
    tree: Node,
    slopes: Derivatives,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    sources: Sequence[Source],
) -> FirstOrder:
    scale = _scale(slopes, inputs)
    g = slopes.first / scale
    joint = g * (covariance @ g)
    # Summed by sources, so that a variance of 0 is 0 and not what rounding leaves.
    variances = [source.variance(g) for source in sources]
    variance = math.fsum(variances)
    dof = math.nan
    if math.isfinite(variance):
        dof = welch_satterthwaite(
            np.array(variances), np.array([source.dof(g) for source in sources])
        )
    mean, second_variance = _second_order(tree, slopes, inputs, covariance, variance, scale)
    share = joint / variance if variance > 0.0 else np.full(len(g), math.nan)
    u = np.array([item.u for item in inputs])
    return FirstOrder(
        name=name,
        value=slopes.value,
        sensitivity=slopes.first,
        contribution=np.abs(slopes.first) * u,
        u=scale * math.sqrt(variance),
        dof=dof,
        share=share,
        second_value=slopes.value + scale * mean,
        second_u=scale * math.sqrt(second_variance) if second_variance >= 0.0 else math.nan,
        tails=long_tails(g, slopes.second / scale, math.sqrt(variance), inputs, sources),
        faults=slopes.faults,
        scale=scale,
    )


def _second_order(
    tree: Node,
    slopes: Derivatives,
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    variance: float,
    scale: float,
) -> tuple[float, float]:
    """Shift of the mean and variance to the second order, of the output over `scale`.

    For jointly normal inputs of covariance V, gradient g, Hessian H:
    shift = tr(HV)/2, variance = g'Vg + tr(HVHV)/2 + sum_j (Vg)_j d/dx_j tr(HV). For independent
    inputs the last two are the terms of JCGM 100:2008, 5.1.2, note:
    sum_ij (f_ij^2/2 + f_i f_ijj) u_i^2 u_j^2. Where an input's own distribution has another
    fourth moment than a normal one (kappa its fourth cumulant) f_ii^2 kappa/4 + f_i f_iii kappa/3
    is added: x^2 at 0 has u = 0.89 u^2(x) for a rectangle, not 1.41.
    """
    held = names(tree)
    rows = np.array([i for i, item in enumerate(inputs) if item.name in held], dtype=np.intp)
    inputs = [inputs[i] for i in rows]
    g, third = slopes.first[rows] / scale, slopes.third[rows] / scale
    H, V = slopes.second[np.ix_(rows, rows)] / scale, covariance[np.ix_(rows, rows)]
    HV = H @ V
    shift = 0.5 * float(np.trace(HV))
    quadratic = 0.5 * float(np.sum(HV * HV.T))
    # Products of small numbers with large ones, in an order in which neither leaves the range.
    u = np.array([item.u for item in inputs])
    kappa = np.array([item.excess for item in inputs])
    bent, twisted = np.diag(H) * u * u, third * u * u * u
    own = float(np.sum(kappa * (bent**2 / 4.0 + g * u * twisted / 3.0)))
    rest = _third(tree, inputs, V, V @ g) / scale
    return shift, variance + quadratic + own + rest


def _third(
    tree: Node, inputs: Sequence[InputQuantity], covariance: FloatArray, along: FloatArray
) -> float:
    """The derivative of tr(HV) along Vg: V = F F', so that it is a sum over the columns of F."""
    if not np.any(along) or not np.all(np.isfinite(along)):
        return 0.0 if np.all(np.isfinite(along)) else math.nan
    F = factor_of(covariance)
    directions = np.stack([np.repeat(along[:, None], F.shape[1], axis=1), F])
    values = {item.name: item.value for item in inputs}
    moved = {item.name: directions[:, i] for i, item in enumerate(inputs)}
    coefficients, _ = taylor(tree, values, moved.get, F.shape[1])
    return 2.0 * float(np.sum(coefficients[PLACE[1, 2]]))
