"""Which of two sets of columns scatters more: false alarms, power, oracles, edges."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from scipy.stats import binom

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.scatter_ratio import (
    CLEAR,
    Side,
    familywise,
    ratio_interval,
    scatter_ratio,
    untested,
)

RUNS = 1000


def drawn(rng: np.random.Generator, rows: int, columns: int, rho: float, *runs: int) -> FloatArray:
    """Rows of variance 1 with correlation rho between the columns, in tables (*runs,)."""
    common = rng.standard_normal((*runs, rows, 1))
    own = rng.standard_normal((*runs, rows, columns))
    values: FloatArray = np.sqrt(rho) * common + np.sqrt(1 - rho) * own
    return values


def bare(values: FloatArray) -> Side:
    return Side(values=values, noise=np.zeros(len(values)))


def repeated(rng: np.random.Generator, values: FloatArray, s: float, repeats: int = 2) -> Side:
    """Means of repeated measurements, with the share of their scatter as estimated."""
    (side,) = repeated_runs(rng, values[None], s, repeats)
    return side


def repeated_runs(
    rng: np.random.Generator, values: FloatArray, s: float, repeats: int = 2
) -> list[Side]:
    """Of every table of `values` (runs, rows, columns)."""
    rows = values.shape[1]
    seen = values[..., None] + s * rng.standard_normal((*values.shape, repeats))
    means = seen.mean(axis=3)
    s2 = ((seen - means[..., None]) ** 2).sum(axis=3).mean(axis=1) / (repeats - 1)
    share = (rows - 1) / repeats * s2
    u2 = (2 * share**2 / (rows * (repeats - 1))).sum(axis=1)
    noise = np.repeat(share.sum(axis=1, keepdims=True) / rows, rows, axis=1)
    return [
        Side(values=own, noise=part, u2=float(u))
        for own, part, u in zip(means, noise, u2, strict=True)
    ]


def alarms_of(sides: Iterable[tuple[Side, Side]]) -> int:
    return sum(scatter_ratio(*two).p <= 0.05 for two in sides)


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
    rng = np.random.default_rng([rows, columns, 1])
    sides = (
        repeated_runs(rng, drawn(rng, rows, columns, r, RUNS), s)
        for r, s in zip(rho, (0.5, 1.0), strict=True)
    )
    alarms = alarms_of(zip(*sides, strict=True))
    assert alarms / RUNS <= 0.065


@pytest.mark.parametrize(
    ("rows", "columns", "rho", "s"),
    [
        (10, 4, (0.9, 0.9), (1.0, 1.0)),
        (24, 10, (1.0, 1.0), (0.7, 1.5)),
        (21, 24, (0.0, 1.0), (1, 1)),
    ],
)
def test_equal_scatter_has_the_nominal_rate(
    rows: int, columns: int, rho: tuple[float, float], s: tuple[float, float]
) -> None:
    rng = np.random.default_rng([rows, columns, 7])
    sides = (
        repeated_runs(rng, drawn(rng, rows, columns, r, RUNS), u, 3)
        for r, u in zip(rho, s, strict=True)
    )
    alarms = alarms_of(zip(*sides, strict=True))
    assert binom.ppf(1e-3, RUNS, 0.05) <= alarms <= binom.ppf(1 - 1e-3, RUNS, 0.05)


def boundary(seed: int, rows: int, columns: int, size: tuple[float, float]) -> tuple[Side, Side]:
    """Parts displaced as a whole, measured three times with s = 1; `size` of x and y."""
    rng = np.random.default_rng([seed, 8])
    first, second = (repeated(rng, v * drawn(rng, rows, columns, 1.0), 1.0, 3) for v in size)
    return first, second


def test_a_side_that_hardly_scatters_is_told_from_one_that_does() -> None:
    """Its sum less the noise is about 0, of either sign; the test must not depend on which."""
    for (rows, columns), size, least in (
        ((24, 10), (3.5, 0.0), 100),
        ((10, 4), (3.5, 0.46), 94),
        ((10, 24), (3.5, 0.0), 97),
    ):
        found = [scatter_ratio(*boundary(seed, rows, columns, size)) for seed in range(100)]
        assert sum(test.p <= 0.05 for test in found) >= least
    assert 20 <= sum(test.ratio == 0 for test in found) <= 80


def scaled(side: Side, factor: float) -> Side:
    return Side(values=side.values * factor, noise=side.noise * factor**2, u2=side.u2 * factor**4)


@pytest.mark.parametrize("size", [(3.5, 0.0), (3.5, 0.46), (1.0, 1.0), (0.0, 0.0)])
def test_the_unit_does_not_matter(size: tuple[float, float]) -> None:
    for seed in range(4):
        sides = boundary(seed, 10, 4, size)
        inches = [scaled(side, 1 / 25.4) for side in sides]
        assert scatter_ratio(*inches).p == pytest.approx(scatter_ratio(*sides).p, rel=1e-9)
        assert ratio_interval(*inches) == pytest.approx(ratio_interval(*sides), rel=1e-9)


def test_digits_do_not_matter() -> None:
    """Values rounded to a quarter of the CMM's scatter: as inches to 1e-5."""
    for seed in range(20):
        sides = boundary(seed, 10, 4, (3.5, 0.46))
        rounded = [
            Side(values=np.round(4 * side.values) / 4, noise=side.noise, u2=side.u2)
            for side in sides
        ]
        fine, coarse = (scatter_ratio(*item).p for item in (sides, rounded))
        assert 0.5 < coarse / fine < 2


def test_with_noise_by_leaving_out() -> None:
    """Slowly: of each row left out the columns' means and the noise are taken anew."""
    from scipy.stats import t as student

    n, columns = 9, 3
    for seed in range(3):
        rng = np.random.default_rng([seed, 10])
        sides = [repeated(rng, v * drawn(rng, n, columns, 0.5), s) for v, s in ((2, 1), (1, 0.7))]
        N = [float(side.noise.sum()) for side in sides]

        def less_noise(kept: list[int], sides: list[Side] = sides) -> list[float]:
            squares = [((v.values[kept] - v.values[kept].mean(axis=0)) ** 2).sum() for v in sides]
            share = (len(kept) - 1) / (n - 1)
            return [q - share * v.noise.sum() for q, v in zip(squares, sides, strict=True)]

        out = [[i for i in range(n) if i != j] for j in range(n)]
        least = min(min(less_noise(kept)) for kept in out)
        chance = sum(2 * x**2 / (columns * (n - 1)) + v.u2 for x, v in zip(N, sides, strict=True))
        w = 1 / (1 + max(least, 0.0) ** 2 / (chance * CLEAR**2))

        def theta(kept: list[int], w: float = w, N: list[float] = N) -> float:
            lift = w * sum(N) * (len(kept) - 1) / (n - 1)
            first, second = (P + lift for P in less_noise(kept))
            return float(np.log(second / first))

        left = np.array([theta(kept) for kept in out])
        P1, P2 = (P + w * sum(N) for P in less_noise(list(range(n))))
        parts = [
            ((n - 1) / n * ((left - left.mean()) ** 2).sum(), n - 2),
            (sides[0].u2 * (w / P2 + (1 - w) / P1) ** 2, 2 * N[0] ** 2 / sides[0].u2),
            (sides[1].u2 * (w / P1 + (1 - w) / P2) ** 2, 2 * N[1] ** 2 / sides[1].u2),
        ]
        variance = sum(v for v, _ in parts)
        dof = variance**2 / sum(v**2 / nu for v, nu in parts)
        p = 2 * student.sf(abs(np.log(P2 / P1)) / np.sqrt(variance), dof)
        assert scatter_ratio(*sides).p == pytest.approx(p, rel=1e-9)


def test_interval_by_scaling_a_side() -> None:
    """Its ends are the ratios that are just rejected; turned about they are the reciprocals."""
    for seed in range(5):
        first, second = boundary(seed, 12, 5, (1.0, 2.0))
        low, high = ratio_interval(first, second)
        for end in (low, high):
            moved = scaled(first, np.sqrt(end))
            assert scatter_ratio(moved, second).p == pytest.approx(0.05, rel=0.01)
        assert ratio_interval(second, first) == pytest.approx((1 / high, 1 / low), rel=2e-3)
        assert (low <= 1 <= high) == (scatter_ratio(first, second).p > 0.05)


def test_interval_holds_the_ratio() -> None:
    runs = 300
    for size, ratio in (((1.0, 1.5), 2.25), ((3.5, 0.0), 0.0)):
        found = [ratio_interval(*boundary(seed, 12, 3, size)) for seed in range(runs)]
        held = sum(low <= ratio <= high for low, high in found)
        assert held >= binom.ppf(1e-3, runs, 0.95)
        assert all(low < high for low, high in found)
        if ratio:
            assert held <= binom.ppf(1 - 1e-3, runs, 0.95)
        else:
            assert max(high for _, high in found) < 1
    assert np.mean([low == 0 for low, _ in found]) > 0.9


def test_edges_of_the_interval() -> None:
    rng = np.random.default_rng(11)
    a, one = bare(drawn(rng, 9, 3, 0.0)), np.zeros((9, 3))
    one[4] = 1.0
    # All of a side's scatter in one row: nothing can be said.
    assert scatter_ratio(a, bare(one)).p == 1
    assert ratio_interval(a, bare(one)) == (0.0, np.inf)
    # Without any scatter about twice the other side there is one ratio.
    assert ratio_interval(a, bare(2 * a.values)) == pytest.approx((4, 4))
    assert np.isnan(ratio_interval(a, bare(np.ones((9, 3))))).all()
    # Far more rows than a first look can see between.
    rows = 3000
    many = [repeated(rng, v * drawn(rng, rows, 8, 0.0), 0.3) for v in (1.0, 1.1)]
    low, high = ratio_interval(*many)
    assert 1.15 < low < scatter_ratio(*many).ratio < high < 1.27
    assert np.isnan([untested(3).p, untested(3).ratio]).all()


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


def test_a_coarse_resolution_is_no_scatter() -> None:
    """One part in twenty is a step off, along either axis alike: at most 5 % of all tables."""
    rng = np.random.default_rng(12)
    alarms = 0
    for _ in range(1000):
        sides = ((rng.random((10, 1)) < 0.05) * 0.01 for _ in range(2))
        found = scatter_ratio(
            *(Side(values=own.astype(np.float64), noise=np.zeros(10)) for own in sides)
        )
        alarms += found.p < 0.05
    assert binom.sf(alarms - 1, 1000, 0.05) > 0.001


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
