"""Reports as bytes, JSON read back, and files written whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from support import write_files

from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import report_bytes
from mtu_cli.findings import InputError


def test_a_report_keeps_keys_digits_and_one_record_a_line() -> None:
    document = {
        "schema": "mtu/lengths/1",
        "results": {
            "lengths": [{"id": "3-9", "u_um": np.float64(0.1)}, {"id": "µ", "u_um": 1e-17}],
            "pair_um": (np.float32(0.5), None),
            "matrix": np.array([[1.5, 2.0], [3.0, 4.0]]),
            "empty": {},
        },
        "a": np.bool_(True),
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


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.nan, np.array([1.0, -np.inf])])
def test_non_finite_numbers_are_a_fault_of_the_program(value: object) -> None:
    with pytest.raises(ValueError, match=r"report\.results\.x"):
        report_bytes({"results": {"x": value}})
    with pytest.raises(TypeError, match=r"report\.results\.x: JSON cannot hold a object"):
        report_bytes({"results": {"x": object()}})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1,\n "b": }', "r.json:2: cannot be read: no JSON: expecting value at column 7"),
        (f'{{"a": -{"9" * 5000}}}', "cannot be read"),
    ],
)
def test_faulty_json(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(InputError) as caught:
        read_json(tmp_path / "r.json", "components")
    assert words in str(caught.value)


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
