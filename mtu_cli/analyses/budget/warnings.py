"""What the user of a budget should know beside its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.budget.first_order import OutputBudget
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.analyses.budget.sources import Source
from mtu_cli.analyses.budget.tails import names_of_source, unsettled
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.features import NO_U
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult

NO_WEAKER = 0.9995
"""A factor of a correlation that shows as 1."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
FEW, MANY = 0.2, 10_000
"""Share of u that its standard error is where a few of many trials make it: that of normal ones is
1/sqrt(2 M)."""


def budget_warnings(
    loaded: LoadedBudget,
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    outputs: Sequence[OutputBudget],
    run: MonteCarloResult,
    converged: bool,
) -> tuple[Finding, ...]:
    """All warnings of a budget, those of the file first."""
    found = [*loaded.warnings, *_inputs(inputs, sources)]
    for index, item in enumerate(outputs):
        found += _first_order(item, inputs, sources, run)
        found += _validation(item, run, index)
    beyond = [item.k for item in outputs if item.k > item.k_probability]
    if beyond and run.probability >= LARGEST_PROBABILITY:
        percent = 100 * run.probability
        found.append(finding("coverage-beyond-check", k=max(beyond), percent=percent))
    found += _unsettled(outputs, run)
    found += _shortest(outputs)
    if not converged:
        goal = "the digits of u asked for (JCGM 101, 7.9.4)"
        found.append(finding("not-converged", trials=run.trials, goal=goal))
    return tuple(dict.fromkeys(found))


def _unsettled(outputs: Sequence[OutputBudget], run: MonteCarloResult) -> list[Finding]:
    """Outputs with trials so far out that their squares or fourth powers are beyond numbers."""
    far, of_few = [], []
    for index, item in enumerate(outputs):
        u, se = run.u[index], run.se_u[index]
        if math.isinf(u) or (math.isfinite(u) and not math.isfinite(se)):
            far.append(item.first.name)
        if FEW * u < se < math.inf and run.trials >= MANY:
            of_few.append(item.first.name)
    return [
        finding("heavy-tails", outputs=names, reason=reason, remedy="use the interval")
        for names, reason in (
            (far, "its trials are too far apart for a standard error"),
            (of_few, "a few trials far out make it, as of a ratio whose divisor may be 0"),
        )
        if names
    ]


def _shortest(outputs: Sequence[OutputBudget]) -> list[Finding]:
    named = [item.first.name for item in outputs if not item.has_shortest]
    if not named:
        return []
    reason = "the trials are too far apart"
    return [finding("not-estimable", quantity="the shortest interval", names=named, reason=reason)]


def _inputs(inputs: Sequence[InputQuantity], sources: Sequence[Source]) -> list[Finding]:
    found = []
    short = [
        part.label(item.name) if len(item.parts) > 1 else item.name
        for item in inputs
        for part in item.parts
        if not part.distribution.bounded and part.distribution.dof <= 2
    ]
    if short:
        found.append(finding("few-degrees-of-freedom", names=short, how=NO_U))
    for source in sources:
        names = [inputs[row].name for row in source.rows]
        weaker = _weaker(source, inputs)
        if source.how == "copula":
            how, assumed = "all normal", "the Monte Carlo takes a Gaussian copula"
            facts = {"names": names, "how": how, "assumed": assumed, "weaker": weaker}
            found.append(finding("correlated-inputs", **facts))
        if source.how != "alone" and not source.common_dof:
            weaker = weaker if source.how == "normal" else ""
            how = "of the same degrees of freedom"
            assumed = "Welch-Satterthwaite takes the smallest for all of them"
            facts = {"names": names, "how": how, "assumed": assumed, "weaker": weaker}
            found.append(finding("correlated-inputs", **facts))
    return found


def _weaker(source: Source, inputs: Sequence[InputQuantity]) -> str:
    """Which coefficients of what is drawn differ from those stated, and by how much: the random
    scale of an input of finite degrees of freedom makes its coefficients smaller.
    """
    members = [
        (inputs[row].name, item.correlated_share)
        for row, item in zip(source.rows, source.members, strict=True)
    ]
    times = [f"{name} {share:.3g}" for name, share in members if share < NO_WEAKER]
    none = [name for name, share in members if math.isnan(share)]
    text = ""
    if times:
        text = (
            "; the trials have smaller coefficients, the stated one times the factors of both "
            f"inputs ({listed(times)}; 1 for others)"
        )
    return text + (f"; {listed(none)} have no coefficient" if none else "")


def _first_order(
    item: OutputBudget,
    inputs: Sequence[InputQuantity],
    sources: Sequence[Source],
    run: MonteCarloResult,
) -> list[Finding]:
    first = item.first
    if first.faults:
        fault = first.faults[0]
        reason = f"{fault.text} (column {fault.column} of its equation)"
        return [finding("not-differentiable", output=first.name, reason=reason)]
    if first.u == 0.0:
        return [_without_u(item, inputs)]
    found = []
    tolerance = item.validation.tolerance / first.u
    # A single block has no control variate: of a linear equation, too, u is that of the trials.
    far = unsettled(first.tails, tolerance, run.trials, controlled=run.blocks > 1)
    if far:
        more = not unsettled(first.tails, tolerance, run.trials, controlled=True)
        named = [text for tail in far for text in names_of_source(sources[tail.source], inputs)]
        found.append(
            finding(
                "heavy-tails",
                outputs=[first.name],
                sources=named,
                reason=f"{listed(named)} with four degrees of freedom or fewer",
                remedy="take more trials" if more else "use the interval",
            )
        )
    return [*found, *_second_order(item)]


def _second_order(item: OutputBudget) -> list[Finding]:
    first = item.first
    shift, apart = abs(first.second_value - first.value), abs(first.second_u - first.u)
    if not max(shift, apart) > item.validation.tolerance > 0.0:
        return []
    known = math.isfinite(first.second_u)
    u = f"u {first.second_u:.4g}" if known else "the variance below 0, so that u is undefined"
    reason = "the equation is not linear over the uncertainties of its inputs"
    second = f"the value is {first.second_value:.10g} and {u}"
    return [finding("second-order", output=first.name, reason=reason, second=second, u=u)]


def _without_u(item: OutputBudget, inputs: Sequence[InputQuantity]) -> Finding:
    first = item.first
    if all(other.u == 0.0 for other in inputs):
        return finding("no-uncertainty", names=[f"the inputs of {first.name}"])
    cancel = any(c * other.u != 0.0 for c, other in zip(first.sensitivity, inputs, strict=True))
    why = "the contributions cancel" if cancel else "every sensitivity is 0 at the estimates"
    reason, second = f"the first-order u is 0 ({why})", f"u is {first.second_u:.4g}"
    return finding("second-order", output=first.name, reason=reason, second=second)


def _validation(item: OutputBudget, run: MonteCarloResult, index: int) -> list[Finding]:
    first, verdict = item.first, item.validation
    if math.isnan(first.u) or verdict.passed:
        return []
    if verdict.passed is None:
        return [finding("validation-undecided", names=[first.name])]
    unit = f" {item.unit}" if item.unit and item.unit != "1" else ""
    largest = float(np.max([verdict.d_low, verdict.d_high]))
    difference = f"up to {largest:.2g}{unit}"
    if first.u == 0.0 and largest <= ROUNDING * abs(first.value):
        # A step: the ends of its interval agree.
        difference = f"u 0 against {run.u[index]:.2g}{unit}"
    return [finding("validation-failed", names=[first.name], difference=difference)]
