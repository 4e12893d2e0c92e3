"""The result of a budget, and what its user should know beside the figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtu_cli.analyses.budget.inputs import InputQuantity, Inputs
from mtu_cli.analyses.budget.propagation import FirstOrder
from mtu_cli.findings import Finding, finding
from mtu_cli.model.settings import validation_warnings
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation

SHORTEST = 1.05
"""More than its own scatter may make the shortest interval longer than the symmetric one."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
Interval = tuple[float, float]


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
    def estimates(self) -> Iterator[dict[str, Any]]:
        """By first order, second order and Monte Carlo; intervals are rounded to `ends_u`."""
        first, u, (low, high) = self.first, self.of_run("u"), self.symmetric
        dof = None if math.isnan(first.dof) else first.dof
        # A few trials far out give a u to which an interval of 95 % is nothing.
        ends_u = u if u <= high - low or low == high else 0.25 * (high - low)
        stated = {"dof": dof, "k": self.k, "U": self.expanded, "interval": self.interval}
        drawn = {"interval": (low, high), "shortest": self.shortest, "ends_u": ends_u}
        for method, value, own, more in (
            ("first order", first.value, first.u, {**stated, "ends_u": first.u}),
            ("second order", first.second_value, first.second_u, {}),
            ("Monte Carlo", self.mean, u, drawn),
        ):
            row = {"output": first.name, "unit": self.unit, "method": method, "value": value}
            yield {**row, "u": own, **more}

    def findings(self, u: FloatArray) -> Iterator[Finding]:
        """What first and second order and clause 8 show; `u` (n,) of the inputs."""
        first, verdict, drawn = self.first, self.validation, self.of_run("u")
        shift, apart = abs(first.second_value - first.value), abs(first.second_u - first.u)
        if first.faults:
            fault = first.faults[0]
            reason = f"{fault.text} (column {fault.column} of its equation)"
            yield finding("not-differentiable", output=first.name, reason=reason)
        elif np.all(u == 0.0):
            yield finding("no-uncertainty", names=[f"the inputs of {first.name}"])
        elif max(shift, apart) > verdict.tolerance > 0.0 or (first.u == 0.0 and drawn > 0.0):
            known = math.isfinite(first.second_u)
            second = "the variance below 0, so that u is undefined"
            second = f"u {first.second_u:.4g}" if known else second
            reason = "the equation is not linear over the uncertainties of its inputs"
            text = f"the value is {first.second_value:.10g} and {second}"
            facts = {"output": first.name, "reason": reason, "second": text, "u": second}
            yield finding("second-order", **facts)
        if math.isnan(first.u):
            return
        unit = "" if self.unit == "1" else self.unit
        largest = max(verdict.d_low, verdict.d_high)
        if verdict.passed is False and first.u == 0.0 and largest <= ROUNDING * abs(first.value):
            # A step: the ends of its interval agree.
            difference = f"u 0 against {drawn:.2g} {unit}".rstrip()
            yield finding("validation-failed", names=[first.name], difference=difference)
        else:
            yield from validation_warnings([first.name], [verdict], unit, 1.0)


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
        result = [*self.of_file, *self.given.findings()]
        for item in self.outputs:
            result += item.findings(self.given.u)
        if not self.converged:
            goal = "the digits of u asked for (JCGM 101, 7.9.4)"
            result.append(finding("not-converged", trials=self.run.trials, goal=goal))
        return tuple(dict.fromkeys(result))
