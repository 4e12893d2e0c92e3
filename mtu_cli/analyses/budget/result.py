"""The result of a budget, and what its user should know beside the figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.budget.inputs import InputQuantity, Inputs
from mtu_cli.analyses.budget.propagation import FirstOrder
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import NO_U
from mtu_cli.model.settings import validation_warnings
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult
from mtu_cli.stats.validation import Validation

SHORTEST = 1.05
"""More than its own scatter may make the shortest interval longer than the symmetric one."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
FEW, MANY = 0.2, 10_000
"""Share of u that its standard error is where a few of many trials make it: that of normal ones is
1/sqrt(2 M)."""
Interval = tuple[float, float]


class Estimate(NamedTuple):
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
    def shortest(self) -> Interval:
        """Of the trials; the symmetric one where a few of them far out leave none that is shorter
        than that.
        """
        low, high = self.of_run("shortest_low"), self.of_run("shortest_high")
        longest = SHORTEST * (self.symmetric[1] - self.symmetric[0])
        return (low, high) if 0.0 <= high - low <= longest else self.symmetric

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """By first order, second order and Monte Carlo."""
        first, u, of = self.first, self.of_run("u"), (self.first.name, self.unit)
        dof = None if math.isnan(first.dof) else first.dof
        stated = Estimate(*of, "first order", first.value, first.u, dof, self.k, self.expanded)
        drawn = Estimate(*of, "Monte Carlo", self.mean, u, shortest=self.shortest)
        return (
            stated._replace(interval=self.interval, ends_u=_ends_u(first.u, self.interval)),
            Estimate(*of, "second order", first.second_value, first.second_u),
            drawn._replace(interval=self.symmetric, ends_u=_ends_u(u, self.symmetric)),
        )


def _ends_u(u: float, interval: Interval) -> float:
    """A few trials far out give a u to which an interval of 95 % is nothing: then a quarter of the
    interval's width, which is about u for a normal distribution.
    """
    width = interval[1] - interval[0]
    return u if u <= width or width == 0.0 else 0.25 * width


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetResult:
    """A budget: what is `given`, its inputs with their sources, and its `outputs`.

    `run`: one Monte Carlo for all outputs; `converged`: to the digits asked for. `of_file`: the
    warnings of the file.
    """

    name: str
    single: bool
    given: Inputs
    outputs: tuple[OutputBudget, ...]
    run: MonteCarloResult
    converged: bool
    of_file: tuple[Finding, ...] = ()

    @property
    def probability(self) -> float:
        """Of the intervals; where a factor k is given, that of a normal distribution at k."""
        return self.run.probability

    @property
    def covariance(self) -> FloatArray:
        """Of the outputs (outputs, outputs), to first order: C V C' (JCGM 102:2011, 6.2)."""
        C = np.array([item.first.sensitivity for item in self.outputs])
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            joint: FloatArray = C @ self.given.covariance @ C.T
            # Without the rounding that cancelling leaves.
            np.fill_diagonal(joint, np.square([item.first.u for item in self.outputs]))
        return joint

    @property
    def correlation(self) -> FloatArray:
        """Of the outputs, to first order."""
        return correlation_of(self.covariance)

    @property
    def inputs(self) -> tuple[InputQuantity, ...]:
        """The inputs in the order of the file."""
        return self.given.quantities

    @property
    def input_correlation(self) -> FloatArray:
        """Their correlation coefficients (n, n), 0 of exact ones."""
        return np.nan_to_num(correlation_of(self.given.covariance))

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """All warnings, those of the file first."""
        result, run = [*self.of_file, *_of_inputs(self.given)], self.run
        for item in self.outputs:
            result += [*_of_first_order(item, self.given.u), *_of_validation(item)]
        beyond = [item.k for item in self.outputs if item.k > item.k_probability]
        if beyond and run.probability >= LARGEST_PROBABILITY:
            percent = 100 * run.probability
            result.append(finding("coverage-beyond-check", k=max(beyond), percent=percent))
        heavy = ~(np.isnan(run.u) | (run.se_u <= FEW * run.u)) & (run.trials >= MANY)
        if heavy.any():
            names = [self.outputs[i].first.name for i in np.flatnonzero(heavy)]
            reason = "a few trials far out make it, as of a ratio whose divisor may be 0"
            given = {"reason": reason, "remedy": "use the interval"}
            result.append(finding("heavy-tails", outputs=names, **given))
        if not self.converged:
            goal = "the digits of u asked for (JCGM 101, 7.9.4)"
            result.append(finding("not-converged", trials=run.trials, goal=goal))
        return tuple(dict.fromkeys(result))


def _of_inputs(inputs: Inputs) -> list[Finding]:
    result = []
    if short := [item.name for item in inputs.quantities if item.without_u]:
        result.append(finding("few-degrees-of-freedom", names=short, how=NO_U))
    for source in inputs.sources:
        names, more = [inputs.quantities[row].name for row in source.rows], ""
        if not source.is_t and any(math.isfinite(item.dof) for item in source.members):
            more = "; the scale of each makes the coefficients of the trials smaller"
        for met, how, what in (
            (source.copula, "all normal", "the Monte Carlo takes a Gaussian copula"),
            (
                not source.common_dof,
                "of the same degrees of freedom",
                "Welch-Satterthwaite takes the smallest for all of them",
            ),
        ):
            if met:
                facts = {"names": names, "how": how, "assumed": what, "weaker": more}
                result.append(finding("correlated-inputs", **facts))
    return result


def _of_first_order(item: OutputBudget, u: FloatArray) -> list[Finding]:
    first, tolerance = item.first, item.validation.tolerance
    if first.faults:
        fault = first.faults[0]
        reason = f"{fault.text} (column {fault.column} of its equation)"
        return [finding("not-differentiable", output=first.name, reason=reason)]
    if first.u == 0.0:
        if np.all(u == 0.0):
            return [finding("no-uncertainty", names=[f"the inputs of {first.name}"])]
        if first.second_u == 0.0 and item.of_run("u") == 0.0:
            return []  # Nothing of it varies.
        reason, second = "the first-order u is 0", f"u is {first.second_u:.4g}"
        return [finding("second-order", output=first.name, reason=reason, second=second)]
    shift, apart = abs(first.second_value - first.value), abs(first.second_u - first.u)
    if not max(shift, apart) > tolerance > 0.0:
        return []
    known = math.isfinite(first.second_u)
    second = f"u {first.second_u:.4g}" if known else "the variance below 0, so that u is undefined"
    reason = "the equation is not linear over the uncertainties of its inputs"
    text = f"the value is {first.second_value:.10g} and {second}"
    return [finding("second-order", output=first.name, reason=reason, second=text, u=second)]


def _of_validation(item: OutputBudget) -> list[Finding]:
    first, verdict = item.first, item.validation
    if math.isnan(first.u):
        return []
    unit = "" if item.unit == "1" else item.unit
    largest = max(verdict.d_low, verdict.d_high)
    if verdict.passed is False and first.u == 0.0 and largest <= ROUNDING * abs(first.value):
        # A step: the ends of its interval agree.
        difference = f"u 0 against {item.of_run('u'):.2g} {unit}".rstrip()
        return [finding("validation-failed", names=[first.name], difference=difference)]
    return validation_warnings([first.name], [verdict], unit, 1.0)
