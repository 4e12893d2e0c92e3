"""Ordered values of blocks against full sorts and exact sums; scratch arrays."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from trial_models import Bent

from mtu_cli.stats.blocks import BlockPlan, BlockSummariser, Draws
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


@pytest.mark.parametrize("probability", [0.5, 0.95])
def test_expected_ordered_values(probability: float) -> None:
    """Exponential, as above, from the lowest of -x up: to the second order in 1/m."""
    plan = BlockPlan(probability, 8192, None)
    found = plan.expected_ordered(np.log)
    exact = -np.cumsum(1.0 / np.arange(8192, 0, -1))[::-1][: plan.tail]
    j = np.arange(1, plan.tail + 1)
    assert np.all(np.abs(found - exact) < 0.1 / j**2 + 0.002 / j)


def test_long_blocks_for_models_that_draw_in_pieces() -> None:
    for trials in (20_000, 300_000, 1_000_000, 10_000_003):
        plan = BlockPlan.fixed(trials, 0.95, in_pieces=True)
        plain = BlockPlan.fixed(trials, 0.95)
        assert plan.blocks is not None
        assert plain.blocks is not None
        assert plan.size * plan.blocks + plan.longer == trials
        assert min(30, plain.blocks) <= plan.blocks <= plain.blocks


@pytest.mark.parametrize("m", [200, 201, 1000, 8192])
@pytest.mark.parametrize("f", [np.exp, np.round, np.zeros_like])
def test_tails_are_those_of_a_full_sort(f: Callable[[FloatArray], FloatArray], m: int) -> None:
    """Of skew values, of few values, of equal ones; a block too short for two tails is sorted."""
    block = f(np.random.default_rng(1).standard_normal((1, m)))
    before = block.copy()
    plan = BlockPlan(0.5 if m == 201 else 0.95, m, None)
    lower, upper = BlockSummariser(Bent(control=False), plan).summarise(Draws(values=block)).tails
    ordered = np.sort(block, axis=1)
    assert np.array_equal(lower, ordered[:, : plan.tail])
    assert np.array_equal(upper, ordered[:, ::-1][:, : plan.tail])
    assert np.array_equal(block, before)


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


def test_a_smaller_shape_takes_the_memory_there_is() -> None:
    work = Workspace()
    large = work.array("z", (3, 100))
    small = work.array("z", (3, 7))
    assert small.flags.c_contiguous
    assert np.shares_memory(large, small)
    assert work.array("z", (3, 7)) is small
    assert not np.shares_memory(large, work.array("z", (4, 100)))
