"""Whether passes there and back are alike: by statsmodels, and how often by chance."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from pass_designs import DRIFT, NO_DRIFT, Design, balanced, drawn, plain_passes
from scipy.stats import kstest

from mtu_cli.stats.mixed import PassFit, fit_passes
from mtu_cli.stats.pass_pairs import shared_scatter

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    # statsmodels ships no types.
    from statsmodels.formula.api import ols  # type: ignore[import-untyped]
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
    assert pytest.approx(float(wanted["F"]), rel=1e-8) == found.test.F
    # By levels and slopes of the passes, one after the other: 2 var(m)/(var(m) + var(h)).
    lines = plain_passes(design, y).lines
    m, h = (lines[0::2] + lines[1::2]) / 2, (lines[0::2] - lines[1::2]) / 2
    shares = [np.var(m[:, i]) / (np.var(m[:, i]) + np.var(h[:, i])) for i in (0, 1)]
    assert found.understated == pytest.approx((2 * max(shares)) ** 0.5, rel=1e-7)
    # The smaller of two, of level and slope.
    assert found.p == pytest.approx(2 * float(wanted["PR(>F)"]), rel=1e-7)
    assert (found.test.df_numerator, found.test.df_denominator) == (5, 5)


def test_alike_slopes_are_found_too() -> None:
    """An axis that grows as it warms: the passes' slopes go together, at the centre nothing."""
    design = balanced(12, both=True)
    rng = np.random.default_rng(2)
    y = drawn(design, rng, NO_DRIFT) + warm(design, rng, 0.0, slope=0.05)
    slopes = plain_passes(design, y).lines[:, 1]
    m, h = (slopes[0::2] + slopes[1::2]) / 2, (slopes[0::2] - slopes[1::2]) / 2
    found = shared_scatter(each_way(design, y), runs_of(design))
    assert found is not None
    assert pytest.approx(np.var(m) / np.var(h), rel=1e-7) == found.test.F
    assert found.p < 1e-3


def test_the_order_of_passes_does_not_matter_and_a_run_of_one_way_is_left_out() -> None:
    design = balanced(10, both=True)
    rng = np.random.default_rng(4)
    y = drawn(design, rng, reversal=3.0) + warm(design, rng, 5.0)
    wanted = shared_scatter(each_way(design, y), runs_of(design))
    backwards = shared_scatter(each_way(design, y), 9 - runs_of(design))
    # An eleventh pass, forward alone.
    longer = balanced(11, both=True)
    more = np.concatenate([y, 100 + rng.normal(size=8)])
    found = shared_scatter(each_way(longer, more), runs_of(longer))
    for other in (backwards, found):
        assert wanted is not None
        assert other is not None
        assert pytest.approx(wanted.test.F, rel=1e-9) == other.test.F
        assert other.understated == pytest.approx(wanted.understated, rel=1e-9)


@pytest.mark.parametrize(("shared", "own"), [(5.0, 0.0), (2.0, 1.0), (0.0, 2.0)])
def test_what_u_lacks_is_what_many_machines_scatter_more(shared: float, own: float) -> None:
    """u of the level by passes taken as independent, against its scatter over 800 trials."""
    design = balanced(20, both=True)
    rng = np.random.default_rng(9)
    D = np.diag([own**2, 0.0])
    levels, stated, lacks = [], [], []
    for _ in range(800):
        y = drawn(design, rng, D, b=(0.0, 0.0)) + warm(design, rng, shared)
        fit = each_way(design, y)
        found = shared_scatter(fit, runs_of(design))
        assert found is not None
        middle = np.array([1.0, fit.center])
        levels.append(middle @ fit.plain.coefficients)
        stated.append(middle @ fit.covariance @ middle)
        lacks.append(found.understated**2)
    ratio = float(np.var(levels) / np.mean(stated))
    # Nothing scatters but the level: what a slope would add to the larger is noise, of 9 degrees
    # of freedom. Relative standard errors: of a variance of 800, and of the mean of lacks.
    noise = (2 / 800 + np.var(lacks) / np.mean(lacks) ** 2 / 800) ** 0.5
    assert ratio < np.mean(lacks) * (1 + 4 * noise)
    if shared:
        # The larger of level and slope is a little above that of the level.
        assert ratio > 0.85 * np.mean(lacks) * (1 - 4 * noise)


def test_what_two_runs_or_one_way_cannot_tell_is_none() -> None:
    rng = np.random.default_rng(5)
    few, one_way, by_chance = balanced(4, both=True), balanced(8), balanced(1)
    for design in (few, one_way, by_chance):
        fit = each_way(design, drawn(design, rng))
        assert shared_scatter(fit, runs_of(design)) is None
    level = balanced(6, both=True)
    exact = each_way(level, 3.0 + 0.0 * level.position)
    assert shared_scatter(exact, runs_of(level)) is None


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
