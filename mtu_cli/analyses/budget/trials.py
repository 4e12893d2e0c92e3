"""The trials of a budget: JCGM 101:2008, 6 and 7, and JCGM 102:2011 for several outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.budget.first_order import NO_U, FirstOrder
from mtu_cli.analyses.budget.inputs import ROUNDING, Inputs, Source
from mtu_cli.language import Node, evaluate, names
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution, bounded_quantile, t_scales
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.linear_distribution import Quantile, Term, sum_quantile
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.workspace import Workspace

SCALED = (
    "mean", "u", "low", "high", "shortest_low", "shortest_high", "se_mean", "se_u", "se_low",
    "se_high",
)  # fmt: skip
"""Fields of a run in the unit of the output."""


class BudgetTrials:
    """A Monte Carlo model: m draws of all inputs a block, and the outputs of the equations.

    The control variate is the first-order form, of which the engine knows the mean and, where all
    sources are independent, the variance exactly: of an equation that is linear, u is then free of
    chance. Where its distribution is known too (see `sum_quantile`) so are its quantiles, which
    serve the ends of the interval. Every output is
    divided by its `scale` (outputs,), lest its square overflow or vanish; `in_full` undoes it.
    Where it is not `controlled`, as a single block cannot be, the form is left out.
    """

    def __init__(
        self,
        trees: dict[str, Node],
        inputs: Inputs,
        first: Sequence[FirstOrder],
        controlled: bool = True,
    ) -> None:
        self.names = tuple(trees)
        self.trees = trees
        self.inputs = inputs
        self.work = Workspace()
        self.value = np.array([item.value for item in inputs.quantities])[:, None]
        short = {item.name for item in inputs.quantities if item.least_dof <= NO_U}
        self.u_exists = np.array([short.isdisjoint(names(tree)) for tree in trees.values()])
        # A form that does not exist is a constant, which controls nothing.
        self.scale = np.array([item.scale for item in first])
        slopes = np.array([item.sensitivity / item.scale for item in first])
        self.gradient = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
        self.offset = np.array([item.value for item in first]) / self.scale
        self.linear_mean: FloatArray | None = self.offset if controlled else None
        # What cancels, of inputs or in an equation, leaves a scatter that is none and would never
        # converge.
        self.rounding = ROUNDING * (np.abs(self.gradient) @ inputs.u)
        still = np.array([item.rounding if item.u == 0.0 else 0.0 for item in first]) / self.scale
        self.rounding = np.maximum(self.rounding, still)
        if controlled:
            self._control()

    def _control(self) -> None:
        """What the engine may know of the first-order form."""
        variances: list[float] = []
        self._quantiles: list[Quantile | None] = []
        for g in self.gradient:
            # Inputs that cancel to first order still scatter where each has a scale of its own.
            counted = [
                source
                for source in self.inputs.sources
                if source.variance(g) > 0.0
                or (np.any(g[list(source.rows)]) and not source.is_simple)
            ]
            variances.append(math.fsum(source.drawn_variance(g) for source in counted))
            terms = [_term(source, g) for source in counted]
            known = [term for term in terms if term is not None]
            self._quantiles.append(sum_quantile(known) if len(known) == len(terms) else None)
        self.linear_variance = np.array(variances)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        """Those (outputs, n) of the first-order forms less their mean, nan where unknown."""
        unknown = np.full(probability.shape, np.nan)
        return np.array([unknown if q is None else q(probability) for q in self._quantiles])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and, where it controls, first-order values (outputs, m)."""
        deviation = self.work.array("deviation", (len(self.value), m))
        deviation[:] = 0.0
        for source in self.inputs.sources:
            self._add(source, rng, deviation)
        x = np.add(deviation, self.value, out=self.work.array("x", deviation.shape))
        drawn = {item.name: x[i] for i, item in enumerate(self.inputs.quantities)}
        values = self.work.array("values", (len(self.names), m))
        for k, tree in enumerate(self.trees.values()):
            values[k] = evaluate(tree, drawn)
            if self.scale[k] != 1.0:
                values[k] /= self.scale[k]
            if np.all(np.abs(values[k] - self.offset[k]) <= self.rounding[k]):
                values[k] = self.offset[k]
        if self.linear_mean is None:
            return Draws(values=values)
        linear = self.work.array("linear", values.shape)
        np.matmul(self.gradient, deviation, out=linear)
        linear += self.offset[:, None]
        return Draws(values=values, linear=linear)

    def in_full(self, run: MonteCarloResult) -> MonteCarloResult:
        """A run's outputs in their own units again."""
        if np.all(self.scale == 1.0):
            return run
        with np.errstate(over="ignore", under="ignore"):
            scaled = {name: getattr(run, name) * self.scale for name in SCALED}
            covariance = run.covariance * self.scale * self.scale[:, None]
            samples = run.samples * self.scale[:, None]
        return replace(run, covariance=covariance, samples=samples, **scaled)

    def _add(self, source: Source, rng: np.random.Generator, deviation: FloatArray) -> None:
        m = deviation.shape[1]
        if source.how == "alone":
            drawn = self.work.array("drawn", (m,))
            source.members[0].draw(rng, drawn, self.work)
            deviation[source.rows[0]] += drawn
            return
        joint = source.factor @ rng.standard_normal((source.factor.shape[1], m))
        scale = self.work.array("scale", (m,))
        if source.how == "normal" and source.common_dof:
            if source.members[0].dof < NORMAL_DOF:
                joint *= t_scales(source.members[0].dof, rng, scale)
        else:
            for row, item in zip(joint, source.members, strict=True):
                _marginal(item, row, rng, scale)
        deviation[list(source.rows)] += joint


def _marginal(
    item: Distribution, row: FloatArray, rng: np.random.Generator, scale: FloatArray
) -> None:
    """Turns `row`, normal with standard deviation u or (bounded) 1, into draws of `item`."""
    if not item.bounded:
        if item.dof < NORMAL_DOF:
            row *= t_scales(item.dof, rng, scale)
        return
    from scipy.special import ndtr

    row[:] = bounded_quantile(item, ndtr(row))
    if item.inexact > 0.0:
        row *= 1.0 + item.inexact * (2.0 * rng.random(row.shape) - 1.0)


def _term(source: Source, gradient: FloatArray) -> Term | None:
    """A source's part of a first-order form; None where its distribution is unknown."""
    if source.how == "alone":
        return float(gradient[source.rows[0]]), source.members[0]
    if not (source.is_t or source.is_normal):
        return None
    dof = source.members[0].dof if source.is_t else math.inf
    u = math.sqrt(source.variance(gradient))
    return 1.0, Distribution(kind="normal", u=u, dof=dof)
