"""Messages of files outside the working folder say where they are; reports do not."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import mtu
from support import CONFIGS

MACHINE = (CONFIGS / "gilsinn-ling" / "machine.yaml").read_bytes()
STUDY = "schema: mtu/study/1\nmachine: machine.yaml\npart: part.yaml\nlbb: [bar.csv]\n"
PART = """\
schema: mtu/part/1
name: two holes
features: {a: {x_mm: 10, y_mm: 10}, b: {x_mm: 140, y_mm: 10}}
lengths: [{from: a, to: b, tolerance_um: 20}]
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A study of a fault in its readings whose warnings name it."""
    folder = tmp_path / "mill-2"
    folder.mkdir()
    (folder / "machine.yaml").write_bytes(MACHINE)
    (folder / "part.yaml").write_text(PART, "utf-8")
    (folder / "bar.csv").write_text("component,position_mm,error,unit\ndx_x,1,zz,um\n", "utf-8")
    (folder / "mtu.yaml").write_text(STUDY, "utf-8")
    return folder


def test_faults_say_where_their_file_is(study: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    told = mtu("fit-components", str(study), cwd=elsewhere)
    assert told.returncode == 2
    assert told.stderr.startswith(f"mtu: {study}/bar.csv, row 2, column 'error': not a number")
    within = mtu("fit-components", str(study), cwd=study)
    assert within.stderr.startswith("mtu: bar.csv, row 2")
    beneath = mtu("fit-components", str(study), cwd=tmp_path)
    assert beneath.stderr.startswith("mtu: mill-2/bar.csv, row 2")
    (study / "bar.csv").unlink()
    gone = mtu("fit-components", str(study), cwd=elsewhere)
    assert gone.stderr.startswith(f"mtu: {study}/mtu.yaml:4: lbb[0]: no such file: 'bar.csv'")
