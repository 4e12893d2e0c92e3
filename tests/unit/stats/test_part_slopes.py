"""Slopes of parts: their variances by draws, by refits and by another package's mixed model."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.part_slopes import (
    CLEAR,
    coefficients,
    crossed,
    shrunken,
    slope_variances,
)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
P, H = 30, 9


def drawn(seed: int, sizes: tuple[float, float], missing: float) -> tuple[Floats, Floats, Mask]:
    """X, y (P, H, 1) of unit noise and which entries are near; columns have no means."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1, 1, (H, 2))
    X = np.broadcast_to(np.column_stack([np.ones(H), places - places.mean(axis=0)]), (P, H, 3))
    b = np.column_stack([3 * rng.normal(size=P), rng.normal(size=(P, 2)) * sizes])
    y = (np.einsum("phi,pi->ph", X, b) + rng.normal(size=(P, H)))[..., None]
    near: Mask = (rng.random((P, H)) >= missing)[..., None]
    return X.copy(), np.where(near, y, 0.0), near


@pytest.mark.parametrize("missing", [0.0, 0.5])
@pytest.mark.parametrize("sizes", [(3.0, 1.0), (0.5, 10.0)])
def test_variances_are_those_that_were_drawn(sizes: tuple[float, float], missing: float) -> None:
    found = []
    for seed in range(60):
        X, y, near = drawn(seed, sizes, missing)
        found.append(slope_variances(X, y, near, np.ones(1), None)[0][0])
    error = np.std(found, axis=0) / np.sqrt(len(found))
    # Steps end within 1 % of where they go, and a variance is never below 0.
    assert (np.abs(np.mean(found, axis=0) - np.square(sizes)) < 4 * error + 0.05).all()


def test_variances_are_those_of_restricted_maximum_likelihood() -> None:
    """Of a common slope there is none here, nor there: columns are taken off before."""
    from scipy.optimize import minimize

    X, y, near = drawn(3, (3.0, 1.0), 0.4)

    def minus_log_likelihood(log_variance: Floats) -> float:
        total = 0.0
        for x, own, there in zip(X, y[..., 0], near[..., 0], strict=True):
            Z, v = x[there], own[there]
            if len(v) < 2:
                continue
            V = np.eye(len(v)) + (Z[:, 1:] * np.exp(log_variance)) @ Z[:, 1:].T
            W = np.linalg.inv(V)
            one = np.ones(len(v))
            left = v - (one @ W @ v) / (one @ W @ one)
            total += np.linalg.slogdet(V)[1] + np.log(one @ W @ one) + left @ W @ left
        return total / 2

    # A simplex has no width about 0.
    best = minimize(minus_log_likelihood, np.ones(2), method="Nelder-Mead", tol=1e-9)
    found = None
    for _ in range(300):
        found, _ = slope_variances(X, y, near, np.ones(1), found)
    assert found is not None
    np.testing.assert_allclose(found[0], np.exp(best.x), rtol=0.01)


def test_best_linear_predictions_are_those_of_the_covariance() -> None:
    X, y, near = drawn(4, (2.0, 1.0), 0.3)
    variances = np.array([4.0, 1.0]) * 1.7**2
    inverse = shrunken(crossed(X, near), np.array([1.7]), np.tile(variances, (P, 1, 1)))
    b = coefficients(inverse, X, y)[:, 0]
    for p in range(P):
        there = near[p, :, 0]
        Z, v = X[p, there], y[p, there, 0]
        V = 1.7**2 * np.eye(len(v)) + (Z[:, 1:] * variances) @ Z[:, 1:].T
        W = np.linalg.inv(V)
        one = np.ones(len(v))
        level = (one @ W @ v) / (one @ W @ one)
        slopes = variances * (Z[:, 1:].T @ W @ (v - level))
        np.testing.assert_allclose(b[p], [level, *slopes], atol=1e-8)


def test_a_clear_slope_of_one_part_is_its_own_whichever_entry_is_left_out() -> None:
    X, y, near = drawn(5, (0.0, 0.0), 0.0)
    turned = y.copy()
    turned[7, :, 0] += 15.0 * X[7, :, 1]
    slip = y.copy()
    far = int(np.argmax(np.abs(X[7, :, 1])))
    slip[7, far, 0] += 25.0
    for values, own in ((turned, True), (slip, False)):
        of_all, of_parts = slope_variances(X, values, near, np.ones(1), None)
        # One in thirty is none of the others' distribution.
        assert of_all[0, 0] < 1.0
        assert (of_parts[7, 0, 0] > of_all[0, 0]) == own
        least = np.inf
        for left_out in range(H):
            rest = np.arange(H) != left_out
            Z = X[7, rest]
            b = np.linalg.lstsq(Z, values[7, rest, 0], rcond=None)[0][1]
            chance = np.linalg.inv(Z.T @ Z)[1, 1]
            least = min(least, b**2 - chance if b**2 > CLEAR**2 * chance else 0.0)
        wanted = max(float(of_all[0, 0]), least)
        assert of_parts[7, 0, 0] == pytest.approx(wanted, rel=1e-9)
        assert np.array_equal(np.delete(of_parts, 7, axis=0)[:, 0, 0] > of_all[0, 0], [False] * 29)


def test_a_slope_that_no_part_tells_is_none() -> None:
    X, y, near = drawn(6, (3.0, 0.0), 0.0)
    X[..., 2] = 0.0
    of_all, _ = slope_variances(X, y, near, np.ones(1), None)
    assert of_all[0, 1] < 1e-8
    assert of_all[0, 0] > 1.0
