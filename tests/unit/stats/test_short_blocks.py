"""Few trials of a smooth model: unbiased, honest about their scatter, and never too sure."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from trial_models import COPIES, Bent, Copies, Grown, Smooth, Twice, Z

from mtu_cli.stats.block_plan import FIRST_LOOK, LEAST_BLOCKS, BlockPlan, trials_for_tails
from mtu_cli.stats.blocks import Draws, block_generator
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo
from mtu_cli.stats.short_blocks import SURE_GAIN, error_factors
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]
NAMES = ("mean", "u", "low", "high")
LONGEST_SHORT = 19_999
"""One trial more makes ten blocks, for 95 %, that are no longer short."""


@cache
def student(blocks: int) -> float:
    return float(stats.t.ppf(0.975, blocks - 1) / stats.norm.ppf(0.975))


def added(result: MonteCarloResult, name: str) -> FloatArray:
    """What a standard error is stated larger by beyond the scatter: t for few short blocks.

    And for an end that runs as a square again for the skew of its scatter, 1.1 + 1/h.
    """
    gain, h = getattr(result.gain, name), result.blocks
    if result.trials > LONGEST_SHORT:
        return np.ones(len(gain))
    more = student(h) * ((1.1 + 1.0 / h) if name in ("low", "high") else 1.0)
    return np.where(gain == 1.0, 1.0, more)


@pytest.mark.parametrize("trials", [2000, 5003, None])
@pytest.mark.parametrize("model", [Smooth(0.003), Smooth(0.05), Grown(0.01), Grown(0.5)])
def test_scatter_over_seeds_is_the_stated_one(model: Smooth | Grown, trials: int | None) -> None:
    """Mean squared error over mean se^2: chi-square with 200; se^2 from ten blocks or more
    scatters by 2/9 itself.
    """
    copies, runs = Copies(model), 200 // COPIES
    results = [
        monte_carlo(copies, seed=s, trials=trials, tolerance_fraction=0.5, threads=1)
        for s in range(runs)
    ]
    samples = runs * COPIES
    four_sigma = 4.0 * np.sqrt((2.0 + 2.0 / 9.0) / samples)
    for name, exact in copies.exact.items():
        error = np.array([getattr(r, name) for r in results]) - exact
        se = np.array([getattr(r, f"se_{name}") / added(r, name) for r in results])
        assert abs(np.mean(error**2) / np.mean(se**2) - 1.0) < four_sigma, name
        assert abs(error.mean()) < 4.0 * np.sqrt(np.mean(se**2) / samples), name


@pytest.mark.parametrize("trials", [2000, 4000])
def test_twice_the_standard_error_holds_the_error_nineteen_times_in_twenty(trials: int) -> None:
    """Ends of a gain of hundreds and one of 5, u of one of 6: sometimes from the whole sample.

    Of all runs and of those alone that took the control: four standard deviations of a share.
    """
    seeds = 800
    model = Twice()
    results = [monte_carlo(model, seed=s, trials=trials, threads=1) for s in range(seeds)]
    for name, exact in model.exact.items():
        error = np.array([getattr(r, name) for r in results]) - exact
        se = np.array([getattr(r, f"se_{name}") for r in results])
        missed = np.abs(error) > 2.0 * se
        taken = np.array([getattr(r.gain, name) for r in results]) > 1.0
        for own, where in zip(missed.T, taken.T, strict=True):
            for some in (own, own[where]):
                four_sigma = 4.0 * np.sqrt(0.05 * 0.95 / len(some))
                assert abs(np.mean(some) - 0.05) < four_sigma, (name, len(some))


@pytest.mark.parametrize("trials", [2000, 2003])
def test_the_gain_that_decides_is_that_of_other_blocks(trials: int) -> None:
    """Every tenth trial in one, each with the slope of the others: as stated, and not by chance."""
    model, h = Smooth(0.05), 10
    plan = BlockPlan.short(trials, 0.95)
    draws = [model.draw(block_generator(8, b), plan.trials_in(b)).copy() for b in range(h)]
    y = np.concatenate([item.values[0] for item in draws])
    x = np.concatenate([item.linear[0] for item in draws if item.linear is not None])
    result = monte_carlo(model, seed=8, trials=trials)
    for name, statistic, expected in (("mean", np.mean, 3.0), ("u", slow_variance, 4.0)):
        s, c = (np.array([statistic(a[i::h]) for i in range(h)]) for a in (y, x))
        c -= expected
        slopes = [np.polyfit(np.delete(c, i), np.delete(s, i), 1)[0] for i in range(h)]
        wanted = np.var(s, ddof=1) / np.var(s - slopes * c, ddof=1)
        found = getattr(result.gain, name)[0]
        assert found == pytest.approx(wanted if wanted >= SURE_GAIN else 1.0, rel=1e-6)


def slow_variance(sample: FloatArray) -> float:
    return float(np.var(sample, ddof=1))


def test_factors_are_those_of_students_distribution() -> None:
    """To the last of the four digits that tables print of t, and of z."""
    for blocks in range(LEAST_BLOCKS, FIRST_LOOK + 1):
        found = error_factors(blocks)
        wanted = stats.t.ppf(0.975, blocks - 1) / stats.norm.ppf(0.975)
        assert found["mean"] == found["u"] == pytest.approx(wanted, rel=0.0005 / 2 + 0.0005 / 1.96)
        end = np.sqrt(1.0 + 2.0 / blocks) * (1.1 + 1.0 / blocks)
        assert found["low"] == found["high"] == pytest.approx(found["u"] * end)


@pytest.mark.parametrize("probability", [0.5, 0.9, 0.95, 0.99])
def test_there_is_a_factor_for_every_plan_of_short_blocks(probability: float) -> None:
    least = trials_for_tails(probability)
    for trials in (least, least + 1, 3 * least // 2, 2 * least, 9 * least):
        blocks = BlockPlan.short(trials, probability).blocks
        assert blocks is not None
        assert error_factors(blocks)["u"] > 1.0
        assert LEAST_BLOCKS <= blocks <= FIRST_LOOK


def test_few_trials_of_a_nearly_linear_output_are_as_good_as_many() -> None:
    few = monte_carlo(Smooth(0.001), seed=1, trials=2000)
    assert (few.blocks, few.trials) == (10, 2000)
    assert all(gain[0] > 1000.0 for gain in few.gain)
    for name, exact in Smooth(0.001).exact.items():
        assert getattr(few, name)[0] == pytest.approx(exact, abs=2e-3)
    for name, exact in (("shortest_low", 3.0 - 2.0 * Z), ("shortest_high", 3.0 + 2.0 * Z)):
        # The ends of the shortest interval are told less surely than its width: it is flat.
        assert getattr(few, name)[0] == pytest.approx(exact, abs=0.15)
    width = few.shortest_high[0] - few.shortest_low[0]
    assert width == pytest.approx(4.0 * Z, abs=0.02)


def test_without_use_of_the_control_the_whole_sample_counts() -> None:
    """JCGM 101:2008, 7.6 and 7.7 to the letter, as for any model of few trials."""

    class Unrelated(Bent):
        smooth = True

        def draw(self, rng: np.random.Generator, m: int) -> Draws:
            return Draws(
                values=rng.standard_normal((1, m)),
                linear=3.0 + 2.0 * rng.standard_normal((1, m)),
                linear_u=np.array([[2.0]]),
            )

    result = monte_carlo(Unrelated(), seed=2, trials=2000)
    ordered = np.sort(result.samples[0])
    assert len(ordered) == 2000
    assert all(gain[0] == 1.0 for gain in result.gain)
    assert (result.low[0], result.high[0]) == (ordered[49], ordered[1949])
    assert result.mean[0] == pytest.approx(ordered.mean(), rel=1e-12, abs=1e-15)
    assert result.u[0] == pytest.approx(ordered.std(ddof=1), rel=1e-12)
    assert result.covariance[0, 0] == pytest.approx(result.u[0] ** 2, rel=1e-12)
    assert result.se_mean[0] == pytest.approx(result.u[0] / np.sqrt(2000), rel=1e-12)


def test_a_gain_that_may_be_chance_is_not_taken() -> None:
    for seed in range(30):
        result = monte_carlo(Smooth(0.2), seed=seed, trials=2000)
        assert all(gain[0] == 1.0 or gain[0] >= SURE_GAIN for gain in result.gain)


def test_an_adaptive_count_stops_early_only_where_all_is_controlled() -> None:
    straight = monte_carlo(Smooth(0.003), seed=3, tolerance_fraction=0.2)
    assert (straight.trials, straight.converged) == (4000, True)
    bent = monte_carlo(Smooth(0.1), seed=3, tolerance_fraction=0.2)
    assert bent.trials >= 40_960
    assert bent.converged
    plain = monte_carlo(Bent(0.01), seed=3, tolerance_fraction=0.2)
    assert plain.trials >= 40_960


def test_values_that_many_trials_share_are_not_judged_by_few() -> None:
    """Smooth only by its word: rare steps are not controlled, so the count goes on."""

    class Steps(Bent):
        smooth = True

        def draw(self, rng: np.random.Generator, m: int) -> Draws:
            linear = 3.0 + 2.0 * rng.standard_normal((1, m))
            return Draws(values=np.round(linear), linear=linear, linear_u=np.array([[2.0]]))

    result = monte_carlo(Steps(), seed=4)
    assert result.trials >= 40_960
    assert (result.low[0], result.high[0]) == (-1.0, 7.0)


def test_kept_samples_and_progress() -> None:
    seen: list[tuple[int, int | None]] = []
    adaptive = monte_carlo(
        Smooth(0.003), seed=5, keep=100, progress=lambda done, total: seen.append((done, total))
    )
    assert adaptive.samples.shape == (1, 100)
    assert seen == [(4000, None)]
    fixed = monte_carlo(Smooth(0.01), seed=5, trials=3000, keep=100)
    assert fixed.samples.shape == (1, 100)
    assert fixed.trials == 3000


@pytest.mark.parametrize("trials", [2000, 2001, 3999, 4000, 19_999])
@pytest.mark.parametrize("probability", [0.9, 0.95, 0.99])
def test_short_blocks_have_five_trials_a_tail(trials: int, probability: float) -> None:
    plan = BlockPlan.fixed(trials, probability, smooth=True)
    if trials < 100 / (1 - probability) - 1e-6:
        assert plan.blocks == 1
        return
    assert plan.blocks is not None
    assert plan.blocks >= 10
    assert plan.size * plan.blocks + plan.longer == trials
    assert plan.size * (1 - probability) / 2 > 5 - 1e-6 or not plan.is_short


def test_the_same_bits_for_any_number_of_threads() -> None:
    for trials in (None, 2000, 19_999):
        one, two = (
            monte_carlo(Smooth(0.003), seed=6, trials=trials, threads=t, tolerance_fraction=0.2)
            for t in (1, 2)
        )
        for name in (*NAMES, "shortest_low", "shortest_high", "samples"):
            assert np.array_equal(getattr(one, name), getattr(two, name))


def test_long_blocks_for_models_that_draw_in_pieces() -> None:
    for trials in (20_000, 300_000, 1_000_000, 10_000_003):
        plan = BlockPlan.fixed(trials, 0.95, in_pieces=True)
        plain = BlockPlan.fixed(trials, 0.95)
        assert plan.blocks is not None
        assert plain.blocks is not None
        assert plan.size * plan.blocks + plan.longer == trials
        assert min(30, plain.blocks) <= plan.blocks <= plain.blocks


def test_a_smaller_shape_takes_the_memory_there_is() -> None:
    work = Workspace()
    large = work.array("z", (3, 100))
    small = work.array("z", (3, 7))
    assert small.flags.c_contiguous
    assert np.shares_memory(large, small)
    assert work.array("z", (3, 7)) is small
    assert not np.shares_memory(large, work.array("z", (4, 100)))
