"""What the user of a budget should know beside its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.analyses.budget.tails import told_source, unsettled
from mtu_cli.errors import Warned
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult

if TYPE_CHECKING:
    from mtu_cli.analyses.budget import OutputBudget

SHOWN = 6
NO_WEAKER = 0.9995
"""A factor of a correlation that shows as 1."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
FEW, MANY = 0.2, 10_000
"""Share of u that its standard error is where a few of many trials make it: that of normal ones is
1/sqrt(2 M)."""
SHORTEST = 1.05
"""More than its own scatter may make the shortest interval longer than the symmetric one."""


def budget_warnings(
    loaded: LoadedBudget,
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    outputs: Sequence[OutputBudget],
    run: MonteCarloResult,
    converged: bool,
) -> tuple[Finding, ...]:
    """All warnings of a budget, those of the file first."""
    found = [Warned(code=item.code, message=item.message) for item in loaded.warnings]
    found += _inputs(inputs, sources)
    for index, item in enumerate(outputs):
        found += _first_order(item, inputs, sources, run)
        found += _validation(item, run, index)
    beyond = [item.k for item in outputs if item.k > item.k_probability]
    if beyond and run.probability >= LARGEST_PROBABILITY:
        message = (
            f"k = {max(beyond):g} covers more than the {100 * run.probability:g} % that a Monte "
            "Carlo can check: its intervals, and those of first order, are for that"
        )
        found.append(Warned(code="coverage-beyond-check", message=message))
    found += _unsettled(outputs, run)
    found += _shortest(outputs, run)
    if not converged:
        found.append(
            Warned(
                code="not-converged",
                message=f"{run.trials} Monte Carlo trials: not enough for the digits of u asked "
                "for (JCGM 101, 7.9.4)",
            )
        )
    return tuple(dict.fromkeys(found))


def _unsettled(outputs: Sequence[OutputBudget], run: MonteCarloResult) -> list[Finding]:
    """Outputs with trials so far out that their squares or fourth powers are beyond numbers."""
    named = [
        item.first.name
        for index, item in enumerate(outputs)
        if math.isinf(run.u[index])
        or (math.isfinite(run.u[index]) and not math.isfinite(run.se_u[index]))
    ]
    found = []
    if named:
        message = (
            f"{_listed(named)}: the Monte Carlo u has no standard error of its own, its trials are "
            "too far apart to calculate one: use the interval"
        )
        found.append(Warned(code="no-standard-error", message=message))
    of_few = [
        item.first.name
        for index, item in enumerate(outputs)
        if FEW * run.u[index] < run.se_u[index] < math.inf
    ]
    if of_few and run.trials >= MANY:
        message = (
            f"{_listed(of_few)}: a few trials far out make the Monte Carlo u, which may not exist, "
            "as of a ratio whose divisor may be 0; more trials may not help: use the interval"
        )
        found.append(Warned(code="heavy-tails", message=message))
    return found


def has_shortest(run: MonteCarloResult, index: int) -> bool:
    """Whether the shortest interval is that: trials too far apart leave one that is longer."""
    width = float(run.shortest_high[index] - run.shortest_low[index])
    return 0.0 <= width <= SHORTEST * float(run.high[index] - run.low[index])


def _shortest(outputs: Sequence[OutputBudget], run: MonteCarloResult) -> list[Finding]:
    named = [
        item.first.name
        for index, item in enumerate(outputs)
        if run.u[index] != 0.0 and not has_shortest(run, index)
    ]
    if not named:
        return []
    message = (
        f"{_listed(named)}: no shortest interval, the trials are too far apart to tell where it is"
    )
    return [Warned(code="no-shortest-interval", message=message)]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _inputs(inputs: Sequence[InputQuantity], sources: Sequence[Source]) -> list[Finding]:
    found = []
    short = [
        part.told(item.name) if len(item.parts) > 1 else item.name
        for item in inputs
        for part in item.parts
        if not part.distribution.bounded and part.distribution.dof <= 2
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
                "determined by that. The Monte Carlo takes a Gaussian copula, such that they have "
                f"the stated coefficients{_weaker(source, inputs)}"
            )
            found.append(Warned(code="gaussian-copula", message=message))
        if source.how != "alone" and not source.common_dof:
            message = (
                f"{named} are correlated and differ in degrees of freedom: Welch-Satterthwaite "
                "takes the smallest for all of them"
            )
            if source.how == "normal":
                message += (
                    ". The Monte Carlo draws jointly normal values that have the stated "
                    f"coefficients{_weaker(source, inputs)}"
                )
            found.append(Warned(code="correlated-dof", message=message))
    return found


def _weaker(source: Source, inputs: Sequence[InputQuantity]) -> str:
    """Which coefficients of what is drawn differ from those stated, and by how much."""
    times = [
        f"{inputs[row].name} {item.correlated_share:.3g}"
        for row, item in zip(source.rows, source.members, strict=True)
        if item.correlated_share < NO_WEAKER
    ]
    none = [
        inputs[row].name
        for row, item in zip(source.rows, source.members, strict=True)
        if math.isnan(item.correlated_share)
    ]
    said = ""
    if times:
        said = (
            " before each input of finite degrees of freedom is given a random scale of its own. "
            "What is drawn has a smaller coefficient: the stated one times the factors of both "
            f"inputs, which are {', '.join(times)} (1 for others)"
        )
    if none:
        said += f"; {_listed(none)}, of two degrees of freedom or fewer: no coefficient exists"
    return said


def _first_order(
    item: OutputBudget,
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    run: MonteCarloResult,
) -> list[Finding]:
    first = item.first
    name = first.name
    if first.faults:
        fault = first.faults[0]
        message = (
            f"{name}: {fault.text} (column {fault.column} of its equation): no first-order "
            "uncertainty exists, use the Monte Carlo"
        )
        return [Warned(code="not-differentiable", message=message)]
    if first.u == 0.0:
        return [_without_u(item, inputs)]
    found = []
    tolerance = item.validation.tolerance / first.u
    # A single block has no control variate: of a linear equation, too, u is that of the trials.
    far = unsettled(first.tails, tolerance, run.trials, controlled=run.blocks > 1)
    if far:
        more = not unsettled(first.tails, tolerance, run.trials, controlled=True)
        remedy = "take more trials" if more else "use the interval"
        named = [text for tail in far for text in told_source(sources[tail.source], inputs)]
        message = (
            f"{name}: with four degrees of freedom or fewer for {_listed(named)} the standard "
            f"uncertainty by Monte Carlo may not settle to the digits asked for, {remedy}"
        )
        found.append(Warned(code="heavy-tails", message=message))
    return [*found, *_second_order(item)]


def _second_order(item: OutputBudget) -> list[Finding]:
    first = item.first
    shift, apart = abs(first.second_value - first.value), abs(first.second_u - first.u)
    if not max(shift, apart) > item.validation.tolerance > 0.0:
        return []
    known = math.isfinite(first.second_u)
    u = f"u {first.second_u:.4g}" if known else "its variance below 0, so that there is no u"
    message = (
        f"{first.name}: the equation is not linear over the uncertainties of its inputs; to the "
        f"second order the value is {first.second_value:.10g} and {u}"
    )
    return [Warned(code="second-order", message=message)]


def _without_u(item: OutputBudget, inputs: Sequence[InputQuantity]) -> Finding:
    first = item.first
    if all(other.u == 0.0 for other in inputs):
        message = f"{first.name}: no input has an uncertainty"
        return Warned(code="no-uncertainty", message=message)
    if any(c * other.u != 0.0 for c, other in zip(first.sensitivity, inputs, strict=True)):
        message = (
            f"{first.name}: the first-order contributions cancel, so that its u is 0; to the "
            f"second order u is {first.second_u:.4g}"
        )
        return Warned(code="first-order-zero", message=message)
    message = (
        f"{first.name}: every sensitivity is 0 at the estimates, so the first-order u is 0 and "
        f"says nothing; to the second order u is {first.second_u:.4g}"
    )
    return Warned(code="first-order-zero", message=message)


def _validation(item: OutputBudget, run: MonteCarloResult, index: int) -> list[Finding]:
    first, verdict = item.first, item.validation
    if math.isnan(first.u):
        return []
    percent = f"{100 * run.probability:.4g} %"
    unit = f" {item.unit}" if item.unit and item.unit != "1" else ""
    largest = float(np.max([verdict.d_low, verdict.d_high]))
    if verdict.passed is False and first.u == 0.0 and largest <= ROUNDING * abs(first.value):
        message = (
            f"{first.name}: the first-order u is 0 and the Monte Carlo's {run.u[index]:.2g}{unit}: "
            "first order is not valid (JCGM 101, clause 8), although the intervals agree"
        )
        return [Warned(code="validation-failed", message=message)]
    if verdict.passed is False:
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
