"""Tables wider than what there is: columns below each other, and nothing cut off."""

from __future__ import annotations

import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from mtu_cli.reports.table_groups import Extent, Group, groups
from mtu_cli.reports.tables import Column, Sheet, plain_text

NAME = Extent(wanted=8, least=8, names=True)
TEN = Extent(wanted=10, least=10)

extents = st.builds(
    lambda least, more, begins: Extent(wanted=least + more, least=least, begins=begins),
    st.integers(1, 30),
    st.integers(0, 40),
    st.booleans(),
)


def shown_at(sheet: Sheet, width: int) -> str:
    """What a terminal of this width receives, without its colours."""
    out = io.StringIO()
    Console(file=out, force_terminal=True, width=width).print(sheet, crop=False)
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())


def test_side_by_side_where_there_is_room() -> None:
    assert groups([NAME, TEN, TEN], 32) == [Group(columns=(0, 1, 2), widths=(8, 10, 10), gap=2)]
    assert groups([NAME, TEN, TEN], 30) == [Group(columns=(0, 1, 2), widths=(8, 10, 10), gap=1)]


def test_what_folds_does_so_before_columns_stand_below_each_other() -> None:
    long = Extent(wanted=40, least=12, names=True)
    assert groups([long, TEN, TEN], 60)[0].widths == (38, 10, 10)
    middle = Extent(wanted=20, least=12)
    # The widest first, down to the others; never below the least.
    assert groups([long, middle, TEN], 52)[0].widths == (20, 20, 10)
    assert groups([long, middle, TEN], 36)[0].widths == (12, 12, 10)


def test_groups_repeat_the_names() -> None:
    found = groups([NAME, TEN, TEN, TEN], 30)
    assert [group.columns for group in found] == [(0, 1, 2), (0, 3)]
    assert [group.width for group in found] == [30, 20]


def test_a_group_rather_ends_before_what_begins() -> None:
    first = Extent(wanted=10, least=10, begins=True)
    found = groups([NAME, first, TEN, TEN, first, TEN, TEN], 63)
    assert [group.columns for group in found] == [(0, 1, 2, 3), (0, 4, 5, 6)]
    # Also where there is room for no more than what ends there.
    found = groups([NAME, first, TEN, first, TEN, first, TEN], 52)
    assert [group.columns for group in found] == [(0, 1, 2, 3, 4), (0, 5, 6)]


def test_a_column_without_room_beside_the_names_is_whole_all_the_same() -> None:
    assert [group.width for group in groups([NAME, TEN, TEN], 12)] == [19, 19]


@given(st.lists(extents, min_size=1, max_size=9), st.integers(1, 120))
def test_no_column_is_lost_or_narrower_than_its_least(columns: list[Extent], width: int) -> None:
    every = [NAME, *columns]
    found = groups(every, width)
    assert [i for group in found for i in group.columns[1:]] == list(range(1, len(every)))
    assert all(group.columns[0] == 0 for group in found)
    for group in found:
        own = [every[i] for i in group.columns]
        assert all(e.least <= w <= e.wanted for e, w in zip(own, group.widths, strict=True))
        least = sum(item.least for item in own) + len(own) - 1
        assert group.width <= width or len(own) == 2 or group.width == least
        assert group.width <= max(width, least)


SHEET = Sheet(
    title="Errors",
    columns=[
        Column(title="feature\n", text=True, folds=True),
        Column(title="of\n", text=True),
        *(Column(title=f"value {i}\num") for i in range(9)),
    ],
    rows=[
        ["bore_of_the_flange_04", "x", *(f"-12{i}.4 ± 5.6" for i in range(9))],
        ["b", "y", *["1"] * 9],
    ],
    notes=["a note"],
)


@pytest.mark.parametrize("width", [10, 20, 34, 60, 80, 90, 100, 200])
def test_no_digit_and_no_name_is_lost_on_any_terminal(width: int) -> None:
    shown = shown_at(SHEET, width)
    for i in range(9):
        assert f"-12{i}.4 ± 5.6" in shown
        assert f"value {i}" in shown
    heads = [line for line in shown.splitlines() if line.startswith("feature")]
    assert len(heads) == shown.count("bore_of_the_") > 1
    if width >= 34:
        assert max(map(len, shown.splitlines())) <= min(width, 100)


def test_a_pipe_has_the_same_groups() -> None:
    blocks = plain_text([SHEET]).split("\n\n")
    assert len(blocks) == 2
    assert blocks[0].startswith("Errors\nfeature")
    assert blocks[1].startswith("feature")
    assert blocks[1].endswith("a note\n")
    assert max(map(len, plain_text([SHEET]).splitlines())) <= 100


def test_numbers_that_name_a_row_are_repeated_as_names_are() -> None:
    numbers = [Column(title=f"n{i}") for i in range(2)]
    wide = Sheet(
        title="t",
        columns=[Column(title="repeat", names=True), *numbers],
        rows=[["17", "1" * 70, "2" * 70]],
    )
    assert plain_text([wide]).count("17") == 2
    # The first column names the row where no text does.
    bare = Sheet(title="t", columns=[Column(title="round"), *numbers], rows=wide.rows)
    assert plain_text([bare]).count("17") == 2
