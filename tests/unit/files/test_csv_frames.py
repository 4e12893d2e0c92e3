"""Reading in blocks gives what reading in one piece gives, whatever the block's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import csv_file, csv_frames
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_table import ProblemList
from mtu_cli.files.points import SPEC, Points, read_points

HEADER = "part,feature,operation,x_mm,y_mm,nominal_x_mm,nominal_y_mm,note,T_a_degC\n"


@pytest.fixture(autouse=True)
def every_table_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast reader first, whatever the size; commands read small files with the slow one."""
    monkeypatch.setattr(csv_file, "SMALL", 0)


def row(i: int) -> str:
    """Part numbers with leading zeros, notes with line ends in quotes, empty cells, blanks."""
    note = f'"line {i}\n, next"' if i % 7 == 0 else ("" if i % 5 else f"n{i % 3}")
    blank = "\n" if i % 11 == 0 else ""
    return f"{i % 13:03d},{i},drilled,{i}.25,{-i}.5,{i},{-i},{note},{20 + i % 3}\n{blank}"


def read(tmp_path: Path, text: str) -> Points:
    path = tmp_path / "cmm.csv"
    path.write_text(text)
    return read_points([(path, "cmm")], None)


def same(one: Points, other: Points) -> None:
    assert (one.parts, one.features, one.operations) == (
        other.parts, other.features, other.operations,
    )  # fmt: skip
    for name in ("part", "feature", "operation", "measured", "nominal", "row"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name, column in one.covariates.items():
        np.testing.assert_array_equal(column, other.covariates[name])


@pytest.mark.parametrize("size", [1, 40, 333, 5000])
@pytest.mark.parametrize("threads", [1, 3])
def test_any_block_size(
    tmp_path: Path, size: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = HEADER + "".join(row(i) for i in range(200))
    whole = read(tmp_path, text)
    assert whole.parts[:3] == ("000", "001", "002")
    assert len(whole) == 200
    assert (whole.measured[:, 0] == np.arange(200) + 0.25).all()
    assert whole.covariates["note"][0] == "line 0\n, next"
    monkeypatch.setattr(csv_frames, "_BLOCK", size)
    monkeypatch.setattr(csv_frames, "_PIECE", max(1, size // 3))
    monkeypatch.setattr("os.cpu_count", lambda: threads)
    same(whole, read(tmp_path, text))


def test_labels_that_look_like_numbers_stay_as_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_frames, "_BLOCK", 30)
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm\n"
    found = read(
        tmp_path, head + "".join(f"{p},1e1,1,1,1,1\n" for p in ("007", "7", "7.0", "True"))
    )
    assert found.parts == ("007", "7", "7.0", "True")
    assert found.features == ("1e1",)


@pytest.mark.parametrize(
    "line", ["P,f,1,2,3\n", "P,f,1,2,3,4,5\n", "P,f,1,2,3,4,\n", "P,f,1,x,3,4\n"]
)
@pytest.mark.parametrize("at", [0, 50, 99])
def test_a_fault_in_any_block_is_told_with_its_row(
    tmp_path: Path, line: str, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_frames, "_BLOCK", 64)
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm\n"
    rows = [f"P{i},f,1,2,1,2\n" for i in range(100)]
    rows[at] = line
    with pytest.raises(InputError) as caught:
        read(tmp_path, head + "".join(rows))
    assert f"row {at + 2}" in str(caught.value)


@pytest.mark.parametrize("order", [1, -1])
def test_a_longer_row_does_not_make_up_for_a_shorter_one(tmp_path: Path, order: int) -> None:
    """Separators count right in all, and the last column may be empty."""
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,T_a_degC\n"
    longer, shorter = ["P1,f,1,2,1,2,20,21\n", "P2,f,1,2,1,2\n"][::order]
    with pytest.raises(InputError) as caught:
        read(tmp_path, head + longer + "P3,f,1,2,1,2,20\n" + shorter)
    assert {problem.row for problem in caught.value.findings} == {2, 4}


@pytest.mark.parametrize("size", [20, 1000])
def test_whole_numbers_and_others_in_one_column(
    tmp_path: Path, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a column that no contract names, pandas finds the type block by block."""
    monkeypatch.setattr(csv_frames, "_BLOCK", size)
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,load\n"
    cells = ["1", "-2", "", "0.5", "9007199254740993", "1e3"]
    rows = [f"P{i},f,1,2,1,2,{cell}\n" for i, cell in enumerate(cells)]
    found = read(tmp_path, head + "".join(rows)).covariates["load"]
    np.testing.assert_array_equal(found, [float(cell or "nan") for cell in cells])


@pytest.mark.parametrize("cell", ["18446744073709551616", "-9223372036854775809", "9" * 300])
@pytest.mark.parametrize("beside", [[], ["1"], ["0.5", ""]])
def test_whole_numbers_beyond_64_bits_are_numbers(
    tmp_path: Path, cell: str, beside: list[str]
) -> None:
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,load\n"
    cells = [cell, *beside]
    rows = [f"P{i},f,1,2,1,2,{value}\n" for i, value in enumerate(cells)]
    found = read(tmp_path, head + "".join(rows)).covariates["load"]
    np.testing.assert_array_equal(found, [float(value or "nan") for value in cells])


@pytest.mark.parametrize("cells", [["\t", "\t"], ["", " "], ["1", "\t"], [" ", "-2.5"]])
@pytest.mark.parametrize("fault", ["", "P9,f,1\n"])
def test_blank_cells_are_empty_cells(tmp_path: Path, cells: list[str], fault: str) -> None:
    """A column of nothing else is one of numbers that are not given, however it is read."""
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,load\n"
    rows = [f"P{i},f,1,2,1,2,{cell}\n" for i, cell in enumerate(cells)]
    (tmp_path / "p.csv").write_text(head + "".join(rows) + fault)
    problems = ProblemList()
    found = read_table(tmp_path / "p.csv", "cmm", SPEC, problems)
    assert len(problems.listed) == (fault != "")
    wanted = [float(cell.strip() or "nan") for cell in cells]
    np.testing.assert_array_equal(found.columns.numbers["load"], wanted)


@pytest.mark.parametrize("cell", ["1e999", "-1e999", "inf", "nan", ""])
@pytest.mark.parametrize("column", ["x_mm", "T_a_degC"])
@pytest.mark.parametrize("beside", ["1", ""])
def test_numbers_that_are_not_finite(tmp_path: Path, cell: str, column: str, beside: str) -> None:
    """None is let through, be it with empty cells beside it; only a covariate may be empty."""
    head = "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,T_a_degC\n"
    x, temperature = (cell, "20") if column == "x_mm" else ("1", cell)
    text = f"{head}P1,f,1,2,1,2,{beside}\nP2,f,{x},2,1,2,{temperature}\n"
    if cell == "" and column == "T_a_degC":
        assert np.isnan(read(tmp_path, text).covariates[column][1])
        return
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert [(p.row, p.column) for p in caught.value.findings] == [(3, column)]
