"""Marks of rows and groups of rows, and counting whether rows differ."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.files.byte_count import count_byte
from mtu_cli.files.row_marks import AllMarks, all_distinct, fingerprints, row_marks

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


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("first_bits", [0, 1, 2, 3])
def test_marks_that_stand_twice(
    first_bits: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One pair of equal marks, in different blocks and whichever bits they start with."""
    monkeypatch.setattr("os.cpu_count", lambda: threads)
    rng = np.random.default_rng(first_bits)
    marks = np.unique(rng.integers(0, 2**64, 5000, dtype=np.uint64))
    rng.shuffle(marks)
    own = np.flatnonzero(marks >> np.uint64(62) == first_bits)
    for twice in (False, True):
        if twice:
            marks[own[-1]] = marks[own[0]]
        held = AllMarks()
        for block in np.array_split(marks, 7):
            held.add(block)
        assert held.any_twice() == twice
    assert not AllMarks().any_twice()


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


@pytest.mark.parametrize("start", [0, 1, 300_000, 700_001])
def test_bytes_are_counted(start: int) -> None:
    content = b"a,b\n" * 175_000 + b","
    assert count_byte(content, ord(","), start) == content.count(b",", start)
