"""An uncertainty budget: propagation to first and second order, and Monte Carlo beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from warnings import catch_warnings, simplefilter

import numpy as np

from mtu_cli.analyses.budget.inputs import inputs_of
from mtu_cli.analyses.budget.propagation import BudgetTrials, FirstOrder, first_order
from mtu_cli.analyses.budget.result import BudgetResult, OutputBudget
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import InputError
from mtu_cli.model.settings import PROBABILITY, Settings
from mtu_cli.stats.blocks import is_one_block
from mtu_cli.stats.coverage import coverage_factor as quantile_factor
from mtu_cli.stats.coverage import numerical_tolerance
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult, monte_carlo
from mtu_cli.stats.validation import CONVERGED_TO, Validation, clause8

__all__ = ["BudgetResult", "evaluate_budget"]

DRAWN = 2**17
"""Trials kept for the histogram."""


def evaluate_budget(
    loaded: LoadedBudget, settings: Settings, coverage_factor: float | None = None
) -> BudgetResult:
    """Evaluates a budget; `coverage_factor` wins over the file's coverage.

    The Monte Carlo goes on until the digits asked for are sure (JCGM 101:2008, 7.9.4) and, where
    clause 8 is not settled by that, to a fifth of its tolerance (8.2): an equation that first order
    plainly fails needs no more trials to say so.

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
    controlled = not is_one_block(settings.trials, probability)
    trials = BudgetTrials(loaded.trees, inputs, first, controlled)
    factors = [
        math.nan if math.isnan(x.dof) else quantile_factor(probability, x.dof) for x in first
    ]
    run = _run(loaded, trials, settings, probability, 1.0)
    reached = run.converged
    verdicts = _judged(first, factors, run, settings.digits)
    unsettled = any(not v.settled and x.u > 0.0 for v, x in zip(verdicts, first, strict=True))
    if settings.trials is None and reached and unsettled:
        # The engine takes its tolerance from its own u, which may need a digit more: 0.105 beside
        # 0.074. The least of the tolerances of clause 8 over those of the engine.
        both = [(x.u, float(u)) for x, u in zip(first, run.u, strict=True) if x.u > 0.0 and u > 0.0]
        digits = settings.digits
        ratios = [numerical_tolerance(u, digits) / numerical_tolerance(v, digits) for u, v in both]
        fraction = CONVERGED_TO * min([1.0, *(ratio for ratio in ratios if math.isfinite(ratio))])
        run = _run(loaded, trials, settings, probability, fraction)
        verdicts = _judged(first, factors, run, settings.digits)
    # Nothing but a standard error can say that a statistic has converged.
    errors = np.where(trials.u_exists, run.u + run.se_mean + run.se_u, 0.0)
    converged = reached and bool(np.all(np.isfinite(errors + run.se_low + run.se_high)))
    outputs = [
        OutputBudget(
            first=item,
            unit=loaded.units[item.name],
            k=factors[i] if k is None else k,
            k_probability=factors[i],
            validation=verdicts[i],
            inputs=inputs.quantities,
            run=run,
            index=i,
            converged=converged,
        )
        for i, item in enumerate(first)
    ]
    return BudgetResult(
        name=loaded.budget.name,
        single=loaded.single,
        given=inputs,
        outputs=tuple(outputs),
        run=run,
        converged=converged,
        of_file=loaded.warnings,
    )


def _run(
    loaded: LoadedBudget,
    trials: BudgetTrials,
    settings: Settings,
    probability: float,
    fraction: float,
) -> MonteCarloResult:
    """The Monte Carlo, where the count adapts to this fraction of the tolerance."""
    try:
        # Trials too far apart to be squared leave inf or nan, which a warning of ours reports.
        with catch_warnings():
            simplefilter("ignore", RuntimeWarning)
            return monte_carlo(
                trials,
                seed=settings.seed,
                trials=settings.trials,
                probability=probability,
                digits=settings.digits,
                tolerance_fraction=fraction,
                threads=settings.threads,
                keep=DRAWN,
                progress=settings.progress,
            )
    except InputError as fault:
        # The engine knows no file: the equation's place makes its message one of the file's.
        outputs = [(problem, problem.facts.get("output")) for problem in fault.findings]
        raise InputError(
            problem.at(**loaded.where(name)) if name in loaded.trees else problem
            for problem, name in outputs
        ) from None


def _judged(
    first: Sequence[FirstOrder], factors: Sequence[float], run: MonteCarloResult, digits: int
) -> list[Validation]:
    """Clause 8 of every output; undecided where there is no first order."""
    result = []
    for i, item in enumerate(first):
        verdict = Validation(passed=None, d_low=math.nan, d_high=math.nan, tolerance=math.nan)
        if not math.isnan(item.u):
            verdict = clause8(item.value, item.u, factors[i], run, digits, i)
            # The ends of a step's interval may agree: no u is still wrong where there is one.
            if item.u == 0.0 and run.u[i] > 0.0:
                verdict = replace(verdict, passed=False)
        result.append(verdict)
    return result
