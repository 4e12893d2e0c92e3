"""Normality, condition numbers and variance inflation against scipy, statsmodels and by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import normaltest

from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.residuals import condition_number, normality_p, variance_inflation

SAMPLES: dict[str, Callable[[np.random.Generator, int], FloatArray]] = {
    "normal": lambda rng, n: rng.normal(size=n),
    "skewed": lambda rng, n: rng.exponential(size=n),
    "flat": lambda rng, n: rng.uniform(size=n),
    "heavy": lambda rng, n: rng.standard_t(3, size=n),
    "two values": lambda rng, n: np.where(np.arange(n) % 3, 0.0, 1.0),
}


@pytest.mark.parametrize("n", [20, 25, 100, 3000])
@pytest.mark.parametrize("kind", SAMPLES)
def test_normality_is_scipys(kind: str, n: int) -> None:
    values = SAMPLES[kind](np.random.default_rng(n), n)
    found = normality_p(values)
    assert found == pytest.approx(float(normaltest(values).pvalue), rel=1e-9)


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
