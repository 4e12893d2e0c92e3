"""What the user of a budget should know beside its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.model.settings import Warned
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult

if TYPE_CHECKING:
    from mtu_cli.analyses.budget import OutputBudget

SHOWN = 6
FEW_DOF = 4.0
"""The square of a t distribution with no more has no variance."""


def budget_warnings(
    loaded: LoadedBudget,
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    outputs: Sequence[OutputBudget],
    run: MonteCarloResult,
    converged: bool,
) -> tuple[Warned, ...]:
    """All warnings of a budget, those of the file first."""
    found = [Warned(code=item.code, message=item.message) for item in loaded.warnings]
    found += _inputs(inputs, sources)
    for index, item in enumerate(outputs):
        found += _first_order(item, inputs)
        found += _validation(item, run, index)
    beyond = [item.k for item in outputs if item.k > item.k_probability]
    if beyond and run.probability >= LARGEST_PROBABILITY:
        message = (
            f"k = {max(beyond):g} covers more than the {100 * run.probability:g} % that a Monte "
            "Carlo can check: its intervals, and those of first order, are for that"
        )
        found.append(Warned(code="coverage-beyond-check", message=message))
    if not converged:
        found.append(
            Warned(
                code="not-converged",
                message=f"{run.trials} Monte Carlo trials: not enough for the digits of u asked "
                "for (JCGM 101, 7.9.4)",
            )
        )
    return tuple(dict.fromkeys(found))


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _inputs(inputs: Sequence[InputQuantity], sources: Sequence[Source]) -> list[Warned]:
    found = []
    short = [
        item.name
        for item in inputs
        if any(not part.distribution.bounded and part.distribution.dof <= 2 for part in item.parts)
    ]
    if short:
        message = (
            f"two degrees of freedom or fewer for {_listed(short)}: the Monte Carlo has no "
            "standard uncertainty, use its interval"
        )
        found.append(Warned(code="no-standard-uncertainty", message=message))
    for source in sources:
        named = _listed([inputs[row].name for row in source.rows])
        if source.how == "copula":
            message = (
                f"{named} are correlated and not all normal: their joint distribution is not "
                "determined by that, the Monte Carlo takes a Gaussian copula with the stated "
                "correlation"
            )
            found.append(Warned(code="gaussian-copula", message=message))
        if source.how != "alone" and not source.common_dof:
            message = (
                f"{named} are correlated and differ in degrees of freedom: Welch-Satterthwaite "
                "takes the smallest for all of them"
            )
            found.append(Warned(code="correlated-dof", message=message))
    return found


def _first_order(item: OutputBudget, inputs: Sequence[InputQuantity]) -> list[Warned]:
    first = item.first
    name = first.name
    if first.faults:
        fault = first.faults[0]
        message = (
            f"{name}: {fault.what} (column {fault.column} of its equation): no first-order "
            "uncertainty exists, use the Monte Carlo"
        )
        return [Warned(code="not-differentiable", message=message)]
    if first.u == 0.0:
        return [_without_u(item, inputs)]
    found = []
    tail = [
        other.name
        for other, curved in zip(inputs, first.curved, strict=True)
        if curved
        and any(
            not part.distribution.bounded and part.distribution.dof <= FEW_DOF
            for part in other.parts
        )
    ]
    if tail:
        message = (
            f"{name} is curved in {_listed(tail)}, of four degrees of freedom or fewer: its "
            "standard uncertainty by Monte Carlo may not settle, use the interval"
        )
        found.append(Warned(code="heavy-tails", message=message))
    shift = abs(first.second_value - first.value)
    apart = abs(first.second_u - first.u)
    if max(shift, apart) > item.validation.tolerance > 0.0:
        message = (
            f"{name}: the equation is not linear over the uncertainties of its inputs; to the "
            f"second order the value is {first.second_value:.10g} and u {first.second_u:.4g}"
        )
        found.append(Warned(code="second-order", message=message))
    return found


def _without_u(item: OutputBudget, inputs: Sequence[InputQuantity]) -> Warned:
    first = item.first
    if all(other.u == 0.0 for other in inputs):
        message = f"{first.name}: no input has an uncertainty"
        return Warned(code="no-uncertainty", message=message)
    message = (
        f"{first.name}: every sensitivity is 0 at the estimates, so the first-order u is 0 and "
        f"says nothing; to the second order u is {first.second_u:.4g}"
    )
    return Warned(code="first-order-zero", message=message)


def _validation(item: OutputBudget, run: MonteCarloResult, index: int) -> list[Warned]:
    first, verdict = item.first, item.validation
    if math.isnan(first.u):
        return []
    percent = f"{100 * run.probability:.4g} %"
    unit = f" {item.unit}" if item.unit else ""
    if verdict.passed is False:
        largest = float(np.max([verdict.d_low, verdict.d_high]))
        message = (
            f"{first.name}: the first-order {percent} interval differs from the Monte Carlo one "
            f"by {largest:.2g}{unit}, more than the tolerance {verdict.tolerance:.2g}{unit} of "
            "JCGM 101, clause 8"
        )
        return [Warned(code="validation-failed", message=message)]
    if verdict.passed is None:
        message = (
            f"{first.name}: too few Monte Carlo trials to judge the first-order interval (JCGM "
            "101, clause 8)"
        )
        return [Warned(code="validation-undecided", message=message)]
    return []
