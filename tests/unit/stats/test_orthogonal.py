"""Orthogonal factors: what defines them, and NumPy's own."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.orthogonal import orthonormal, triangle

EPS = np.finfo(float).eps
SHAPES = [(1, 1), (5, 1), (40, 3), (3, 3), (2, 5), (200, 40), (35, 70)]


def drawn(n: int, k: int) -> FloatArray:
    """Columns of very different sizes, one of them twice, in an order that LAPACK must copy."""
    rng = np.random.default_rng(n + 100 * k)
    Z = rng.normal(size=(n, k)) * 10.0 ** rng.uniform(-6, 6, k)
    if k > 2:
        Z[:, 2] = Z[:, 0]
    return Z


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(("n", "k"), SHAPES)
def test_a_triangle_has_the_squares_and_products_of_the_rows(n: int, k: int, order: str) -> None:
    Z = drawn(n, k)
    given = np.array(Z, order=order)  # type: ignore[call-overload]  # one of two letters
    R = triangle(given)
    size = np.linalg.norm(Z, axis=0)
    assert R.shape == (min(n, k), k)
    assert (np.tril(R, -1) == 0.0).all()
    # Backward stable: an error of n k eps of the columns' lengths (Higham 2002, theorem 19.4).
    assert (np.abs(R.T @ R - Z.T @ Z) <= 10 * n * k * EPS * np.outer(size, size)).all()
    np.testing.assert_array_equal(given, Z)


@pytest.mark.parametrize(("n", "k"), [shape for shape in SHAPES if shape[0] >= shape[1]])
def test_columns_are_orthonormal_and_give_the_rows_back(n: int, k: int) -> None:
    Z = drawn(n, k)
    Q, R = orthonormal(Z)
    size = np.linalg.norm(Z, axis=0)
    assert np.abs(Q.T @ Q - np.eye(k)).max() <= 10 * n * k * EPS
    assert (np.abs(Q @ R - Z) <= 10 * n * k * EPS * size).all()
    np.testing.assert_array_equal(R, triangle(Z))


@pytest.mark.parametrize(("n", "k"), SHAPES)
def test_they_are_those_of_numpy(n: int, k: int) -> None:
    Z = drawn(n, k)
    size = np.linalg.norm(Z, axis=0)
    assert (np.abs(triangle(Z) - np.linalg.qr(Z, mode="r")) <= 10 * n * k * EPS * size).all()


@pytest.mark.parametrize(("n", "k"), [(0, 0), (4, 0), (0, 4)])
def test_of_nothing_there_is_nothing_and_nothing_is_said(
    n: int, k: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert triangle(np.zeros((n, k))).shape == (0, k)
    assert capfd.readouterr() == ("", "")
