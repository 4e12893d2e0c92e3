"""Ridge paths against the closed form, and columns that add nothing."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.compressed import compress
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.ridge import ridge

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
    of_free = free.T @ (y - X @ path.coefficients[i]) / (n / 2)
    assert path.intercepts[i] == pytest.approx(of_free, rel=1e-9)
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
