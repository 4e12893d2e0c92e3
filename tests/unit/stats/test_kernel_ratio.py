"""Likelihood of a smooth random effect against dense Gaussian densities and their integral."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from mtu_cli.close_loop_sealed.stats.kernel_ratio import (
    RATIOS,
    kernel_log_bayes,
    kernel_of,
    kernel_ratios,
)


def walk(n: int) -> Floats:
    """Covariance of a random walk of n steps."""
    steps = np.arange(1.0, n + 1)
    return np.asarray(np.minimum.outer(steps, steps))


def dense(y: Floats, V: Floats) -> float:
    """Largest log density of y ~ N(0, lambda V) over lambda, by numbers."""

    def minus(log_level: float) -> float:
        return -float(multivariate_normal.logpdf(y, cov=np.exp(log_level) * V))

    start = float(np.log(y @ np.linalg.solve(V, y) / len(y)))
    return -float(minimize_scalar(minus, bounds=(start - 3, start + 3), method="bounded").fun)


@pytest.mark.parametrize("n", [4, 9])
def test_ratios_are_those_of_dense_densities(n: int) -> None:
    K = walk(n)
    kernel = kernel_of(7.0 * K)
    assert kernel is not None
    scaled = K / np.trace(K) * n
    y = np.random.default_rng(n).normal(size=(3, n))
    found = kernel_ratios(kernel, y)
    for i, rho in enumerate(RATIOS):
        for b, own in enumerate(y):
            expected = 2 * (dense(own, np.eye(n) + rho * scaled) - dense(own, np.eye(n)))
            assert found[i, b] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_log_bayes_is_the_mean_of_the_profile_likelihoods() -> None:
    ratios = np.random.default_rng(1).normal(size=(5, 4)) * 300
    expected = logsumexp(0.5 * ratios, axis=0) - np.log(5)
    np.testing.assert_allclose(kernel_log_bayes(ratios), expected, rtol=1e-12)


def test_the_largest_ratio_is_where_the_variance_is() -> None:
    # 400 walks of 40 steps: twice the log likelihood at the true rho beats its neighbours'.
    n, K = 40, walk(40)
    kernel = kernel_of(K)
    assert kernel is not None
    at = 7
    root = np.linalg.cholesky(np.eye(n) + RATIOS[at] * K / np.trace(K) * n)
    y = np.random.default_rng(2).normal(size=(400, n)) @ root.T
    mean = kernel_ratios(kernel, y).mean(axis=1)
    assert int(mean.argmax()) == at


def test_scale_does_not_matter_and_nothing_gives_nothing() -> None:
    kernel = kernel_of(walk(6))
    assert kernel is not None
    y = np.random.default_rng(3).normal(size=(2, 6))
    np.testing.assert_allclose(kernel_ratios(kernel, 1e-3 * y), kernel_ratios(kernel, y))
    assert np.isfinite(kernel_ratios(kernel, np.zeros((1, 6)))).all()
    assert kernel_of(np.zeros((3, 3))) is None
    assert kernel_of(np.zeros((0, 0))) is None
