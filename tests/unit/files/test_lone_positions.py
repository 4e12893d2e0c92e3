"""Positions that are mistyped."""

from __future__ import annotations

from pathlib import Path

from test_blank_directions import table, told
from test_readings_file import MACHINE

from mtu_cli.files.readings import read_readings


def test_a_mistyped_position(tmp_path: Path) -> None:
    rows = table()
    assert told(tmp_path, rows) == []
    rows[4][1] = "30"
    assert told(tmp_path, rows) == [
        "r.csv, row 6, column 'position_mm': dx_x at 30 mm, where no other pass reads it, but none "
        "of this pass at 300 mm, where the others do: look whether the position is mistyped"
    ]
    (note,) = read_readings([(tmp_path / "r.csv", "lbb")], MACHINE, for_fit=True).notes
    assert note.facts.get("about", ()) == ("dx_x",)
    rows[11][1] = "7"
    assert len(told(tmp_path, rows)) == 2


def test_positions_that_are_no_slips(tmp_path: Path) -> None:
    """One more place in a pass, a pass that was cut short, places that differ from pass to pass,
    two passes alone.
    """
    rows = table()
    assert (
        told(tmp_path, [*rows[:6], ["dx_x", "330", "1", "forward", "0.4", "um"], *rows[6:]]) == []
    )
    assert told(tmp_path, [*rows[:3], *rows[6:]]) == []
    jittered = [[row[0], f"{float(row[1]) + i:g}", *row[2:]] for i, row in enumerate(rows)]
    assert told(tmp_path, jittered) == []
    two = [row for row in table(2) if row[3] == "forward"]
    two[1][1] = "70"
    assert told(tmp_path, two) == []


def test_three_passes_one_way_tell_where_they_read(tmp_path: Path) -> None:
    """Of three the place that one lacks is read by the two others; of two nobody knows which of
    both places is right.
    """
    rows = [row for row in table(3) if row[3] == "forward"]
    rows[7][1] = "70"
    (text,) = told(tmp_path, rows)
    assert "row 9, column 'position_mm': dx_x at 70 mm, where" in text
    assert "none of this pass at 75 mm, where the others do" in text
    assert told(tmp_path, rows[:12]) == []


def test_more_than_a_few_places_alone_are_no_slips(tmp_path: Path) -> None:
    rows = table(10)
    for i in (1, 14, 27):
        rows[i][1] = f"{float(rows[i][1]) + 1:g}"
    assert len(told(tmp_path, rows)) == 3
    rows[40][1] = "7"
    assert told(tmp_path, rows) == []


def test_where_some_places_are_read_one_way_alone_nothing_is_said(tmp_path: Path) -> None:
    rows = [row for row in table(4) if row[3] == "forward" or row[1] != "150"]
    rows[4][1] = "30"
    assert told(tmp_path, rows) == []


def test_a_place_that_a_third_of_the_passes_read_is_not_where_they_read(tmp_path: Path) -> None:
    rows = [row for row in table(3) if row[3] == "forward"]
    for i, place in ((2, "110"), (8, "120"), (14, "130")):
        rows[i][1] = place
    assert told(tmp_path, rows) == []


def test_of_many_passes_two_may_lack_a_place(tmp_path: Path) -> None:
    """Two slips at one place: three quarters of the passes read it, if not all of them but one."""
    rows = [row for row in table(10) if row[3] == "forward"]
    rows[2][1], rows[8][1] = "110", "120"
    assert len(told(tmp_path, rows)) == 2
