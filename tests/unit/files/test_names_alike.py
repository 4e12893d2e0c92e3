"""Parts and features whose names are one number in several ways are told once."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.points import read_points


def told(folder: Path, rows: list[str]) -> list[str]:
    path = folder / "cmm.csv"
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm\n"
    path.write_text(head + "".join(f"{row},1,2,1,{i}\n" for i, row in enumerate(rows)), "utf-8")
    notes = read_points([(path, "cmm")], None).notes
    return [note.message for note in notes if note.code == "names-alike"]


def test_one_number_in_several_ways_is_told(tmp_path: Path) -> None:
    (message,) = told(tmp_path, ["1,A", "2,A", "01,A", "1.0,A", "7,A"])
    assert message == (
        "cmm.csv, row 4, column 'part': '1' and '01' and '1.0': the same number, counted as "
        "different parts; give it one name if one is meant"
    )
    (message,) = told(tmp_path, ["A,0", "A,00", "A,3", "B,3"])
    assert message.startswith("cmm.csv, row 3, column 'feature': '0' and '00': the same number")
    (message,) = told(tmp_path, [f"{z}{i},A" for i in range(1, 6) for z in ("", "0")])
    assert "'3' and '03', and 2 more such: the same number" in message


@pytest.mark.parametrize(
    "names", [("1", "10"), ("1.1", "1.10"), ("P1", "P01"), ("1", "-1"), ("1e1", "10"), ("1", "1a")]
)
def test_other_names_are_not(names: tuple[str, str], tmp_path: Path) -> None:
    assert not told(tmp_path, [f"{name},A" for name in names])
