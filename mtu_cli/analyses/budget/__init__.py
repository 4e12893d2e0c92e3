"""An uncertainty budget: propagation to first and second order (JCGM 100:2008, 5.1.2 and 5.2), and
by Monte Carlo (JCGM 101:2008, 6 and 7).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.special import ndtr

from mtu_cli.analyses.budget.inputs import ROUNDING, InputQuantity, Inputs, inputs_of
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node, evaluate, names, to_text
from mtu_cli.language.derivative import PLACE, Derivatives, derivatives, taylor
from mtu_cli.model.settings import MOST_TRIALS, Settings, validation_warnings
from mtu_cli.stats.blocks import Draws, Workspace
from mtu_cli.stats.covariance import correlation_of, factor_of
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor, welch_satterthwaite
from mtu_cli.stats.distributions import (
    NORMAL_DOF,
    Distribution,
    Quantile,
    bounded_quantile,
    sum_quantile,
    t_scales,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import LARGEST_PROBABILITY, MonteCarloResult, Validation, validated

DRAWN = 2**17
"""Trials kept for the histogram."""
SHORTEST = 1.05
"""By its scatter the shortest interval may be longer than the symmetric one by this factor."""
EQUAL = 1e-9
"""Share of a value below which ends of an interval agree."""
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class FirstOrder:
    """One output: `value` y, `sensitivity` c (n,), `contribution` |c| u (n,), `u`, effective
    degrees of freedom `dof`.

    `share` (n,): c_i u_i sum_j r_ij c_j u_j / u^2, sums to 1; below 0 where a correlation
    makes u smaller. `second_value`, `second_u`: to the second order. nan where a derivative
    does not exist; `faults` says at which functions.
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
    faults: tuple[Finding, ...]


def first_order(loaded: LoadedBudget, inputs: Inputs) -> tuple[FirstOrder, ...]:
    """Every output of the budget.

    Raises InputError where an equation has no finite value at the estimates.
    """
    outputs, problems = [], []
    values = {item.name: item.value for item in inputs.quantities}
    for name, tree in loaded.trees.items():
        # Inputs without uncertainty are constants; an equation has few of the others.
        variables = names(tree)
        rows = [i for i, x in enumerate(inputs.quantities) if x.u > 0.0 and x.name in variables]
        slopes = derivatives(tree, values, [inputs.quantities[i].name for i in rows])
        if not math.isfinite(slopes.value):
            what, at = "the equation", " at the estimates of its inputs"
            unknown = finding("no-finite-value", what=what, where=at)
            problems.append((*slopes.faults, unknown)[0].at(**loaded.where(name)))
            continue
        g = np.zeros(len(inputs.quantities))
        g[rows] = slopes.first
        # What overflows is inf or nan, and no uncertainty to the first order then exists.
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            # Summed by sources, so that a variance of 0 is 0 and not rounding.
            variances = [source.variance(g) for source in inputs.sources]
            variance, dof = math.fsum(variances), math.nan
            if math.isfinite(variance):
                dofs = [source.dof(g) for source in inputs.sources]
                dof = float(welch_satterthwaite(np.array(variances), np.array(dofs)))
            shift, increase = _second_order(tree, slopes, inputs, rows)
            contribution, joint = np.abs(g) * inputs.u, g * (inputs.covariance @ g)
            share = joint / variance if variance > 0.0 else np.full(len(g), math.nan)
        output = FirstOrder(
            name=name,
            value=slopes.value,
            sensitivity=g,
            contribution=contribution,
            u=math.sqrt(variance),
            dof=dof,
            share=share,
            second_value=slopes.value + shift,
            second_u=math.sqrt(variance + increase) if variance + increase >= 0.0 else math.nan,
            faults=slopes.faults,
        )
        outputs.append(output)
    if problems:
        raise InputError(problems)
    return tuple(outputs)


def _second_order(
    tree: Node, slopes: Derivatives, inputs: Inputs, rows: Sequence[int]
) -> tuple[float, float]:
    """What the second order adds to the value and to the variance.

    Of jointly normal inputs of covariance V, gradient g, Hessian H: tr(HV)/2, and tr(HVHV)/2 +
    sum_j (Vg)_j d/dx_j tr(HV), which of independent ones are the terms of JCGM 100:2008, 5.1.2,
    note. An input of fourth cumulant kappa adds f_ii^2 kappa/4 + f_i f_iii kappa/3: x^2 at 0 has
    u = 0.89 u^2(x) for a rectangle, not 1.41.
    """
    members = [inputs.quantities[i] for i in rows]
    g, H, V = slopes.first, slopes.second, inputs.covariance[np.ix_(rows, rows)]
    HV = H @ V
    u = np.array([item.u for item in members])
    kappa = np.array([item.excess for item in members])
    # Products of small numbers with large ones, in an order in which neither leaves the range.
    second, third = np.diag(H) * u * u, slopes.third * u * u * u
    fourth = float(np.sum(kappa * (second**2 / 4.0 + g * u * third / 3.0)))
    increase = 0.5 * float(np.sum(HV * HV.T)) + fourth
    Vg = V @ g
    if not np.all(np.isfinite(Vg)):
        return 0.5 * float(np.trace(HV)), math.nan
    if np.any(Vg):
        # The derivative of tr(HV) along Vg: V = F F', so that it is a sum over the columns of F.
        F = factor_of(V)
        vectors = np.stack([np.repeat(Vg[:, None], F.shape[1], axis=1), F])
        values = {item.name: item.value for item in inputs.quantities}
        directions = {item.name: vectors[:, i] for i, item in enumerate(members)}
        coefficients, _ = taylor(tree, values, directions.get, F.shape[1])
        increase += 2.0 * float(np.sum(coefficients[PLACE[1, 2]]))
    return 0.5 * float(np.trace(HV)), increase


class BudgetTrials:
    """A Monte Carlo model: m draws of all inputs a block, and the outputs of the equations.

    The control variate is the first-order form, of which the engine knows the mean and, where all
    sources are independent, the variance exactly: of an equation that is linear, u is then free of
    chance. Where its distribution is known too (see `sum_quantile`) so are its quantiles, which
    serve the ends of the interval.
    """

    def __init__(self, trees: dict[str, Node], inputs: Inputs, first: Sequence[FirstOrder]) -> None:
        self.names = tuple(trees)
        self.trees, self.inputs, self.work = trees, inputs, Workspace()
        self.value = np.array([item.value for item in inputs.quantities])[:, None]
        short = {item.name for item in inputs.quantities if item.without_u}
        self.u_exists = np.array([short.isdisjoint(names(tree)) for tree in trees.values()])
        # A form that does not exist is a constant, which controls nothing.
        slopes = np.array([item.sensitivity for item in first])
        self.gradient = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
        self.linear_mean = np.array([item.value for item in first])
        # Rounding of what cancels would never converge.
        size = np.abs(self.gradient) @ np.abs(self.value[:, 0]) + np.abs(self.linear_mean)
        size[[item.u != 0.0 for item in first]] = 0.0
        self.rounding = ROUNDING * np.maximum(np.abs(self.gradient) @ inputs.u, size)
        # Where the variance overflows the trials do, too, which stops them.
        with np.errstate(over="ignore", invalid="ignore"):
            controls = [self._control(g) for g in self.gradient]
        self.linear_variance = np.array([variance for variance, _ in controls])
        self._quantiles = [quantile for _, quantile in controls]

    def _control(self, g: FloatArray) -> tuple[float, Quantile | None]:
        """Variance and quantiles of a first-order form with gradient `g`; nan and None where inputs
        are correlated that are not jointly t.
        """
        terms = []
        for source in self.inputs.sources:
            u2, item = source.variance(g), source.members[0]
            if source.factor is not None and not source.is_t and np.any(g[source.rows]):
                return math.nan, None
            if u2 > 0.0 and source.factor is None:
                terms.append((float(g[source.rows[0]]), item))
            elif u2 > 0.0:
                terms.append((1.0, Distribution(kind="normal", u=math.sqrt(u2), dof=item.dof)))
        return math.fsum(c * c * item.drawn_variance for c, item in terms), sum_quantile(terms)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        """Those (outputs, n) of the first-order forms less their mean, nan where unknown."""
        unknown = np.full(probability.shape, np.nan)
        return np.array([unknown if q is None else q(probability) for q in self._quantiles])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        deviation = self.work.array("deviation", (len(self.value), m))
        deviation[:] = 0.0
        draws = self.work.array("drawn", (m,))
        for source in self.inputs.sources:
            if source.factor is None:
                source.members[0].draw(rng, draws, self.work)
                deviation[source.rows[0]] += draws
                continue
            joint = source.factor @ rng.standard_normal((source.factor.shape[1], m))
            if not source.is_t:
                # Rows are normal, of standard deviation u or (bounded) 1, and become what is drawn.
                for row, item in zip(joint, source.members, strict=True):
                    if item.bounded:
                        row[:] = bounded_quantile(item, ndtr(row))
                        if item.inexact > 0.0:
                            row *= 1.0 + item.inexact * (2.0 * rng.random(row.shape) - 1.0)
                    elif item.dof < NORMAL_DOF:
                        row *= t_scales(item.dof, rng, draws)
            elif source.members[0].dof < NORMAL_DOF:
                joint *= t_scales(source.members[0].dof, rng, draws)
            deviation[source.rows] += joint
        x = np.add(deviation, self.value, out=self.work.array("x", deviation.shape))
        of_name = {item.name: x[i] for i, item in enumerate(self.inputs.quantities)}
        values = self.work.array("values", (len(self.names), m))
        for k, tree in enumerate(self.trees.values()):
            values[k] = evaluate(tree, of_name)
            if np.all(np.abs(values[k] - self.linear_mean[k]) <= self.rounding[k]):
                values[k] = self.linear_mean[k]
        linear = np.matmul(self.gradient, deviation, out=self.work.array("linear", values.shape))
        linear += self.linear_mean[:, None]
        return Draws(values=values, linear=linear)


@dataclass(frozen=True, kw_only=True)
class OutputBudget(FirstOrder):
    """One output: first order, its expanded uncertainty U = k u, and clause 8's verdict on it by
    the trials, row `index` of a `run`.

    `k_probability`: the factor for the coverage probability at the output's effective degrees
    of freedom; k itself is that, unless a factor is given.
    """

    unit: str
    equation: str
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
        if verdict.passed is False and self.u == 0.0 and largest <= EQUAL * abs(self.value):
            # A step: the ends of its interval agree.
            difference = f"u 0 against {u_trials:.2g} {unit}".rstrip()
            yield finding("validation-failed", names=[self.name], difference=difference)
        else:
            yield from validation_warnings([self.name], [verdict], unit, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetResult:
    """A budget: what is `given`, its inputs with their sources, and its `outputs`.

    `run`: one Monte Carlo for all outputs, of intervals for `probability`: where a factor k is
    given, that of a normal distribution at k.
    """

    name: str
    single: bool
    given: Inputs
    outputs: tuple[OutputBudget, ...]
    run: MonteCarloResult

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
        """Those of the inputs first."""
        result = [*self.given.findings()]
        for item in self.outputs:
            result += item.findings(self.given.u)
        if not self.run.converged:
            goal = "the digits of u asked for (JCGM 101, 7.9.4)"
            result.append(finding("not-converged", trials=self.run.trials, goal=goal))
        return tuple(dict.fromkeys(result))


def evaluate_budget(
    loaded: LoadedBudget, settings: Settings, k: float | None = None
) -> BudgetResult:
    """Evaluates a budget; the coverage factor `k` wins over the file's coverage.

    Raises InputError for correlations that no inputs can have, an equation without a finite
    value at the estimates or in some trials, a factor so small that it covers nothing.
    """
    inputs = inputs_of(loaded)
    first = first_order(loaded, inputs)
    k = loaded.budget.coverage.k if k is None else k
    stated = loaded.budget.coverage.probability
    probability = PROBABILITY if stated is None else stated
    if k is not None:
        # Of a normal distribution; what a short t covers at k is another matter.
        probability = min(math.erf(k / math.sqrt(2.0)), LARGEST_PROBABILITY)
    trials = BudgetTrials(loaded.trees, inputs, first)
    factors = [
        math.nan if math.isnan(x.dof) else coverage_factor(probability, x.dof) for x in first
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
            equation=to_text(loaded.trees[item.name]),
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
    )
