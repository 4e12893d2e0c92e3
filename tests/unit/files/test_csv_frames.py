"""Reading in blocks gives what reading in one piece gives, whatever the block's size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import csv_frames
from mtu_cli.files.points import Points, read_points

HEADER = "part,feature,operation,x_mm,y_mm,nominal_x_mm,nominal_y_mm,note,T_a_degC\n"


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
