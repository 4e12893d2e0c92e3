"""A text among the numbers of a column takes the column from every search: it is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.points import read_points

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
