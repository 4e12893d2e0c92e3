"""Passes there and back: by hand, by statsmodels and scipy, and how often they are alike."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pass_designs import DRIFT, NO_DRIFT, Design, balanced, dense_covariance, drawn, plain_passes
from scipy.stats import kstest, ttest_rel

from mtu_cli.stats.mixed import PassFit, fit_passes
from mtu_cli.stats.pass_pairs import paired_reversal, shared_scatter

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    # statsmodels ships no types.
    from statsmodels.formula.api import ols  # type: ignore[import-untyped]
    from statsmodels.regression.linear_model import OLS  # type: ignore[import-untyped]
    from statsmodels.stats.anova import anova_lm  # type: ignore[import-untyped]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def runs_of(design: Design) -> IntArray:
    """Run (G,) of each pass: two follow each other, there and back."""
    found: IntArray = np.arange(design.n_passes) // 2
    return found


def warm(design: Design, rng: np.random.Generator, size: float, slope: float = 0.0) -> FloatArray:
    """What both directions of a run share at every reading: a level, and a slope."""
    run = design.group // 2
    level, steep = rng.normal(0, size, run.max() + 1), rng.normal(0, slope, run.max() + 1)
    shared: FloatArray = level[run] + steep[run] * (design.position - design.position.mean())
    return shared


def each_way(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    return fit_passes(y, design.position, degree, design.group, design.direction)


def there_and_back(design: Design, y: FloatArray, degree: int = 1) -> PassFit:
    return fit_passes(y, design.position, degree, design.group // 2, design.direction)


def test_alike_is_the_analysis_of_variance_with_runs_as_blocks() -> None:
    """F and p of the runs in a two-way table of levels (run, direction), by statsmodels."""
    design = balanced(12, both=True)
    rng = np.random.default_rng(1)
    y = drawn(design, rng, 0.01 * DRIFT, reversal=4.0) + warm(design, rng, 1.0)
    level = plain_passes(design, y).lines[:, 0]
    frame = pd.DataFrame({"y": level, "run": runs_of(design), "way": np.arange(12) % 2})
    wanted = anova_lm(ols("y ~ C(run) + C(way)", frame).fit()).loc["C(run)"]
    found = shared_scatter(each_way(design, y), runs_of(design))
    assert found is not None
    assert pytest.approx(float(wanted["F"]), rel=1e-8) == found.F
    # The smaller of two, of level and slope.
    assert found.p == pytest.approx(2 * float(wanted["PR(>F)"]), rel=1e-7)
    assert (found.df_numerator, found.df_denominator) == (5, 5)


def test_alike_slopes_are_found_too() -> None:
    """An axis that grows as it warms: the passes' slopes go together, at the centre nothing."""
    design = balanced(12, both=True)
    rng = np.random.default_rng(2)
    y = drawn(design, rng, NO_DRIFT) + warm(design, rng, 0.0, slope=0.05)
    slopes = plain_passes(design, y).lines[:, 1]
    m, h = (slopes[0::2] + slopes[1::2]) / 2, (slopes[0::2] - slopes[1::2]) / 2
    found = shared_scatter(each_way(design, y), runs_of(design))
    assert found is not None
    assert pytest.approx(np.var(m) / np.var(h), rel=1e-7) == found.F
    assert found.p < 1e-3


def test_reversal_is_students_paired_t() -> None:
    design = balanced(10, both=True)
    rng = np.random.default_rng(3)
    y = drawn(design, rng, NO_DRIFT, reversal=3.0) + warm(design, rng, 5.0)
    means = y.reshape(10, 8).mean(axis=1)
    wanted = ttest_rel(means[0::2], means[1::2])
    found = paired_reversal(each_way(design, y), runs_of(design))
    assert found is not None
    assert found.value == pytest.approx(np.mean(means[0::2] - means[1::2]), rel=1e-9)
    assert found.value / found.u == pytest.approx(wanted.statistic, rel=1e-7)
    assert found.p == pytest.approx(wanted.pvalue, rel=1e-6)
    assert found.dof == 4


def test_the_order_of_passes_does_not_matter_and_a_run_of_one_way_is_left_out() -> None:
    design = balanced(10, both=True)
    rng = np.random.default_rng(4)
    y = drawn(design, rng, reversal=3.0) + warm(design, rng, 5.0)
    wanted = shared_scatter(each_way(design, y), runs_of(design))
    backwards = shared_scatter(each_way(design, y), 9 - runs_of(design))
    # An eleventh pass, forward alone.
    longer = balanced(11, both=True)
    more = np.concatenate([y, 100 + rng.normal(size=8)])
    fit = each_way(longer, more)
    found, back = shared_scatter(fit, runs_of(longer)), paired_reversal(fit, runs_of(longer))
    same = paired_reversal(each_way(design, y), runs_of(design))
    assert found is not None
    assert wanted is not None
    assert backwards is not None
    assert back is not None
    assert same is not None
    assert pytest.approx(wanted.F, rel=1e-9) == found.F
    assert pytest.approx(wanted.F, rel=1e-9) == backwards.F
    assert back.value == pytest.approx(same.value, rel=1e-9)
    assert back.u == pytest.approx(same.u, rel=1e-9)


def test_what_two_runs_or_one_way_cannot_tell_is_none() -> None:
    rng = np.random.default_rng(5)
    few, one_way, by_chance = balanced(4, both=True), balanced(8), balanced(1)
    for design in (few, one_way, by_chance):
        fit = each_way(design, drawn(design, rng))
        assert shared_scatter(fit, runs_of(design)) is None
        assert paired_reversal(fit, runs_of(design)) is None
    level = balanced(6, both=True)
    exact = each_way(level, 3.0 + 0.0 * level.position)
    assert shared_scatter(exact, runs_of(level)) is None
    assert paired_reversal(exact, runs_of(level)) is None


@pytest.mark.parametrize("D", [NO_DRIFT, DRIFT], ids=["no drift", "drift"])
def test_p_values_are_uniform_where_directions_are_not_alike(D: FloatArray) -> None:
    """The smaller of two independent p values p has P(2 p < c) = c - c^2/4, c below 1."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(6)
    p = []
    for _ in range(600):
        found = shared_scatter(each_way(design, drawn(design, rng, D)), runs_of(design))
        assert found is not None
        p.append(found.p)
    below = np.array(p)
    # Level and slope are correlated where they drift, which only lowers the rate of small ones.
    if D is NO_DRIFT:
        assert kstest(1 - (1 - below[below < 1] / 2) ** 2, "uniform", (0, 0.75)).pvalue > 1e-3
    assert abs(np.mean(below < 0.05) - 0.05) < 3 * (0.05 * 0.95 / 600) ** 0.5


@pytest.mark.parametrize("degree", [1, 2])
def test_passes_there_and_back_against_dense_matrices(degree: int) -> None:
    """One line a run, its powers and the way of the move for all: textbook least squares."""
    design = balanced(8, both=True).without({(0, 5), (3, 1), (3, 2)})
    rng = np.random.default_rng(7)
    y = drawn(design, rng, NO_DRIFT, reversal=3.0) + warm(design, rng, 3.0, 0.01)
    fit = there_and_back(design, y, degree)
    c = design.position - design.position.mean()
    own = (design.group[:, None] // 2 == np.arange(4)).astype(float)
    way = design.direction[:, None] / 2
    X = np.hstack([own, own * c[:, None], way, way * c[:, None]])
    if degree == 2:
        X = np.hstack([X, design.position[:, None] ** 2])
    wanted = OLS(y, X).fit()
    assert fit.s2 == pytest.approx(wanted.mse_resid, rel=1e-7)
    assert (fit.within_dof, fit.pass_dof, fit.n_passes) == (len(y) - X.shape[1], 3, 4)
    runs = Design(design.position, design.group // 2, design.direction)
    lines = np.column_stack([wanted.params[:4], wanted.params[4:8]])
    if degree == 1:
        np.testing.assert_allclose(fit.pass_coefficients, lines, rtol=1e-7)
    np.testing.assert_allclose(fit.between, np.cov(lines.T), rtol=1e-6)
    expected = dense_covariance(runs, degree, fit.s2, fit.D_moment)
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-6)


@pytest.mark.parametrize("shared", [0.0, 3.0])
def test_moments_of_passes_there_and_back_are_unbiased(shared: float) -> None:
    """Level, D and s2 over 400 trials, where the directions have nothing of their own."""
    design = balanced(10, both=True)
    rng = np.random.default_rng(8)
    levels, covariances, D, s2 = [], [], [], []
    for _ in range(400):
        y = drawn(design, rng, NO_DRIFT, b=(0.0, 0.0), reversal=3.0) + warm(design, rng, shared)
        fit = there_and_back(design, y)
        middle = np.array([1.0, fit.center])
        levels.append(middle @ fit.plain.coefficients)
        covariances.append(middle @ fit.covariance @ middle)
        D.append(fit.D_moment[0, 0])
        s2.append(fit.s2)
    # Var of the level by the design: shared^2/5 + 1/80; its estimates have 4 degrees of freedom.
    truth = shared**2 / 5 + 1 / 80
    assert abs(np.mean(levels)) < 4 * (truth / 400) ** 0.5
    assert abs(np.var(levels) / truth - 1) < 4 * (2 / 400) ** 0.5
    assert abs(np.mean(covariances) / truth - 1) < 4 * (2 / 4 / 400) ** 0.5
    assert abs(np.mean(D) - shared**2) < 4 * 5 * truth * (2 / 4 / 400) ** 0.5
    assert abs(np.mean(s2) - 1.0) < 4 * (2 / fit.within_dof / 400) ** 0.5
