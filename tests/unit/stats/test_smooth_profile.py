"""A smooth profile averaged over its amplitude, against dense kriging of every reading."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from mtu_cli.stats.kernels import smooth_root, wiener
from mtu_cli.stats.smooth_profile import AMPLITUDES, LOG_PRIOR, averaged

KNOTS = np.array([0.0, 40.0, 90.0, 150.0, 170.0, 240.0, 300.0])
PASSES = 4


@pytest.mark.parametrize("size", [0.0, 1.0, 20.0])
def test_mean_and_covariance_are_those_of_dense_kriging(size: float) -> None:
    """y = f(x) + e of every reading, f without a line about the knots; 1/sigma^2 as prior."""
    rng = np.random.default_rng(3)
    T = len(KNOTS)
    y = size * np.sin(KNOTS / 60) + rng.standard_normal((PASSES, T))
    line = np.column_stack([np.ones(T), KNOTS])
    M = np.eye(T) - line @ np.linalg.pinv(line)
    y = y @ M
    K = M @ wiener(KNOTS, KNOTS) @ M
    K /= np.trace(K) / T
    N = np.tile(np.eye(T), (PASSES, 1))
    n = PASSES * (T - 2)
    logs, means, covariances = [], [], []
    # A basis of what the lines of the passes leave: there the noise is white.
    free = np.kron(np.eye(PASSES), np.linalg.svd(M)[0][:, : T - 2].T)
    for a2 in AMPLITUDES**2:
        V = np.eye(n) + a2 * free @ N @ K @ N.T @ free.T
        gain = a2 * K @ N.T @ free.T @ np.linalg.inv(V)
        z = free @ y.ravel()
        logs.append(-np.linalg.slogdet(V)[1] / 2 - n / 2 * np.log(z @ np.linalg.solve(V, z)))
        means.append(gain @ z)
        covariances.append(a2 * K - gain @ free @ N @ K * a2)
    weight = np.exp(np.array(logs) + LOG_PRIOR - logsumexp(np.array(logs) + LOG_PRIOR))
    dense = weight @ np.array(means)

    G = np.sqrt(PASSES) * M
    mean = y.mean(axis=0)
    sse, nu = float(((y - mean) ** 2).sum()), (PASSES - 1) * (T - 2)
    B = smooth_root(KNOTS)
    B /= np.sqrt((B**2).sum() / T)
    kept = np.linalg.svd(M)[0][:, : T - 2].T
    found, covariance, amplitude2 = averaged(kept @ G, np.sqrt(PASSES) * kept @ mean, B, sse, nu)
    assert found == pytest.approx(dense, abs=2e-3 * max(size, 0.5))
    apart = np.array(means) - dense
    spread = (apart.T * weight) @ apart / (sse / nu)
    expected = np.einsum("a,aij->ij", weight, np.array(covariances)) + spread
    assert covariance == pytest.approx(expected, rel=0.02, abs=2e-3 * float(np.max(expected)))
    assert amplitude2 == pytest.approx(float(weight @ AMPLITUDES**2), rel=0.02)
