"""Headers of other programs: what to rename is told, nothing is lost by its spelling."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.points import read_points
from mtu_cli.files.readings import SPEC as READINGS

POINTS = "P1,A,10.001,10.002,1\n"


def refused(tmp_path: Path, header: str, row: str = POINTS) -> list[str]:
    path = tmp_path / "t.csv"
    path.write_text(f"{header}\n{row}", "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    return str(caught.value).splitlines()


def test_columns_of_a_measuring_program_are_told_one_by_one(tmp_path: Path) -> None:
    lines = refused(tmp_path, "Serial,Hole,X,Y,Rep")
    pairs = ("Serial", "part"), ("Hole", "feature"), ("X", "x_mm"), ("Y", "y_mm"), ("Rep", "repeat")
    assert len(lines) == len(pairs)
    for line, (other, name) in zip(lines, pairs, strict=True):
        assert f"rename {other!r} to {name!r}" in line


@pytest.mark.parametrize(
    ("column", "name"),
    [("Repeat", "repeat"), ("dir_X", "dir_x"), ("Sequence", "sequence"), ("Time", "time"),
     ("Nominal X mm", "nominal_x_mm"), ("TimeMin", "time_min")],
)  # fmt: skip
def test_an_optional_column_is_not_lost_by_its_spelling(
    column: str, name: str, tmp_path: Path
) -> None:
    (line,) = refused(tmp_path, f"part,feature,x_mm,y_mm,{column}")
    assert f"column {column!r}" in line
    assert f"rename {column!r} to {name!r}" in line


def test_readings_too(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("component,error,unit,Direction,Pass\ndx,1,um,+,1\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, "lbb", READINGS)
    assert "'Direction'" in str(caught.value)
    assert "'Pass'" in str(caught.value)


@pytest.mark.parametrize("column", ["direction_x", "T_02_degC", "operator", "time_of_day", "load"])
def test_other_columns_stay_covariates(column: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"part,feature,x_mm,y_mm,{column}\n{POINTS}", "utf-8")
    found = read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert column in found.covariates


def test_beside_the_column_itself_another_spelling_may_stay(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("part,feature,x_mm,y_mm,repeat,Repeat\nP1,A,10.001,10.002,1,7\n", "utf-8")
    assert "Repeat" in read_points([(path, "cmm")], {"A": (10.0, 10.0, None)}).covariates


def test_a_text_of_the_time_beside_minutes_may_stay(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("part,feature,x_mm,y_mm,time_min,Time\nP1,A,10.001,10.002,1,noon\n", "utf-8")
    read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
