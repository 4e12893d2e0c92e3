"""The one definition of an outlier, against a plain version, and how often chance meets it."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats.outliers import (
    GROSS,
    NEAR,
    NEAR_EFFICIENCY,
    NEAR_SQUARE,
    OUTLYING_P,
    outlying,
    spikes,
)

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


def test_efficiency_of_the_near_values() -> None:
    """2/nu is the relative variance of s^2: of 4000 samples of 1000 to four of its errors."""
    d = np.abs(np.random.default_rng(4).standard_normal((4000, 1000)))
    d.partition(799, axis=1)
    s2 = (d[:, :800] ** 2).mean(axis=1)
    assert s2.mean() == pytest.approx(NEAR_SQUARE, rel=2e-3)
    found = 2 / (s2.var() / s2.mean() ** 2) / 1000
    assert found == pytest.approx(NEAR_EFFICIENCY, rel=4 * np.sqrt(2 / 4000))


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
