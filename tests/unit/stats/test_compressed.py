"""Compressed rows against the rows themselves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mtu_cli.stats.compressed import compress, together
from mtu_cli.stats.least_squares import FloatArray, least_squares


def rows(n: int, seed: int = 1) -> FloatArray:
    """A constant, three unlike columns and a target."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 3)) * [1.0, 1e-3, 1e4] + [20.0, 0.0, 1e4]
    y = X @ [0.3, 50.0, 2e-5] + rng.normal(size=n)
    return np.column_stack([np.ones(n), X, y])


@pytest.mark.parametrize("n", [1, 2, 4, 5, 6, 400])
def test_the_factor_holds_all_inner_products(n: int) -> None:
    Z = rows(n)
    found = compress(Z)
    expected = Z.T @ Z
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(found.factor.T @ found.factor - expected).max() <= 1e-13 * size.max()
    assert (np.abs(found.factor.T @ found.factor - expected) <= 1e-13 * size).all()
    assert len(found.factor) <= Z.shape[1]
    assert (found.n, found.pairs) == (n, n - 1)


def test_lag_products_by_a_plain_loop() -> None:
    Z = rows(30)
    plain = np.zeros((5, 5))
    for before, after in pairwise(Z):
        plain += np.outer(before, after)
    assert compress(Z).lag == pytest.approx(plain, rel=1e-12)


def test_pieces_together_in_any_order_and_grouping() -> None:
    Z = rows(97)
    ends = [0, 1, 3, 30, 31, 97]
    pieces = [compress(Z[a:b]) for a, b in pairwise(ends)]
    left = together(pieces)
    right = together([together(pieces[3:]), together(pieces[:3][::-1])])
    for found in (left, right):
        assert found.factor.T @ found.factor == pytest.approx(Z.T @ Z, rel=1e-12)
        assert found.n == 97
        assert found.pairs == 97 - len(pieces)
    # Consecutive rows of two pieces are no pair: four products are missing.
    missing = sum(np.outer(Z[b - 1], Z[b]) for b in ends[1:-1])
    assert left.lag + missing == pytest.approx(compress(Z).lag, rel=1e-12)
    assert right.lag == pytest.approx(left.lag, rel=1e-12)


def test_columns_transforms_rows_and_their_lag() -> None:
    Z = rows(40)
    T = np.random.default_rng(3).normal(size=(5, 2))
    found, direct = compress(Z).columns(T), compress(Z @ T)
    assert found.factor.T @ found.factor == pytest.approx(direct.factor.T @ direct.factor, rel=1e-9)
    assert found.lag == pytest.approx(direct.lag, rel=1e-9)
    assert (found.n, found.pairs) == (40, 39)


def test_sensors_that_move_together_keep_their_digits() -> None:
    """Columns 1e-6 apart, then blocks through each other: what least squares sees of the rows."""
    rng = np.random.default_rng(7)
    t = rng.normal(size=(900, 1)).cumsum(axis=0)
    X = 6 + t + 1e-6 * rng.normal(size=(900, 3))
    Z = np.column_stack([np.ones(900), X, X @ [1.0, -3.0, 2.5] + 1e-7 * rng.normal(size=900)])
    known = compress(Z[:300])
    for block in (Z[300:600], Z[600:]):
        known = together([known, compress(block)])
    fit = least_squares(known.factor[:, :4], known.factor[:, 4])
    direct = least_squares(Z[:, :4], Z[:, 4])
    # A condition number of 1e7 costs seven of fifteen digits, however it is done.
    assert fit.coefficients[1:] == pytest.approx(direct.coefficients[1:], rel=1e-6)
    assert fit.rss == pytest.approx(direct.rss, rel=1e-6)
