"""Which steps and gates of the pipeline follow from a study's files, however they are written."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import MTU
from pipeline_runner import PART, STUDY, make, placed

FEATURES = PART[: PART.index("lengths:")]


def steps(tmp_path: Path, *args: str) -> list[list[str]]:
    """The calls of mtu that a gate would make for the studies, each in words."""
    ran = make(tmp_path / "out", "-n", "GATE=1", f"ROOT={tmp_path / 'shop'}", *args)
    assert ran.returncode == 0, ran.stderr
    lines = ran.stdout.splitlines()
    return [line.split()[1:] for line in lines if line.startswith(str(MTU))]


@pytest.mark.parametrize(
    ("lengths", "gated"),
    [
        ("- tolerance_um: 5\n  from: a\n  to: b\n", True),
        ("- {from: a, to: b,\n  'tolerance_um' : 5}\n", True),
        ("- {from: a, to: b} # tolerance_um: 5\n", False),
        ("- {id: 'no tolerance_um: here', from: a, to: b}\n", False),
    ],
)
def test_a_tolerance_has_its_gate_wherever_it_stands(
    tmp_path: Path, lengths: str, gated: bool
) -> None:
    """Without it a study passes whose lengths are out of tolerance."""
    study = tmp_path / "shop" / "mill"
    placed(study)
    (study / "part.yaml").write_text(f"{FEATURES}lengths:\n{lengths}", "utf-8")
    (call,) = [words for words in steps(tmp_path) if words[0] == "lengths"]
    assert ("--fail-if" in call) == gated


def test_a_part_that_is_not_found_is_left_to_mtu(tmp_path: Path) -> None:
    """Its lengths and their gate would be left out, and the study passed."""
    study = tmp_path / "shop" / "mill"
    placed(study)
    (study / "part.yaml").rename(study / "part #1.yaml")
    every = {"predict-points", "lengths", "orthogonality"}
    for named, commands in (("part.yaml", every), ("'part #1.yaml'", every - {"orthogonality"})):
        (study / "mtu.yaml").write_text(STUDY.replace("part.yaml", named), "utf-8")
        asked = {words[0]: words for words in steps(tmp_path)}
        assert asked.keys() == commands
        assert "--fail-if" in asked["lengths"]


@pytest.mark.parametrize("name", ["ROOT", "OUT"])
def test_an_empty_name_is_no_folder(tmp_path: Path, name: str) -> None:
    """Of a variable that a script has not set: reports would go to /, or be looked for there."""
    placed(tmp_path / "shop" / "mill")
    ran = make(tmp_path / "out", "-n", f"ROOT={tmp_path / 'shop'}", f"{name}=")
    assert ran.returncode == 2
    assert f"{name}= names no folder" in ran.stderr


def test_reports_do_not_go_where_the_studies_are(tmp_path: Path) -> None:
    """A report that a study names was removed before the step that reads it."""
    study = tmp_path / "shop" / "mill"
    placed(study, "components: components.json\nlbb: [lbb.csv]\n")
    (study / "components.json").write_text("{}", "utf-8")
    (tmp_path / "link").symlink_to(study.parent)
    for out in (study.parent, tmp_path / "link"):
        ran = make(out, f"ROOT={study.parent}")
        assert ran.returncode == 2
        assert "holds the studies: name another folder" in ran.stderr
    assert (study / "components.json").is_file()
