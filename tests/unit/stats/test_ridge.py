"""Ridge paths against augmented rows, the closed form, ordinary least squares and simulation."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.compressed import compress
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.ridge import RidgePath, ridge

PENALTIES = np.array([0.0, 1e-6, 1e-2, 0.3, 10.0])


def data(n: int = 60, seed: int = 5) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Two intercepts, four columns of unlike units, two of them alike, and a target."""
    rng = np.random.default_rng(seed)
    free = np.zeros((n, 2))
    free[: n // 2, 0] = free[n // 2 :, 1] = 1.0
    X = rng.normal(size=(n, 4))
    X[:, 3] = X[:, 2] + 0.05 * X[:, 3]
    X = X * [1.0, 1e3, 1e-2, 1e-2] + [20.0, 0.0, 1.0, 0.0]
    y = free @ [5.0, -3.0] + X @ [1.0, 1e-3, 50.0, 20.0] + rng.normal(size=n)
    return free, X, y


def augmented(free: FloatArray, X: FloatArray, y: FloatArray, penalty: float) -> FloatArray:
    """(intercepts, coefficients) by least squares with a row sqrt(n penalty) s_j a column."""
    n = len(y)
    s = np.sqrt([least_squares(free, column).rss / n for column in X.T])
    more = np.hstack([np.zeros((X.shape[1], free.shape[1])), np.diag(np.sqrt(n * penalty) * s)])
    rows = np.vstack([np.hstack([free, X]), more])
    return least_squares(rows, np.concatenate([y, np.zeros(X.shape[1])])).coefficients


@pytest.mark.parametrize("i", range(len(PENALTIES)))
def test_the_path_is_least_squares_on_augmented_rows(i: int) -> None:
    free, X, y = data()
    path = ridge(free, X, y, len(y), PENALTIES)
    plain = augmented(free, X, y, PENALTIES[i])
    assert path.intercepts[i] == pytest.approx(plain[:2], rel=1e-9)
    assert path.coefficients[i] == pytest.approx(plain[2:], rel=1e-9)


@pytest.mark.parametrize("i", range(len(PENALTIES)))
def test_closed_form_covariance_and_effective_number(i: int) -> None:
    """(X'X + P)^-1 X'y, (X'X + P)^-1 X'X (X'X + P)^-1 and tr (X'X + P)^-1 X'X, by inverses."""
    free, X, y = data()
    n = len(y)
    path = ridge(free, X, y, n, PENALTIES)
    left = X - free @ (free.T @ X) / (n / 2)
    S = left.T @ left
    inverse = np.linalg.inv(S + PENALTIES[i] * np.diag(np.diag(S)))
    assert path.coefficients[i] == pytest.approx(inverse @ left.T @ y, rel=1e-7)
    assert path.unit_covariance(i) == pytest.approx(inverse @ S @ inverse, rel=1e-6)
    assert path.effective[i] == pytest.approx(np.trace(inverse @ S), rel=1e-9)


def test_compressed_rows_give_the_same_path() -> None:
    free, X, y = data()
    pieces = [compress(np.column_stack([free, X, y])[k::2]).factor for k in range(2)]
    small = np.vstack(pieces)
    whole = ridge(free, X, y, len(y), PENALTIES)
    found = ridge(small[:, :2], small[:, 2:6], small[:, 6], len(y), PENALTIES)
    assert found.coefficients == pytest.approx(whole.coefficients, rel=1e-9)
    assert found.intercepts == pytest.approx(whole.intercepts, rel=1e-9)
    assert found.effective == pytest.approx(whole.effective, rel=1e-9)


def test_a_column_that_repeats_the_free_ones_gets_nothing() -> None:
    free, X, y = data()
    X[:, 1] = 3.0 * free[:, 0] - 7.0
    path = ridge(free, X, y, len(y), PENALTIES)
    without = ridge(free, np.delete(X, 1, axis=1), y, len(y), PENALTIES)
    assert (path.coefficients[:, 1] == 0).all()
    assert np.delete(path.coefficients, 1, axis=1) == pytest.approx(without.coefficients, rel=1e-9)
    assert (path.unit_covariance(2)[1] == 0).all()
    assert path.effective == pytest.approx(without.effective, rel=1e-12)


def test_no_columns_at_all() -> None:
    free, _, y = data()
    path = ridge(free, np.zeros((len(y), 0)), y, len(y), PENALTIES)
    assert path.coefficients.shape == (5, 0)
    assert path.intercepts[0] == pytest.approx([y[:30].mean(), y[30:].mean()], rel=1e-12)
    assert (path.effective == 0).all()


def test_unit_covariance_is_that_of_simulated_fits() -> None:
    """4000 targets with errors of variance 1; each moment within five of its standard errors."""
    free, X, _ = data()
    rng = np.random.default_rng(6)
    draws = 4000
    found = np.empty((draws, 4))
    path: RidgePath = ridge(free, X, X[:, 0], len(X), np.array([0.05]))
    for k in range(draws):
        found[k] = ridge(free, X, rng.normal(size=len(X)), len(X), np.array([0.05])).coefficients[0]
    C = path.unit_covariance(0)
    seen = np.cov(found.T)
    error = np.sqrt((C**2 + np.outer(np.diag(C), np.diag(C))) / draws)
    assert (np.abs(seen - C) < 5 * error).all()
