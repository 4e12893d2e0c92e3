"""Points with a row for each axis, known by their cells where the column has a name of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.points import read_points


def told(folder: Path, cells: str) -> str:
    path = folder / "long.csv"
    rows = "".join(f"1;B1;{cell};20;20,001;mm\n" for cell in cells)
    path.write_text(f"part;feature;Property;Nominal;Actual;Unit\n{rows}", "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"B1": (20.0, 20.0, None)})
    return str(caught.value)


@pytest.mark.parametrize("cells", ["XYXY", "xyzx", "XYDX", "RTXY", "X" * 150 + "Y" * 150])
def test_a_column_of_axes_is_told_by_its_cells(tmp_path: Path, cells: str) -> None:
    found = told(tmp_path, cells)
    assert "column 'Property': the table has a row for each axis" in found
    assert "'Actual' of X in a column 'x_mm'" in found


@pytest.mark.parametrize("cells", ["XXXX", "XYKX", "DXRD"])
def test_other_cells_are_no_axes(tmp_path: Path, cells: str) -> None:
    assert "a row for each axis" not in told(tmp_path, cells)


def refused(folder: Path, content: str) -> str:
    path = folder / "t.csv"
    path.write_text(content, "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"B1": (20.0, 20.0, None)})
    return str(caught.value)


def test_a_separator_within_quotes_is_part_of_a_cell(tmp_path: Path) -> None:
    rows = "".join(f'1,"B1, left",{axis},20,20.001\n' for axis in "XYXY")
    found = refused(tmp_path, f"part,feature,Property,Nominal,Actual\n{rows}")
    assert "column 'Property': the table has a row for each axis" in found


@pytest.mark.parametrize("name", ["feature", "Feature", "Merkmal", "Operation"])
def test_features_may_be_called_as_axes_are(name: str, tmp_path: Path) -> None:
    rows = "".join(f"1;{cell};20,001\n" for cell in "XYZX")
    assert "a row for each axis" not in refused(tmp_path, f"part;{name};Actual\n{rows}")


def test_beside_features_another_word_for_them_may_be_of_axes(tmp_path: Path) -> None:
    rows = "".join(f"1;B1;{cell};20,001\n" for cell in "XYZX")
    found = refused(tmp_path, f"part;feature;Characteristic;Actual\n{rows}")
    assert "column 'Characteristic': the table has a row for each axis" in found


@pytest.mark.parametrize(
    ("names", "told"), [("x_pos;y_pos", False), ("XPos;YPos", False), ("dir_x;dir_y", True)]
)
def test_beside_coordinates_axes_are_of_approach(names: str, told: bool, tmp_path: Path) -> None:
    rows = "".join(f"1;B1;1;-1;{axis};20,001\n" for axis in "XYXY")
    found = refused(tmp_path, f"part;feature;{names};Anfahrachse;Messwert\n{rows}")
    assert ("a row for each axis" in found) == told
