"""The reader of CSV tables: what it takes, and that it names every bad cell."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
from csv_contract import SPEC, faults, names, table
from hypothesis import given, settings
from hypothesis import strategies as st

from mtu_cli.files import csv_file
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.headers import LIKE, LISTED_FAULTS, CellFaults, meant_by, perhaps_equal, time_of
from mtu_cli.findings import MOST_SHOWN, InputError

PLAIN = "name,value,size\na,1,2\nb,-2.5e-3,\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.replace("\n", "\r"),
        "# a comment\n\n" + PLAIN.replace("b,", "# another\n  \nb,"),
        PLAIN.removesuffix("\n"),
        "size,name,value\n2,a,1\n,b,-0.0025\n",
    ],
)
def test_one_table_in_many_ways(content: str, tmp_path: Path) -> None:
    found = table(tmp_path, content)
    assert names(found) == ["a", "b"]
    assert found.numbers["value"].tolist() == [1.0, -0.0025]
    np.testing.assert_array_equal(found.numbers["size"], [2.0, np.nan])


def test_rows_count_as_in_an_editor_and_may_be_packed(tmp_path: Path) -> None:
    content = '# one\n\nname,value,note\na,1,"a\nb"\n\n# six\nc,2,\n'
    assert table(tmp_path, content).rows.tolist() == [4, 8]
    assert table(tmp_path, "name,value\na,1\n\n   \nc,2\n").rows.tolist() == [2, 5]
    packed = gzip.compress(PLAIN[:20].encode()) + gzip.compress(PLAIN[20:].encode())
    assert names(table(tmp_path, packed, "t.csv.gz")) == ["a", "b"]
    (fault,) = faults(tmp_path, packed[:-9], "t.csv.gz")
    assert "damaged gzip data" in fault


def test_covariates_are_numbers_or_texts(tmp_path: Path) -> None:
    content = "name,value,load,tool,flag\na,1,3,T1,TRUE\nb,2,,2,true\n"
    found = table(tmp_path, content)
    np.testing.assert_array_equal(found.numbers["load"], [3.0, np.nan])
    assert names(found, "tool") == ["T1", "2"]
    assert names(found, "flag") == ["TRUE", "true"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "name,value,count\na,1,1.50\n",
            ": not a whole number: '1.50'; expected a whole number from 0 on",
        ),
        (
            "name,value\na,9007199254740993000000000000000\n",
            "'9007199254740993000000000000000'; expected at most 1e+12 in size",
        ),
        ('{"name": 1}', "holds no table: '{\"name\": 1}'; expected a header row"),
        ("sep=;\nname;value\n", "holds no table: 'sep=;'; expected a header row"),
        ("name,value\nd,1_0\n", "not a number: '1_0'; expected a number"),
        ("name,value\nd,0x1\n", "not a number: '0x1'; expected a number"),
    ],
)
def test_what_a_fault_says(content: str, words: str, tmp_path: Path) -> None:
    (found,) = faults(tmp_path, content)
    assert words in found


def test_a_fault_of_a_whole_column_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("name,value\n" + "a,x\n" * 3000 + "a,y\n")
    found = CellFaults()
    read_table(tmp_path / "m.csv", "lbb", SPEC, found)
    with pytest.raises(InputError) as caught:
        found.raise_if_any()
    assert len(caught.value.findings) == 3001
    assert str(caught.value).splitlines() == [
        "m.csv, rows 2 to 3001, column 'value': not a number: 'x'; expected a number",
        "m.csv, row 3002, column 'value': not a number: 'y'; expected a number",
    ]


def test_very_many_bad_cells_are_counted(tmp_path: Path) -> None:
    many = LISTED_FAULTS + 5000
    (tmp_path / "m.csv").write_text("name,value\n" + "".join(f"a,x{i}\n" for i in range(many)))
    found = CellFaults()
    read_table(tmp_path / "m.csv", "lbb", SPEC, found)
    with pytest.raises(InputError) as caught:
        found.raise_if_any()
    assert len(caught.value.findings) + caught.value.uncounted == many
    first, *others, last = str(caught.value).splitlines()
    assert len(others) == MOST_SHOWN - 1
    assert first.startswith("m.csv, row 2, column 'value': not a number: 'x0'")
    assert last == f"... and {many - MOST_SHOWN} more"


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
    assert meant_by(name, header, LIKE) == meant


@pytest.mark.parametrize(
    "cell",
    [
         "2024-05-03T14:30", "2024-05-03 14:30:05.25",
        "2024-05-03T14:30:05Z",  "2024-05-03T14:30+02:00", "1969-12-31",
    ],
)  # fmt: skip
def test_times_are_those_of_pandas(cell: str) -> None:
    found = time_of(cell)
    assert found is not None
    stamp = pd.Timestamp(cell.upper())
    exact = stamp if stamp.tzinfo else stamp.tz_localize("UTC")
    assert found == (exact.value // 1000, stamp.tzinfo is not None)


def test_equal_rows_are_marked_and_no_others() -> None:
    """In several blocks, for floats and codes; 0.0 equals -0.0."""
    rng, n = np.random.default_rng(1), 100_003
    numbers, codes = rng.standard_normal(n), rng.integers(-1, 50, n)
    assert not perhaps_equal([numbers, codes]).any()
    numbers[[0, -1]], codes[-1] = [0.0, -0.0], codes[0]
    assert np.flatnonzero(perhaps_equal([numbers, codes])).tolist() == [0, n - 1]
    # The same values in another column are another row.
    assert not perhaps_equal([np.array([1.0, 2.0]), np.array([2.0, 1.0])]).any()


CELLS = st.sampled_from(
    ["1", "-2.5", " 3 ", "", "x", "nan", "1e400", "7,5", "2024-05-03", "True", "é", "1e-3", '"q"']
)


@settings(deadline=None)
@given(st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=1, max_size=8), st.booleans())
def test_the_quick_way_is_the_plain_one(rows: list[list[str]], semicolons: bool) -> None:
    """Also in chunks, and where quotes or wrong lengths make it go record by record at once."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "t.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, delimiter=";" if semicolons else ",")
            writer.writerows([["name", "value", "size", "other"], *rows])
        told, exact = CellFaults(), CellFaults()
        with patch.object(csv_file, "CHUNK", 3):
            quick = read_table(path, "lbb", SPEC, told)
        with patch.object(csv_file, "_sound_rows", return_value=None):
            plain = read_table(path, "lbb", SPEC, exact)
    assert {p.message for p in told.listed} == {p.message for p in exact.listed}
    assert quick.rows.tolist() == plain.rows.tolist()
    for name, values in plain.numbers.items():
        np.testing.assert_array_equal(quick.numbers[name], values)
    for name, texts in plain.texts.items():
        assert quick.texts[name].labels == texts.labels
        assert quick.texts[name].codes.tolist() == texts.codes.tolist()
