"""The graph as a Monte Carlo model: blocks of trials, one transition at a time."""

from __future__ import annotations

import numpy as np

from mtu_cli.model.graph.first_order import FirstOrder
from mtu_cli.model.graph.measurement_graph import LARGEST, Evaluation
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.workspace import Workspace

KEPT_BYTES = 16 << 20


def keep_freed_memory() -> None:
    """Makes the C library keep what the constructions of a block free, for those of the next.

    glibc gives memory back to the system beyond twice the largest block that it has seen freed
    (mallopt(3), M_MMAP_THRESHOLD), and every page of it costs a fault when it is asked for again:
    a third of the time. One large block, freed and never touched, moves that bound.
    """
    np.empty(KEPT_BYTES, dtype=np.uint8)


class GraphTrials:
    """m simulation cycles a block: every place of a cycle from one draw of the inputs.

    The first-order form c.x of the outputs is drawn along and serves as control variate: of the
    whole distribution where all inputs are normal, of the mean and u where some are not.
    """

    def __init__(self, evaluation: Evaluation, linear: FirstOrder) -> None:
        self.evaluation = evaluation
        self.names = tuple(str(item) for item in evaluation.outputs)
        self.linear_mean = linear.nominal
        self.linear_variance = linear.u**2
        self._u = linear.u[:, None] if evaluation.inputs.normal else None
        self._gradient = linear.gradient @ evaluation.inputs.factor
        self._work = Workspace()
        keep_freed_memory()

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
        return Draws(values=values, linear=linear, linear_u=self._u)
