"""The CSV reader: every form of a table that it takes, and how fast and slow paths agree."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from csv_contract import SPEC, faults, names, table

from mtu_cli.files import csv_file
from mtu_cli.files.csv_cells import TIME_EXPECTED
from mtu_cli.files.csv_fast import read_fast
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_slow import read_slow
from mtu_cli.files.csv_table import ProblemList
from mtu_cli.files.csv_text import read_csv_text


@pytest.fixture(autouse=True)
def every_table_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast reader first, whatever the size; commands read small files with the slow one."""
    monkeypatch.setattr(csv_file, "SMALL", 0)


def test_a_table(tmp_path: Path) -> None:
    read = table(
        tmp_path, "value,name,T_a_degC,shift\n1.5,a,20,day\n-2e-3, b ,,\n+3,a,21.5,night\n"
    )
    assert read.columns.numbers["value"].tolist() == [1.5, -2e-3, 3.0]
    assert names(read) == ["a", "b", "a"]
    assert read.columns.texts["name"].labels == ("a", "b")
    np.testing.assert_array_equal(read.columns.numbers["T_a_degC"], [20.0, np.nan, 21.5])
    assert names(read, "shift") == ["day", "", "night"]
    assert read.covariates == ("T_a_degC", "shift")
    assert read.rows.tolist() == [2, 3, 4]
    assert (read.source.rows, read.source.role) == (3, "lbb")


PLAIN = "name,value,note\na,1.5,x\nb,2.25,y\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        PLAIN.rstrip("\n"),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        "\ufeff" + PLAIN,
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace(".", ","),
        PLAIN.replace("name,value,note", '"name", value ,note'),
        PLAIN.replace("a,", '"a",').replace("x", '"x"'),
        PLAIN + "\n\n  \n",
    ],
)
def test_forms_of_the_same_table(tmp_path: Path, content: str) -> None:
    read = table(tmp_path, content)
    assert names(read) == ["a", "b"]
    assert read.columns.numbers["value"].tolist() == [1.5, 2.25]
    assert names(read, "note") == ["x", "y"]
    assert read.rows.tolist() == [2, 3]


def test_comments_and_blank_lines_count_as_rows(tmp_path: Path) -> None:
    content = '# say "hi\n\n#\nname,value\n# x\na,1\n\n   \nb#1,2\n#end\n'
    read = table(tmp_path, content)
    assert names(read) == ["a", "b#1"]
    assert read.rows.tolist() == [6, 9]
    assert table(tmp_path, content.replace("\n", "\r\n")).rows.tolist() == [6, 9]


def test_quoted_cells_over_several_lines(tmp_path: Path) -> None:
    content = 'name,value,note\na,1,"one\n# two, ""three""\n"\n# comment\nb,2,plain\n'
    read = table(tmp_path, content)
    assert names(read, "note") == ['one\n# two, "three"', "plain"]
    assert read.rows.tolist() == [2, 6]
    assert faults(tmp_path, content + "c,x,\n") == [
        ", row 7, column 'value': not a number: 'x'; expected a number"
    ]


def test_a_quote_inside_a_plain_cell_is_data(tmp_path: Path) -> None:
    read = table(tmp_path, 'name,value\n5" pin,1\n6" pin, 2\n7" pin,3\n')
    assert names(read) == ['5" pin', '6" pin', '7" pin']


def test_fast_and_slow_readers_agree(tmp_path: Path) -> None:
    content = (
        "name,value,size,time,c,d,e\n"
        "a,1,,2024-05-03T14:30:00,1,x,\n"
        "NA,2.5e3,7,2024-05-03 14:31,,,\n"
        "null,-.5,8.,2024-05-04,007,1,\n"
    )
    (tmp_path / "t.csv").write_text(content)
    text = read_csv_text(tmp_path / "t.csv", "lbb")
    count, fast = read_fast(text, SPEC)
    rows, slow = read_slow(text, SPEC, ProblemList())
    assert rows.tolist() == [2, 3, 4]
    assert count == 3
    assert set(fast.numbers) == set(slow.numbers) == {"value", "size", "c", "e"}
    for name, values in fast.numbers.items():
        np.testing.assert_array_equal(values, slow.numbers[name])
    for name, column in fast.texts.items():
        assert column.labels == slow.texts[name].labels
        np.testing.assert_array_equal(column.codes, slow.texts[name].codes)
    np.testing.assert_array_equal(fast.times["time"].microseconds, slow.times["time"].microseconds)
    assert np.diff(fast.times["time"].microseconds).tolist() == [60_000_000, 34_140_000_000]
    assert fast.texts["name"].labels == ("a", "NA", "null")


def test_numbers_are_read_to_the_last_digit(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(0, 1, 2000) * 10.0 ** np.arange(-50, 50).repeat(20)
    body = "".join(f"a,{value!r}\n" for value in values.tolist())
    read = table(tmp_path, "name,value\n" + body)
    np.testing.assert_array_equal(read.columns.numbers["value"], values)


def test_semicolons_with_decimal_points_and_commas_in_texts(tmp_path: Path) -> None:
    read = table(tmp_path, "name;value;note\na;1.5;x, y\nb;2;z\n")
    assert read.columns.numbers["value"].tolist() == [1.5, 2.0]
    assert names(read, "note") == ["x, y", "z"]


def test_times(tmp_path: Path) -> None:
    head = "name,value,time\n"
    read = table(tmp_path, head + "a,1,2024-05-03T14:30:00.25Z\na,1,2024-05-03T16:30:00+02:00\n")
    assert read.columns.times["time"].aware
    assert np.diff(read.columns.times["time"].microseconds).tolist() == [-250_000]
    found = faults(tmp_path, head + "a,1,2024-05-03\na,1,\na,1,12:30\na,1,2024\na,1,2024-13-01\n")
    assert [line.split(": ")[:2] for line in found] == [
        [", row 3, column 'time'", f"empty cell; expected {TIME_EXPECTED}"],
        [", row 4, column 'time'", "not a time"],
        [", row 5, column 'time'", "not a time"],
        [", row 6, column 'time'", "not a time"],
    ]
    assert "ISO 8601" in found[1]
    mixed = head + "a,1,2024-05-03T10:00\na,1,2024-05-03T10:00Z\n"
    assert "times with and without an offset from UTC" in faults(tmp_path, mixed)[0]


def test_compressed_files(tmp_path: Path) -> None:
    packed = gzip.compress(PLAIN.encode())
    assert names(table(tmp_path, packed, "t.csv.gz")) == ["a", "b"]
    two = gzip.compress(b"name,value\na,1\n") + gzip.compress(b"b,2\n")
    assert names(table(tmp_path, two, "t.csv.gz")) == ["a", "b"]
    assert "the compressed data end too early" in faults(tmp_path, packed[:-12], "t.csv.gz")[0]
    damaged = packed[:15] + bytes([packed[15] ^ 0xFF]) + packed[16:]
    assert "damaged gzip data" in faults(tmp_path, damaged, "t.csv.gz")[0]
    assert "is not gzip-compressed" in faults(tmp_path, PLAIN, "t.csv.gz")[0]


def test_a_compressed_bomb_is_refused(tmp_path: Path) -> None:
    bomb = gzip.compress(b"\n" * (1 << 27))
    assert "unpacks to more than" in faults(tmp_path, bomb, "t.csv.gz")[0]


def test_encodings(tmp_path: Path) -> None:
    assert names(table(tmp_path, "name,value\nmüller,1\n")) == ["müller"]
    assert (
        ":3: not UTF-8: byte 17 is 0xfc" in faults(tmp_path, b"name,value\na,1\nm\xfcller,1\n")[0]
    )
    assert "byte 13 is zero" in faults(tmp_path, b"name,value\na\0,1\n")[0]


def test_a_large_table_takes_the_fast_path(tmp_path: Path) -> None:
    n = 60_000
    index = np.arange(n)
    lines = [f"P{i // 1000:03},{i * 0.5},{i % 7},{'late' if i == n - 1 else i}" for i in index]
    lines[30_000] += "\n# a comment in the middle\n"
    content = "name,value,c,d\n" + "\n".join(lines) + "\n"
    (tmp_path / "t.csv").write_text(content)
    text = read_csv_text(tmp_path / "t.csv", "lbb")
    count, columns = read_fast(text, SPEC)
    assert count == n
    np.testing.assert_array_equal(columns.numbers["value"], index * 0.5)
    np.testing.assert_array_equal(columns.numbers["c"], index % 7)
    np.testing.assert_array_equal(columns.texts["name"].codes, index // 1000)
    # Nearly all cells of `d` are numbers; one is not, so that all stay as they are written.
    assert columns.texts["d"].labels[:2] == ("0", "1")
    assert columns.texts["d"].labels[-1] == "late"
    read = read_table(tmp_path / "t.csv", "lbb", SPEC)
    np.testing.assert_array_equal(read.rows, index + 2 + 2 * (index > 30_000))


def test_the_fast_path_refuses_what_it_cannot_vouch_for(tmp_path: Path) -> None:
    for row in ("a,x", "a,1,2", "a,inf", ",1", 'a,"1'):
        (tmp_path / "t.csv").write_text(f"name,value\na,1\n{row}\n")
        with pytest.raises(Suspect):
            read_fast(read_csv_text(tmp_path / "t.csv", "lbb"), SPEC)
