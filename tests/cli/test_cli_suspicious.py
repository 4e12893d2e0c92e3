"""Folders of improbable input: a warning names the rows, and the run goes on with them.

`call.txt` holds the arguments, `expected.txt` what a warning of the checks must begin with, each.
"""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pytest
from cli_runner import done, mtu, report

SUSPICIOUS = Path(__file__).with_name("suspicious")
FOLDERS = sorted(path for path in SUSPICIOUS.iterdir() if path.is_dir())


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_improbable_input(folder: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    shutil.copytree(folder, work)
    call = shlex.split((work / "call.txt").read_text("utf-8"))
    expected = (work / "expected.txt").read_text("utf-8").splitlines()
    told = done(mtu(*call, "--fail-if", "suspicious", cwd=work), 3)
    lines = [line.removeprefix("warning: ") for line in told.stderr.splitlines()]
    for words in expected:
        assert any(line.startswith(words) for line in lines), told.stderr
    # In the report they have their place and facts; without the gate the run is done.
    found = [item for item in report(*call, cwd=work)["warnings"] if "rows" in item["facts"]]
    assert len(found) == len(expected)
    assert all(item["severity"] == "warning" and item["row"] for item in found)
