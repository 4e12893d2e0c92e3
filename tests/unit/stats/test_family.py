"""Tests of a family, and of several estimates at once."""

from __future__ import annotations

import numpy as np
import pytest
import statsmodels.api as sm  # type: ignore[import-untyped]
from scipy.stats import binom, chi2, f, t

from mtu_cli.close_loop_sealed.stats.none_of_all import p_of_none, squared_distance
from mtu_cli.stats.family import holm, hotelling_p


def test_holm_by_hand() -> None:
    p = np.array([0.04, 0.001, 0.03, 0.5])
    assert holm(p) == pytest.approx([0.09, 0.004, 0.09, 0.5])


def test_a_test_that_was_not_made_does_not_count() -> None:
    found = holm(np.array([np.nan, 0.04, 0.03, np.nan]))
    assert found == pytest.approx([np.nan, 0.06, 0.06, np.nan], nan_ok=True)
    assert np.isnan(holm(np.full(3, np.nan))).all()


def test_never_beyond_one_and_in_the_order_of_p() -> None:
    rng = np.random.default_rng(1)
    p = rng.random(200) ** 3
    found = holm(p)
    assert found.max() <= 1
    assert (found >= p).all()
    assert (np.diff(found[np.argsort(p)]) >= 0).all()
    # The slow rule: reject at level q the smallest as long as p < q/(those left).
    for level in (0.01, 0.05, 0.3):
        left, rejected = sorted(p), set()
        while left and left[0] <= level / len(left):
            rejected.add(left.pop(0))
        assert {x for x, a in zip(p, found, strict=True) if a <= level} == rejected


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("k", [1, 2, 4])
def test_it_is_the_F_of_least_squares(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(15), rng.normal(size=(15, 4))])
    fit = sm.OLS(X @ [1.0, 0.4, 0.0, -0.3, 0.1] + rng.normal(size=15), X).fit()
    own = fit.f_test(np.eye(5)[1 : 1 + k])
    place = slice(1, 1 + k)
    p = p_of_none(fit.params[place], fit.cov_params()[place, place], fit.df_resid)
    assert p == pytest.approx(float(own.pvalue), rel=1e-9)


@pytest.mark.parametrize("dof", [1, 3, 12.5])
def test_of_one_estimate_it_is_students_t(dof: float) -> None:
    p = p_of_none(np.array([3.0]), np.array([[2.0]]), dof)
    assert p == pytest.approx(2 * t.sf(3 / np.sqrt(2), dof), rel=1e-9)


def test_fewer_than_one_degree_of_freedom_count_as_one() -> None:
    b, V = np.array([3.0]), np.array([[2.0]])
    assert p_of_none(b, V, 0.2) == p_of_none(b, V, 1.0)


def test_without_end_of_degrees_of_freedom_it_is_chi_squared() -> None:
    b, V = np.array([1.0, 2.0]), np.diag([1.0, 2.0])
    assert p_of_none(b, V, np.inf) == pytest.approx(chi2.sf(3.0, 2), rel=1e-6)


def test_units_do_not_matter() -> None:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(3, 3))
    b, V, unit = rng.normal(size=3), A @ A.T, np.array([1e-9, 1.0, 1e6])
    assert squared_distance(b, V) == pytest.approx(float(b @ np.linalg.solve(V, b)), rel=1e-9)
    scaled = squared_distance(b * unit, V * np.outer(unit, unit))
    assert scaled == pytest.approx(squared_distance(b, V), rel=1e-9)


def test_nothing_is_told_by_a_singular_covariance() -> None:
    assert squared_distance(np.ones(2), np.ones((2, 2))) is None
    assert squared_distance(np.ones(2), np.diag([1.0, 0.0])) is None
    assert p_of_none(np.ones(2), np.ones((2, 2)), 5.0) is None


def test_distances_of_draws_are_of_chi_squared() -> None:
    rng = np.random.default_rng(7)
    V = np.array([[4.0, 1.5], [1.5, 1.0]])
    draws = rng.multivariate_normal([0, 0], V, size=4000)
    beyond = sum((squared_distance(own, V) or 0.0) > chi2.isf(0.05, 2) for own in draws)
    low, high = binom.interval(0.999, 4000, 0.05)
    assert low <= beyond <= high


@pytest.mark.parametrize(("k", "dof"), [(1, 6), (2, 9), (4, 9)])
def test_hotellings_of_drawn_covariances(k: int, dof: int) -> None:
    """p of T^2 by the covariance of a sample is even from 0 to 1."""
    rng = np.random.default_rng(3)
    p = []
    for _ in range(2000):
        sample = rng.normal(size=(dof + 1, k))
        V = np.atleast_2d(np.cov(sample.T)) / (dof + 1)
        square = squared_distance(sample.mean(axis=0), V)
        assert square is not None
        p.append(hotelling_p(square, k, dof))
    for share in (0.05, 0.5):
        below = int(np.sum(np.array(p) < share))
        assert binom.cdf(below, len(p), share) > 1e-4
        assert binom.sf(below, len(p), share) > 1e-4


def test_hotellings_at_its_ends() -> None:
    assert hotelling_p(7.0, 1, 5.0) == pytest.approx(2 * t.sf(np.sqrt(7.0), 5), rel=1e-9)
    assert hotelling_p(7.0, 3, 8.0) == pytest.approx(f.sf(7 * 6 / 24, 3, 6), rel=1e-9)
    assert hotelling_p(7.0, 3, np.inf) == pytest.approx(chi2.sf(7.0, 3), rel=1e-6)
    assert hotelling_p(700.0, 3, 2.0) == 1.0
