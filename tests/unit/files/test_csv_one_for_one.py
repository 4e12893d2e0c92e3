"""Columns of other programs: one of them is offered for one that is missing, and for no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.points import SPEC, read_points
from mtu_cli.files.readings import SPEC as READINGS


def refused(folder: Path, header: str) -> list[str]:
    path = folder / "t.csv"
    path.write_text(f"{header}\n{','.join('1' * (header.count(',') + 1))}\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, "cmm", SPEC)
    return str(caught.value).splitlines()


def test_what_is_one_missing_column_is_not_offered_for_another(tmp_path: Path) -> None:
    part, feature = refused(tmp_path, "Lot,Pos,x_mm,y_mm")
    assert "expected 'Pos' renamed to 'feature'" in feature
    assert "expected a column 'part' (the columns are Lot, Pos, x_mm, y_mm)" in part


def test_what_may_be_either_is_told_once(tmp_path: Path) -> None:
    part, feature = refused(tmp_path, "Lot,Bezeichnung,x_mm,y_mm")
    either = "'Bezeichnung' may be it or the column 'feature', renamed"
    assert part.endswith(f"expected a column 'part': {either}")
    assert "expected a column 'feature' (the columns are Lot, Bezeichnung, x_mm, y_mm)" in feature
    part, feature = refused(tmp_path, "Name,Bohrung,x_mm,y_mm")
    assert part.endswith("expected a column 'part': 'Name' may be it, renamed")
    assert feature.endswith("expected 'Bohrung' renamed to 'feature'")


@pytest.mark.parametrize(
    ("header", "other", "name"),
    [
        ("part,feature,X basic,x_mm,y_mm", "X basic", "nominal_x_mm"),
        ("part,feature,basic_y,x_mm,y_mm", "basic_y", "nominal_y_mm"),
        ("part,feature,BasicY,x_mm,y_mm", "BasicY", "nominal_y_mm"),
        ("WST,feature,x_mm,y_mm", "WST", "part"),
        ("part,Bhrg.,x_mm,y_mm", "Bhrg.", "feature"),
        ("part,feature,X gem.,y_mm", "X gem.", "x_mm"),
        ("part,feature,x_mm,y_mm,Rpt", "Rpt", "repeat"),
        ("part,feature,x_mm,y_mm,Rpt No", "Rpt No", "repeat"),
    ],
)
def test_more_words_are_known(header: str, other: str, name: str, tmp_path: Path) -> None:
    (line,) = refused(tmp_path, header)
    assert f"expected {other!r} renamed to {name!r}" in line


@pytest.mark.parametrize(
    ("column", "told"),
    [("Cycle", 1), ("cycles", 1), ("Zyklus", 1), ("Cycle no", 1), ("Durchgang", 1),
     ("cycle_id", 0), ("cycle_time", 0)],
)  # fmt: skip
def test_cycles_of_points_may_be_their_repeats(column: str, told: int, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    head = "part,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm"
    path.write_text(f"{head},{column}\nP,A,1,1,1,1,1\nP,A,1,1,1,1,2\n", "utf-8")
    notes = read_points([(path, "cmm")], None).notes
    words = f"the column {column!r} is not used as 'repeat': rename it where it numbers these"
    assert sum(words in note.message for note in notes) == told
    path.write_text(f"{head},{column},repeat\nP,A,1,1,1,1,1,1\nP,A,1,1,1,1,2,2\n", "utf-8")
    assert not any("'repeat'" in note.message for note in read_points([(path, "cmm")], None).notes)


@pytest.mark.parametrize("column", ["Cycle", "Zyklus", "cycle_id"])
def test_a_cycle_of_readings_names_a_warm_up(column: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(f"component,error,unit,{column}\ndx,1,um,1\n", "utf-8")
    with pytest.raises(InputError, match=f"{column!r} renamed to 'cycle'"):
        read_table(path, "lbb", READINGS)
