"""Directions whose scatter is an estimate, against estimates made of drawn parts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, ks_2samp, kstest, t

from mtu_cli.close_loop_sealed.stats.estimated_scatter import inflation, scattered

Floats = NDArray[np.float64]
COUNT = 4000


def squares(m: Floats, S: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Of means m (B, b) and S (B, b, b): x'S^-1 m/(x'S^-1 x), and the variance that S gives it."""
    solved = np.linalg.solve(S, np.broadcast_to(x[:, None], (len(m), len(x), 1)))[..., 0]
    variance = 1 / (solved @ x)
    return np.sum(solved * m, axis=1) * variance, variance


def of_parts(b: int, n: int, seed: int) -> tuple[Floats, Floats, Floats]:
    """Means and covariances of drawn parts, and a column along no axis of their scatter."""
    rng = np.random.default_rng(seed)
    root = 30 * (rng.normal(size=(b, b)) + np.eye(b))
    parts = rng.normal(size=(COUNT, n, b)) @ root.T
    return rng.normal(size=(COUNT, b)) @ root.T, parts.transpose(0, 2, 1) @ parts / n, root[0]


@pytest.mark.parametrize(("b", "n"), [(1, 3), (2, 5), (2, 3), (3, 6), (4, 12)])
def test_one_column_scatters_as_that_of_drawn_parts(b: int, n: int) -> None:
    m, S, x = of_parts(b, n, seed=b)
    beta, variance = squares(m, S, x)
    rng = np.random.default_rng(10 + b)
    known = S[0] + 100 * np.eye(b)
    drawn = scattered(
        rng.normal(size=(COUNT, b)) @ np.linalg.cholesky(known).T, known, float(n), rng
    )
    own, by_known = squares(drawn, np.broadcast_to(known, S.shape), x)
    assert ks_2samp(beta**2 / variance, own**2 / by_known).pvalue > 1e-3
    if b == 1:
        assert kstest(own / np.sqrt(by_known), t(n).cdf).pvalue > 1e-3


@pytest.mark.parametrize(("b", "n"), [(1, 6), (2, 9), (3, 14)])
def test_an_inflated_variance_is_unbiased(b: int, n: int) -> None:
    m, S, x = of_parts(b, n, seed=20 + b)
    beta, variance = squares(m, S, x)
    factor, dof = inflation(float(n), b)
    assert dof == n - b + 1
    ratio = beta**2 - factor * variance
    # Their difference has the mean 0.
    assert abs(ratio.mean()) < 4 * ratio.std() / np.sqrt(COUNT)
    assert inflation(np.inf, b) == (1.0, np.inf)


def test_scatter_below_the_noise_leaves_the_noise() -> None:
    """Nothing makes it less, and little is it ever more."""
    z = np.random.default_rng(3).normal(size=(COUNT, 1))
    one, other = (
        scattered(z, share * np.eye(1), 5.0, np.random.default_rng(4)) for share in (1.0, 1e-6)
    )
    np.testing.assert_allclose(other, z, rtol=1e-12)
    assert (np.abs(one) >= np.abs(z) - 1e-12).all()
    # 5/X > 1 where chi^2 of 5 degrees of freedom is below 5: 58.4 %.
    more = int((np.abs(one) > np.abs(z) * (1 + 1e-9)).sum())
    assert binom.ppf(1e-4, COUNT, 0.5841) <= more <= binom.ppf(1 - 1e-4, COUNT, 0.5841)


def test_directions_that_few_parts_do_not_see_scatter_alike() -> None:
    rng = np.random.default_rng(5)
    S = np.diag([0.0, 400.0])
    drawn = scattered(rng.normal(size=(COUNT, 2)) * [1.0, 20.0], S, 1.0, rng)
    # Of the mean, 200, with two degrees of freedom.
    for own in drawn.T:
        assert kstest(own / np.sqrt(200), t(2).cdf).pvalue > 1e-3
