"""Faulty CSV tables: every fault with its file, row, column, value and what was expected."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from csv_contract import SPEC, faults, names, table

from mtu_cli.errors import InputError
from mtu_cli.files import csv_file
from mtu_cli.files.contract_errors import number_expectation
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_table import LISTED_PROBLEMS
from mtu_cli.files.csv_text import CELL_LIMIT
from mtu_cli.files.points import SPEC as POINTS


@pytest.fixture(autouse=True)
def every_table_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast reader first, whatever the size; commands read small files with the slow one."""
    monkeypatch.setattr(csv_file, "SMALL", 0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "name,val\na,1\n",
            [", row 1: the column 'value' is missing; expected 'val' renamed to 'va"],
        ),
        (
            "Name,value\na,1\n",
            [", row 1: the column 'name' is missing; expected 'Name' renamed to"],
        ),
        (
            "x,y\na,1\n",
            [
                "column 'name' is missing; expected a column 'name' (the columns are x, y)",
                "'value'",
            ],
        ),
        ("name,value,,size,\na,1,,,\n", ["row 1: columns 3, 5 have no name; expected a name"]),
        ("#\nname,value,c,value\n", [", row 2, column 'value': the column stands twice, as colu"]),
        ("name\tvalue\na\t1\n", ["the columns are separated by tabs: 'name\\tvalue'; expected co"]),
        ("name value\na 1\n", ["the columns are separated by spaces"]),
        ("name|value\na|1\n", ["the columns are separated by '|'"]),
        ("name,value\n", [": holds a header but no rows"]),
        ("# only\n\n", [": holds no header and no rows"]),
        ("<html><body>Login</body>", ["looks like a web page"]),
    ],
)
def test_faulty_headers(tmp_path: Path, content: str, words: list[str]) -> None:
    found = faults(tmp_path, content)
    assert len(found) == len(words)
    for line, part in zip(found, words, strict=True):
        assert part in line


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("a", ", row 3: a short row of 1 cell: 'a'; expected 3, as in the header"),
        ("a,1", ", row 3: a short row of 2 cells: 'a,1'; expected 3"),
        ("a,1,2,x", ", row 3: a long row of 4 cells: 'a,1,2,x'; expected 3, as in the header"),
        (
            "a,1,2,",
            ", row 3: ',' too many at the end of the row; expected 3 cells, as in the header",
        ),
        (
            "a,1,2, ,",
            ", row 3: 2 ',' too many at the end of the row; expected 3 cells, as in the h",
        ),
        (
            "a,1.5,2,1,7",
            ", row 3: a long row of 5 cells: 'a,1.5,2,1,7'; expected 3, as in the header",
        ),
        ("a,1,5,2", "do the numbers have decimal commas? Then separate columns by semicolons"),
        (",,", ", row 3: all cells are empty"),
        (",1,2", ", row 3, column 'name': empty cell; expected a text"),
        (" ,1,2", ", row 3, column 'name': empty cell; expected a text"),
        ("a,,2", ", row 3, column 'value': empty cell; expected a number"),
        ("a,x,2", ", row 3, column 'value': not a number: 'x'; expected a number"),
        ("a,12 um,2", "not a number: '12 um'; expected a number alone, without its unit"),
        ('a,"1,5",2', "not a number: '1,5'; expected a number with a decimal point"),
        ('a,"1,234.5",2', "'1,234.5'; expected a number without thousands separators"),
        ("a,1 234,2", "'1 234'; expected a number without thousands separators"),
        ("a,−5,2", "expected a number with a plain minus sign (-)"),
        ("a,nan,2", ", row 3, column 'value': not finite: 'nan'; expected a finite number"),
        ("a,NA,2", ", row 3, column 'value': not a number: 'NA'; expected a number"),
        ("a,-Inf,2", "not finite: '-Inf'; expected a finite number"),
        ("a,1e999,2", "too large: '1e999'; expected at most 1e+12 in size"),
        (f"a,{'7' * 5000},2", "too large: '777777"),
        ("a,True,2", "not a number: 'True'; expected a number"),
        ("a,1_000,2", "not a number: '1_000'; expected a number"),
        ("a,0x10,2", "not a number: '0x10'; expected a number in decimal digits"),
        ("a,-0b11,2", "not a number: '-0b11'; expected a number in decimal digits"),
        ("a,0x10 um,2", "not a number: '0x10 um'; expected a number alone, without its unit"),
        ("a,\uff11.5,2", "not a number: '\uff11.5'; expected a number in the digits 0 to 9"),
        ("a,\u0661,2", "expected a number in the digits 0 to 9"),
        ('a,1,"2', ", row 3: a quote that opens in this row is never closed"),
        ("a,1,inf", ", row 3, column 'size': not finite: 'inf'; expected a finite number"),
    ],
)
def test_faulty_rows(tmp_path: Path, row: str, words: str) -> None:
    found = faults(tmp_path, f"name,value,size\na,1,2\n{row}\n")
    assert len(found) == 1
    assert words in found[0]


def test_a_covariate_that_is_too_large(tmp_path: Path) -> None:
    (found,) = faults(tmp_path, "name,value,size,load\na,1,2,3\na,1,2,-1e400\n")
    words = "row 3, column 'load': too large: '-1e400'; expected a smaller number, or an empty cell"
    assert words in found
    assert "nan'; expected a finite" in faults(tmp_path, "name,value,load\na,1,1\na,1,nan\n")[-1]


def test_an_empty_cell_is_offered_where_no_row_needs_the_cell(tmp_path: Path) -> None:
    table = "name,value,size,T_a_degC\na,1,2,20\na,1,{},{}\n"
    (found,) = faults(tmp_path, table.format("n/a", 20))
    assert found.endswith("column 'size': not a number: 'n/a'; expected a number")
    for cell, words in (("-", "'-'; expected a"), ("nan", "'nan'; expected a finite")):
        (found,) = faults(tmp_path, table.format(2, cell))
        assert found.endswith(f"{words} number, or an empty cell")


@pytest.mark.parametrize(
    ("cell", "expected"),
    [("x" * 200_000, "a table of numbers and names"), ('"' + "x" * 200_000, "a closing")],
)
def test_a_cell_without_end_is_not_always_an_open_quote(
    tmp_path: Path, cell: str, expected: str
) -> None:
    (found,) = faults(tmp_path, f'name,value,size\n"a\nb",1,2\n{cell},1,2\n')
    assert found.startswith(", row 4: a cell has more than 131072 characters; expected " + expected)


@pytest.mark.parametrize("separator", [",", ";"])
@pytest.mark.parametrize(
    "cell", ["1" * 60_000 + "x", "1" * 60_000 + "e", '"1.' + "1" * 60_000 + '\nx"', "1m" * 50_000]
)
def test_a_very_long_cell_costs_nothing(tmp_path: Path, separator: str, cell: str) -> None:
    """Digits that could belong to two parts of a number would be cut in all ways."""
    start = time.process_time()
    head, row = (line.replace(",", separator) for line in ("name,value,size\n", f"a,{cell},2\n"))
    (found,) = faults(tmp_path, head + row)
    assert found.startswith(", row 2, column 'value': not a number: ")
    assert time.process_time() - start < 5.0


def test_a_table_whose_line_ends_are_lost(tmp_path: Path) -> None:
    """All of it is one header then, of very many columns."""
    start = time.process_time()
    found = faults(tmp_path, "name,value," + ",".join(str(i // 2) for i in range(40_000)))
    assert len(found) == 20_000
    assert found[0].endswith("column '0': the column stands twice, as column 3 and 4")
    # To look each name up in the list of all would take several times as long.
    assert time.process_time() - start < 3.2


@pytest.mark.parametrize("fault", ["", "b,x,2\n"])
@pytest.mark.parametrize(
    "row",
    [
        f"{'a' * (CELL_LIMIT + 1)},1,2",
        f"a,1.{'0' * CELL_LIMIT},2",
        f"a,1,2{' ' * CELL_LIMIT}",
        f'"{"a" * CELL_LIMIT}b",1,2',
        f'"{"ab" * (CELL_LIMIT // 4)}{chr(10) * (CELL_LIMIT // 2)}b",1,2',
        f"{'a,1,2' + chr(10)}{'b' * (CELL_LIMIT + 1)},1,2{chr(10)}c,1,2",
    ],
    ids=["text", "number", "spaces", "quoted", "lines", "between"],
)
def test_a_cell_that_no_cell_is_as_long_as(tmp_path: Path, row: str, fault: str) -> None:
    """Refused by both ways of reading, not only where another cell is at fault."""
    (found,) = faults(tmp_path, f"name,value,size\n{row}\n{fault}")
    assert found.startswith(f", row {2 + row.startswith('a,1,2' + chr(10))}: a cell has more than")
    assert "131072 characters" in found


@pytest.mark.parametrize("cells", [f"{'a' * CELL_LIMIT},1,2", f"a,{' ' * (CELL_LIMIT - 1)}1,2"])
def test_a_cell_that_is_as_long_as_it_may_be(tmp_path: Path, cells: str) -> None:
    assert names(table(tmp_path, f"name,value,size\n{cells}\n"))


@pytest.mark.parametrize(
    ("rows", "row"),
    [
        ('"open,1,2\na,1,2\n"open,1,2\n', 2),
        ('"a"b,1,2\n', 2),
        ('a,1,2\n"a" ,1,2\n', 3),
        ('a,1,"2"x"3"\n', 2),
    ],
)
def test_a_quote_encloses_a_whole_cell_or_is_told(tmp_path: Path, rows: str, row: int) -> None:
    """The parser of sound tables takes these: rows between two quotes would be part of a cell."""
    (found,) = faults(tmp_path, f"name,value,size\n{rows}")
    assert found.startswith(f", row {row}: a cell cannot be read")


@pytest.mark.parametrize(
    ("rows", "label"),
    [
        ('"a",1,2\n', "a"),
        ('"a"",""b",1,""\n', 'a","b'),
        ('"""",1,2\r\n', '"'),
        ('a"b"c,1,"2"\n', 'a"b"c'),
        ('"a\nb",1,"2"', "a\nb"),
    ],
)
def test_quotes_that_are_well_placed(tmp_path: Path, rows: str, label: str) -> None:
    assert names(table(tmp_path, f"name,value,size\n{rows}")) == [label]


def test_all_bad_cells_are_collected_and_counted(tmp_path: Path) -> None:
    content = "name,value,size\n" + "a,1,2\n" * 3 + ",x,y\n" + "a,z\n" + "a,1,2\n" + "b,,q\n"
    assert [line.split(":")[0] for line in faults(tmp_path, content)] == [
        ", row 5, column 'name'",
        ", row 5, column 'value'",
        ", row 5, column 'size'",
        ", row 6",
        ", row 8, column 'value'",
        ", row 8, column 'size'",
    ]
    many = LISTED_PROBLEMS + 5000
    (tmp_path / "m.csv").write_text("name,value\n" + "a,x\n" * many)
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "m.csv", "lbb", SPEC)
    assert len(caught.value.findings) + caught.value.uncounted == many
    assert str(caught.value).splitlines() == [
        "m.csv, row 2, column 'value': not a number: 'x'; expected a number "
        f"(and rows 3 to {LISTED_PROBLEMS + 1})",
        "... and 5000 more",
    ]


def test_short_rows_are_not_filled(tmp_path: Path) -> None:
    assert faults(tmp_path, "name,value,shift\na,1,x\nb,2\n") == [
        ", row 3: a short row of 2 cells: 'b,2'; expected 3, as in the header"
    ]
    # A long row makes up for a short one in the count of separators.
    found = faults(tmp_path, "name,value,shift\na,1,x,\nb,2\n")
    assert [line.split(":")[0] for line in found] == [", row 2", ", row 3"]
    quoted = faults(tmp_path, 'name,value,shift\r\n"a",1,x,\r\n"b, c",2\r\n')
    assert [line.split(":")[0] for line in quoted] == [", row 2", ", row 3"]
    empty_last = table(tmp_path, "name,value,shift\na,1,\nb,2,x\n\nc,3,\n")
    assert names(empty_last, "shift") == ["", "x", ""]


@pytest.mark.parametrize(
    ("header", "rows", "told"),
    [
        (";", ",", ["a,1.5,2", "b,2.5,3"]),
        (",", ";", ["a;1.5;2", "b;2.5;3"]),
        (",", ";", ["a;1,5;2", "b;2,5;3"]),
    ],
)
def test_mixed_separators_are_told_as_what_they_are(
    tmp_path: Path, header: str, rows: str, told: list[str]
) -> None:
    """As short rows they would be told one by one."""
    content = "\n".join([header.join(["name", "value", "size"]), *told * 10, ""])
    signs = {",": "commas", ";": "semicolons"}
    words = f"the separators of the columns are mixed: {signs[rows]} here, {signs[header]} in the "
    with pytest.raises(InputError) as caught:
        table(tmp_path, content)
    assert str(caught.value) == (
        f"t.csv, row 2: {words}header; expected the same ones in all rows (and rows 3 to 21)"
    )


def test_a_short_row_with_decimal_commas_is_a_short_row(tmp_path: Path) -> None:
    (found,) = faults(tmp_path, "name;value;size\na;1,5;2,5\nb,x;1,5\n")
    assert "a short row of 2 cells" in found


def test_decimal_commas_and_points_are_not_mixed(tmp_path: Path) -> None:
    content = "name;value;c\na;1,5;2,5\nb;1,25;3\nc;1.5;4\n"
    assert faults(tmp_path, content) == [
        ", row 4, column 'value': not a number: '1.5'; "
        "expected a number with a decimal comma, as in the rest of the file"
    ]
    found = faults(tmp_path, "name;value;c\na;1,5;2.5\nb;1,25;3\n")
    assert found == [
        ", row 2, column 'c': not a number as the others are: '2.5'; "
        "expected a finite number with a decimal comma, or an empty cell"
    ]


def test_covariates_are_numbers_texts_or_faults(tmp_path: Path) -> None:
    head = "name,value,c,T_a_degC\n"
    read = table(tmp_path, head + "a,1,1,\na,2,,2\na,3,2.5,3\n")
    np.testing.assert_array_equal(read.columns.numbers["c"], [1, np.nan, 2.5])
    assert names(table(tmp_path, head + "a,1,1,1\na,2,1.50,2\na,3,x,3\n"), "c") == [
        "1",
        "1.50",
        "x",
    ]
    assert names(table(tmp_path, head + "a,1,True,1\na,2,FALSE,2\n"), "c") == ["True", "FALSE"]
    assert names(table(tmp_path, head + "a,1,NA,1\na,2,b,2\n"), "c") == ["NA", "b"]
    late = head + "a,1,007,1\n" * 50 + "a,2,b,2\n"
    assert names(table(tmp_path, late), "c") == ["007"] * 50 + ["b"]
    assert (
        "row 3, column 'c': not finite: 'nan'" in faults(tmp_path, head + "a,1,1,1\na,2,nan,2\n")[0]
    )
    assert (
        "row 3, column 'c': not finite: 'inf'" in faults(tmp_path, head + "a,1,1,1\na,2,inf,2\n")[0]
    )
    assert "row 2, column 'T_a_degC': not a number: 'x'" in faults(tmp_path, head + "a,1,1,x\n")[0]


def test_digits_of_other_scripts_are_told_apart_from_other_signs() -> None:
    signs = [chr(i) for i in range(0x80, sys.maxunicode + 1) if chr(i).isdecimal()]
    assert len(signs) > 500
    for sign in signs:
        assert number_expectation(f"1{sign}5").endswith("in the digits 0 to 9"), hex(ord(sign))
    for other in ("\u00b2", "\u00bd", "\u2160", "\u00e9", "\u4e00"):
        assert number_expectation(f"1{other}5") == "a number"


def test_a_header_that_stands_again_is_one_fault(tmp_path: Path) -> None:
    rows = "a,1\nb,2\n"
    found = faults(tmp_path, f"name,value\n{rows}name, value\n{rows}")
    assert len(found) == 1
    assert ", row 4: the header again, as in a table that was pasted again" in found[0]


ISO = "an ISO 8601 time such as 2024-05-03T14:30:00"
MINUTES = f"{ISO} or, where these are minutes, the column renamed to 'time_min'"
WHOLE_DAYS = (
    f"{MINUTES}; or, where these are serial days of a spreadsheet, the first of them "
    "2023-03-15T00:00, give the column a date format there"
)
SERIAL = (
    f"{ISO}: these look like serial days of a spreadsheet, the first of them 2023-03-15T00:00; "
    "give the column a date format there"
)
SINCE_1970 = f"{ISO}: these look like {{}} since 1970, the first of them 2024-05-03T14:30:00"


@pytest.mark.parametrize(
    ("cells", "row", "expected"),
    [
        ("0 12.5 25", 2, MINUTES),
        ("0 25", 2, MINUTES),
        ("45000 45000.5 45001.25", 2, SERIAL),
        # Whole numbers may be seconds of a day, or minutes of a month.
        ("45000 45001 45002", 2, WHOLE_DAYS),
        ("1714746600 1714746610 1714746620", 2, SINCE_1970.format("seconds")),
        ("1714746600000 1714746610000", 2, SINCE_1970.format("milliseconds")),
        ("08:15 8:20:30 11:05", 2, f"{ISO}: the date is to stand before the time of day"),
        ("3.5.2024 03.05.24 4.5.2024", 2, f"{ISO}: year, month and day in this order, with hyph"),
        ("2024/5/3 2024/05/04", 2, f"{ISO}: year, month and day in this order, with hyphens"),
        # Beside dates, minutes are none.
        ("2024-05-03 1 2 3", 3, f"{ISO}: these are plain numbers"),
    ],
)
def test_times_that_are_none_for_one_reason_are_one_fault(
    cells: str, row: int, expected: str, tmp_path: Path
) -> None:
    given = cells.split()
    bad = given[row - 2 :]
    rows = "".join(f"a,1,2,3,{cell}\n" for cell in given)
    path = tmp_path / "t.csv"
    path.write_text(f"part,feature,x_mm,y_mm,time\n{rows}")
    with pytest.raises(InputError) as caught:
        read_table(path, "cmm", POINTS)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(
        f"t.csv, row {row}, column 'time': {len(bad)} of {len(given)} cells are no times (rows "
        f"{row} to {len(given) + 1}): {bad[0]!r}; expected {expected}"
    )


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        # Odd ones among dates are told one by one.
        (["2024-05-03", "45000.5", "2024-05-04"], {3: ISO}),
        (["12", "2024-05-03", "13"], {2: ISO, 4: ISO}),
        (["noon", "evening", "late"], {2: ISO, 3: ISO, 4: ISO}),
        (["7"], {2: MINUTES}),
    ],
)
def test_odd_times_are_told_one_by_one(
    cells: list[str], told: dict[int, str], tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    rows = "".join(f"a,1,2,3,{cell}\n" for cell in cells)
    path.write_text(f"part,feature,x_mm,y_mm,time\n{rows}")
    with pytest.raises(InputError) as caught:
        read_table(path, "cmm", POINTS)
    assert str(caught.value).splitlines() == [
        f"t.csv, row {row}, column 'time': not a time: {cells[row - 2]!r}; expected {expected}"
        for row, expected in told.items()
    ]


def test_minutes_are_offered_where_a_column_of_them_is_known(tmp_path: Path) -> None:
    (line,) = faults(tmp_path, "name,value,time\na,1,1\na,1,2\na,1,3\n")
    assert line.endswith(f"expected {ISO}: these are plain numbers")
