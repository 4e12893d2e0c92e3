"""Faults of a whole file or column are told once: decimal commas, and units behind numbers."""

from __future__ import annotations

from pathlib import Path

import pytest
from csv_contract import SPEC, faults, table

from mtu_cli.errors import InputError
from mtu_cli.files.csv_cells import unit_in
from mtu_cli.files.csv_file import read_table

HEAD = "name,size,value\n"


def message(tmp_path: Path, content: str) -> str:
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "t.csv", "lbb", SPEC)
    return str(caught.value)


def test_decimal_commas_beside_numbers_with_points(tmp_path: Path) -> None:
    """One column was written by another program than the rest; some of its numbers are whole."""
    values = ["0,973", "-3,905", "5", "4,744", "6,763"]
    rows = "".join(f"a,{i}.0,{value}\n" for i, value in enumerate(values))
    assert message(tmp_path, HEAD + rows) == (
        "t.csv, row 2: more cells than columns: the numbers look like ones with decimal commas; "
        "expected semicolons between the columns, or decimal points, as this file has commas for "
        "both (and rows 3, 5 to 6)"
    )


def test_one_long_row_is_none_of_that(tmp_path: Path) -> None:
    rows = "".join(f"a,{i}.0,1\n" for i in range(9))
    (found,) = faults(tmp_path, f"{HEAD}{rows}a,1.0,3,5\n")
    assert found == ", row 11: a long row of 4 cells: 'a,1.0,3,5'; expected 3, as in the header"
    texts = "".join(f"a,{i}.0,1,b\n" for i in range(9))
    assert "a long row of 4 cells" in message(tmp_path, HEAD + texts)


def test_a_unit_behind_every_number_of_a_column(tmp_path: Path) -> None:
    rows = "".join(f"a,{i},{i}.25 mm\n" for i in range(9))
    assert message(tmp_path, HEAD + rows) == (
        "t.csv, row 2, column 'value': numbers with their unit, mm, in the cells; expected the "
        "numbers alone (and rows 3 to 10)"
    )
    few = f"{HEAD}a,1,2.5 mm\na,1,2\na,2,3\n"
    assert message(tmp_path, few) == (
        "t.csv, row 2, column 'value': not a number: '2.5 mm'; expected a number alone, without "
        "its unit"
    )
    semicolons = HEAD.replace(",", ";") + "".join(f"a;{i};{i},25mm\n" for i in range(9))
    assert "numbers with their unit, mm, in the cells" in message(tmp_path, semicolons)
    assert len(table(tmp_path, f"{HEAD}a,1,2\n")) == 1


@pytest.mark.parametrize(
    ("cell", "unit"),
    [
        ("50.0 mm", "mm"),
        ("-3,5\u00b5m", "\u00b5m"),
        (" 21 \u00b0C", "\u00b0C"),
        ("1e-6 um/m", "um/m"),
        ("mm", None),
        ("50.0", None),
        ("1e5", None),
        ("3 of 5", None),
        ("12:30", None),
    ],
)
def test_a_unit_in_a_cell(cell: str, unit: str | None) -> None:
    assert unit_in(cell) == unit
