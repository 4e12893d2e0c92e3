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


@pytest.mark.parametrize("cells", ["XYXY", "xyzx"])
def test_a_column_of_axes_is_told_by_its_cells(tmp_path: Path, cells: str) -> None:
    found = told(tmp_path, cells)
    assert "column 'Property': the table has a row for each axis" in found
    assert "'Actual' of X in a column 'x_mm'" in found


@pytest.mark.parametrize("cells", ["XXXX", "XYDX"])
def test_other_cells_are_no_axes(tmp_path: Path, cells: str) -> None:
    assert "a row for each axis" not in told(tmp_path, cells)
