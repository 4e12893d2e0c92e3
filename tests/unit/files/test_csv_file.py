"""The reader of CSV tables: what it takes, and that it names every bad cell."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest
from csv_contract import SPEC, faults, names, table
from hypothesis import given
from hypothesis import strategies as st

from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_table import LISTED_PROBLEMS, CellFaults
from mtu_cli.files.headers import meant_by
from mtu_cli.findings import InputError

PLAIN = "name,value,size\na,1,2\nb,-2.5e-3,\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace(".", ","),
        "# a comment\n\n" + PLAIN.replace("b,", "# another\n  \nb,"),
        PLAIN.replace("a,1", '"a","1"'),
        PLAIN.removesuffix("\n"),
        "size,name,value\n2,a,1\n,b,-0.0025\n",
    ],
)
def test_one_table_in_many_ways(content: str, tmp_path: Path) -> None:
    found = table(tmp_path, content)
    assert names(found) == ["a", "b"]
    assert found.columns.numbers["value"].tolist() == [1.0, -0.0025]
    np.testing.assert_array_equal(found.columns.numbers["size"], [2.0, np.nan])


def test_rows_count_as_in_an_editor(tmp_path: Path) -> None:
    content = '# one\n\nname,value\n"a\nb",1\n\n# six\nc,2\n'
    assert table(tmp_path, content).rows.tolist() == [4, 8]
    assert table(tmp_path, "name,value\na,1\n\n   \nc,2\n").rows.tolist() == [2, 5]


def test_packed(tmp_path: Path) -> None:
    packed = gzip.compress(PLAIN[:20].encode()) + gzip.compress(PLAIN[20:].encode())
    assert names(table(tmp_path, packed, "t.csv.gz")) == ["a", "b"]
    (fault,) = faults(tmp_path, packed[:-9], "t.csv.gz")
    assert "end too early" in fault
    bomb = gzip.compress(b"name,value\n" + b"0" * (1 << 28))
    (fault,) = faults(tmp_path, bomb, "t.csv.gz")
    assert "unpacks to more than" in fault


def test_texts_that_look_like_numbers_stay_texts(tmp_path: Path) -> None:
    assert names(table(tmp_path, "name,value\n007,1\n7,2\n7.0,3\n")) == ["007", "7", "7.0"]


def test_covariates_are_numbers_or_texts(tmp_path: Path) -> None:
    content = "name,value,load,tool,flag\na,1,3,T1,TRUE\nb,2,,2,true\n"
    found = table(tmp_path, content)
    np.testing.assert_array_equal(found.columns.numbers["load"], [3.0, np.nan])
    assert names(found, "tool") == ["T1", "2"]
    assert names(found, "flag") == ["TRUE", "true"]


def test_all_bad_cells_are_named(tmp_path: Path) -> None:
    content = (
        "name,value,size,time\n"
        "a,1,2,2024-01-02T03:04\n"
        ",x,y,2024-01-02T03:04\n"
        "a,z\n"
        "a,1,2,3,4\n"
        "b,,nan,03.01.2024\n"
        'c,1e999,"1,5",2024-01-02T03:04\n'
        "d,1_0,0x1,2024-01-02T03:04\n"
    )
    found = {tuple(line.split(": ")[:2]) for line in faults(tmp_path, content)}
    assert found == {
        (", row 3, column 'name'", "empty cell; expected a text"),
        (", row 3, column 'value'", "not a number"),
        (", row 3, column 'size'", "not a number"),
        (", row 4", "a short row of 2 cells"),
        (", row 5", "a long row of 5 cells"),
        (", row 6, column 'value'", "empty cell; expected a number"),
        (", row 6, column 'size'", "not a finite number"),
        (", row 6, column 'time'", "not a time"),
        (", row 7, column 'value'", "not a finite number"),
        (", row 7, column 'size'", "not a number"),
        (", row 8, column 'value'", "not a number"),
        (", row 8, column 'size'", "not a number"),
    }


def test_very_many_bad_cells_are_counted(tmp_path: Path) -> None:
    many = LISTED_PROBLEMS + 5000
    (tmp_path / "m.csv").write_text("name,value\n" + "a,x\n" * many)
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "m.csv", "lbb", SPEC)
    assert len(caught.value.findings) + caught.value.uncounted == many
    first, last = str(caught.value).splitlines()
    assert first.startswith("m.csv, row 2, column 'value': not a number: 'x'")
    assert last == "... and 5000 more"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "the file is empty"),
        ("# nothing\n", "holds no rows"),
        ("name,value\n", "holds no rows"),
        ("name\tvalue\na\t1\n", "separated by tabs"),
        ('{"name": 1}', "JSON, no table"),
        ("name,value,value\na,1,2\n", "stands twice"),
        ("name,value,\na,1,\n", "column 3 has no name"),
        ("name,Value\na,1\n", "'Value' renamed to 'value'"),
        ("name,valeu\na,1\n", "'valeu' renamed to 'value'"),
        ("name,value,Size\na,1,2\n", "would not be read as 'size'"),
        ('name,value\n"a,1\n', "row cannot be read"),
    ],
)
def test_what_is_no_table(content: str, words: str, tmp_path: Path) -> None:
    assert any(words in line for line in faults(tmp_path, content))


@pytest.mark.parametrize(
    ("name", "header", "meant"),
    [
        ("x_mm", ["Actual X", "Nominal X"], "Actual X"),
        ("nominal_x_mm", ["Actual X", "Soll X [mm]"], "Soll X [mm]"),
        ("part", ["Serial-No.", "Hole"], "Serial-No."),
        ("feature", ["Hole", "Bohrung"], None),
        ("error", ["Deviation (um)"], "Deviation (um)"),
    ],
)
def test_columns_by_other_names(name: str, header: list[str], meant: str | None) -> None:
    assert meant_by(name, header) == meant


CELLS = st.sampled_from(
    ["1", "-2.5", " 3 ", "", "x", "nan", "1e400", "7,5", "2024-05-03", "True", "é", "1e-3", '"q"']
)


@given(st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=1, max_size=8), st.booleans())
def test_the_quick_way_is_the_plain_one(rows: list[list[str]], semicolons: bool) -> None:
    """Also where quotes or wrong lengths make it go record by record at once."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "t.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, delimiter=";" if semicolons else ",")
            writer.writerows([["name", "value", "size", "other"], *rows])
        told, exact = CellFaults(), CellFaults()
        quick = read_table(path, "lbb", SPEC, told)
        plain = read_table(path, "lbb", SPEC, exact, by_records=True)
    assert {p.message for p in told.listed} == {p.message for p in exact.listed}
    assert quick.rows.tolist() == plain.rows.tolist()
    for name, values in plain.columns.numbers.items():
        np.testing.assert_array_equal(quick.columns.numbers[name], values)
    for name, texts in plain.columns.texts.items():
        assert quick.columns.texts[name].labels == texts.labels
        assert quick.columns.texts[name].codes.tolist() == texts.codes.tolist()
