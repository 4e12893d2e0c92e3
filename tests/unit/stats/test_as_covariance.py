"""Covariances from matrices that need not be any."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.positive_part import as_covariance

SCALES = np.array([1e-3, 40.0])


@pytest.mark.parametrize("r", [-1.0, -0.3, 0.0, 0.9, 1.0])
def test_a_covariance_stays_as_it_is(r: float) -> None:
    C = np.array([[1.0, r], [r, 1.0]]) * np.outer(SCALES, SCALES)
    assert as_covariance(C).tobytes() == C.tobytes()


@pytest.mark.parametrize("r", [-7.0, -1.001, 1.001, 3.0])
def test_of_two_the_correlation_is_one_at_most(r: float) -> None:
    C = np.array([[1.0, r], [r, 1.0]]) * np.outer(SCALES, SCALES)
    full = np.array([[1.0, np.sign(r)], [np.sign(r), 1.0]]) * np.outer(SCALES, SCALES)
    np.testing.assert_allclose(as_covariance(C), full, rtol=1e-12)


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


def test_what_has_no_variance_has_no_covariance() -> None:
    C = np.array([[0.0, 1e-20, 0.0], [0.0, 4.0, 1.0], [0.0, 1.0, 1.0]])
    expected = np.array([[0.0, 0.0, 0.0], [0.0, 4.0, 1.0], [0.0, 1.0, 1.0]])
    np.testing.assert_array_equal(as_covariance(C), expected)


def test_what_is_not_known_stays_unknown() -> None:
    C = np.array([[1.0, np.nan], [np.nan, 1.0]])
    np.testing.assert_array_equal(as_covariance(C), C)
