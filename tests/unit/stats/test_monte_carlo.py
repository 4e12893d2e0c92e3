"""Monte Carlo against slow plain versions; reproducibility, counts, faults, memory."""

import threading
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtri, stdtrit
from trial_models import Bent, Other, ScaledT, Smooth, Z, plain_blocks, slow_end

from mtu_cli.findings import InputError
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, clause8, monte_carlo, single_block_estimates


def same_bits(a: MonteCarloResult, b: MonteCarloResult) -> bool:
    return all(
        np.array_equal(getattr(a, field.name), getattr(b, field.name))
        for field in fields(MonteCarloResult)
    )


@pytest.mark.parametrize("trials", [20_003, 98_304])
def test_plain_statistics_are_those_of_all_trials(trials: int) -> None:
    model = Bent(0.1, control=False)
    blocks, _ = plain_blocks(model, 5, trials)
    result = monte_carlo(model, seed=5, trials=trials)
    everything = np.concatenate(blocks)
    assert len(everything) == trials == result.trials
    assert result.mean[0] == pytest.approx(everything.mean(), rel=1e-12)
    assert result.u[0] == pytest.approx(everything.std(ddof=1), rel=1e-12)
    assert np.array_equal(result.samples[0], everything)
    # Blocks longer by a trial are read at the same probabilities: a second-order difference.
    near = 1e-12 if trials % len(blocks) == 0 else 1e-5
    assert result.low[0] == pytest.approx(np.mean([slow_end(b, 0.025) for b in blocks]), rel=near)
    assert result.high[0] == pytest.approx(np.mean([slow_end(b, 0.975) for b in blocks]), rel=near)
    ends = [slow_end(b, 0.025) for b in blocks]
    h = len(blocks)
    assert result.se_low[0] == pytest.approx(np.std(ends, ddof=1) / np.sqrt(h), rel=1e-4)
    assert result.se_mean[0] == pytest.approx(
        np.std([b.mean() for b in blocks], ddof=1) / np.sqrt(h), rel=1e-3
    )


def test_control_by_slopes_from_the_other_blocks() -> None:
    model = Bent(0.1)
    values, linear = plain_blocks(model, 11, 98_304)
    result = monte_carlo(model, seed=11, trials=98_304)
    pairs = {
        "mean": ([v.mean() for v in values], [w.mean() - 3.0 for w in linear]),
        "low": (
            [slow_end(v, 0.025) for v in values],
            [slow_end(w, 0.025) - (3.0 - 2.0 * Z) for w in linear],
        ),
    }
    for name, (statistic, control) in pairs.items():
        adjusted = []
        for i, (s, c) in enumerate(zip(statistic, control, strict=True)):
            slope = np.polyfit(np.delete(control, i), np.delete(statistic, i), 1)[0]
            adjusted.append(s - slope * c)
        variance = np.var(adjusted, ddof=1) / len(adjusted)
        assert getattr(result, name)[0] == pytest.approx(np.mean(adjusted), rel=1e-10)
        assert getattr(result, f"se_{name}")[0] == pytest.approx(np.sqrt(variance), rel=1e-6)


@pytest.mark.parametrize("quantile", [ndtri, np.log], ids=["normal", "exp"])
def test_ends_of_one_block_are_as_sure_as_stated(quantile: Callable[..., FloatArray]) -> None:
    """Two standard errors hold 95 % but for four standard deviations of a share of 2000 samples."""
    values = quantile(np.random.default_rng(9).random((2000, 1000)))
    found = single_block_estimates(values, 0.95, np.ones(2000, bool))
    for end, se, p in ((found.low, found.se_low, 0.025), (found.high, found.se_high, 0.975)):
        missed = np.abs(end - quantile(p)) > 2.0 * se
        assert abs(np.mean(missed) - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.parametrize("trials", [40, 41, 999, 19_999])
def test_one_block_by_7_7(trials: int) -> None:
    model = Bent(0.3, control=False)
    (sample,), _ = plain_blocks(model, 4, trials)
    ordered = sorted(sample)
    q = int(0.95 * trials + 0.5) if (95 * trials) % 100 else 95 * trials // 100
    r = (trials - q) // 2 if (trials - q) % 2 == 0 else (trials - q + 1) // 2
    result = monte_carlo(model, seed=4, trials=trials)
    assert result.blocks == 1
    assert (result.low[0], result.high[0]) == (ordered[r - 1], ordered[r + q - 1])
    widths = [ordered[j + q] - ordered[j] for j in range(trials - q)]
    best = widths.index(min(widths))
    assert (result.shortest_low[0], result.shortest_high[0]) == (ordered[best], ordered[best + q])
    assert result.u[0] == pytest.approx(np.std(sample, ddof=1), rel=1e-12)


@pytest.mark.parametrize("wrong", [{"trials": 39}, {"max_trials": 10}])
def test_settings_out_of_range(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        monte_carlo(Bent(), seed=1, **wrong)


@pytest.mark.parametrize("trials", [None, 1000, 60_001])
def test_same_bits_for_any_number_of_threads(trials: int | None) -> None:
    """Also of products of matrices, whose sums a library may split among threads."""
    mixing = np.random.default_rng(0).normal(size=(30, 26))
    many = Other(lambda rng, m: mixing @ rng.standard_normal((26, m)), tuple("y" * 30))
    for model in (Bent(0.1), many):
        # Of many outputs some 80 blocks, in several rounds.
        results = [
            monte_carlo(model, seed=9, trials=trials, threads=t, tolerance_fraction=2.0)
            for t in (1, 2, 4)
        ]
        assert all(same_bits(results[0], other) for other in results[1:])
    if trials is not None:
        of_samples = results[0].samples.std(axis=1, ddof=1)
        assert results[0].u == pytest.approx(of_samples, rel=1e-9)
    other = monte_carlo(many, seed=10, trials=trials, tolerance_fraction=2.0)
    assert not same_bits(results[0], other)


@pytest.mark.parametrize("trials", [40, 8193, 19_999, 20_001, 100_003])
def test_exactly_the_trials_asked_for(trials: int) -> None:
    drawn: list[int] = []
    lock = threading.Lock()

    def formula(rng: np.random.Generator, m: int) -> FloatArray:
        with lock:
            drawn.append(m)
        return rng.standard_normal((1, m))

    seen: list[tuple[int, int | None]] = []
    result = monte_carlo(
        Other(formula, ("y",)),
        seed=1,
        trials=trials,
        keep=500,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert sum(drawn) == result.trials == trials
    assert seen[-1] == (trials, trials)
    assert result.samples.shape == (1, min(500, trials))


# Monte Carlo: the adaptive count, clause 8, analytic results, its own standard uncertainty.


def test_largest_count_ends_an_adaptive_run() -> None:
    result = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=100_000)
    assert not result.converged
    assert 90_000 < result.trials <= 100_000
    small = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=5_000)
    assert not small.converged
    assert small.trials == 5_000


@pytest.mark.parametrize(("bad", "trials"), [(np.nan, 1000), (np.inf, 40_000), (np.nan, None)])
def test_values_that_are_not_finite_are_counted(bad: float, trials: int | None) -> None:
    def formula(rng: np.random.Generator, m: int) -> FloatArray:
        values = rng.standard_normal((2, m))
        values[1, :7] = bad
        return values

    with pytest.raises(InputError, match=r"'worse' has no finite value in 7 of") as raised:
        monte_carlo(Other(formula, ("good", "worse")), seed=1, trials=trials)
    assert "good" not in str(raised.value)


def test_clause8_takes_no_rounding_for_an_uncertainty() -> None:
    place, sure = np.array([3.0]), np.zeros(1)
    run = replace(monte_carlo(Bent(0.0), seed=1), low=place, high=place, se_low=sure, se_high=sure)
    assert clause8(3.0, 0.0, Z, replace(run, u=np.array([4e-16]))).passed is True
    assert clause8(3.0, 0.0, Z, replace(run, u=np.array([0.1]))).passed is False


def test_clause8_passes_fails_and_abstains() -> None:
    sure = monte_carlo(Bent(0.0), seed=1, tolerance_fraction=0.2)
    assert clause8(3.0, 2.0, Z, sure).passed is True
    wrong = clause8(3.2, 2.0, Z, sure)
    assert wrong.passed is False
    assert wrong.d_low == pytest.approx(0.2, abs=1e-6)
    assert wrong.tolerance == pytest.approx(0.05)
    unsure = monte_carlo(Bent(0.0, control=False), seed=1, trials=20_000)
    assert clause8(3.0, 2.0, Z, unsure).passed is None
    # So far off that even these few trials can tell.
    assert clause8(8.0, 2.0, Z, unsure).passed is False
    # What is far below the tolerance passes before its fifth is reached; a run goes on to that.
    short = monte_carlo(Bent(0.0, control=False), seed=1, trials=500_000)
    early = clause8(3.0, 2.0, Z, short)
    assert (early.passed, early.settled) == (True, False)
    # A difference within two standard errors of the tolerance is still open.
    near = early.tolerance - float(short.se_low[0])
    assert clause8(3.0 + near, 2.0, Z, short).passed is None


# Monte Carlo results against analytic ones; its own standard uncertainty.


@pytest.mark.parametrize("dof", [1.0, 2.0])
def test_without_a_standard_deviation_only_intervals(dof: float) -> None:
    result = monte_carlo(ScaledT(dof), seed=3)
    assert np.isnan(result.u[0])
    assert np.isnan(result.se_mean[0])
    assert result.converged
    assert result.high[0] == pytest.approx(stdtrit(dof, 0.975), abs=4 * result.se_high[0])
    few = monte_carlo(ScaledT(dof), seed=3, trials=1000)
    assert np.isnan(few.u[0])
    assert np.isfinite(few.high[0])


@pytest.mark.parametrize(
    ("model", "trials", "blocks", "of_se"),
    [
        # se^2 of ten blocks has 2/9 itself; a count that adapts has as many or more.
        (Smooth(0.05), 8_003, {10}, 2.0 / 9.0),
        (Smooth(0.05), None, None, 2.0 / 9.0),
        *((Bent(0.05, control), 2_000, {1}, 2.0 / 20.0) for control in (False, True)),
        *((Bent(0.05, control), 20_000, None, 2.0 / 8.0) for control in (False, True)),
    ],
)
def test_scatter_over_seeds_is_the_stated_one(
    model: Bent, trials: int | None, blocks: set[int] | None, of_se: float
) -> None:
    """Unbiased; mean squared error over mean se^2: chi-square with 200, less what se itself
    scatters.
    """
    seeds = 200
    results = [
        monte_carlo(model, seed=s, trials=trials, tolerance_fraction=0.5, threads=1)
        for s in range(seeds)
    ]
    assert blocks is None or {r.blocks for r in results} == blocks
    four_sigma = 4.0 * np.sqrt((2.0 + of_se) / seeds)
    for name, exact in model.exact.items():
        error = np.array([getattr(r, name)[0] for r in results]) - exact
        se = np.array([getattr(r, f"se_{name}")[0] for r in results])
        assert abs(np.mean(error**2) / np.mean(se**2) - 1.0) < four_sigma + 0.1, name
        assert abs(error.mean()) < 4.0 * np.sqrt(np.mean(se**2) / seeds) + 1e-12, name
