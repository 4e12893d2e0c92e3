"""The result of a budget, and what its user should know beside the figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.budget.first_order import FirstOrder, unsettled
from mtu_cli.analyses.budget.inputs import InputQuantity, Inputs, Source
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.features import NO_U
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult
from mtu_cli.stats.validation import Validation

SHORTEST = 1.05
"""More than its own scatter may make the shortest interval longer than the symmetric one."""
NO_WEAKER = 0.9995
"""A factor of a correlation that shows as 1."""
ROUNDING = 1e-9
"""Share of a value below which ends of an interval agree."""
FEW, MANY = 0.2, 10_000
"""Share of u that its standard error is where a few of many trials make it: that of normal ones is
1/sqrt(2 M)."""
Interval = tuple[float, float]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetResult:
    """A budget: what is `given`, its inputs with their sources, and its `outputs`.

    `covariance`, `correlation` (outputs, outputs): of the outputs, to first order (JCGM
    102:2011, 6.2: C V C'). `probability`: of the intervals; where a factor k is given, that of
    a normal distribution at k. `run`: one Monte Carlo for all outputs; `converged`: to the digits
    asked for.
    """

    name: str
    single: bool
    given: Inputs
    outputs: tuple[OutputBudget, ...]
    covariance: FloatArray
    correlation: FloatArray
    probability: float
    run: MonteCarloResult
    converged: bool
    warnings: tuple[Finding, ...] = ()

    @property
    def inputs(self) -> tuple[InputQuantity, ...]:
        """The inputs in the order of the file."""
        return self.given.quantities

    @property
    def input_correlation(self) -> FloatArray:
        """Their correlation coefficients (n, n), 0 of exact ones."""
        return np.nan_to_num(correlation_of(self.given.covariance))


def budget_warnings(loaded: LoadedBudget, result: BudgetResult) -> tuple[Finding, ...]:
    """All warnings of a budget, those of the file first."""
    inputs, outputs, run = result.given, result.outputs, result.run
    found = [*loaded.warnings, *_of_inputs(inputs)]
    for item in outputs:
        found += [*_of_first_order(item, inputs), *_of_validation(item)]
    beyond = [item.k for item in outputs if item.k > item.k_probability]
    if beyond and run.probability >= LARGEST_PROBABILITY:
        percent = 100 * run.probability
        found.append(finding("coverage-beyond-check", k=max(beyond), percent=percent))
    found += _of_trials(outputs, run)
    if not result.converged:
        goal = "the digits of u asked for (JCGM 101, 7.9.4)"
        found.append(finding("not-converged", trials=run.trials, goal=goal))
    return tuple(dict.fromkeys(found))


def _of_trials(outputs: Sequence[OutputBudget], run: MonteCarloResult) -> list[Finding]:
    """Outputs with trials so far out that their squares or fourth powers are beyond numbers."""
    far, of_few = [], []
    for item in outputs:
        u, se = item.of_run("u"), item.of_run("se_u")
        if math.isinf(u) or (math.isfinite(u) and not math.isfinite(se)):
            far.append(item.first.name)
        if FEW * u < se < math.inf and run.trials >= MANY:
            of_few.append(item.first.name)
    too_far = "the trials are too far apart"
    found = [
        finding("heavy-tails", outputs=named, reason=reason, remedy="use the interval")
        for named, reason in (
            (far, "its trials are too far apart for a standard error"),
            (of_few, "a few trials far out make it, as of a ratio whose divisor may be 0"),
        )
        if named
    ]
    if named := [item.first.name for item in outputs if not item.has_shortest]:
        quantity = "the shortest interval"
        found.append(finding("not-estimable", quantity=quantity, names=named, reason=too_far))
    return found


def _of_inputs(inputs: Inputs) -> list[Finding]:
    found = []
    short = [
        part.label(item.name) if len(item.parts) > 1 else item.name
        for item in inputs.quantities
        for part in item.parts
        if not part.distribution.bounded and part.distribution.dof <= 2
    ]
    if short:
        found.append(finding("few-degrees-of-freedom", names=short, how=NO_U))
    for source in inputs.sources:
        names = [inputs.quantities[row].name for row in source.rows]
        weaker, assumed = _weaker(source, names), []
        if source.how == "copula":
            assumed.append(("all normal", "the Monte Carlo takes a Gaussian copula", weaker))
        if source.how != "alone" and not source.common_dof:
            smallest = "Welch-Satterthwaite takes the smallest for all of them"
            said = weaker if source.how == "normal" else ""
            assumed.append(("of the same degrees of freedom", smallest, said))
        found += [
            finding("correlated-inputs", names=names, how=how, assumed=what, weaker=said)
            for how, what, said in assumed
        ]
    return found


def _weaker(source: Source, names: Sequence[str]) -> str:
    """Which coefficients of what is drawn differ from those stated, and by how much: the random
    scale of an input of finite degrees of freedom makes its coefficients smaller.
    """
    shares = [item.correlated_share for item in source.members]
    members = list(zip(names, shares, strict=True))
    times = [f"{name} {share:.3g}" for name, share in members if share < NO_WEAKER]
    none = [name for name, share in members if math.isnan(share)]
    text = ""
    if times:
        text = (
            "; the trials have smaller coefficients, the stated one times the factors of both "
            f"inputs ({listed(times)}; 1 for others)"
        )
    return text + (f"; {listed(none)} have no coefficient" if none else "")


def _of_first_order(item: OutputBudget, inputs: Inputs) -> list[Finding]:
    first, run = item.first, item.run
    if first.faults:
        fault = first.faults[0]
        reason = f"{fault.text} (column {fault.column} of its equation)"
        return [finding("not-differentiable", output=first.name, reason=reason)]
    if first.u == 0.0:
        return _without_u(item, inputs)
    found = []
    tolerance = item.validation.tolerance / first.u
    # A single block has no control variate: of a linear equation, too, u is that of the trials.
    far = unsettled(first.tails, tolerance, run.trials, controlled=run.blocks > 1)
    if far:
        more = not unsettled(first.tails, tolerance, run.trials, controlled=True)
        named = [text for tail in far for text in _names(inputs.sources[tail.source], inputs)]
        found.append(
            finding(
                "heavy-tails",
                outputs=[first.name],
                sources=named,
                reason=f"{listed(named)} with four degrees of freedom or fewer",
                remedy="take more trials" if more else "use the interval",
            )
        )
    shift, apart = abs(first.second_value - first.value), abs(first.second_u - first.u)
    if max(shift, apart) > item.validation.tolerance > 0.0:
        known = math.isfinite(first.second_u)
        u = f"u {first.second_u:.4g}" if known else "the variance below 0, so that u is undefined"
        reason = "the equation is not linear over the uncertainties of its inputs"
        second = f"the value is {first.second_value:.10g} and {u}"
        found.append(finding("second-order", output=first.name, reason=reason, second=second, u=u))
    return found


def _names(source: Source, inputs: Inputs) -> list[str]:
    """What is drawn together by the names of its inputs; one of several contributions to an input
    by its own place in the file, too.
    """
    named = []
    for row, member in zip(source.rows, source.members, strict=True):
        item = inputs.quantities[row]
        part = next((part for part in item.parts if part.distribution is member), None)
        several = part is not None and len(item.parts) > 1
        named.append(part.label(item.name) if part is not None and several else item.name)
    return named


def _without_u(item: OutputBudget, inputs: Inputs) -> list[Finding]:
    first, u = item.first, inputs.u
    if np.all(u == 0.0):
        return [finding("no-uncertainty", names=[f"the inputs of {first.name}"])]
    cancel = np.any(first.sensitivity * u != 0.0)
    if first.second_u == 0.0 and item.of_run("u") == 0.0 and not cancel:
        # Nothing of it varies, as of (3 x)/x.
        return []
    why = "the contributions cancel" if cancel else "every sensitivity is 0 at the estimates"
    reason, second = f"the first-order u is 0 ({why})", f"u is {first.second_u:.4g}"
    return [finding("second-order", output=first.name, reason=reason, second=second)]


def _of_validation(item: OutputBudget) -> list[Finding]:
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
        difference = f"u 0 against {item.of_run('u'):.2g}{unit}"
    return [finding("validation-failed", names=[first.name], difference=difference)]
