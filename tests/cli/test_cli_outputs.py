"""What a call writes and says: nothing where it fails, and nothing over what somebody measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli_runner import prepared

from mtu_cli.cli.emit import Outcome, check_outputs, execute, warning_lines
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.findings import InputError, finding

STUDY = """\
schema: mtu/study/1
machine: machine.yaml
part: part.yaml
lbb: [lbb.csv]
cmm: [cmm.csv]
components: [known.json]
"""
RUN = "not overwritten, as it is an input"


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the small study, as the working folder."""
    folder = prepared(tmp_path / "work")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def work(small: Path) -> Path:
    """A study of all kinds of files, in its folder."""
    (small / "mtu.yaml").write_text(STUDY)
    for name in ("cmm.csv", "lbb.csv", "known.json", "apart.csv"):
        (small / name).write_text("# Synthetic")
    (small / "link.csv").symlink_to("cmm.csv")
    (small / "x").mkdir()
    return small


@pytest.mark.parametrize(
    ("command", "values", "words"),
    [
        ("anova", {"out": "known.json", "machine": None}, f"known.json: {RUN}"),
        ("predict-points", {"csv": "link.csv"}, f"link.csv: {RUN}"),
        ("fit-components", {"csv": "x/../lbb.csv"}, "lbb.csv: "),
        ("fit-components", {"machine": "m.yaml", "csv": "cmm.csv"}, f"cmm.csv: {RUN}"),
        ("close-loop", {"machine": "m.yaml", "write_machine": "mtu.yaml"}, f"mtu.yaml: {RUN}"),
        ("close-loop", {"machine": "m.yaml", "csv": "m.yaml"}, "m.yaml: --csv does not write"),
        ("anova", {"machine": "m.yaml", "out": "apart.csv"}, "apart.csv: -o does not write .csv"),
        ("simulate", {"write_cmm": "b.csv.gz"}, "--write-cmm does not write .gz"),
        ("anova", {"out": "/"}, "/: a folder, no file"),
        ("anova", {"out": "a.json", "csv": "apart.csv", "plot": "p.png"}, None),
        ("fit-components", {"out": "known.json"}, None),
        ("simulate", {"write_lbb": "lbb.csv", "write_cmm": "cmm.csv"}, None),
        ("simulate", {"machine": "truth.yaml", "write_cmm": "cmm.csv"}, None),
        ("close-loop", {"write_machine": "new.yaml", "write_components": "new.json"}, None),
    ],
)
def test_what_is_named_or_measured_is_not_overwritten(
    command: str, values: dict[str, Any], words: str | None, work: Path
) -> None:
    """But for what a command is there to make."""
    paths = {name: None if value is None else Path(value) for name, value in values.items()}
    inputs = Inputs(Options(command, paths))
    if words is None:
        check_outputs(inputs)
        return
    with pytest.raises(InputError) as caught:
        check_outputs(inputs)
    (problem,) = caught.value.findings
    assert words in str(problem)


def test_warnings_are_said_once_and_notes_not_with_quiet(
    small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    note = finding("not-estimable", quantity="u", names=["a"], reason="n")
    assert warning_lines([*[finding("no-formula", reason="m"), note] * 2]) == [
        "warning: no formula: m [no-formula]",
        "note: not estimable: u (a); n [not-estimable]",
    ]
    for quiet in (True, False):
        execute(Options("lengths", {"quiet": quiet}), lambda *_: Outcome(warnings=[note]))
        assert ("not-estimable" in capsys.readouterr().err) != quiet
