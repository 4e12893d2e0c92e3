"""An uncertainty budget: propagation to first and second order, and by Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from warnings import catch_warnings, simplefilter

import numpy as np

from mtu_cli.analyses.budget.inputs import InputQuantity, Inputs, inputs_of
from mtu_cli.analyses.budget.propagation import BudgetTrials, FirstOrder, first_order
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.settings import MOST_TRIALS, Settings, validation_warnings
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.coverage import PROBABILITY
from mtu_cli.stats.coverage import coverage_factor as quantile_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult, Validation, validated

__all__ = ["BudgetResult", "evaluate_budget"]

DRAWN = 2**17
"""Trials kept for the histogram."""
SHORTEST = 1.05
"""By its scatter the shortest interval may be longer than the symmetric one by this factor."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class OutputBudget(FirstOrder):
    """One output: first order, its expanded uncertainty U = k u, and clause 8's verdict on it by
    the trials, row `index` of a `run`.

    `k_probability`: the factor for the coverage probability at the output's effective degrees
    of freedom; k itself is that, unless a factor is given.
    """

    unit: str
    k: float
    k_probability: float
    validation: Validation
    inputs: tuple[InputQuantity, ...]
    run: MonteCarloResult
    index: int

    @property
    def expanded(self) -> float:
        """U = k u."""
        return self.k * self.u

    @property
    def interval(self) -> Interval:
        """First-order interval y -+ k u for the coverage probability."""
        half = self.k_probability * self.u
        return self.value - half, self.value + half

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
            # Weights of ordered values add rounding to equal ones.
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

    def findings(self, u: FloatArray) -> Iterator[Finding]:
        """What first and second order and clause 8 show; `u` (n,) of the inputs."""
        verdict, u_trials = self.validation, self.of_run("u")
        shift, change = abs(self.second_value - self.value), abs(self.second_u - self.u)
        if self.faults:
            reason = f"{self.faults[0].text} (column {self.faults[0].column} of its equation)"
            yield finding("not-differentiable", output=self.name, reason=reason)
        elif np.all(u == 0.0):
            yield finding("no-uncertainty", names=[f"the inputs of {self.name}"])
        elif max(shift, change) > verdict.tolerance > 0.0 or (self.u == 0.0 and u_trials > 0.0):
            finite = math.isfinite(self.second_u)
            second = "the variance below 0, so that u is undefined"
            second = f"u {self.second_u:.4g}" if finite else second
            reason = "the equation is not linear over the uncertainties of its inputs"
            text = f"the value is {self.second_value:.10g} and {second}"
            facts = {"output": self.name, "reason": reason, "second": text, "u": second}
            yield finding("second-order", **facts)
        if math.isnan(self.u):
            return
        unit = "" if self.unit == "1" else self.unit
        largest = max(verdict.d_low, verdict.d_high)
        if verdict.passed is False and self.u == 0.0 and largest <= ROUNDING * abs(self.value):
            # A step: the ends of its interval agree.
            difference = f"u 0 against {u_trials:.2g} {unit}".rstrip()
            yield finding("validation-failed", names=[self.name], difference=difference)
        else:
            yield from validation_warnings([self.name], [verdict], unit, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetResult:
    """A budget: what is `given`, its inputs with their sources, and its `outputs`.

    `run`: one Monte Carlo for all outputs, of intervals for `probability`: where a factor k is
    given, that of a normal distribution at k. `of_file`: the warnings of the file.
    """

    name: str
    single: bool
    given: Inputs
    outputs: tuple[OutputBudget, ...]
    run: MonteCarloResult
    of_file: tuple[Finding, ...] = ()

    @property
    def covariance(self) -> FloatArray:
        """Of the outputs (outputs, outputs), to first order: C V C' (JCGM 102:2011, 6.2)."""
        C = np.array([item.sensitivity for item in self.outputs])
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            joint: FloatArray = C @ self.given.covariance @ C.T
            # Without the rounding of what cancels.
            np.fill_diagonal(joint, np.square([item.u for item in self.outputs]))
        return joint

    @property
    def correlation(self) -> FloatArray:
        """Of the outputs, to first order."""
        return correlation_of(self.covariance)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """All warnings, those of the file first."""
        result = [*self.of_file, *self.given.findings()]
        for item in self.outputs:
            result += item.findings(self.given.u)
        if not self.run.converged:
            goal = "the digits of u asked for (JCGM 101, 7.9.4)"
            result.append(finding("not-converged", trials=self.run.trials, goal=goal))
        return tuple(dict.fromkeys(result))


def evaluate_budget(
    loaded: LoadedBudget, settings: Settings, coverage_factor: float | None = None
) -> BudgetResult:
    """Evaluates a budget; `coverage_factor` wins over the file's coverage.

    Raises InputError for correlations that no inputs can have, an equation without a finite
    value at the estimates or in some trials, a factor so small that it covers nothing.
    """
    inputs = inputs_of(loaded)
    first = first_order(loaded, inputs)
    k = loaded.budget.coverage.k if coverage_factor is None else coverage_factor
    stated = loaded.budget.coverage.probability
    probability = PROBABILITY if stated is None else stated
    if k is not None:
        # Of a normal distribution; what a short t covers at k is another matter.
        probability = min(math.erf(k / math.sqrt(2.0)), LARGEST_PROBABILITY)
    trials = BudgetTrials(loaded.trees, inputs, first)
    factors = [
        math.nan if math.isnan(x.dof) else quantile_factor(probability, x.dof) for x in first
    ]

    def run_to(fraction: float) -> MonteCarloResult:
        # Trials too far apart to be squared give inf or nan, which a warning of ours reports.
        with catch_warnings():
            simplefilter("ignore", RuntimeWarning)
            return settings.run(
                trials, keep=DRAWN, fraction=fraction, most=MOST_TRIALS, probability=probability
            )

    estimates = [(x.value, x.u, k_p) for x, k_p in zip(first, factors, strict=True)]
    try:
        run, verdicts = validated(run_to, estimates, settings.digits, settings.trials is None)
    except InputError as fault:
        # The engine knows no file: the equation's place makes its message one of the file's.
        pairs = [(problem, problem.facts.get("output")) for problem in fault.findings]
        raise InputError(
            problem.at(**loaded.where(name)) if name in loaded.trees else problem
            for problem, name in pairs
        ) from None
    # Only a standard error shows that a statistic has converged.
    errors = np.where(trials.u_exists, run.u + run.se_mean + run.se_u, 0.0)
    finite = np.all(np.isfinite(errors + run.se_low + run.se_high))
    run = replace(run, converged=run.converged and bool(finite))
    outputs = tuple(
        OutputBudget(
            **vars(item),
            unit=loaded.units[item.name],
            k=factors[i] if k is None else k,
            k_probability=factors[i],
            validation=verdicts[i],
            inputs=inputs.quantities,
            run=run,
            index=i,
        )
        for i, item in enumerate(first)
    )
    return BudgetResult(
        name=loaded.budget.name,
        single=loaded.single,
        given=inputs,
        outputs=outputs,
        run=run,
        of_file=loaded.warnings,
    )
