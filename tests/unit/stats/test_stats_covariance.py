"""Positive parts of differences of mean squares; covariances from matrices that need not be any."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from mtu_cli.stats.covariance import (
    as_covariance,
    bounded,
    correlation_of,
    covariance_root,
    factor_of,
    positive_part,
)
from mtu_cli.stats.least_squares import FloatArray


def spread(rng: np.random.Generator, size: int) -> FloatArray:
    S = rng.normal(size=(size, size + 2))
    result: FloatArray = S @ S.T
    return result


@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("less", [0.0, 0.5, 2.0, 50.0])
def test_against_the_generalised_eigenproblem(size: int, less: float) -> None:
    """S v = l M v: D keeps max(l - less, 0)."""
    rng = np.random.default_rng(int(10 * less) + size)
    for _ in range(20):
        S, M = spread(rng, size), spread(rng, size)
        D = positive_part(S, M, less)
        values, v = eigh(S, M)
        kept = np.maximum(values - less, 0.0)
        np.testing.assert_allclose(D, (M @ v * kept) @ (M @ v).T, atol=1e-9 * np.abs(S).max())
        assert np.linalg.eigvalsh(D).min() >= -1e-12 * np.abs(S).max()
        if values.min() > less:
            np.testing.assert_allclose(D, S - less * M, atol=1e-9 * np.abs(S).max())


@pytest.mark.parametrize("seed", range(8))
def test_variances_stay_and_no_combination_has_one_below_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s = np.exp(4 * rng.standard_normal(5))
    R = np.clip(rng.uniform(-1.5, 1.5, (5, 5)), -1, 1)
    R = np.triu(R, 1) + np.triu(R, 1).T + np.eye(5)
    found = as_covariance(R * np.outer(s, s)) / np.outer(s, s)
    assert np.linalg.eigvalsh(R)[0] < -1e-3
    np.testing.assert_allclose(np.diag(found), 1.0, rtol=1e-12)
    assert np.linalg.eigvalsh(found)[0] > -1e-12


@pytest.mark.parametrize("r", [-1.0, -0.4, 0.0, 1.0])
def test_roots_give_the_covariance_again(r: float) -> None:
    C = np.array([[1.0, r, 0.0], [r, 1.0, 0.0], [0.0, 0.0, 0.0]])
    C *= np.outer(s := np.array([1e-6, 40.0, 1.0]), s)
    for F in (factor_of(C), covariance_root(C)):
        np.testing.assert_allclose(F @ F.T, C, atol=1e-14 * 1600)
    assert factor_of(C).shape == (3, 1 if abs(r) == 1 else 2)
    assert correlation_of(C)[0, 1] == pytest.approx(r)
    assert np.isnan(correlation_of(C)[0, 2])


def test_bounded_by_what_scatters() -> None:
    """-S <= K <= S: both differences have no negative eigenvalue; within the bounds K stays."""
    rng = np.random.default_rng(3)
    S = spread(rng, 3) * np.outer(s := np.array([1e-4, 1.0, 30.0]), s)
    K = 5 * spread(rng, 3) * np.outer(s, s) - S
    cut = bounded(K, S)
    for whole in (S - cut, S + cut):
        assert np.linalg.eigvalsh(whole / np.outer(s, s)).min() > -1e-9
    np.testing.assert_allclose(bounded(0.3 * S, S), 0.3 * S, rtol=1e-9)
    assert not bounded(K, np.zeros((3, 3))).any()


def test_a_metric_that_rounding_made_singular() -> None:
    """As that of the powers of a high degree: Cholesky's factor breaks off."""
    s = np.array([1.0, 1e-8, 1e5])
    metric = (np.full((3, 3), 1.0 + 1e-9) - 1e-9 * np.eye(3)) * np.outer(s, s)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(metric)
    found = positive_part(5.0 * metric, metric, 2.0)
    np.testing.assert_allclose(found, 3.0 * metric, rtol=1e-6)
