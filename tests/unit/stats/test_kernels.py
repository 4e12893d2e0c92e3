"""The integrated Wiener process: splines of another library, and simulated paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp

from mtu_cli.stats.kernels import (
    AMPLITUDES,
    LOG_PRIOR,
    averaged,
    interpolation_covariance,
    smooth_root,
    weights,
    wiener,
)

KNOTS = np.array([0.0, 30.0, 80.0, 100.0, 170.0, 200.0])


def test_the_natural_cubic_spline_and_its_lines_beyond() -> None:
    values = np.array([1.0, -2.0, 0.5, 4.0, 3.0, -1.0])
    spline = CubicSpline(KNOTS, values, bc_type="natural")
    inside = np.linspace(0, 200, 41)
    assert weights(KNOTS, inside) @ values == pytest.approx(spline(inside), abs=1e-12)
    beyond = np.array([-50.0, -10.0, 220.0, 300.0])
    ends = np.where(beyond < 0, 0.0, 200.0)
    lines = spline(ends) + (beyond - ends) * spline(ends, 1)
    assert weights(KNOTS, beyond) @ values == pytest.approx(lines, abs=1e-11)
    assert np.array_equal(weights(KNOTS, KNOTS), np.eye(len(KNOTS)))


def test_what_knots_leave_open_is_that_of_paths() -> None:
    """Paths W(x) = int (x - t)+ dB(t) of a fine grid, from far below: variance of their misfit."""
    rng, step = np.random.default_rng(1), 0.5
    t = np.arange(-60.0, 240.0, step) + step / 2
    at = np.array([15.0, 60.0, 130.0, 210.0])
    places = np.concatenate([KNOTS, at])
    arms = np.clip(places[:, None] - t, 0.0, None)
    paths = arms @ (rng.standard_normal((len(t), 40_000)) * np.sqrt(step))
    missed = paths[len(KNOTS) :] - weights(KNOTS, at) @ paths[: len(KNOTS)]
    expected = np.cov(missed)
    found = interpolation_covariance(KNOTS, at)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found / scale == pytest.approx(expected / scale, abs=0.03)


# A smooth profile averaged over its amplitude, against dense kriging of every reading.


AT = np.array([0.0, 40.0, 90.0, 150.0, 170.0, 240.0, 300.0])
PASSES = 4


@pytest.mark.parametrize("size", [0.0, 1.0, 20.0])
def test_mean_and_covariance_are_those_of_dense_kriging(size: float) -> None:
    """y = f(x) + e of every reading, f without a line about the knots; 1/sigma^2 as prior."""
    rng = np.random.default_rng(3)
    T = len(AT)
    y = size * np.sin(AT / 60) + rng.standard_normal((PASSES, T))
    line = np.column_stack([np.ones(T), AT])
    M = np.eye(T) - line @ np.linalg.pinv(line)
    y = y @ M
    K = M @ wiener(AT, AT) @ M
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
    B = smooth_root(AT)
    B /= np.sqrt((B**2).sum() / T)
    kept = np.linalg.svd(M)[0][:, : T - 2].T
    found, covariance, amplitude2 = averaged(kept @ G, np.sqrt(PASSES) * kept @ mean, B, sse, nu)
    assert found == pytest.approx(dense, abs=2e-3 * max(size, 0.5))
    apart = np.array(means) - dense
    spread = (apart.T * weight) @ apart / (sse / nu)
    expected = np.einsum("a,aij->ij", weight, np.array(covariances)) + spread
    assert covariance == pytest.approx(expected, rel=0.02, abs=2e-3 * float(np.max(expected)))
    assert amplitude2 == pytest.approx(float(weight @ AMPLITUDES**2), rel=0.02)
