"""Values in groups against plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.groups import distinct, filled_table, group_least, occurrence


@pytest.mark.parametrize(
    "codes",
    [np.array([7, 3, 7, 0]), np.array([-2, 5, -2]), np.array([10**12, 1]), np.array([0.5, 0.25])],
)
def test_codes_are_numbered_in_order(codes: np.ndarray) -> None:
    values, index = distinct(codes)
    assert values.tolist() == sorted(set(codes.tolist()))
    assert values[index].tolist() == codes.tolist()


def test_least_values_and_how_often_a_code_came_before() -> None:
    code = np.array([1, 0, 1, 3, 1])
    least = group_least(np.array([5.0, 2.0, 4.0, np.nan, 6.0]), code, 4)
    np.testing.assert_array_equal(least, [2.0, 4.0, np.inf, np.nan])
    assert occurrence(code).tolist() == [0, 0, 1, 0, 2]


def test_missing_cells_hold_the_mean_of_their_column_or_row() -> None:
    nan = np.nan
    table = np.array([[1.0, nan, nan], [3.0, 7.0, nan]])
    filled = filled_table(table, np.isfinite(table))
    assert filled.tolist() == [[1.0, 7.0, 1.0], [3.0, 7.0, 5.0]]
    whole = np.ones((2, 3, 2))
    assert filled_table(whole, np.ones((2, 3), bool)) is whole
