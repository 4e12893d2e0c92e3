"""Normality by its rate of rejection; variance inflation against statsmodels and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.serial import condition_number, normality_p, variance_inflation


@pytest.mark.parametrize("memory", [0.0, 0.19, 0.7, 0.9])
def test_normal_residuals_are_rejected_as_often_as_said(memory: float) -> None:
    """5 %, whether or not the readings follow each other; skewed ones nearly always."""
    rng, n, runs = np.random.default_rng(2), 1200, 600
    shocks = rng.standard_normal((runs, n)) * np.sqrt(1 - memory**2)
    values = lfilter([1.0], [1.0, -memory], shocks, axis=1)[:, 200:]
    effective = 1000 * (1 - memory) / (1 + memory)
    p = np.array([normality_p(row, effective) for row in values])
    assert 0.025 < np.mean(p < 0.05) < 0.085
    skewed = np.array([normality_p(np.exp(row), effective) for row in values[:100]])
    assert np.mean(skewed < 0.05) > 0.95


def test_normality_of_too_few_or_equal_residuals_is_unknown() -> None:
    values = np.random.default_rng(3).standard_normal(100)
    assert normality_p(values, 18.0) is None
    assert normality_p(values[:19]) is None
    assert normality_p(values[:20]) is not None
    assert normality_p(np.zeros(50)) is None


def columns(n: int = 60) -> FloatArray:
    rng = np.random.default_rng(11)
    X = rng.normal(size=(n, 4)) @ rng.normal(size=(4, 4)) * [1.0, 1e3, 1e-3, 1.0] + [20, 0, 1, -5]
    centred: FloatArray = X - X.mean(axis=0)
    return centred


def test_variance_inflation_is_statsmodels_and_one_over_one_less_r_squared() -> None:
    # statsmodels ships no types.
    from statsmodels.stats.outliers_influence import (  # type: ignore[import-untyped]
        variance_inflation_factor,
    )

    X = columns()
    found = variance_inflation(X)
    with_one = np.column_stack([np.ones(len(X)), X])
    for j in range(4):
        assert found[j] == pytest.approx(variance_inflation_factor(with_one, j + 1), rel=1e-8)
        own = X[:, j]
        r2 = 1 - least_squares(np.delete(X, j, axis=1), own).rss / (own @ own)
        assert found[j] == pytest.approx(1 / (1 - r2), rel=1e-8)


def test_dependent_columns() -> None:
    X = columns()
    X[:, 3] = X[:, 0] / X[:, 0].std() - X[:, 1] / X[:, 1].std()
    found = variance_inflation(X)
    assert np.isinf(found[[0, 1, 3]]).all()
    assert found[2] == pytest.approx(variance_inflation(X[:, :3])[2], rel=1e-6)
    assert condition_number(X) == np.inf
