"""A text among the numbers of a column takes the column from every search: it is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files import csv_stream
from mtu_cli.files.mixed_cells import of_names
from mtu_cli.files.points import read_points
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings

PLACES = {"A": (10.0, 10.0, None)}


def told(tmp_path: Path, cells: list[str], sign: str = ",", name: str = "wear") -> list[str]:
    path = tmp_path / "c.csv"
    rows = "".join(f"{i}{sign}A{sign}10{sign}10{sign}{cell}\n" for i, cell in enumerate(cells))
    head = sign.join(("part", "feature", "x_mm", "y_mm", name))
    path.write_text(f"{head}\n{rows}", "utf-8")
    return [
        n.message for n in read_points([(path, "cmm")], PLACES).notes if n.code == "cells-mixed"
    ]


@pytest.mark.parametrize(("sign", "cell"), [(",", "0.5"), (";", "0,5")])
def test_a_text_among_numbers_is_told(tmp_path: Path, sign: str, cell: str) -> None:
    (text,) = told(tmp_path, [cell] * 12 + ["n/a"] + [cell] * 7, sign)
    assert text.startswith("c.csv, row 14, column 'wear': 'n/a' among numbers makes the column")
    (text,) = told(tmp_path, ["x", *[cell] * 18, "y"], sign)
    assert text.startswith("c.csv, row 2, column 'wear': 'x' and 1 more among numbers")


@pytest.mark.parametrize(
    "cells",
    [["1"] * 20, ["a"] * 20, ["1"] * 17 + ["a", "b", "c"], ["1"] * 19 + [""], ["1"] * 8 + ["a"]],
    ids=["numbers", "names", "names among which some are numbers", "a gap", "few"],
)
def test_what_is_of_one_kind_is_not(tmp_path: Path, cells: list[str]) -> None:
    assert told(tmp_path, cells) == []


def test_names_of_the_contract_may_be_numbers(tmp_path: Path) -> None:
    assert told(tmp_path, ["1"] * 19 + ["drill"], name="operation") == []


def test_a_column_is_told_once_by_its_row_or_as_one_of_names(tmp_path: Path) -> None:
    for names in range(4):
        cells = ["0.5"] * (20 - names) + ["n/a"] * names
        assert of_names([*cells, ""]) == (names > 2)
        assert bool(told(tmp_path, cells)) == (0 < names <= 2)


def test_readings_too_as_a_whole_and_in_blocks(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    rows = "".join(f"axy,{i},um,{'x' if i == 4 else i}\n" for i in range(20))
    path.write_text(f"component,error,unit,load\n{rows}", "utf-8")
    whole = read_readings([(path, "lbb")], None, for_fit=False)
    (block,) = stream_readings([(path, "lbb")], None)
    assert block.notes == whole.notes
    (text,) = [item.message for item in whole.notes if item.code == "cells-mixed"]
    assert text.startswith("r.csv, row 6, column 'load': 'x' among numbers")


def test_a_column_is_that_of_all_files(tmp_path: Path) -> None:
    """Two texts are few of all cells, if not of those of their own file; three are many."""
    for names in (2, 3):
        files = []
        for number, cells in enumerate((["0.5"] * 16, ["0.5"] * (4 - names) + ["n/a"] * names)):
            rows = "".join(f"{number}{i},A,10,10,{cell}\n" for i, cell in enumerate(cells))
            (tmp_path / f"{number}.csv").write_text(f"part,feature,x_mm,y_mm,wear\n{rows}", "utf-8")
            files.append((tmp_path / f"{number}.csv", "cmm"))
        points = read_points(files, PLACES)
        found = [item.message for item in points.notes if item.code == "cells-mixed"]
        assert of_names(map(str, points.covariates["wear"])) == (names == 3)
        assert len(found) == (names == 2)
        assert all(
            text.startswith("1.csv, row 4, column 'wear': 'n/a' and 1 more") for text in found
        )


def test_a_column_of_several_blocks_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for size in ("_BLOCK", "_PIECE"):
        monkeypatch.setattr(csv_stream, size, 1 << 12)
    path = tmp_path / "r.csv"
    count = 2000
    rows = (f"axy,{i % 97},um,{'x' if i in (7, count - 1) else i % 13}\n" for i in range(count))
    path.write_text("component,error,unit,load\n" + "".join(rows), "utf-8")
    blocks = list(stream_readings([(path, "lbb")], None))
    assert len(blocks) > 1
    (note,) = [note for block in blocks for note in block.notes]
    assert note.message.startswith("r.csv, row 9, column 'load': 'x' and 1 more among numbers")


def test_empty_cells_are_none_of_the_numbers(tmp_path: Path) -> None:
    """Of 19 cells that are given two are more than a tenth, whatever is empty beside them."""
    cells = ["0.5"] * 17 + ["n/a"] * 2
    assert of_names(cells)
    assert told(tmp_path, cells + [""] * 20) == []
    assert len(told(tmp_path, ["0.5", *cells] + [""] * 20)) == 1
