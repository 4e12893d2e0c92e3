"""What is told and what is written: nothing of it where the call fails, nothing told in vain."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from cli_runner import done, listing, mtu, prepared, shell

from mtu_cli.cli.analyse import fit_components as fitting
from mtu_cli.cli.emit import Outcome, deliver, execute, warning_lines
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import modelled
from mtu_cli.cli.options import Options
from mtu_cli.findings import Finding, InputError, finding


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the small study, as the working folder."""
    folder = prepared(tmp_path / "work")
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_nothing_is_written_where_nothing_can_be_said(work: Path) -> None:
    before = listing(work)
    done(shell(f"cd {work} && mtu lengths --at T_x_degC=20 -q -o r.json 2> /dev/full"), 2)
    assert listing(work) == before


def test_files_come_after_what_is_told(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = work / "new.json"
    files = {target: b"{}"}

    def fails(error: OSError) -> None:
        assert not target.exists()
        raise error

    before = listing(work)
    with pytest.raises(OSError, match="No space"):
        deliver(files, lambda: fails(OSError(28, "No space left on device")), [])
    assert listing(work) == before
    deliver(files, lambda: None, ["warning: a"])
    assert capsys.readouterr().err == "warning: a\n"
    assert listing(work) == before | {"new.json": b"{}"}


def _report(folder: Path) -> Path:
    target = folder / "r.json"
    execute(Options("fit-components", {"out": target, "quiet": True}), fitting)
    return target


def _told(values: Mapping[str, Any]) -> tuple[list[Finding], list[str]]:
    found = modelled(Inputs(Options("lengths", dict(values)))).warnings
    own = [item for item in found if item.code == "not-used"]
    return own, warning_lines(own)


def test_readings_that_a_report_was_fitted_to_are_no_news(work: Path) -> None:
    """A warning only where the files are others."""
    fitted = _report(work)
    assert _told({"components": [fitted]}) == ([], [])
    (work / "new.csv").write_bytes((work / "lbb.csv").read_bytes() + b"# once more\n")
    for lbb in (["new.csv"], ["lbb.csv", "new.csv"]):
        (item,), (line,) = _told({"components": [fitted], "lbb": [Path(name) for name in lbb]})
        assert item.facts["names"] == ["new.csv"]
        assert line.endswith("[not-used]")
    with pytest.raises(InputError, match=r"lbb\.cvs: no such file; did you mean 'lbb\.csv'"):
        _told({"components": [fitted], "lbb": [Path("lbb.cvs")]})
    document = json.loads(fitted.read_text())
    document["inputs"].append({"role": "laser", "path": "l.csv", "sha256": "0", "rows": 3})
    fitted.write_text(json.dumps(document))
    assert "[not-used]" in _told({"components": [fitted]})[1][0]
    fitted.write_text(json.dumps(document | {"inputs": []}))
    assert "[not-used]" in _told({"components": [fitted]})[1][0]


def test_warnings_and_notes_are_told_once() -> None:
    warned = [
        finding("no-formula", reason="m"),
        finding("not-estimable", quantity="u", names=["a"], reason="n"),
    ]
    assert warning_lines([*warned, *warned]) == [
        "warning: no formula: m [no-formula]",
        "note: not estimable: u (a); n [not-estimable]",
    ]


def test_notes_are_not_told_with_quiet(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    note = finding("not-estimable", quantity="u", names=["a"], reason="n")
    for quiet in (True, False):
        execute(Options("lengths", {"quiet": quiet}), lambda *_: Outcome(warnings=[note]))
        assert ("not-estimable" in capsys.readouterr().err) != quiet


@pytest.mark.parametrize("name", ["dir_z=0", "dir_x=2", "dir_*=0.5"])
def test_a_direction_is_forth_or_back(name: str, work: Path) -> None:
    """As a column of points is."""
    text = (work / "machine.yaml").read_text()
    (work / "machine.yaml").write_text(text.replace("Ex: ", "Ex: 0.001*dir_x + "))
    for sign in ("-1", "-", "reverse"):
        assert Inputs(Options("lengths", {"at": [f"dir_*={sign}"]})).at == {"dir_*": -1.0}
    modelled(Inputs(Options("lengths", {"at": ["dir_*=-1"]})))
    words = r"--at dir_[xz]: out of range: '.*'; expected -1 or \+1"
    with pytest.raises(InputError, match=words):
        modelled(Inputs(Options("lengths", {"at": [name]})))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_rows_are_told_once_they_are_written(work: Path) -> None:
    before = listing(work)
    said = done(mtu("simulate", "--write-lbb", "l.csv", "--write-cmm", "/dev/full", cwd=work), 2)
    assert said.stderr.startswith("mtu: /dev/full: cannot be written: no space")
    assert said.stdout == ""
    assert listing(work) == before
