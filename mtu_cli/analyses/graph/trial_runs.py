"""The Monte Carlo runs of simulate and sweep: which outputs vary, and to which tolerance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtu_cli.language.tree import Call, walk
from mtu_cli.model.graph.first_order import FirstOrder, first_order
from mtu_cli.model.graph.inputs import noises
from mtu_cli.model.graph.measurement_graph import Evaluation, MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.graph.trials import GraphTrials
from mtu_cli.model.settings import PROBABILITY, Settings
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo
from mtu_cli.stats.streams import stream

PILOT = 4096
"""Trials that tell which outputs follow their first-order form."""
LINEAR = 0.5
"""Share of u that the first-order u must have for the adaptive count to wait for clause 8."""
ROUNDING = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
DRAWN = 2**16
"""Trials kept for the histogram."""


def survey(
    graph: MeasurementGraph, whole: Evaluation, linear: FirstOrder, seed: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which outputs (n,) do not vary, and which hardly follow their first-order form.

    What goes through a step may vary in so few trials that a pilot sees none of them: it counts
    as varying, whatever the pilot says.
    """
    model = GraphTrials(whole, linear)
    u = model.draw(stream(seed, 1), PILOT).values.std(axis=1)
    jumps = np.array([_may_jump(graph, item) for item in whole.outputs], dtype=bool)
    fixed = (u <= ROUNDING * whole.sizes) & (linear.u == 0.0) & ~jumps
    return fixed, ~fixed & ~((linear.u >= LINEAR * u) & (linear.u > 0.0))


def _may_jump(graph: MeasurementGraph, output: Output) -> bool:
    """Whether a random input reaches the output through the equation language's step."""
    start, steps = graph.needed([output])
    return bool(noises(graph.graph, start)) and any(
        isinstance(node, Call) and node.function == "step"
        for item in steps
        if item.step.formula is not None
        for node in walk(item.step.formula)
    )


def run_trials(
    graph: MeasurementGraph, outputs: Sequence[Output], settings: Settings, *, bent: bool
) -> MonteCarloResult:
    """The trials of some outputs.

    An adaptive count of outputs that hardly follow a first-order form (`bent`: a direction
    cosine near 1, a distance near 0) goes on to the tolerance of JCGM 101:2008, 7.9.4 itself, of
    others to the fifth of it that clause 8 wants: it has nothing to compare there, and no control
    variate helps.
    """
    part = evaluation(graph, outputs)
    model = GraphTrials(part, first_order(part))
    if not bent or settings.trials is not None:
        return settings.run(model, keep=DRAWN)
    return monte_carlo(
        model,
        seed=settings.seed,
        probability=PROBABILITY,
        digits=settings.digits,
        threads=settings.threads,
        keep=DRAWN,
        progress=settings.progress,
    )
