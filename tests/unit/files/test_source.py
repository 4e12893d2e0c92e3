"""Reading bytes: what is wrong with a file, said in plain words."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import write_files

from mtu_cli.files.readings import read_readings
from mtu_cli.files.reports_read import read_json
from mtu_cli.files.source import check_text, read_source, shown_path
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import InputError


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
        ("drft.csv", "lbb", "did you mean 'drift.csv'?"),
        ("lbb.csv", "lbb", "did you mean 'lbb.csv.gz'?"),
        ("v1.2", "study", "no such file"),
        ("no/machine.yaml", "machine", "no such file"),
    ],
)
def test_a_missing_file_names_what_is_near(
    name: str, role: str, words: str, tmp_path: Path
) -> None:
    for there in ("tm.yaml", "drift.csv", "lbb.csv.gz"):
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
