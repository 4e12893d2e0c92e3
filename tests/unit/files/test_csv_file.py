"""A small CSV contract, its reader and its faults, for tests of the files floor."""

import csv
import gzip
import json
import os
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import write_files

from mtu_cli.files import csv_file
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.headers import (
    LIKE,
    LISTED_FAULTS,
    CellFaults,
    Column,
    Table,
    TableSpec,
    meant_by,
    time_of,
)
from mtu_cli.files.machine import covariance_fault
from mtu_cli.files.readings import read_readings
from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import check_text, read_source, report_bytes, shown_path
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import MOST_SHOWN, InputError

SPEC = TableSpec(
    columns={
        "name": Column("text", required=True),
        "value": Column(required=True),
        "size": Column(may_be_empty=True),
        "time": Column("time"),
        "count": Column("count"),
    }
)


def table(tmp_path: Path, content: str | bytes, name: str = "t.csv") -> Table:
    data = content if isinstance(content, bytes) else content.encode()
    (tmp_path / name).write_bytes(data)
    problems = CellFaults()
    read = read_table(tmp_path / name, "lbb", SPEC, problems)
    problems.raise_if_any()
    return read


def faults(tmp_path: Path, content: str | bytes, name: str = "t.csv") -> list[str]:
    with pytest.raises(InputError) as caught:
        table(tmp_path, content, name)
    return [str(problem).removeprefix(name) for problem in caught.value.findings]


def names(read: Table, column: str = "name") -> list[str]:
    text = read.texts[column]
    return ["" if code < 0 else text.labels[code] for code in text.codes]


# The reader of CSV tables: what it takes, and that it names every bad cell.


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
        ('{"name": 1}', "holds no table: '{\"name\": 1}'; expected a header row"),
        ("sep=;\nname;value\n", "holds no table: 'sep=;'; expected a header row"),
        ("name,value\nd,1_0\n", "not a number: '1_0'; expected a number"),
        ("name,value\nd,0x1\n", "not a number: '0x1'; expected a number"),
    ],
)
def test_what_a_fault_says(content: str, words: str, tmp_path: Path) -> None:
    (found,) = faults(tmp_path, content)
    assert words in found


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


# Reports as bytes, JSON read back, and files written whole or not at all.


def test_a_report_keeps_keys_digits_and_one_record_a_line() -> None:
    document = {
        "schema": "mtu/lengths/1",
        "results": {
            "lengths": [{"id": "3-9", "u_um": np.float64(0.1)}, {"id": "µ", "u_um": 1e-17}],
            "pair_um": (0.5, None),
            "matrix": [[1.5, 2.0], [3.0, 4.0]],
            "empty": {},
        },
        "a": True,
    }
    assert report_bytes(document).decode() == (
        "{\n"
        '  "schema": "mtu/lengths/1",\n'
        '  "results": {\n'
        '    "lengths": [\n'
        '      {"id": "3-9", "u_um": 0.1},\n'
        '      {"id": "µ", "u_um": 1e-17}\n'
        "    ],\n"
        '    "pair_um": [0.5, null],\n'
        '    "matrix": [\n'
        "      [1.5, 2.0],\n"
        "      [3.0, 4.0]\n"
        "    ],\n"
        '    "empty": {}\n'
        "  },\n"
        '  "a": true\n'
        "}\n"
    )


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.nan, [1.0, -np.inf]])
def test_non_finite_numbers_are_a_fault_of_the_program(value: object) -> None:
    with pytest.raises(ValueError, match=r"report\.results\.x"):
        report_bytes({"results": {"x": value}})
    with pytest.raises(TypeError, match=r"report\.results\.x: Object of type object is not JSON"):
        report_bytes({"results": {"x": object()}})


def test_a_number_that_is_too_long_for_json(tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(f'{{"a": -{"9" * 5000}}}')
    with pytest.raises(InputError, match="a number of too many digits"):
        read_json(tmp_path / "r.json", "components")


def test_files_are_written_with_nothing_left_behind(tmp_path: Path) -> None:
    """With the rights that they have; a link stays one, a device a device."""
    (tmp_path / "b").write_bytes(b"old")
    (tmp_path / "b").chmod(0o640)
    (tmp_path / "link").symlink_to(tmp_path / "b")
    write_files({tmp_path / "a": b"1", tmp_path / "link": b"2", Path("/dev/null"): b"x"})
    assert json.loads((tmp_path / "a").read_bytes()) == 1
    assert (tmp_path / "b").read_bytes() == b"2"
    assert (tmp_path / "b").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "link").is_symlink()
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "link"]
    assert Path("/dev/null").is_char_device()


def test_all_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "c"):
        (tmp_path / name).write_bytes(b"old")
    replace = os.replace

    def failing(source: Path, target: Path) -> None:
        if Path(target).name == "c" and Path(source).suffix == ".tmp":
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(InputError, match="c: cannot be written: no space left on device"):
        write_files({tmp_path / name: b"new" for name in ("a", "b", "c")})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "c").read_bytes() == b"old"
    assert sorted(os.listdir(tmp_path)) == ["a", "c"]


def test_what_no_system_takes(tmp_path: Path) -> None:
    (tmp_path / "l.json").symlink_to("/nope/zzz")
    for name, words in (
        ("l.json", r"l\.json: cannot be written: the folder '/nope' does not exist"),
        (f"{'a' * 300}.json", "cannot be written: file name too long"),
    ):
        with pytest.raises(InputError, match=words):
            write_files({tmp_path / name: b"x"})


# Reading bytes: what is wrong with a file, said in plain words.


def message(path: Path, role: str = "machine") -> str:
    with pytest.raises(InputError) as caught:
        check_text(read_source(path, role)[1], path.name)
    return str(caught.value)


def test_relative_paths_are_shown_as_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert shown_path(Path("../data/./lbb.csv")) == "../data/lbb.csv"
    assert shown_path(tmp_path / "a" / "b.csv") == "a/b.csv"
    assert shown_path(tmp_path.parent / "elsewhere.csv") == "elsewhere.csv"


def test_the_hash_is_of_the_bytes(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"abc")
    source, content = read_source(tmp_path / "a.yaml", "machine")
    # FIPS 180-2, appendix B.1
    assert source.sha256 == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert (source.role, source.rows, content) == ("machine", None, b"abc")


@pytest.mark.parametrize(
    ("name", "role", "words"),
    [
        ("machine.yaml", "machine", "no such file"),
        ("lbb.csv", "lbb", "did you mean 'lbb.csv.gz'?"),
        ("v1.2", "study", "no such file"),
    ],
)
def test_a_missing_file_names_what_is_near(
    name: str, role: str, words: str, tmp_path: Path
) -> None:
    for there in ("tm.yaml", "lbb.csv.gz"):
        (tmp_path / there).touch()
    told = message(tmp_path / name, role)
    assert told.startswith(f"{tmp_path}/{name}: no such file")
    assert told.endswith(words)
    assert ("did you mean" in told) == words.endswith("?")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero")
def test_devices_are_refused_at_once(tmp_path: Path) -> None:
    zero = tmp_path / "link.csv"
    zero.symlink_to("/dev/zero")
    for read in (
        lambda: read_yaml(zero, "machine"),
        lambda: read_json(zero, "machine"),
        lambda: read_readings([(zero, "lbb")], None, for_fit=False),
    ):
        with pytest.raises(InputError, match=r"link\.csv: a device, no file; expected a file"):
            read()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "holds no text"),
        (b"ab\ncd\0ef", ":2: cannot be read: byte 6 is 0x00"),
        (b"ab\nc\xe9d", ":2: cannot be read: byte 5 is 0xe9"),
        (b"x" * (1 << 20) + b"\xc3", f"cannot be read: byte {(1 << 20) + 1} is 0xc3"),
        (b" \n<!DOCTYPE html><html>", "it is a web page"),
        (b"PK\x03\x04abc", "it is an Excel workbook"),
        ("name: a".encode("utf-32"), "it is UTF-32 text"),
    ],
)
def test_what_is_no_text(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "f").write_bytes(content)
    assert words in message(tmp_path / "f")
    check_text(("x" * ((1 << 20) - 1) + "µm").encode(), "f")


def test_a_folder_a_large_file_and_a_loop_of_links(tmp_path: Path) -> None:
    assert "a folder, no file" in message(tmp_path)
    (tmp_path / "f").write_bytes(b"123456")
    with pytest.raises(InputError, match="6 bytes; expected at most 5"):
        read_source(tmp_path / "f", "machine", max_bytes=5)
    loop = tmp_path / "loop.csv"
    loop.symlink_to("loop.csv")
    assert "loop.csv: cannot be read: too many levels" in message(loop)
    write_files({loop: b"new"})
    assert loop.read_bytes() == b"new"


# Whether a matrix is a covariance.


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], None),
        ([[0.0, 0.0], [0.0, 1.0]], None),
        ([[1.0, 0.5], [0.5000001, 1.0]], None),
        ([[1.0, 0.5], [0.50001, 1.0]], "not symmetric"),
        ([[1.0, 1.00000001], [1.00000001, 1.0]], None),
        ([[1.0, 1.0000005], [1.0000005, 1.0]], "a combination has a negative variance"),
        ([[1.0, 1.00001], [1.00001, 1.0]], "a combination has a negative variance"),
        ([[0.0, 1e-9], [1e-9, 1.0]], "a combination has a negative variance"),
        ([[1e-320, 1.0], [1.0, 1e-320]], "a combination has a negative variance"),
        ([[1e-320, 1e-320], [1e-320, 1e-320]], None),
        ([[1e300, 1e300], [-1e300, 1e300]], "not symmetric"),
        ([[1.0, 0.0], [0.0]], "not 2 x 2"),
    ],
)
def test_what_a_covariance_is(rows: list[list[float]], words: str | None) -> None:
    found = covariance_fault(rows, len(rows))
    assert (found is None) == (words is None)
    assert words is None or (found or "").endswith(words)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e12])
def test_the_answer_does_not_depend_on_units(unit: float) -> None:
    """Slopes are some powers of ten smaller than offsets."""
    scale = np.diag([1.0, unit])
    for r, sound in ((0.999, True), (1.001, False)):
        rows = (scale @ np.array([[1.0, r], [r, 1.0]]) @ scale).tolist()
        assert (covariance_fault(rows, 2) is None) == sound
