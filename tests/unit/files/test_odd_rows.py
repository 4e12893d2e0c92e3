"""Rows among the measured ones that hold no measurement are one fault, told as what they are."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_points_file import HEAD, faults, read

SOUND = "a,h1,0,0,1\na,h2,0,0,1\n"
HEADER = f"{HEAD},repeat\n"


@pytest.mark.parametrize(
    ("row", "told"),
    [
        (
            ",,[mm],[mm],",
            "p0.csv, row 2: a row of units: '[mm] [mm]'; expected rows of values: the",
        ),
        ("-,-,mm,\u00b5m,-", "p0.csv, row 2: a row of units: '- - mm \u00b5m -'; expected rows of"),
    ],
)
def test_a_row_of_units_below_the_header(row: str, told: str, tmp_path: Path) -> None:
    (found,) = faults(tmp_path, f"{HEADER}{row}\n{SOUND}")
    assert found.startswith(told)


def test_a_row_of_units_stands_below_the_header_alone(tmp_path: Path) -> None:
    found = faults(tmp_path, f"{HEADER}{SOUND},,[mm],[mm],\n")
    assert found
    assert not any("a row of units" in item for item in found)


@pytest.mark.parametrize(
    "row", ["Mittelwert,,3.1,2.2,", ",,Summe:,,", "Mean,3.1,2.2", "M\u00e9dia,,0,0,1,,"]
)
def test_a_row_of_totals(row: str, tmp_path: Path) -> None:
    (found,) = faults(tmp_path, f"{HEADER}{SOUND}{row}\n")
    word = next(cell for cell in row.split(",") if cell)
    assert found == (
        f"p0.csv, row 4: a row that sums up others: {word!r}; expected rows of values alone"
    )


def test_totals_with_a_value_in_every_cell(tmp_path: Path) -> None:
    (found,) = faults(tmp_path, f"{HEADER}{SOUND}Mittelwert,h1,3.1,2.2,1\n")
    assert found == (
        "p0.csv, row 4, column 'part': a row that sums up others: 'Mittelwert'; expected rows of "
        "measured parts alone"
    )


def test_words_of_totals_in_columns_of_their_own_are_values(tmp_path: Path) -> None:
    """A covariate may say which kind of value a row holds; so may a note in one that lacks none."""
    rows = "a,h1,0,0,1,mean\na,h2,0,0,1,range\n"
    assert len(read(tmp_path, f"{HEAD},repeat,kind\n{rows}")) == 2


def test_rows_in_quotes(tmp_path: Path) -> None:
    quoted = "".join(f'"{row}"\n' for row in SOUND.splitlines())
    assert faults(tmp_path, HEADER + quoted) == [
        f"p0.csv, row {row}: the whole row stands in quotes; expected quotes around single cells "
        "alone" for row in (2, 3)
    ]  # fmt: skip
