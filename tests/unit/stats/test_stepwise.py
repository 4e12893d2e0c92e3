"""Forward-backward selection against full refits, and its error rates against simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import f as f_distribution

from mtu_cli.stats.compressed import Compressed, compress, effective_number
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.stepwise import stepwise


def independent(Z: FloatArray) -> Compressed:
    """Rows without any autocorrelation, so that their number is their effective one."""
    rows = compress(Z)
    return replace(rows, lag=np.zeros_like(rows.lag))


def rss(Z: FloatArray, chosen: Sequence[int]) -> float:
    return least_squares(Z[:, [0, *chosen]], Z[:, -1]).rss


def partial_p(less: float, more: float, columns: int, number: float) -> float:
    """Of one column, from the residual sums of squares without it and with it, of `columns`."""
    dof = number - columns - 1
    return float(f_distribution.sf((less - more) / more * dof, 1, dof))


def by_full_refits(Z: FloatArray, number: float, enter: float, remove: float) -> list[int]:
    """The textbook's procedure, every step by regressions from scratch."""
    chosen: list[int] = []
    now = rss(Z, chosen)
    for _ in range(100):
        others = [j for j in range(1, Z.shape[1] - 1) if j not in chosen]
        entry = {j: rss(Z, [*chosen, j]) for j in others}
        best = min(entry, key=lambda j: entry[j], default=0)
        if not best or partial_p(now, entry[best], len(chosen) + 1, number) >= enter:
            return sorted(chosen)
        chosen.append(best)
        now = entry[best]
        while True:
            # Of one column each: the largest p is that of the least rise.
            exits = {j: rss(Z, [i for i in chosen if i != j]) for j in chosen}
            worst = min(exits, key=lambda j: exits[j])
            if partial_p(exits[worst], now, len(chosen), number) <= remove:
                break
            chosen.remove(worst)
            now = exits[worst]
    raise AssertionError("no end")


def collinear_data(seed: int, n: int = 40, k: int = 7) -> FloatArray:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, k)) @ rng.normal(size=(k, k)) + 20
    y = X @ (rng.normal(size=k) * (rng.uniform(size=k) < 0.5)) + rng.normal(size=n) * 2
    return np.column_stack([np.ones(n), X, y])


@pytest.mark.parametrize("limits", [(0.05, 0.10), (0.15, 0.15)])
def test_against_full_refits(limits: tuple[float, float]) -> None:
    sizes = set()
    for seed in range(60):
        Z = collinear_data(seed)
        expected = by_full_refits(Z, len(Z), *limits)
        assert list(stepwise(independent(Z), *limits)) == expected
        sizes.add(len(expected))
    assert len(sizes) > 3


def test_against_full_refits_with_an_effective_number() -> None:
    differ = 0
    for seed in range(20):
        Z = collinear_data(seed, n=200)
        Z[:, -1] += 6 * ar1(np.random.default_rng(seed), 200, 0.9)
        rows = compress(Z)
        residuals = least_squares(Z[:, :-1], Z[:, -1]).residuals
        r = (residuals[:-1] @ residuals[1:] / 199) / (residuals @ residuals / 200)
        number = float(200 * (1 - r) / (1 + r))
        chosen = list(stepwise(rows))
        assert chosen == by_full_refits(Z, number, 0.05, 0.10)
        differ += chosen != by_full_refits(Z, 200, 0.05, 0.10)
    assert differ > 0


def sensors_alike(seed: int, apart: float, n: int = 300) -> FloatArray:
    """Eight sensors that follow one room with lags of their own; two more repeat one nearly.

    What the repeats hold beyond it, `apart` of its size, counts in the reading as much as it.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(n)[:, None]
    X = 6 * (1 - np.exp(-time / rng.uniform(40, 120, 8))) + 0.3 * rng.normal(size=(n, 8))
    own = rng.normal(size=(n, 2))
    X = np.column_stack([X, X[:, :1] + apart * own])
    y = X[:, :4] @ rng.normal(size=4) + own[:, 0] + 0.5 * rng.normal(size=n)
    return np.column_stack([np.ones(n), X, y])


@pytest.mark.parametrize("apart", [1e-1, 1e-3, 3e-5])
def test_sensors_that_are_nearly_one(apart: float) -> None:
    several = 0
    for seed in range(15):
        Z = sensors_alike(seed, apart)
        expected = by_full_refits(Z, len(Z), 0.05, 0.10)
        assert list(stepwise(independent(Z))) == expected
        several += len({1, 9, 10} & set(expected)) > 1
    assert several > 5


def test_an_exact_fit_is_found_and_ends() -> None:
    rng = np.random.default_rng(1)
    X = rng.normal(size=(30, 5)) + 20
    Z = np.column_stack([np.ones(30), X, 2 * X[:, 1] - X[:, 3] + 4])
    assert stepwise(independent(Z)) == (2, 4)


def test_nothing_to_choose() -> None:
    rng = np.random.default_rng(2)
    one, x = np.ones(20), rng.normal(size=20)
    assert stepwise(compress(np.column_stack([one, x]))) == ()
    assert stepwise(compress(np.column_stack([one, x, np.full(20, 3.0)]))) == ()
    assert stepwise(compress(np.column_stack([one, np.full(20, 7.0), x]))) == ()


@pytest.mark.parametrize("n", [1, 2])
def test_a_line_through_two_readings_is_no_evidence(n: int) -> None:
    x = np.array([1.0, 2.0])
    assert stepwise(compress(np.column_stack([np.ones(2), x, x**2])[:n])) == ()


def test_noise_free_readings_of_a_slow_column() -> None:
    """What is left is rounding, which may follow itself: it must not hide the column."""
    x = np.linspace(20.0, 26.0, 500)
    for slope in np.geomspace(1e-5, 1e3, 30):
        assert stepwise(compress(np.column_stack([np.ones(500), x, slope * x + 0.3]))) == (1,)


def ar1(rng: np.random.Generator, n: int, r: float) -> FloatArray:
    """Stationary noise of variance 1 with autocorrelation r^k."""
    e = rng.normal(size=n) * np.sqrt(1 - r**2)
    e[0] = rng.normal()
    return np.asarray(lfilter([1.0], [1.0, -r], e), float)


def test_effective_number_limits() -> None:
    assert effective_number(50, -0.4) == 50
    assert effective_number(50, 0.5) == pytest.approx(50 / 3)
    assert effective_number(50, 1.0) == 1
    assert effective_number(50, 1.7) == 1
    assert effective_number(2, 0.9) == 1


def test_error_rate_on_noise_that_follows_itself() -> None:
    """A slow column and noise that it has nothing to do with: 5 % may enter, not half of them.

    The autocorrelation is estimated, so that the rate is near its nominal value only; the
    number of readings alone would let far more in.
    """
    rng = np.random.default_rng(6)
    n, draws, entered, naive = 300, 400, 0, 0
    for _ in range(draws):
        x = ar1(rng, n, 0.99)
        Z = np.column_stack([np.ones(n), x, ar1(rng, n, 0.8)])
        entered += len(stepwise(compress(Z)))
        naive += len(stepwise(independent(Z)))
    error = np.sqrt(0.05 * 0.95 / draws)
    assert 0.05 - 4 * error < entered / draws < 0.08 + 4 * error
    assert naive / draws > 0.3
