"""Folders of input, over a copy of `valid/small`: `call.txt` holds the arguments of a call.

valid: `expected.txt` stands in what is said. invalid: every fault of a file at once, in one line
each, nothing written; each line holds that of `expected.txt`. suspicious (alone, not over another):
a warning of the checks begins so, and the run goes on.
"""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pytest
from cli_runner import HERE, INVALID, VALID, done, mtu, prepared, refused, report


def folders(kind: Path) -> list[Path]:
    return sorted(path for path in kind.iterdir() if (path / "call.txt").exists())


def call_of(folder: Path) -> tuple[list[str], list[str]]:
    """The arguments, and the lines expected."""
    call, expected = ((folder / name).read_text("utf-8") for name in ("call.txt", "expected.txt"))
    return shlex.split(call), expected.splitlines()


@pytest.mark.parametrize("folder", folders(VALID), ids=lambda path: path.name)
def test_sound_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    result = done(mtu(*call, cwd=prepared(tmp_path / "work", folder)))
    assert [words for words in expected if words not in result.stdout + result.stderr] == []


@pytest.mark.parametrize("folder", folders(INVALID), ids=lambda path: path.name)
def test_faulty_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    message = refused(prepared(tmp_path / "work", folder), *call)
    assert message.startswith("mtu: ")
    found = message.removeprefix("mtu: ").splitlines()
    assert len(found) == len(expected), message
    for line, words in zip(found, expected, strict=True):
        assert words in line


@pytest.mark.parametrize("folder", folders(HERE / "suspicious"), ids=lambda path: path.name)
def test_improbable_input(folder: Path, tmp_path: Path) -> None:
    call, expected = call_of(folder)
    work = shutil.copytree(folder, tmp_path / "work")
    told = done(mtu(*call, "--fail-if", "suspicious", cwd=work), 3)
    lines = [line.removeprefix("warning: ") for line in told.stderr.splitlines()]
    for words in expected:
        assert any(line.startswith(words) for line in lines), told.stderr
    # In the report they have their place and facts; without the gate the run is done.
    found = [item for item in report(*call, cwd=work)["warnings"] if "rows" in item["facts"]]
    assert len(found) == len(expected)
    assert all(item["severity"] == "warning" and item["row"] for item in found)
