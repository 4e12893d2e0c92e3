"""The positive part of a difference of mean squares, against the generalised eigenproblem."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from mtu_cli.stats.positive_part import positive_part

FloatArray = NDArray[np.float64]


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


@pytest.mark.parametrize("slope_unit", [1e-6, 1e-3, 1e3])
def test_it_does_not_depend_on_units(slope_unit: float) -> None:
    S, M = np.array([[3.0, 0.4], [0.4, 0.9]]), np.array([[1.0, 0.1], [0.1, 0.8]])
    U = np.diag([1.0, slope_unit])
    D = positive_part(S, M, 1.5)
    other = positive_part(U @ S @ U, U @ M @ U, 1.5)
    np.testing.assert_allclose(np.linalg.inv(U) @ other @ np.linalg.inv(U), D, atol=1e-12)
    assert np.linalg.matrix_rank(D, tol=1e-12) == 1


def test_nothing_less_something_is_nothing() -> None:
    assert not positive_part(np.zeros((2, 2)), np.eye(2), 1.0).any()


def test_the_nearest_matrix_without_negative_eigenvalues() -> None:
    V = np.linalg.qr(np.random.default_rng(45).normal(size=(3, 3)))[0]
    found = positive_part(V @ np.diag([2.0, 0.5, -1.0]) @ V.T)
    assert found == pytest.approx(V @ np.diag([2.0, 0.5, 0.0]) @ V.T, abs=1e-12)
    assert (found == found.T).all()


def test_a_metric_that_rounding_made_singular() -> None:
    """As that of the powers of a high degree: Cholesky's factor breaks off."""
    s = np.array([1.0, 1e-8, 1e5])
    metric = (np.full((3, 3), 1.0 + 1e-9) - 1e-9 * np.eye(3)) * np.outer(s, s)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(metric)
    found = positive_part(5.0 * metric, metric, 2.0)
    np.testing.assert_allclose(found, 3.0 * metric, rtol=1e-6)
