"""Reading bytes: what is wrong with a file, said in plain words."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from support import write_files

from mtu_cli.files.readings import read_readings
from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import check_text, read_source, shown_path
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import InputError

T = TypeVar("T")


def message(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        check_text(read_source(path, "machine")[1], path.name)
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
    ("name", "there", "hint"),
    [
        ("machine.yaml", "tm.yaml", None),
        ("drft.csv", "drift.csv", "drift.csv"),
        ("lbb.csv", "lbb.csv.gz", "lbb.csv.gz"),
    ],
)  # fmt: skip
def test_only_near_names_are_offered(
    name: str, there: str, hint: str | None, tmp_path: Path
) -> None:
    (tmp_path / there).touch()
    found = message(tmp_path / name)
    assert found.startswith(f"{tmp_path}/{name}: no such file")
    assert ("did you mean" in found) == (hint is not None)
    assert hint is None or found.endswith(f"{hint}'?")


def test_a_missing_study_may_be_a_folder(tmp_path: Path) -> None:
    for name, role, words in (
        ("v1.2", "study", "; expected a study or its folder"),
        ("other.yaml", "study", ""),
        ("no/machine.yaml", "machine", "; expected a path to an existing folder"),
    ):
        with pytest.raises(InputError) as caught:
            read_source(tmp_path / name, role)
        assert str(caught.value) == f"{tmp_path}/{name}: no such file{words}"


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero")
def test_devices_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to("/dev/zero")
    reads: list[Callable[[], object]] = [
        lambda: read_yaml(Path("/dev/zero"), "machine"),
        lambda: read_json(Path("/dev/zero"), "machine"),
        lambda: read_readings([(Path("/dev/zero"), "lbb")], None, for_fit=False),
    ]
    for read in reads:
        with pytest.raises(InputError, match=r"^/dev/zero: a device, no file; expected a file"):
            read()
    with pytest.raises(InputError, match="a device, no file"):
        read_source(tmp_path / "link.csv", "lbb")


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


def test_a_folder_and_a_large_file(tmp_path: Path) -> None:
    assert "a folder, no file" in message(tmp_path)
    (tmp_path / "f").write_bytes(b"123456")
    with pytest.raises(InputError, match="6 bytes; expected at most 5"):
        read_source(tmp_path / "f", "machine", max_bytes=5)


def test_a_loop_of_links_is_told(tmp_path: Path) -> None:
    """Neither as an input nor as an output does it end in the system's own words."""
    loop = tmp_path / "loop.csv"
    loop.symlink_to("loop.csv")
    with pytest.raises(InputError, match=r"loop\.csv: cannot be read: too many levels"):
        read_source(loop, "cmm")
    assert shown_path(loop) == "loop.csv"
    write_files({loop: b"new"})
    assert loop.read_bytes() == b"new"
