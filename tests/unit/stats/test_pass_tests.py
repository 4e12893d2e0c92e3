from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray
from pass_designs import DRIFT, NO_DRIFT, PLACES, UNBALANCED, Design, balanced, drawn, plain_passes
from scipy.linalg import orth
from scipy.stats import ttest_ind

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes
from mtu_cli.stats.pass_tests import (
    MAX_POSITIONS,
    FTest,
    lack_of_fit,
    pass_scatter,
    pass_trend,
    reversal,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    # statsmodels ships no types.
    from statsmodels.regression.linear_model import OLS  # type: ignore[import-untyped]

IntArray = NDArray[np.int64]

DESIGNS = {"balanced": balanced(6), "balanced, both ways": balanced(6, both=True), **UNBALANCED}


def fitted(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    return fit_passes(y, design.position, degree, design.group, design.direction)


def dummies(codes: IntArray | FloatArray) -> FloatArray:
    return np.array(codes[:, None] == np.unique(codes), dtype=np.float64)


def lines(codes: IntArray | FloatArray, position: FloatArray) -> FloatArray:
    """A level and a slope for every code."""
    own = dummies(codes)
    return np.hstack([own, own * (position[:, None] - 185.0) / 185.0])


def nested(y: FloatArray, full: FloatArray, reduced: FloatArray) -> FTest:
    """F test of nested models by statsmodels, on orthonormal bases of their columns."""
    F, p, df = OLS(y, orth(full)).fit().compare_f_test(OLS(y, orth(reduced)).fit())
    within = len(y) - np.linalg.matrix_rank(full)
    return FTest(F=float(F), p=float(p), df=(int(df), int(within)))


def assert_same(found: FTest | None, wanted: FTest) -> None:
    assert found is not None
    assert pytest.approx(wanted.F, rel=1e-7) == found.F
    assert found.p == pytest.approx(wanted.p, rel=1e-6, abs=1e-14)
    assert found.df == wanted.df


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize("D", [NO_DRIFT, DRIFT], ids=["no drift", "drift"])
def test_pass_scatter_is_the_analysis_of_covariance(name: str, D: FloatArray) -> None:
    """One line a pass against one line a direction, by statsmodels, on any design."""
    design = DESIGNS[name]
    y = drawn(design, np.random.default_rng(1), D, reversal=3.0)
    wanted = nested(
        y, lines(design.group, design.position), lines(design.direction, design.position)
    )
    assert_same(pass_scatter(fitted(design, y)), wanted)


@pytest.mark.parametrize("both", [False, True], ids=["one direction", "both directions"])
def test_trend_is_the_slope_of_the_levels(both: bool) -> None:
    """Ordinary least squares of the passes' levels on direction and order, by statsmodels."""
    design = balanced(9, both=both)
    y = drawn(design, np.random.default_rng(2), reversal=3.0) + 0.4 * design.group
    order = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0])
    level = plain_passes(design, y).lines[:, 0]
    columns = [np.ones(9), np.argsort(np.argsort(order))]
    if both:
        columns.append(np.where(np.arange(9) % 2 == 0, 1.0, -1.0))
    wanted = OLS(level, np.column_stack(columns)).fit()
    found = pass_trend(fitted(design, y), order)
    assert found is not None
    assert found.value == pytest.approx(wanted.params[1], rel=1e-8)
    assert found.u == pytest.approx(wanted.bse[1], rel=1e-8)
    assert found.p == pytest.approx(wanted.pvalues[1], rel=1e-7)
    assert found.dof == wanted.df_resid


def test_reversal_is_forward_minus_reverse() -> None:
    """Student's two-sample t of the passes' means."""
    design = balanced(10, both=True)
    y = drawn(design, np.random.default_rng(3), reversal=6.0)
    means = y.reshape(10, 8).mean(axis=1)
    wanted = ttest_ind(means[0::2], means[1::2])
    found = reversal(fitted(design, y), np.arange(10.0))
    assert found is not None
    assert found.value == pytest.approx(means[0::2].mean() - means[1::2].mean(), rel=1e-9)
    assert found.value > 0
    assert found.value / found.u == pytest.approx(wanted.statistic, rel=1e-8)
    assert found.p == pytest.approx(wanted.pvalue, rel=1e-7)
    assert found.dof == 8


def in_runs(design: Design, y: FloatArray) -> PassFit:
    """Two passes that follow each other are a run there and back."""
    return fit_passes(y, design.position, 1, design.group, design.direction, design.group // 2)


def shared_in_runs(design: Design, rng: np.random.Generator, size: float) -> FloatArray:
    found: FloatArray = rng.normal(0, size, 20)[design.group // 2]
    return found


def test_of_runs_the_reversal_is_that_of_levels_less_a_steady_drift() -> None:
    """Its value is the coefficient of direction beside order, by statsmodels; its u by hand."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(5)
    y = drawn(design, rng, reversal=6.0) + shared_in_runs(design, rng, 2.0) + 0.5 * design.group
    level = plain_passes(design, y).lines[:, 0]
    way = np.where(np.arange(10) % 2 == 0, 0.5, -0.5)
    wanted = OLS(level, np.column_stack([np.ones(10), way, np.arange(10)])).fit()
    found = reversal(in_runs(design, y), np.arange(10.0))
    assert found is not None
    assert found.value == pytest.approx(wanted.params[1], rel=1e-8)
    m, h = (level[0::2] + level[1::2]) / 2, (level[0::2] - level[1::2]) / 2
    # Runs are at -4, -2, 0, 2, 4: the sum of squares is 40.
    u2 = 4 * np.var(h, ddof=1) / 5 + np.var(m, ddof=1) / 40
    assert found.u == pytest.approx(u2**0.5, rel=1e-8)
    assert found.dof == 4


@pytest.mark.parametrize("drift", [1.0, 3.0])
def test_where_the_order_is_assumed_a_steady_drift_is_no_reversal(drift: float) -> None:
    """Reverse was read first, which without times nobody can say: the drift is in u."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(9)
    alarms = 0
    for _ in range(300):
        y = drawn(design, rng, NO_DRIFT) + drift * (design.group // 2 * 2 + (design.direction > 0))
        found = reversal(in_runs(design, y), np.arange(10.0), timed=False)
        assert found is not None
        assert found.value == pytest.approx(drift, abs=1.5)
        alarms += found.p < 0.05
    assert alarms < 300 * (0.05 + 3 * (0.05 * 0.95 / 300) ** 0.5)


@pytest.mark.parametrize("passes", [2.0, 4.0, 8.0])
def test_a_warm_up_is_no_reversal(passes: float) -> None:
    """An axis that grows by 20 um, ever more slowly, with so many passes of a time constant."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(7)
    growth = 20 * (1 - np.exp(-design.group / passes))
    alarms = 0
    for _ in range(300):
        found = reversal(in_runs(design, drawn(design, rng, NO_DRIFT) + growth), np.arange(10.0))
        assert found is not None
        alarms += found.p < 0.05
    assert alarms < 300 * (0.05 + 3 * (0.05 * 0.95 / 300) ** 0.5)


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_lack_of_fit_within_passes(name: str, degree: int) -> None:
    """Free means against the polynomial, both beside the passes' own lines, by statsmodels."""
    design = DESIGNS[name]
    y = drawn(design, np.random.default_rng(4)) + 0.5 * np.sin(design.position / 30)
    own = lines(design.group, design.position) if degree else dummies(design.group)
    scaled = (design.position - 185.0) / 185.0
    powers = np.column_stack([scaled**k for k in range(degree + 1)])
    wanted = nested(y, np.hstack([own, dummies(design.position)]), np.hstack([own, powers]))
    assert_same(lack_of_fit(y, design.position, degree, design.group), wanted)


def test_what_cannot_be_tested_is_none() -> None:
    rng = np.random.default_rng(9)
    few = balanced(2)
    fit = fitted(few, drawn(few, rng))
    assert pass_scatter(fit) is not None
    assert pass_trend(fit, np.arange(2.0)) is None
    assert reversal(fit, np.arange(float(fit.n_passes))) is None
    y = rng.normal(size=8)
    assert lack_of_fit(y, PLACES, 1, None) is None
    assert lack_of_fit(y, np.repeat(PLACES[:2], 4), 1, None) is None
    assert lack_of_fit(y, np.zeros(8), 0, np.arange(8)) is None
    many = np.repeat(np.arange(MAX_POSITIONS + 1.0), 2)
    assert lack_of_fit(rng.normal(size=len(many)), many, 1, None) is None
