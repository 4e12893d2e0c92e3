"""The pooled scatter of all features: its test, its rate of false alarms, and its power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compare_trials import fitted, made, study
from scipy import stats

from mtu_cli.analyses.compare import CompareResult, compare
from mtu_cli.analyses.compare.evidence import pooled_test
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Settings
from mtu_cli.model.variance import PassSquare
from mtu_cli.reports.compare import document, verdict_text
from mtu_cli.stats.least_squares import FloatArray


def p_of(ratio: FloatArray, correlation: FloatArray, df: float, dof: float = np.inf) -> float:
    """p of items of one mean square and no CMM, whose part means have this correlation."""
    squares = np.ones((1, 1)), np.array([dof])
    return pooled_test(ratio, correlation, 2 * correlation**2 / df, squares, 0.0).p


@pytest.mark.parametrize("T", [1.2, 1.5, 0.7])
def test_independent_items_are_one_chi_squared(T: float) -> None:
    """30 items of 4 degrees of freedom: chi-squared of 120, to 1 in 1000 (`sum_tails`)."""
    found = p_of(np.full(30, T), np.eye(30), 4.0)
    tail = min(stats.chi2.sf(120 * T, 120), stats.chi2.cdf(120 * T, 120))
    assert found == pytest.approx(2 * tail, rel=1e-3)


def test_items_that_are_one_are_no_more_than_one() -> None:
    found = p_of(np.full(30, 2.5), np.ones((30, 30)), 4.0)
    assert found == pytest.approx(2 * stats.chi2.sf(10.0, 4), rel=0.02)


def test_an_expectation_of_few_readings_makes_it_fisher() -> None:
    found = p_of(np.full(30, 2.5), np.eye(30), 4.0, dof=6.0)
    # A hundredth for the nodes of the variance.
    assert found == pytest.approx(2 * stats.f.sf(2.5, 120, 6), rel=0.01)


@pytest.mark.parametrize("common", [0.3, 0.8])
@pytest.mark.parametrize("tail", [0.0005, 0.005, 0.025])
def test_correlated_items_against_draws(common: float, tail: float) -> None:
    """Four standard errors of the drawn quantiles, and 2 % for the formula."""
    m, df, draws = 24, 5, 100_000
    correlation = common * np.ones((m, m)) + (1 - common) * np.eye(m)
    sizes = np.linalg.eigvalsh(correlation)
    T = np.random.default_rng(11).chisquare(df, (draws, m)) @ sizes / (df * m)
    for end in np.quantile(T, [tail, 1 - tail]):
        found = p_of(np.full(m, end), correlation, df)
        error = 2 * 4 * np.sqrt(tail / draws)
        assert found == pytest.approx(2 * tail, abs=error + 0.02 * 2 * tail)


def test_degrees_of_freedom_of_a_sum_over_a_mean_square_of_passes() -> None:
    """Against draws of Wishart matrices: the variance of sum w g'S g."""
    rng = np.random.default_rng(3)
    g, w, nu, draws = rng.standard_normal((12, 4)), rng.uniform(0.5, 2, 12), 6, 20000
    root = rng.standard_normal((4, 4))
    S = root @ root.T
    z = rng.standard_normal((draws, nu, 4)) @ root.T
    sums = np.einsum("dnk,mk,m->dnm", z, g, np.sqrt(w))
    total = (sums**2).sum(axis=(1, 2)) / nu
    times = PassSquare(g, S).independent(w)
    expected = 2 * total.mean() ** 2 / (nu * times)
    # Four standard errors of a variance, whose own kurtosis is no more than that of chi-squared.
    assert total.var() == pytest.approx(expected, rel=4 * np.sqrt((2 + 12 / (nu * times)) / draws))
    one = PassSquare(g[:1], S).independent(w[:1])
    assert one == pytest.approx(1.0)
    assert PassSquare(0 * g, S).independent(w) == 1.0


def loose(points: Points, factor: float) -> Points:
    """Parts that scatter `factor` times as much about the mean of each feature."""
    measured = points.measured.copy()
    for feature in np.unique(points.feature):
        own = points.feature == feature
        mean = points.measured[own].mean(axis=0)
        for part in np.unique(points.part):
            rows = own & (points.part == part)
            measured[rows] += (factor - 1) * (points.measured[rows].mean(axis=0) - mean)
    return replace(points, measured=measured)


def study_of(seed: int, factor: float, passes: int = 10) -> CompareResult:
    _, truth, part = study()
    points = loose(made(truth, part, seed + 1_000_000), factor)
    return compare(fitted(passes, seed), part, points, Settings())


def test_scatter_that_no_feature_shows_is_found_in_all() -> None:
    """21 parts that all scatter 1.5 times: of 30 studies more than a third, where single features
    show it in a sixth at most.
    """
    results = [study_of(seed, 1.5) for seed in range(30)]
    found = [result.features.pooled[0] for result in results]
    told = [own.verdict == "under-predicted" for own in found]
    single = [any(result.features.under_predicted) for result in results]
    assert sum(told) > 10
    assert sum(single) < 6
    ratios = np.array([own.ratio for own in found])
    # By chance of the fit, of 10 passes, too.
    assert ratios.mean() == pytest.approx(1.5, abs=4 * ratios.std() / np.sqrt(30))
    own, result = next(
        (own, result)
        for own, result, yes, one in zip(found, results, told, single, strict=True)
        if yes and not one
    )
    (summary,) = result.feature_summaries
    assert summary.pooled_fault == "under-predicted"
    assert verdict_text(summary).startswith("features: under-predicted (pooled scatter ")
    entry = document(result).record()["summary"]["features"][0]["all_at_once"]
    assert (entry["verdict"], entry["items"]) == ("under-predicted", 48)
    assert entry["ratio_scatter"] == own.ratio
