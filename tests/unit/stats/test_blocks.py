"""Ordered values of blocks, quantiles of mixtures, scratch arrays."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr, stdtr
from trial_models import Bent, Z

from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.blocks import BlockSummariser
from mtu_cli.stats.mixture_quantile import mixture_quantile
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]


@pytest.mark.parametrize("m", [2000, 4096, 8192])
def test_end_weights_remove_the_bias_of_ordered_values(m: int) -> None:
    """Exponential: E y_(j) from above = sum of 1/i for i = j to m, exactly; Q = -ln a."""
    plan = BlockPlan(0.95, m, None)
    expected = np.cumsum(1.0 / np.arange(m, 0, -1))[::-1][: plan.tail]
    left = expected @ plan.end_weights + np.log(0.025)
    uncorrected = np.interp(0.025 * (m + 1), np.arange(1, plan.tail + 1), expected) + np.log(0.025)
    assert abs(left) < 0.05 * abs(uncorrected)


def test_ends_of_many_short_blocks_are_unbiased() -> None:
    model = Bent(control=False)
    plan = BlockPlan(0.95, 2000, 1000)
    summariser = BlockSummariser(model, plan)
    rng = np.random.default_rng(0)
    ends = [summariser.summarise(model.draw(rng, 2000)).statistics[2:, 0] for _ in range(1000)]
    error = np.mean(ends, axis=0) - np.array([model.exact["low"], model.exact["high"]])
    assert np.all(np.abs(error) < 4 * np.std(ends, axis=0) / np.sqrt(1000))


def test_a_longer_block_is_read_at_the_same_probabilities() -> None:
    plan = BlockPlan(0.95, 2000, 10, 5)
    longer = np.arange(1, 2002) / 2002.0
    on_grid = plan.on_grid(longer[np.newaxis, : plan.tail + 1], 2001)
    assert on_grid[0] == pytest.approx(np.arange(1, plan.tail + 1) / 2001.0, rel=1e-12)


@pytest.mark.parametrize("dof", [1.0, 2.0, 4.0, 50.0])
@pytest.mark.parametrize("probability", [0.0005, 0.025, 0.25, 0.45])
def test_mixture_quantile_solves_its_equation(dof: float, probability: float) -> None:
    rng = np.random.default_rng(1)
    scales = np.sqrt(dof / rng.chisquare(dof, (3, 8192)))
    q = mixture_quantile(scales, probability)
    reached = ndtr(q[:, np.newaxis] / scales).mean(axis=1)
    assert reached == pytest.approx(np.full(3, probability), rel=1e-6)
    spread = np.std(ndtr(q[0] / scales[0])) / np.sqrt(8192)
    assert stdtr(dof, q[0]) == pytest.approx(probability, abs=5 * spread)


def test_mixture_quantile_of_one_scale() -> None:
    q = mixture_quantile(np.array([[2.0] * 8, [0.0] * 8]), 0.025)
    assert q[0] == pytest.approx(-2.0 * Z, rel=1e-12)
    assert q[1] == 0.0


def test_workspace_reuses_arrays_and_keeps_threads_apart() -> None:
    work = Workspace()
    first = work.array("z", (2, 8))
    assert work.array("z", (2, 8)) is first
    assert work.array("z", (2, 9)) is not first
    seen: list[FloatArray] = []
    thread = threading.Thread(target=lambda: seen.append(work.array("z", (2, 9))))
    thread.start()
    thread.join()
    assert seen[0] is not work.array("z", (2, 9))
