"""Marks of rows and groups of rows, and counting whether rows differ."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.row_marks import all_distinct, fingerprints, row_marks

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


def test_groups_of_the_same_rows_in_any_order() -> None:
    rng = np.random.default_rng(2)
    values = rng.standard_normal(1000)
    group = np.repeat(np.arange(4), 250)
    values[250:500] = rng.permutation(values[:250])
    values[500:750] = values[:250]
    values[749] += 1e-12
    marks = fingerprints([values], group, 4)
    assert (marks[0] == marks[1]).all()
    assert (marks[0] != marks[2]).any()
    assert (marks[0] != marks[3]).any()
    # A row more is another group, even if it is one that is there already.
    more = fingerprints([np.r_[values, values[0]]], np.r_[group, 0], 4)
    assert (more[0] != more[1]).any()


def test_rows_that_differ_are_counted() -> None:
    a, b = np.divmod(np.random.default_rng(3).permutation(N), 1000)
    columns = [(a, 101), (b, 1000)]
    assert all_distinct(columns, 200_000)
    assert not all_distinct(columns, 1000)
    a[5], b[5] = a[N - 1], b[N - 1]
    assert not all_distinct(columns, 200_000)
