"""A checked graph on any number of trials at once: to first order, and as a Monte Carlo model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import InputError, finding, listed
from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.model.graph.places import Inputs, Output, noises, read
from mtu_cli.model.graph.transitions import Computed
from mtu_cli.stats.blocks import Draws, Quantiles
from mtu_cli.stats.coverage import t_quantile
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace

LARGEST = 1e150
"""Beyond it the square of a value is not finite."""
ROUNDING = 256 * float(np.finfo(np.float64).eps)
"""Share of the largest coordinate below which a difference is rounding, not a derivative."""
KEPT_BYTES = 16 << 20


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What stands behind some outputs, and nothing else, as a function of the random inputs."""

    graph: MeasurementGraph
    outputs: tuple[Output, ...]
    inputs: Inputs
    steps: tuple[Computed, ...]

    @property
    def jumps(self) -> NDArray[np.bool_]:
        """Outputs (n,) that a random input reaches through the equation language's step."""
        found = []
        for item in self.outputs:
            start, steps = self.graph.needed([item])
            found.append(
                bool(noises(self.graph.graph, start)) and any(x.step.may_jump for x in steps)
            )
        return np.array(found, dtype=bool)

    @property
    def sizes(self) -> FloatArray:
        """What the rounding of each output (n,) is a share of: the part's largest coordinate for
        a length, 1 for an angle or a ratio.
        """
        part = float(np.max(np.abs(self.inputs.mean), initial=1.0))
        return np.array([1.0 if item.unit in ("1", "rad") else part for item in self.outputs])

    def run(self, X: FloatArray, into: FloatArray | None = None) -> FloatArray:
        """Outputs (n, m) for inputs X (k, m)."""
        values = self.inputs.values(X)
        for step in self.steps:
            step.run(values)
        return read(values, self.outputs, self.graph.nominal, into)

    def raise_not_finite(self, X: FloatArray) -> None:
        """Raises InputError for the first transition that has no finite value at all inputs X."""
        values = self.inputs.values(X)
        for item in self.steps:
            with np.errstate(all="ignore"):
                item.run(values)
            made = [values[name].reshape(-1, X.shape[1]) for name in item.step.outputs]
            bad = np.any(~(np.abs(np.concatenate(made)) < LARGEST), axis=0)
            if not np.any(bad):
                continue
            what = f"{item.step.do} of {listed(item.step.outputs)}"
            where = (
                f" below {LARGEST:g} in {np.count_nonzero(bad)} of {len(bad)} Monte Carlo trials"
            )
            where += item.why_not_finite(values, int(np.argmax(bad)))
            expected = "a step that is defined for all values its inputs may take: bounded "
            expected += "distributions or smaller uncertainties where it needs them"
            fault = finding("no-finite-value", what=what, where=where, expected=expected)
            raise InputError([fault.at(**self.graph.place_of(item.step.index))])


def evaluation(graph: MeasurementGraph, outputs: Sequence[Output]) -> Evaluation:
    """The part of the graph that some outputs need."""
    start, steps = graph.needed(outputs)
    inputs = Inputs(graph.graph, start)
    return Evaluation(graph=graph, outputs=tuple(outputs), inputs=inputs, steps=steps)


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """n outputs, k inputs. `nominal` (n,), `gradient` (n, k) with respect to the inputs, `u` (n,)
    standard uncertainties, `shares` (n,) of the variance of each output by source: c C_s c' of the
    covariance C_s that the source has over c C c', nan where that is 0 (JCGM 100:2008, 5.1.2, and
    5.2.2 for correlated inputs); `by_place`: by the place where they come in.
    """

    nominal: FloatArray
    gradient: FloatArray
    u: FloatArray
    shares: dict[str, FloatArray]
    by_place: dict[str, FloatArray]


def first_order(evaluation: Evaluation) -> FirstOrder:
    """Central differences over one standard uncertainty of each input, all in one batch.

    (f(x + u_i e_i) - f(x - u_i e_i)) / (2 u_i), as JCGM 100:2008, 5.1.3, note 2, allows: exact
    for what is of second order in the inputs; it differs from the derivative by what is of third
    order in u over the dimensions of the part. Where one of both has no finite value it is 0, and
    the trials tell whether the output has one.
    """
    inputs = evaluation.inputs
    k = inputs.k
    X = np.repeat(inputs.mean[:, None], 2 * k + 1, axis=1)
    X[np.arange(k), 1 + np.arange(k)] += inputs.u
    X[np.arange(k), 1 + k + np.arange(k)] -= inputs.u
    with np.errstate(all="ignore"):
        values = evaluation.run(X)
        half = 0.5 * (values[:, 1 : k + 1] - values[:, k + 1 :])
    change = np.where(np.isfinite(half), half, 0.0)
    nominal = values[:, 0]
    floor = ROUNDING * np.maximum(np.abs(nominal), evaluation.sizes)
    change[np.abs(change) <= floor[:, None]] = 0.0
    gradient = np.divide(change, inputs.u, out=np.zeros_like(change), where=inputs.u > 0)
    by_source: dict[str, FloatArray] = {}
    by_place: dict[str, FloatArray] = {}
    with np.errstate(over="ignore", invalid="ignore"):
        variance = np.sum((gradient @ inputs.factor) ** 2, axis=1)
        total = np.where(variance > 0, variance, np.nan)
        for item, rows in zip(inputs.noises, inputs.rows, strict=True):
            c = gradient[:, rows]
            for source, covariance in item.sources:
                part = np.einsum("ni,ij,nj->n", c, covariance, c) / total
                by_source[source] = by_source.get(source, 0.0) + part
                name = source if source in item.places else item.places[0]
                by_place[name] = by_place.get(name, 0.0) + part
    return FirstOrder(
        nominal=nominal,
        gradient=gradient,
        u=np.sqrt(variance),
        shares=by_source,
        by_place=by_place,
    )


class GraphTrials:
    """m simulation cycles a block: every place of a cycle from one draw of the inputs.

    The first-order form c.x of the outputs is drawn along and serves as control variate: of the
    whole distribution where all inputs are normal, of the mean and u where some are not. Of what
    jumps it is nil: the mean of 0 and 1 is the share of 1.
    """

    def __init__(self, evaluation: Evaluation, linear: FirstOrder) -> None:
        self.evaluation = evaluation
        self.names = tuple(str(item) for item in evaluation.outputs)
        self.linear_mean = linear.nominal
        smooth = ~evaluation.jumps
        self.linear_variance = (linear.u * smooth) ** 2
        u = (linear.u * smooth)[:, None]
        self.linear_quantiles: Quantiles | None = None
        if evaluation.inputs.normal:
            self.linear_quantiles = lambda p: u * t_quantile(p, np.inf)
        self._gradient = (linear.gradient * smooth[:, None]) @ evaluation.inputs.factor
        self._work = Workspace()
        # glibc gives memory back to the system beyond twice the largest block that it has seen
        # freed (mallopt(3), M_MMAP_THRESHOLD), and every page of it costs a fault when it is asked
        # for again: a third of the time. One large block, freed and never touched, moves that
        # bound, and what the constructions of a block free is there for those of the next.
        np.empty(KEPT_BYTES, dtype=np.uint8)

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m).

        Raises InputError for the first transition behind them that has no finite value.
        """
        n = len(self.names)
        z = self.evaluation.inputs.draw(rng, m, self._work)
        linear = np.matmul(self._gradient, z, out=self._work.array("linear", (n, m)))
        linear += self.linear_mean[:, None]
        X = self.evaluation.inputs.scaled(z)
        with np.errstate(all="ignore"):
            values = self.evaluation.run(X, self._work.array("values", (n, m)))
        # What is not a number compares as neither.
        if not (values.max() < LARGEST and values.min() > -LARGEST):
            self.evaluation.raise_not_finite(X)
        return Draws(values=values, linear=linear)
