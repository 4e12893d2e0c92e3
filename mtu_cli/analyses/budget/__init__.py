"""An uncertainty budget: propagation to first and second order, and Monte Carlo beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.budget.first_order import FirstOrder, first_order
from mtu_cli.analyses.budget.inputs import InputQuantity, inputs_of
from mtu_cli.analyses.budget.result import BudgetResult, OutputBudget, budget_warnings
from mtu_cli.analyses.budget.trials import BudgetTrials
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, error
from mtu_cli.model.settings import PROBABILITY, Settings
from mtu_cli.stats.blocks import is_one_block
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.coverage import coverage_factor, numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult, monte_carlo
from mtu_cli.stats.validation import CONVERGED_TO, Validation, clause8

__all__ = ["BudgetResult", "evaluate_budget"]

DRAWN = 2**17
"""Trials kept for the histogram."""


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
    probability = _probability(loaded, k, coverage_factor is not None)
    controlled = not is_one_block(settings.trials, probability)
    trials = BudgetTrials(loaded.trees, inputs, first, controlled)
    judge = _Judge(first, inputs.quantities, loaded.units, k, probability, settings.digits)
    run, converged = _run(loaded, trials, judge, settings)
    outputs = judge.outputs(run, converged)
    joint = _joint(first, inputs.covariance)
    result = BudgetResult(
        name=loaded.budget.name,
        single=loaded.single,
        given=inputs,
        outputs=outputs,
        covariance=joint,
        correlation=correlation_of(joint),
        probability=probability,
        run=run,
        converged=converged,
    )
    return replace(result, warnings=budget_warnings(loaded, result))


def _joint(first: Sequence[FirstOrder], covariance: FloatArray) -> FloatArray:
    """C V C' of the outputs, its diagonal without the rounding that cancelling leaves."""
    C = np.array([item.sensitivity for item in first])
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        joint: FloatArray = C @ covariance @ C.T
        np.fill_diagonal(joint, np.square([item.u for item in first]))
    return joint


def _probability(loaded: LoadedBudget, k: float | None, called: bool) -> float:
    """Of the intervals; `called`: whether k is the call's and not the file's."""
    if k is None:
        stated = loaded.budget.coverage.probability
        return PROBABILITY if stated is None else stated
    # Of a normal distribution; what a short t covers at k is another matter.
    probability = min(math.erf(k / math.sqrt(2.0)), LARGEST_PROBABILITY)
    if 0.5 * (1.0 + probability) == 0.5:
        place: dict[str, Any] = {"path": "--k"}
        if not called:
            line = loaded.line_of("coverage", "k")
            place = {"file": loaded.source.shown, "line": line, "path": "coverage.k"}
        raise error("out-of-range", value=f"{k:g}", expected="a factor such as 2", **place)
    return probability


@dataclass(frozen=True, slots=True)
class _Judge:
    """First order against a Monte Carlo; `k` None where the coverage probability gives it."""

    first: tuple[FirstOrder, ...]
    inputs: tuple[InputQuantity, ...]
    units: Mapping[str, str]
    k: float | None
    probability: float
    digits: int

    def outputs(self, run: MonteCarloResult, converged: bool) -> tuple[OutputBudget, ...]:
        return tuple(self._output(i, run, converged) for i in range(len(self.first)))

    def unsettled(self, run: MonteCarloResult) -> bool:
        outputs = self.outputs(run, run.converged)
        return any(not item.validation.settled and item.first.u > 0.0 for item in outputs)

    def _output(self, index: int, run: MonteCarloResult, converged: bool) -> OutputBudget:
        first = self.first[index]
        factor = math.nan
        if not math.isnan(first.dof):
            factor = coverage_factor(self.probability, first.dof)
        if math.isnan(first.u):
            verdict = Validation(passed=None, d_low=math.nan, d_high=math.nan, tolerance=math.nan)
        else:
            verdict = clause8(first.value, first.u, factor, run, self.digits, index)
            # The ends of a step's interval may agree: no u is still wrong where there is one.
            if first.u == 0.0 and run.u[index] > 0.0:
                verdict = replace(verdict, passed=False)
        return OutputBudget(
            first=first,
            unit=self.units[first.name],
            k=factor if self.k is None else self.k,
            k_probability=factor,
            validation=verdict,
            inputs=self.inputs,
            run=run,
            index=index,
            converged=converged,
        )


def _run(
    loaded: LoadedBudget, trials: BudgetTrials, judge: _Judge, settings: Settings
) -> tuple[MonteCarloResult, bool]:
    """The Monte Carlo, and whether the digits asked for are sure (JCGM 101:2008, 7.9.4).

    Where clause 8 is not settled by that it goes on to a fifth of the tolerance (8.2): an equation
    that first order plainly fails needs no more trials to say so.
    """

    def at(fraction: float) -> MonteCarloResult:
        # Trials too far apart to be squared leave inf or nan, which a warning of ours reports.
        with catch_warnings():
            simplefilter("ignore", RuntimeWarning)
            run = monte_carlo(
                trials,
                seed=settings.seed,
                trials=settings.trials,
                probability=judge.probability,
                digits=settings.digits,
                tolerance_fraction=fraction,
                threads=settings.threads,
                keep=DRAWN,
                progress=settings.progress,
            )
        return trials.in_full(run)

    try:
        run = at(1.0)
        if settings.trials is None and run.converged and judge.unsettled(run):
            run = at(CONVERGED_TO * min(1.0, _tolerance_ratio(judge.first, run, settings.digits)))
            return run, _has_errors(run, trials.u_exists)
    except InputError as error:
        # The engine knows no file: the equation's place makes its message one of the file's.
        raise InputError([_placed(loaded, problem) for problem in error.findings]) from None
    return run, run.converged and _has_errors(run, trials.u_exists)


def _has_errors(run: MonteCarloResult, u_exists: NDArray[np.bool_]) -> bool:
    """Whether every statistic has a standard error: nothing else can say that it converged."""
    errors = np.where(u_exists, run.u + run.se_mean + run.se_u, 0.0) + run.se_low + run.se_high
    return bool(np.all(np.isfinite(errors)))


def _tolerance_ratio(first: Sequence[FirstOrder], run: MonteCarloResult, digits: int) -> float:
    """Least of the tolerances of clause 8, from the first-order u, over those of the engine.

    The engine takes them from its own u, which may need a digit less: 0.105 beside 0.074.
    """
    own = [
        numerical_tolerance(float(u) if math.isfinite(u) else item.u, digits)
        for u, item in zip(run.u, first, strict=True)
    ]
    ratios = [
        numerical_tolerance(item.u, digits) / tolerance
        for item, tolerance in zip(first, own, strict=True)
        if item.u > 0.0 and tolerance > 0.0
    ]
    return min(ratios, default=1.0)


def _placed(loaded: LoadedBudget, problem: Finding) -> Finding:
    name = problem.facts.get("output")
    if name not in loaded.trees:
        return problem
    path = loaded.place(name)
    place = ".".join(str(step) for step in path)
    return problem.at(file=loaded.source.shown, line=loaded.line_of(*path), path=place)
