"""Ordered values of blocks against full sorts and exact sums; scratch arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from trial_models import Bent

from mtu_cli.stats.blocks import BlockPlan, BlockSummariser, Draws, weights_of
from mtu_cli.stats.least_squares import FloatArray


@pytest.mark.parametrize("m", [2000, 4096, 8192])
def test_weights_remove_the_bias_of_ordered_values(m: int) -> None:
    """Exponential: E y_(j) from above = sum of 1/i for i = j to m, exactly; Q = -ln a."""
    plan = BlockPlan(0.95, m, None)
    weights, (middle,) = weights_of(plan, m), np.flatnonzero(np.isclose(plan.shares, 0.025))
    expected = np.cumsum(1.0 / np.arange(m, 0, -1))[::-1][: weights.tail]
    left = (weights(expected) + np.log(plan.shares))[middle]
    ranks = np.arange(1, weights.tail + 1)
    uncorrected = np.interp(0.025 * (m + 1), ranks, expected) + np.log(0.025)
    assert abs(left) < 0.05 * abs(uncorrected)


@pytest.mark.parametrize("m", [200, 201, 1000, 8192])
@pytest.mark.parametrize("f", [np.exp, np.round, np.zeros_like])
def test_quantiles_are_those_of_a_full_sort(f: Callable[[FloatArray], FloatArray], m: int) -> None:
    """Of skew values, of few values, of equal ones; a block too short for two tails is sorted."""
    block = f(np.random.default_rng(1).standard_normal((1, m)))
    before = block.copy()
    plan = BlockPlan(0.5 if m == 201 else 0.95, m, None)
    found = BlockSummariser(Bent(control=False), plan).summarise(Draws(values=block), 1).statistics
    ordered, weights = np.sort(block[0]), weights_of(plan, m)
    lower, upper = np.split(found[0, 2:, 0], 2)
    assert lower == pytest.approx(weights(ordered), rel=1e-12, abs=1e-12)
    assert upper == pytest.approx(weights(ordered[::-1]), rel=1e-12, abs=1e-12)
    assert np.array_equal(block, before)


@pytest.mark.parametrize("control", [False, True])
def test_blocks_that_are_drawn_at_once_count_as_each_by_itself(control: bool) -> None:
    model, m, h = Bent(0.1, control), 500, 6
    draws = model.draw(np.random.default_rng(2), h * m)
    summariser = BlockSummariser(model, BlockPlan(0.95, m, h))
    found, squares = summariser.summarise(draws, h), 0.0
    for i in range(h):
        values, linear = (
            None if x is None else x[:, i * m : (i + 1) * m] for x in (draws.values, draws.linear)
        )
        assert values is not None
        own = summariser.summarise(Draws(values=values, linear=linear), 1)
        assert found.statistics[i] == pytest.approx(own.statistics[0], rel=1e-12, abs=1e-12)
        assert found.controls[i] == pytest.approx(own.controls[0], rel=1e-12, abs=1e-12)
        squares += float(own.squares[0, 0])
    assert found.squares[0, 0] == pytest.approx(squares)
    assert bool(found.controls.any()) == control


def test_quantiles_of_equal_values_are_that_value_to_the_bit() -> None:
    plan = BlockPlan(0.95, 2000, None)
    found = BlockSummariser(Bent(control=False), plan).summarise(
        Draws(values=np.full((1, 6000), 0.1)), 3
    )
    assert np.unique(found.statistics[:, 2:]).tolist() == [0.1]
