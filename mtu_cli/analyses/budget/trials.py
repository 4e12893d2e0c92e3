"""The trials of a budget: JCGM 101:2008, 6 and 7, and JCGM 102:2011 for several outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.budget.first_order import FirstOrder
from mtu_cli.analyses.budget.inputs import ROUNDING, Inputs, Source
from mtu_cli.language import Node, evaluate, names
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution, bounded_quantile, t_scales
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.linear_distribution import Quantile, sum_quantile
from mtu_cli.stats.workspace import Workspace


class BudgetTrials:
    """A Monte Carlo model: m draws of all inputs a block, and the outputs of the equations.

    The control variate is the first-order form, of which the engine knows the mean and, where all
    sources are independent, the variance exactly: of an equation that is linear, u is then free of
    chance. Where its distribution is known too (see `sum_quantile`) so are its quantiles, which
    serve the ends of the interval. Where it is not `controlled`, as a single block cannot be, the
    form is left out.
    """

    def __init__(
        self,
        trees: dict[str, Node],
        inputs: Inputs,
        first: Sequence[FirstOrder],
        controlled: bool = True,
    ) -> None:
        self.names = tuple(trees)
        self.trees, self.inputs, self.work = trees, inputs, Workspace()
        self.value = np.array([item.value for item in inputs.quantities])[:, None]
        short = {item.name for item in inputs.quantities if item.without_u}
        self.u_exists = np.array([short.isdisjoint(names(tree)) for tree in trees.values()])
        # A form that does not exist is a constant, which controls nothing.
        slopes = np.array([item.sensitivity for item in first])
        self.gradient = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
        self.offset = np.array([item.value for item in first])
        self.linear_mean: FloatArray | None = self.offset if controlled else None
        # What cancels leaves a scatter that is none and would never converge.
        self.rounding = ROUNDING * (np.abs(self.gradient) @ inputs.u)
        still = ROUNDING * (np.abs(self.gradient) @ np.abs(self.value[:, 0]) + np.abs(self.offset))
        self.rounding = np.maximum(self.rounding, np.where([x.u == 0.0 for x in first], still, 0.0))
        if controlled:
            # Where the variance overflows the trials do, too, which stops them.
            with np.errstate(over="ignore", invalid="ignore"):
                known = [self._control(g) for g in self.gradient]
            self.linear_variance = np.array([variance for variance, _ in known])
            self._quantiles = [quantile for _, quantile in known]

    def _control(self, g: FloatArray) -> tuple[float, Quantile | None]:
        """Variance and quantiles of a first-order form with gradient `g`, as far as known."""
        # Inputs that cancel to first order still scatter where each has a scale of its own.
        counted = [
            source
            for source in self.inputs.sources
            if source.variance(g) > 0.0
            or (source.factor is not None and not source.is_t and np.any(g[source.rows]))
        ]
        variance = math.fsum(source.drawn_variance(g) for source in counted)
        terms = []
        for source in counted:
            if source.factor is None:
                terms.append((float(g[source.rows[0]]), source.members[0]))
            elif source.is_t:
                u, dof = math.sqrt(source.variance(g)), source.members[0].dof
                terms.append((1.0, Distribution(kind="normal", u=u, dof=dof)))
            else:
                return variance, None
        return variance, sum_quantile(terms)

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
            if np.all(np.abs(values[k] - self.offset[k]) <= self.rounding[k]):
                values[k] = self.offset[k]
        if self.linear_mean is None:
            return Draws(values=values)
        linear = np.matmul(self.gradient, deviation, out=self.work.array("linear", values.shape))
        linear += self.offset[:, None]
        return Draws(values=values, linear=linear)

    def _add(self, source: Source, rng: np.random.Generator, deviation: FloatArray) -> None:
        """Draws a source and adds it to the `deviation` (n, m) of its inputs."""
        drawn = self.work.array("drawn", deviation.shape[1:])
        if source.factor is None:
            source.members[0].draw(rng, drawn, self.work)
            deviation[source.rows[0]] += drawn
            return
        joint = source.factor @ rng.standard_normal((source.factor.shape[1], len(drawn)))
        if source.is_t:
            if source.members[0].dof < NORMAL_DOF:
                joint *= t_scales(source.members[0].dof, rng, drawn)
        else:
            for row, item in zip(joint, source.members, strict=True):
                _marginal(item, row, rng, drawn)
        deviation[source.rows] += joint


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
