"""The line of the many: gross readings neither hide each other nor blame good ones."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats.outliers import told_apart
from mtu_cli.stats.trimmed import TRIMMED, Trimmed, trimmed_fit

FAR = 150.0


def columns(n: int, degree: int) -> np.ndarray:
    return np.vander(np.linspace(-1, 1, n), degree + 1)


def told(found: Trimmed) -> set[int]:
    return set(told_apart(found.distance, found.limit, 0.05).tolist())


@pytest.mark.parametrize("degree", range(6))
@pytest.mark.parametrize("kind", ["first", "last", "middle", "spread", "both signs"])
def test_a_fifth_of_gross_readings_is_told_and_no_other(degree: int, kind: str) -> None:
    """Also at an end, where they have most weight in a polynomial."""
    n, count = 100, 20
    rng = np.random.default_rng(degree)
    X = columns(n, degree)
    y = X @ rng.normal(0, 10, degree + 1) + rng.standard_normal(n)
    rows = {
        "first": np.arange(count),
        "last": np.arange(n - count, n),
        "middle": np.arange(40, 40 + count),
        "spread": rng.choice(n, count, replace=False),
        "both signs": rng.choice(n, count, replace=False),
    }[kind]
    sign = rng.choice([-1, 1], count) * rng.uniform(1, 10, count) if kind == "both signs" else 1
    # Equal values are as far as FAR from a line that the coefficients move by tens.
    y[rows] = FAR if kind in ("first", "last") else y[rows] + sign * FAR
    found = trimmed_fit(X, y)
    assert told(found) == set(rows.tolist())
    good = np.setdiff1d(np.arange(n), rows)
    alone = trimmed_fit(X[good], y[good])
    # The gross have no part in it: bit for bit but for rounding.
    np.testing.assert_allclose(found.expected[good], alone.expected, rtol=0, atol=1e-9)
    assert found.spread == pytest.approx(alone.spread)


def test_rows_in_an_order_of_their_own_are_windows_too() -> None:
    """Gross readings of one place among rows that were read place by place, in turn."""
    rng = np.random.default_rng(7)
    position = rng.permutation(np.linspace(-1, 1, 90))
    X = np.vander(position, 4)
    y = rng.standard_normal(90)
    gross = position > 0.65
    y[gross] += FAR
    assert told(trimmed_fit(X, y)) == set()
    found = trimmed_fit(X, y, [np.argsort(position)])
    assert told(found) == set(np.flatnonzero(gross).tolist())


def test_the_least_trimmed_squares_are_those_of_all_subsets() -> None:
    """Slow plain version: every subset of h of 12 rows, of which 2 are gross."""
    rng = np.random.default_rng(8)
    for _ in range(5):
        X = columns(12, 1)
        y = rng.standard_normal(12)
        gross = rng.choice(12, 2, replace=False)
        y[gross] += 60
        h = 12 - int(TRIMMED * 10)
        subsets = [list(own) for own in combinations(range(12), h)]
        best = min(subsets, key=lambda own: np.linalg.lstsq(X[own], y[own], rcond=None)[1][0])
        b = np.linalg.lstsq(X[best], y[best], rcond=None)[0]
        expected = trimmed_fit(X, y).expected
        assert np.abs(expected - X @ b).max() < 1e-9
        assert set(gross) == set(range(12)) - set(best)


@pytest.mark.parametrize(("n", "degree"), [(8, 0), (8, 2), (8, 4), (12, 3), (12, 5), (60, 1)])
def test_clean_readings_are_told_as_rarely_as_stated(n: int, degree: int) -> None:
    rng, files = np.random.default_rng(9), 300
    X = columns(n, degree)
    alarms = sum(bool(told(trimmed_fit(X, rng.standard_normal(n)))) for _ in range(files))
    assert alarms <= stats.binom(files, 0.01).ppf(0.999)


def test_many_readings_are_begun_on_some_of_them() -> None:
    n = 60_000
    rng = np.random.default_rng(10)
    X = columns(n, 3)
    y = X @ np.array([3.0, 5.0, -2.0, 1.0]) + rng.standard_normal(n)
    y[50_000:] = FAR
    assert told(trimmed_fit(X, y)) == set(range(50_000, n))


def test_what_the_clean_rows_do_not_determine_is_not_judged() -> None:
    """A column that only gross rows have; columns that depend; no scatter at all."""
    rng = np.random.default_rng(11)
    y = rng.standard_normal(60)
    X = np.column_stack([np.ones(60), np.zeros(60), np.full(60, 2.0)])
    X[:4, 1] = 1.0
    y[:4] = [5e2, -5e2, 1e3, -1e3]
    found = trimmed_fit(X, y)
    assert not told(found) & set(range(4, 60))
    assert not told(trimmed_fit(X, np.ones(60)))
    assert not told(trimmed_fit(np.ones((9, 1)), np.append(np.zeros(8), 1.0)))


@pytest.mark.parametrize("size", [0.003, 0.3, 7.0])
@pytest.mark.parametrize("scatter", [0.0, 0.2, 0.4])
def test_what_a_coarse_display_shows_is_not_gross(size: float, scatter: float) -> None:
    """Most readings are equal, a line goes through all of these: the others are a step off."""
    rng = np.random.default_rng(7)
    position = np.linspace(0, 1, 60)
    X = np.vander(position, 2)
    # Without scatter all files are the same one.
    for _ in range(50 if scatter else 1):
        steps = np.round(3 + scatter * rng.standard_normal(60))
        steps[5] += 1
        found = trimmed_fit(X, size * steps)
        assert (found.distance <= found.limit).all()
        # Not one that is many steps off.
        steps[20] += 30
        found = trimmed_fit(X, size * steps)
        assert np.flatnonzero(found.distance > found.limit).tolist() == [20]
