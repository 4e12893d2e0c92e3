"""The Makefile pipeline of configs/pipeline: steps by what a study names, gates, nothing twice."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from cli_runner import MTU, done, shell
from pipeline_runner import GILSINN_LING, PART, STUDY, make, placed, quick
from support import CONFIGS


def test_a_study_runs_once_and_a_gate_stops_every_time(tmp_path: Path) -> None:
    study, out = tmp_path / "shop" / "mill-1", tmp_path / "out"
    study.mkdir(parents=True)
    (study / "machine.yaml").write_bytes((GILSINN_LING / "machine.yaml").read_bytes())
    (study / "part.yaml").write_text(PART, "utf-8")
    (study / "mtu.yaml").write_text(STUDY, "utf-8")
    root = f"ROOT={study.parent}"
    ran = make(out, "-j2", root)
    assert ran.returncode == 0, ran.stderr
    made = {path.name for path in (out / "mill-1").iterdir()}
    assert made == {"points.json", "points.png", "lengths.json", "lengths.csv", "lengths.done"}
    assert make(out, "-q", root).returncode == 0
    for _ in range(2):
        stopped = make(out, root, "GATE=1")
        assert stopped.returncode == 2
        assert "Error 3" in stopped.stderr
        assert "gate nonconforming" in stopped.stderr


STEPS = ("predict-points", "lengths")
RENAME = "make takes letters, digits and . _ + @ - in names alone: rename the folder"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("ROOT={}/none", "*** no study: no {}/none/*/mtu.yaml here"),
        ("ROOT={}/shop", "'{}/shop/mill 1': " + RENAME),
        ("ROOT={}/shop/mill 1", "ROOT='{}/shop/mill 1': " + RENAME),
        ("OUT={}/my out", "OUT='{}/my out': " + RENAME),
        ("STUDIES=a%b", "STUDIES='a%b': " + RENAME),
    ],
)
def test_a_gate_that_finds_no_study_does_not_pass(tmp_path: Path, call: str, words: str) -> None:
    study = tmp_path / "shop" / "mill 1"
    study.mkdir(parents=True)
    (study / "mtu.yaml").write_text(STUDY, "utf-8")
    ran = make(tmp_path / "out", "GATE=1", call.format(tmp_path))
    assert ran.returncode == 2
    assert words.format(tmp_path) in ran.stderr
    assert "grep" not in ran.stderr


def test_studies_may_be_called_as_anything_of_the_makefile(tmp_path: Path) -> None:
    names = ["-x", "Fr\u00e4se.1", "all", "clean", "steps"]
    for name in names:
        placed(tmp_path / "shop" / name)
    out, root = tmp_path / "out", f"ROOT={tmp_path / 'shop'}"
    words = tmp_path / "words"
    mtu = tmp_path / "mtu"
    script = f'printf "%s\\n" "$1 $2" >> {words}; until [ "$1" = -o ]; do shift; done; : > "$2"'
    mtu.write_text(f"#!/bin/sh\n{script}\n", "utf-8")
    mtu.chmod(0o755)
    ran = make(out, "-j2", "GATE=1", root, f"MTU={mtu}")
    assert ran.returncode == 0, ran.stderr
    assert {f"{name}: passed" for name in names} <= set(ran.stdout.splitlines())
    asked = {f"{step} {tmp_path}/shop/{name}" for name in names for step in STEPS}
    assert set(words.read_text("utf-8").splitlines()) == asked
    assert all((out / name / "lengths.passed").is_file() for name in names)
    assert make(out, "clean", root).returncode == 0
    assert not out.exists()


def test_a_study_whose_file_is_gone_has_not_passed(tmp_path: Path) -> None:
    """Neither where it never was there nor where it was at the last run."""
    study, out = tmp_path / "shop" / "mill", tmp_path / "out"
    placed(study, "lbb: [bar.csv]\n")
    for there in (False, True, False):
        (study / "bar.csv").unlink(missing_ok=True)
        if there:
            (study / "bar.csv").touch()
        ran = make(out, "GATE=1", f"ROOT={study.parent}", quick(tmp_path))
        assert (ran.returncode == 0) == there, ran.stderr
        assert ("mill: passed" in ran.stdout) == there
        left = "mill: not passed: fit-components iso230 predict-points lengths"
        assert (left in ran.stdout) != there
        assert "No rule" not in ran.stderr


def test_clean_takes_away_what_the_pipeline_has_made_alone(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "measured.csv").write_text("1\n", "utf-8")
    ran = make(mine, "clean")
    assert ran.returncode == 2
    assert "was there before this pipeline" in ran.stderr
    assert (mine / "measured.csv").is_file()


def test_another_root_has_an_output_of_its_own(tmp_path: Path) -> None:
    """A study of the same name with older files would keep the reports of the other one."""
    # Nor do strokes and hyphens make one name of two.
    shops = ("first/b-c", "first-b/c", "first/b+-c")
    for shop in shops:
        placed(tmp_path / shop / "mill")
    call = ["make", "-n", "-C", str(CONFIGS / "pipeline"), f"MTU={MTU}"]
    told = [
        done(shell(shlex.join([*call, f"ROOT={tmp_path / shop}"]), {"MAKEFLAGS": ""})).stdout
        for shop in shops
    ]
    folders = [{word for word in text.split() if word.endswith("lengths.json")} for text in told]
    assert all(folders)
    assert len(set.union(*folders)) == sum(map(len, folders))


def test_a_gate_runs_all_studies_and_sums_them_up(tmp_path: Path) -> None:
    """The second of three meets the gate of its lengths; folders count from the call."""
    for name in ("mill-1", "mill-2", "mill-3"):
        placed(tmp_path / "shop" / name)
    gate = tmp_path / "shop" / "mill-2" / "fails"
    gate.write_text("lengths", "utf-8")
    call = ("ROOT=shop", "GATE=1", quick(tmp_path))
    ran = make(Path("out"), "-j2", *call, called=tmp_path)
    assert ran.returncode == 2
    assert ran.stdout.splitlines()[-5:-1] == [
        "study: passed, or which of its steps have not",
        "mill-1: passed",
        "mill-2: not passed: lengths",
        "mill-3: passed",
    ]
    passed = {path.parent.name for path in (tmp_path / "out").glob("*/lengths.passed")}
    assert passed == {"mill-1", "mill-3"}
    gate.unlink()
    again = make(Path("out"), *call, called=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "mill-2: passed" in again.stdout.splitlines()
