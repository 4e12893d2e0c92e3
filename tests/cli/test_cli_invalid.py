"""Folders of faulty input: every fault of a file at once, in one line each, nothing written.

A folder of `invalid/` lies over a copy of `valid/small`; `call.txt` holds the arguments and
`expected.txt` what each line of the message must hold, in order.
"""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from cli_runner import INVALID, prepared, refused

FOLDERS = sorted(path for path in INVALID.iterdir() if path.is_dir())


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_faulty_input(folder: Path, tmp_path: Path) -> None:
    work = prepared(tmp_path / "work", folder)
    message = refused(work, *shlex.split((folder / "call.txt").read_text("utf-8")))
    found = message.removeprefix("mtu: ").splitlines()
    expected = (folder / "expected.txt").read_text("utf-8").splitlines()
    assert message.startswith("mtu: ")
    assert len(found) == len(expected), message
    for line, words in zip(found, expected, strict=True):
        assert words in line
