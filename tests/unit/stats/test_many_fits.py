"""Many small fits at once against the one least-squares routine."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.least_squares import least_squares
from mtu_cli.stats.many_fits import beside, squares_left

RNG = np.random.default_rng(1)


def test_what_is_left_is_that_of_one_fit_after_the_other() -> None:
    B, z = RNG.normal(size=(7, 9, 3)), RNG.normal(size=9)
    np.testing.assert_allclose(
        squares_left(B, z), [least_squares(own, z).rss for own in B], rtol=1e-12
    )


def test_columns_that_depend_on_others_explain_nothing_more() -> None:
    B, z = RNG.normal(size=(3, 6, 2)), RNG.normal(size=6)
    B[0, :, 1] = 0.0
    B[1, :, 1] = -2.0 * B[1, :, 0]
    B[2, :, 1] = 1e-14 * B[2, :, 1]
    wanted = [least_squares(own[:, :1], z).rss for own in B]
    np.testing.assert_allclose(squares_left(B, z), wanted, rtol=1e-12)


def test_a_column_of_rounding_takes_nothing_from_those_after_it() -> None:
    B, z = RNG.normal(size=(3, 6, 2)), RNG.normal(size=6)
    B[0, :, 0] = 0.0
    B[1, :, 0] = 1e-14 * B[1, :, 1]
    B[2, :, 0] *= 1e-14
    wanted = [least_squares(own[:, 1:], z).rss for own in B]
    np.testing.assert_allclose(squares_left(B, z), wanted, rtol=1e-12)


def test_columns_beside_others_fit_as_all_together() -> None:
    rows = RNG.normal(size=(20, 7))
    left = beside(rows, 3)
    assert left.shape == (4, 4)
    whole = least_squares(rows[:, :-1], rows[:, -1])
    apart = least_squares(left[:, :-1], left[:, -1])
    assert np.isclose(apart.rss, whole.rss, rtol=1e-12)
    np.testing.assert_allclose(apart.coefficients, whole.coefficients[3:], rtol=1e-10)
    # Of fewer rows than columns nothing is left that others could explain.
    assert beside(rows[:3], 3).shape == (0, 4)
