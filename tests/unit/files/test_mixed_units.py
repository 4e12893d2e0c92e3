"""Components whose rows carry several units: taken, with a warning."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files import csv_stream
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings

HEAD = "component,position_mm,time_min,error,unit"
UM = [f"dx_x,{i},{i},{i / 8},um" for i in range(40)]


def written(tmp_path: Path, *tables: list[str], role: str = "lbb") -> list[tuple[Path, str]]:
    files = []
    for index, rows in enumerate(tables):
        path = tmp_path / f"r{index}.csv"
        path.write_text("\n".join([HEAD, *rows]) + "\n")
        files.append((path, role))
    return files


def told(files: list[tuple[Path, str]]) -> list[str]:
    notes = read_readings(files, None, for_fit=False).notes
    return [note.message for note in notes if note.code == "units-mixed"]


def test_each_component_of_several_units_has_a_warning(tmp_path: Path) -> None:
    rows = [*UM[:3], "dx_x,3,3,1,nm", "dx_x,4,4,1,nm", *UM[5:], "axy,,0,1,arcsec", "axy,,1,1,urad"]
    assert told(written(tmp_path, rows)) == [
        "r0.csv, row 5, column 'unit': dx_x is given in um (38 rows) and in nm (2 rows); each row "
        "is read in its own unit: look whether nm is meant there",
        "r0.csv, row 43, column 'unit': axy is given in arcsec (1 row) and in urad (1 row); each "
        "row is read in its own unit: look whether urad is meant there",
    ]


def test_of_three_units_the_rarest_is_shown(tmp_path: Path) -> None:
    rows = [*UM, "dx_x,40,40,1,mm", "dx_x,41,41,1,nm", "dx_x,42,42,1,nm"]
    (text,) = told(written(tmp_path, rows))
    assert text.startswith("r0.csv, row 42, ")
    assert "in um (40 rows), nm (2 rows) and in mm (1 row);" in text


def test_files_of_one_instrument_are_one(tmp_path: Path) -> None:
    (text,) = told(written(tmp_path, UM, ["dx_x,0,50,3,nm"]))
    assert text.startswith("r1.csv, row 2, column 'unit': dx_x is given in um (40 rows) and in nm")


def test_two_instruments_have_their_own_units(tmp_path: Path) -> None:
    (bar, _), (laser, _) = written(tmp_path, UM, ["dx_x,0,50,3,nm"])
    assert not told([(bar, "lbb"), (laser, "laser")])


def test_two_names_of_one_unit_are_one(tmp_path: Path) -> None:
    assert not told(written(tmp_path, ["axy,,0,1,urad", "axy,,1,2,um/m", *UM]))


@pytest.mark.parametrize("size", [200, 1 << 20])
def test_drift_readings_are_told_of_with_the_last_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(csv_stream, "_BLOCK", size)
    monkeypatch.setattr(csv_stream, "_PIECE", 100)
    rows = [row.replace("um", "nm") if 20 <= i < 25 else row for i, row in enumerate(UM)]
    files = written(tmp_path, rows, role="drift")
    blocks = list(stream_readings(files, None))
    assert len(blocks) > 1 or size > 200
    assert [note.message for note in blocks[-1].notes] == told(files)
    assert [note.code for block in blocks for note in block.notes] == ["units-mixed"]
    assert "row 22, column 'unit': dx_x is given in um (35 rows) and in nm (5 rows)" in str(blocks)
