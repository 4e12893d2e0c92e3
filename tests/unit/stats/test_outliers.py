"""Rows and values that stand out: false alarms over a whole table, power, groups, spikes."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats import outliers
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import (
    GROSS,
    NEAR,
    NEAR_EFFICIENCY,
    OUTLYING_P,
    deviation_p,
    median_polish,
    outlying,
    outstanding_rows,
    spikes,
)

ROWS, COLUMNS = 21, 30
GROUPS = np.arange(COLUMNS) % 2


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """199 rotations: p in steps of 0.005 are fine enough for the 5 % level."""
    monkeypatch.setattr(outliers, "ROTATIONS", 199)


def clean(seed: int, rho: float, missing: float = 0.0) -> FloatArray:
    rng = np.random.default_rng([seed, 17])
    common = rng.standard_normal((ROWS, 2))[:, GROUPS]
    own = rng.standard_normal((ROWS, COLUMNS))
    table = np.sqrt(rho) * common + np.sqrt(1 - rho) * own
    table[rng.random(table.shape) < missing] = np.nan
    result: FloatArray = table
    return result


def alarmed(table: FloatArray, seed: int) -> np.ndarray:
    found = outstanding_rows(table, GROUPS, seed)
    rows: np.ndarray = np.minimum(found.by_row, found.by_cell.min(axis=1)) <= 0.05
    return rows


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("rho", "missing"), [(0.0, 0.0), (0.8, 0.0), (0.5, 0.1)])
def test_false_alarms_of_a_whole_table(rho: float, missing: float) -> None:
    runs = 150
    alarms = sum(alarmed(clean(s, rho, missing), s).any() for s in range(runs)) / runs
    error = np.sqrt(0.05 * 0.95 / runs)
    assert alarms <= 0.05 + 3 * error
    # A test that never alarms would do that too; missing entries may cost some of the rate.
    assert alarms >= 0.005


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_a_row_shifted_by_four_sigma_is_found(rho: float) -> None:
    runs = 60
    found = others = 0
    for seed in range(runs):
        table = clean(seed, rho)
        table[4] += 4.0
        rows = alarmed(table, seed)
        found += int(rows[4])
        others += int(np.delete(rows, 4).any())
    assert found >= 0.95 * runs
    assert others <= 0.15 * runs


def test_large_tables_by_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outliers, "ENTRIES", 0)
    table = clean(6, 0.3)
    assert not alarmed(table, 1).any()
    table[3] += 5.0
    assert np.flatnonzero(alarmed(table, 1)).tolist() == [3]
    many = np.random.default_rng(1).standard_normal((300, 40))
    many[8] += 1.0
    many[200, 6] = 12.0
    found = outstanding_rows(many, np.zeros(40, np.int64), 1)
    assert found.by_row[8] <= 0.05
    assert found.by_cell[200, 6] <= 0.001
    runs = 120
    alarms = sum(alarmed(clean(s, 0.5), s).any() for s in range(runs)) / runs
    assert alarms <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


def test_grubbs() -> None:
    """Critical values of Grubbs 1969, Technometrics 11, Table I, two-sided 5 %: the largest of n
    deviations at 5 % / (2 n) in a tail.
    """
    printed = {10: 2.290, 20: 2.709, 30: 2.908}
    for n, value in printed.items():
        # His third decimal is off by one in places.
        p = deviation_p(np.array([value - 0.001, value + 0.001]), np.full(2, float(n)))
        assert p[1] < 0.05 / n < p[0]
    assert deviation_p(np.array(1.0), np.array(2.0)) == 1.0


# The one definition of an outlier, against a plain version, and how often chance meets it.


RNG = np.random.default_rng(20261128)


def plain(values: list[float], fitted: int) -> tuple[set[int], float]:
    """Value by value, with statistics of the library, Student's t and the truncated normal of
    scipy.
    """
    middle = statistics.median(values)
    away = [abs(v - middle) for v in values]
    n, dof = len(values), len(values) - fitted - 1
    near = sorted(away)[: int(NEAR * n)]
    end = float(stats.norm.isf((1 - NEAR) / 2))
    normal = float(stats.truncnorm(-end, end).var())
    s = (statistics.fmean(d**2 for d in near) / normal / (dof / n)) ** 0.5
    t = float(stats.t.isf(OUTLYING_P / (2 * n), NEAR_EFFICIENCY * dof))
    return {i for i, d in enumerate(away) if d > max(GROSS, t) * s}, s


@pytest.mark.parametrize("n", [12, 40, 300])
@pytest.mark.parametrize("slips", [0, 1, 2])
def test_as_a_plain_version(n: int, slips: int) -> None:
    values = RNG.normal(0, 1, n)
    at = RNG.choice(n, slips, replace=False)
    values[at] += RNG.choice([-1, 1], slips) * RNG.uniform(60, 100, slips)
    found, s = outlying(values, fitted=2)
    expected, plain_s = plain(values.tolist(), fitted=2)
    assert set(np.flatnonzero(found)) == expected
    assert s == pytest.approx(plain_s, rel=1e-9)


def test_chance_seldom_meets_it() -> None:
    """A thousandth of the samples at most, of few values and of many."""
    for n in (8, 20, 80):
        sets = RNG.normal(0, 1, (1000, n))
        assert sum(bool(outlying(own)[0].any()) for own in sets) <= 1
        assert sum(bool(spikes(own.cumsum())[0].any()) for own in sets) <= 3


def test_spikes_of_a_curve_are_named_and_its_kinks_are_not() -> None:
    t = np.arange(60.0)
    curve = np.where(t < 30, t, 30 + 5 * (t - 30)) + RNG.normal(0, 0.05, 60)
    assert not spikes(curve)[0].any()
    for at in ([10], [29], [30], [5, 7], [40, 41], [3, 20, 33, 50]):
        own = curve.copy()
        own[at] += 40
        assert np.flatnonzero(spikes(own)[0]).tolist() == at


def test_a_last_digit_is_no_outlier() -> None:
    """All readings alike but one, by one digit: with the variance of the display it is none."""
    values = np.array([2.0] * 19 + [3.0])
    assert outlying(values)[0].sum() == 1
    assert not outlying(values, r=1 / 12)[0].any()
    assert outlying(np.where(values == 3, 30, values), r=1 / 12)[0].sum() == 1
    curve = np.where(np.arange(40) == 20, 1.0, 0.0)
    assert not spikes(curve, r=1 / 12)[0].any()
    assert spikes(30 * curve, r=1 / 12)[0].sum() == 1


def test_a_polish_leaves_what_is_neither_of_row_nor_of_column() -> None:
    """Levels of rows and columns and slopes of rows are taken out, one slip is not."""
    x = np.arange(5.0)
    table = np.arange(6.0)[:, None] + x**2 + np.outer([0, 1, 2, 3, 4, 5.0], x)
    table[2, 3] += 9.0
    table[4, 0] = np.nan
    left = median_polish(table, x)
    assert left[2, 3] == pytest.approx(9.0, abs=0.5)
    left[2, 3] = 0.0
    assert np.nanmax(np.abs(left)) < 0.5
