"""Which of two sets of columns scatters more: false alarms, power, oracles, edges."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.scatter_ratio import Side, familywise, scatter_ratio

RUNS = 1000


def drawn(rng: np.random.Generator, rows: int, columns: int, rho: float) -> FloatArray:
    """Rows of variance 1 with correlation rho between the columns."""
    common = rng.standard_normal((rows, 1))
    own = rng.standard_normal((rows, columns))
    values: FloatArray = np.sqrt(rho) * common + np.sqrt(1 - rho) * own
    return values


def bare(values: FloatArray) -> Side:
    return Side(values=values, noise=np.zeros(len(values)))


def repeated(rng: np.random.Generator, values: FloatArray, s: float, repeats: int = 2) -> Side:
    """Means of repeated measurements, with the share of their scatter as estimated."""
    rows, columns = values.shape
    seen = values[..., None] + s * rng.standard_normal((rows, columns, repeats))
    s2 = seen.var(axis=2, ddof=1).mean(axis=0)
    share = (rows - 1) / repeats * s2
    u2 = 2 * share**2 / (rows * (repeats - 1))
    noise = np.full(rows, share.sum() / rows)
    return Side(values=seen.mean(axis=2), noise=noise, u2=float(u2.sum()))


@pytest.mark.parametrize(("rows", "columns"), [(9, 3), (21, 5), (21, 24)])
@pytest.mark.parametrize("rho", [(0.0, 0.0), (0.0, 0.9), (0.9, 0.9)])
def test_false_alarms_with_correlations_of_their_own(
    rows: int, columns: int, rho: tuple[float, float]
) -> None:
    alarms = 0
    for seed in range(RUNS):
        rng = np.random.default_rng([seed, rows])
        sides = [bare(drawn(rng, rows, columns, r)) for r in rho]
        alarms += scatter_ratio(*sides).p <= 0.05
    assert alarms / RUNS <= 0.065
    assert alarms / RUNS >= 0.02


@pytest.mark.parametrize(("rows", "columns"), [(9, 3), (21, 5), (21, 24)])
@pytest.mark.parametrize("rho", [(0.5, 0.5), (0.0, 0.9), (0.9, 0.0)])
def test_a_noisier_measurement_is_no_scatter(
    rows: int, columns: int, rho: tuple[float, float]
) -> None:
    """CMM s of 0.5 and 1.0 beside equal parts."""
    alarms = 0
    for seed in range(RUNS):
        rng = np.random.default_rng([seed, rows, 1])
        sides = [
            repeated(rng, drawn(rng, rows, columns, r), s)
            for r, s in zip(rho, (0.5, 1.0), strict=True)
        ]
        alarms += scatter_ratio(*sides).p <= 0.05
    assert alarms / RUNS <= 0.065


def test_parts_without_scatter_of_their_own() -> None:
    """What is left of either side is chance: the difference of the noises is added instead."""
    alarms = 0
    for seed in range(300):
        rng = np.random.default_rng([seed, 2])
        sides = [repeated(rng, np.zeros((21, 6)), s) for s in (0.5, 1.0)]
        alarms += scatter_ratio(*sides).p <= 0.05
    assert alarms / 300 <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 300)


def test_a_scatter_twice_as_large_is_found() -> None:
    found = []
    for seed in range(100):
        rng = np.random.default_rng([seed, 3])
        sides = [repeated(rng, size * drawn(rng, 21, 5, 0.3), 0.3) for size in (1.0, 2.0)]
        found.append(scatter_ratio(*sides))
    assert sum(test.p <= 0.05 for test in found) >= 95
    assert np.median([test.ratio for test in found]) == pytest.approx(4, rel=0.15)


def test_jackknife_by_leaving_out() -> None:
    """Slowly: each row left out, the columns' means taken anew; t quantile by bisection of scipy's
    own distribution function.
    """
    from scipy.stats import t as student

    rng = np.random.default_rng(4)
    a, b = drawn(rng, 8, 3, 0.2), 1.7 * drawn(rng, 8, 3, 0.7)

    def log_ratio(kept: list[int]) -> float:
        squares = [((v[kept] - v[kept].mean(axis=0)) ** 2).sum() for v in (a, b)]
        return float(np.log(squares[1] / squares[0]))

    left = np.array([log_ratio([i for i in range(8) if i != out]) for out in range(8)])
    u = np.sqrt(7 / 8 * ((left - left.mean()) ** 2).sum())
    theta = log_ratio(list(range(8)))
    found = scatter_ratio(bare(a), bare(b))
    assert found.p == pytest.approx(2 * student.sf(abs(theta) / u, 6), rel=1e-9)
    assert found.ratio == pytest.approx(np.exp(theta), rel=1e-12)
    turned = scatter_ratio(bare(b), bare(a))
    assert turned.p == pytest.approx(found.p, rel=1e-9)


def test_missing_entries_and_nothing_that_scatters() -> None:
    rng = np.random.default_rng(5)
    a, b = drawn(rng, 9, 3, 0.0), drawn(rng, 9, 3, 0.0)
    a[2, 1] = b[2, 1] = np.nan
    assert 0 < scatter_ratio(bare(a), bare(b)).p <= 1
    still = bare(np.ones((9, 3)))
    assert np.isnan([scatter_ratio(still, still).p, scatter_ratio(still, still).ratio]).all()
    # Nine rows that all say the same: a sign test.
    one_sided = scatter_ratio(still, bare(b))
    assert np.isnan(one_sided.ratio)
    assert one_sided.p == pytest.approx(2**-8)
    assert scatter_ratio(bare(b), still).ratio == 0
    with pytest.raises(ValueError, match="3 and 3 rows"):
        scatter_ratio(bare(a[:3]), bare(b[:3]))


def test_familywise_is_holm() -> None:
    rng = np.random.default_rng(6)
    tests = [
        scatter_ratio(bare(drawn(rng, 21, 5, 0.0)), bare(size * drawn(rng, 21, 5, 0.0)))
        for size in (1.0, 1.5)
    ]
    low, high = sorted(tests, key=lambda test: test.p)
    found = {test.p: test.p_familywise for test in familywise(tests)}
    assert found[low.p] == min(2 * low.p, 1.0)
    assert found[high.p] == max(high.p, found[low.p])
