"""Columns of order, time and direction under other programs' names: told where cells fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from mtu_cli.files.points import read_points
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings

ROWS = tuple((part, feature) for part in ("P1", "P2", "P3", "P4") for feature in "AB")
PLACES = dict.fromkeys("AB", (10.0, 10.0, None))
DAY = "2024-05-03"


def told(tmp_path: Path, columns: dict[str, Sequence[object]], code: str) -> list[str]:
    """What is said of columns of points of four parts with two features each."""
    path = tmp_path / "p.csv"
    lines = [",".join(["part", "feature", "x_mm", "y_mm", *columns])]
    for i, (part, feature) in enumerate(ROWS):
        cells = [str(column[i]) for column in columns.values()]
        lines.append(",".join([part, feature, f"10.00{i}", f"9.99{i}", *cells]))
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return [n.message for n in read_points([(path, "cmm")], PLACES).notes if n.code == code]


def unused(tmp_path: Path, name: str, cells: Sequence[object], **others: Sequence[object]) -> str:
    """What is said of one column, nothing or one message."""
    found = [
        message
        for message in told(tmp_path, {name: cells, **others}, "column-not-used")
        if message.startswith(f"p.csv, row 1: the column {name!r} ")
    ]
    assert len(found) <= 1
    return found[0].partition(f" the column {name!r} is not used as ")[2] if found else ""


SHUFFLED = [3, 3, 1, 1, 4, 4, 2, 2]
MADE = "'sequence': rename it where it is the order in which the parts were made"


@pytest.mark.parametrize(
    "name",
    ["Lfd. Nr.", "lfd. Nr.", "lfd Nr", "LfdNr", "Laufende Nummer", "Laufnr.", "Nr.", "N", "No.",
     "Nummer", "Index", "Order", "Build order", "build_no", "Order of manufacture", "Order no.",
     "run order", "Fertigungsfolge", "Machining order"],
)  # fmt: skip
def test_an_order_of_parts_that_is_not_the_files_is_told(name: str, tmp_path: Path) -> None:
    assert unused(tmp_path, name, SHUFFLED) == MADE


@pytest.mark.parametrize(
    "cells",
    [
        [1, 1, 2, 2, 3, 3, 4, 4],  # which is what counts without a sequence
        [1, 2, 1, 2, 1, 2, 1, 2],  # numbers of features
        [25, 25, 25, 25, 25, 25, 25, 25],  # probing points
        [12, 12, 8, 8, 12, 12, 12, 12],
        [1, 2, 3, 4, 5, 6, 7, 8],  # rows, in the order of the file
        [3.5, 3.5, 1, 1, 4, 4, 2, 2],
        [3, 3, 1, 1, 4, 4, "", ""],
        ["c", "c", "a", "a", "d", "d", "b", "b"],
    ],
)
@pytest.mark.parametrize("name", ["Nr.", "N", "Order", "Lfd. Nr."])
def test_numbers_that_tell_no_other_order_stay_columns_of_their_own(
    name: str, cells: Sequence[object], tmp_path: Path
) -> None:
    assert unused(tmp_path, name, cells) == ""


@pytest.mark.parametrize("name", ["Load", "Pallet Nr.", "Machining", "Work order name", "Build"])
def test_other_names_are_no_order(name: str, tmp_path: Path) -> None:
    assert unused(tmp_path, name, SHUFFLED) == ""


def test_two_parts_are_in_an_order_by_chance(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text("part,feature,x_mm,y_mm,Nr.\nP1,A,10,10,2\nP2,A,10,10.1,1\n", "utf-8")
    assert not read_points([(path, "cmm")], PLACES).notes


def test_gaps_count_where_the_name_says_order(tmp_path: Path) -> None:
    gaps = [1, 1, 2, 2, 5, 5, 6, 6]
    assert unused(tmp_path, "Build order", gaps) == MADE
    assert unused(tmp_path, "Nr.", gaps) == ""


@pytest.mark.parametrize("name", ["Lfd. Nr.", "N"])
def test_numbers_of_rows_are_no_sequence_but_tell_one(name: str, tmp_path: Path) -> None:
    """Renamed as they stand they would give a part two numbers, which is refused."""
    assert unused(tmp_path, name, [5, 6, 1, 2, 7, 8, 3, 4]) == (
        "'sequence': where it tells the order in which the parts were made, give all rows of a "
        "part one number in a column of that name"
    )


def test_beside_a_sequence_an_order_is_another(tmp_path: Path) -> None:
    assert unused(tmp_path, "Lfd. Nr.", SHUFFLED, sequence=SHUFFLED) == ""


CLOCK = ["08:15", "8:16", "09:00:30", "9:20", "10:01", "10:05", "11:10", "11:12"]


def test_a_time_of_day_is_no_time(tmp_path: Path) -> None:
    for name in ("Uhrzeit", "Clock", "time of day", "Heure"):
        assert unused(tmp_path, name, CLOCK) == (
            "'time': write the date before it (2024-05-03T08:15) where it tells when"
        )
    assert "write the date of 'Datum' before it" in unused(
        tmp_path, "Uhrzeit", CLOCK, Datum=[DAY] * 8
    )


@pytest.mark.parametrize(
    "cell", [f"{DAY}T08:15", f"{DAY} 08:15:00", "3.5.2024 08:15", "5/3/24 8:15"]
)
@pytest.mark.parametrize("name", ["Datum", "Uhrzeit", "Date/Time", "date"])
def test_dates_with_times_are_times_under_another_name(
    name: str, cell: str, tmp_path: Path
) -> None:
    assert unused(tmp_path, name, [cell] * 8) == (
        "'time': rename it where it tells when, year, month and day first (2024-05-03T08:15)"
    )


@pytest.mark.parametrize(
    ("name", "cells"),
    [("Datum", [DAY] * 8), ("Uhrzeit", range(8)), ("Uhrzeit", ["early", *CLOCK[1:]]),
     ("Schicht", CLOCK), ("Uhrzeit", [""] * 8)],
)  # fmt: skip
def test_what_is_no_time_of_day_stays_a_column_of_its_own(
    name: str, cells: Sequence[object], tmp_path: Path
) -> None:
    assert unused(tmp_path, name, cells) == ""


@pytest.mark.parametrize("name", ["Minute", "Minutes", "Minuten", "elapsed minutes"])
def test_minutes_are_told(name: str, tmp_path: Path) -> None:
    wanted = "'time_min': rename it where it counts minutes from one start"
    assert unused(tmp_path, name, range(0, 80, 10)) == wanted
    assert unused(tmp_path, name, range(-10, 70, 10)) == ""
    assert unused(tmp_path, name, [5] * 8) == ""
    assert unused(tmp_path, name, ["five"] * 8) == ""
    assert unused(tmp_path, name, range(8), Stunde=range(8)) == ""
    assert unused(tmp_path, name, range(8), time_min=range(8)) == ""
    assert unused(tmp_path, f"{name} of load", range(8)) == ""


@pytest.mark.parametrize(
    "name",
    ["Anfahrrichtung X", "Approach X", "approach_x", "ApproachX", "Approach dir. x", "Anfahrt X",
     "Approach direction X", "X-Achse Anfahrrichtung", "Richtung_x"],
)  # fmt: skip
@pytest.mark.parametrize("cells", [(1, -1), ("+", "-"), ("+1", "-1"), ("pos", "Neg")])
def test_approaches_are_directions(name: str, cells: Sequence[object], tmp_path: Path) -> None:
    wanted = "'dir_x': rename it where it is the direction along x, -1 or +1"
    assert unused(tmp_path, name, [*cells] * 4) == wanted
    assert unused(tmp_path, name, [*cells] * 4, dir_x=[1] * 8) == ""


@pytest.mark.parametrize("cells", [(250, 300), ("left", "right"), ("", "")])
def test_other_cells_are_no_directions(cells: Sequence[object], tmp_path: Path) -> None:
    for name in ("Approach X", "Anfahrrichtung"):
        assert unused(tmp_path, name, [*cells] * 4) == ""


@pytest.mark.parametrize("name", ["Anfahrrichtung", "Approach direction", "Richtung"])
@pytest.mark.parametrize("cells", [(1, -1), ("+", "-"), ("+X", "-Y"), ("x+", "y -")])
def test_a_direction_without_its_axis_is_told(
    name: str, cells: Sequence[object], tmp_path: Path
) -> None:
    wanted = "'dir_x': -1 or +1 along x stand in 'dir_x', those along y in 'dir_y'"
    assert unused(tmp_path, name, [*cells] * 4) == wanted
    assert unused(tmp_path, name, [*cells] * 4, dir_y=[1] * 8) == ""


@pytest.mark.parametrize("role", ["lbb", "drift"])
def test_times_of_readings_too(role: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    rows = "".join(f"a,{i},um,{cell},{i}\n" for i, cell in enumerate(CLOCK))
    path.write_text(f"component,error,unit,Uhrzeit,Nr.\n{rows}", "utf-8")
    whole = read_readings([(path, role)], None, for_fit=False).notes
    (note,) = whole
    assert note.message == (
        "r.csv, row 1: the column 'Uhrzeit' is not used as 'time': write the date before it "
        "(2024-05-03T08:15) where it tells when"
    )
    (block,) = stream_readings([(path, role)], None)
    assert block.notes == whole
