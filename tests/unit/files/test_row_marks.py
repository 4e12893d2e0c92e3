"""Marks of rows and groups of rows, and counting whether rows differ."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.row_marks import all_distinct, row_marks

N = 100_003
"""More than one block, and no whole number of them."""


def test_equal_rows_have_equal_marks_and_others_differ() -> None:
    rng = np.random.default_rng(1)
    numbers, codes = rng.standard_normal(N), rng.integers(-1, 50, N).astype(np.int32)
    marks = row_marks([numbers, codes])
    assert len(np.unique(marks)) == N
    numbers[-1], codes[-1] = numbers[0], codes[0]
    again = row_marks([numbers, codes])
    assert again[-1] == again[0] == marks[0]
    assert (again[:-1] == marks[:-1]).all()
    assert row_marks([np.array([0.0])]) == row_marks([np.array([-0.0])])
    # The same values in another column are another row.
    assert row_marks([np.array([1.0]), np.array([2.0])]) != row_marks(
        [np.array([2.0]), np.array([1.0])]
    )


def test_rows_that_differ_are_counted() -> None:
    a, b = np.divmod(np.random.default_rng(3).permutation(N), 1000)
    columns = [(a, 101), (b, 1000)]
    assert all_distinct(columns, 200_000)
    assert not all_distinct(columns, 1000)
    a[5], b[5] = a[N - 1], b[N - 1]
    assert not all_distinct(columns, 200_000)
