"""Which of two sets of columns scatters more: the exchange test."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from mtu_cli.stats import swap
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.swap import swap_test


def sides(seed: int, rows: int, ratio: float, rho: float = 0.6) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    found = []
    for s in (1.0, ratio):
        common = rng.standard_normal((rows, 1))
        own = rng.standard_normal((rows, 5))
        found.append(s * (np.sqrt(rho) * common + np.sqrt(1 - rho) * own))
    return found[0], found[1]


def test_against_all_exchanges() -> None:
    a, b = sides(3, 7, 1.6)
    squares = [((v - v.mean(axis=0)) ** 2).sum(axis=1) for v in (a, b)]
    observed = abs(squares[1].sum() - squares[0].sum())
    change = squares[1] - squares[0]
    every = [abs(sum(s * c for s, c in zip(signs, change, strict=True)))
             for signs in product((-1, 1), repeat=7)]  # fmt: skip
    exact = np.mean([value >= observed * (1 - 1e-12) for value in every])
    found = swap_test(a, b, 1)
    assert abs(found.p - exact) < 4 * np.sqrt(exact * (1 - exact) / swap.SWAPS) + 1 / swap.SWAPS
    assert found.ratio == pytest.approx(squares[1].sum() / squares[0].sum())


def test_false_alarms_with_correlated_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(swap, "SWAPS", 199)
    runs = 1000
    alarms = sum(swap_test(*sides(seed, 21, 1.0), seed).p <= 0.05 for seed in range(runs))
    assert alarms / runs <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / runs)
    assert alarms / runs >= 0.05 - 4 * np.sqrt(0.05 * 0.95 / runs)


def test_a_scatter_twice_as_large_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(swap, "SWAPS", 199)
    found = [swap_test(*sides(seed, 21, 2.0, rho=0.3), seed) for seed in range(100)]
    assert sum(test.p <= 0.05 for test in found) >= 95
    assert all(test.ratio > 1 for test in found if test.p <= 0.05)


def test_many_rows_are_exchanged_in_blocks() -> None:
    a, b = sides(1, 5000, 1.2)
    found = swap_test(a, b, 2)
    assert found.p == pytest.approx(1 / (1 + swap.SWAPS))
    assert swap_test(b, a, 2).p == found.p
    assert swap_test(*sides(1, 5000, 1.0), 2).p > 0.01


def test_missing_entries_and_nothing_that_scatters() -> None:
    a, b = sides(5, 9, 1.0)
    a[2, 1] = b[2, 1] = np.nan
    assert 0 < swap_test(a, b, 1).p <= 1
    still = np.ones((9, 3))
    assert np.isnan([swap_test(still, still, 1).p, swap_test(still, still, 1).ratio]).all()
    one_sided = swap_test(still, b, 1)
    assert np.isnan(one_sided.ratio)
    assert one_sided.p < 0.05
    assert swap_test(a, b, 1) == swap_test(a, b, 1)
