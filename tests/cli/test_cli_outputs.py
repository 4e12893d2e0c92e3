"""What a call writes and says: nothing where it fails, and nothing over what somebody measured."""

from __future__ import annotations

import codecs
import io
import json
import sys
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from cli_runner import done, listing, mtu, prepared, shell

from mtu_cli.cli.analyse import fit_components
from mtu_cli.cli.emit import Outcome, check_outputs, execute, warning_lines
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.main import main
from mtu_cli.cli.modelled import modelled
from mtu_cli.cli.options import Options
from mtu_cli.findings import Finding, InputError, finding

STUDY = """\
schema: mtu/study/1
machine: machine.yaml
part: part.yaml
lbb: [lbb.csv]
cmm: [cmm.csv]
components: [known.json]
"""
RUN = "not overwritten, as it is an input"
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")


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
    (small / "measured.csv").write_text("# CMM 4\npart;feature;x_mm;y_mm\n1;A;0,1;0\n")
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
        ("anova", {"csv": "measured.csv"}, "not overwritten, as it holds measured points"),
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


def test_simulate_overwrites_files_of_its_own_alone(small: Path) -> None:
    """Readings and points that somebody has measured do not begin as those of simulate do."""
    target, call = small / "made.csv", ["simulate", ".", "-q", "--write-cmm", "made.csv", "--seed"]
    done(mtu(*call, 1, cwd=small))
    first = target.read_bytes()
    done(mtu(*call, 2, cwd=small))
    second = target.read_bytes()
    assert first != second
    measured = second.partition(b"\n")[2]
    target.write_bytes(measured)
    told = done(mtu(*call, 3, cwd=small), 2).stderr
    assert "not overwritten, as it holds measured points" in told
    assert target.read_bytes() == measured
    for nothing in (b"", codecs.BOM_UTF8 + b" \r\n" * 100_000, b"\n" * 100_000 + second):
        target.write_bytes(nothing)
        done(mtu(*call, 3, cwd=small))
    target.write_bytes(b"\n" * 100_000 + measured)
    done(mtu(*call, 3, cwd=small), 2)
    target.write_bytes(b"RENISHAW\n")
    assert "not overwritten" in done(mtu(*call, 3, cwd=small), 2).stderr


def test_synthetic_readings_are_not_overwritten_by_a_table(small: Path) -> None:
    """What simulate made is data to all other commands."""
    done(mtu("simulate", ".", "-q", "--write-cmm", "made.csv", cwd=small))
    made = (small / "made.csv").read_bytes()
    told = done(mtu("lengths", ".", "--csv", "made.csv", cwd=small), 2).stderr
    assert "not overwritten, as it holds measured points" in told
    assert (small / "made.csv").read_bytes() == made


@FULL
def test_nothing_is_written_where_nothing_can_be_said(small: Path) -> None:
    before = listing(small)
    done(shell(f"cd {small} && mtu lengths --at T_x_degC=20 -q -o r.json 2> /dev/full"), 2)
    said = done(mtu("simulate", "--write-lbb", "l.csv", "--write-cmm", "/dev/full", cwd=small), 2)
    assert said.stderr.startswith("mtu: /dev/full: cannot be written: no space")
    assert said.stdout == ""
    assert listing(small) == before


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


def test_readings_that_a_report_was_fitted_to_are_no_news(small: Path) -> None:
    """A warning only where the files are others."""
    fitted = small / "r.json"
    execute(Options("fit-components", {"out": fitted, "quiet": True}), fit_components)

    def unused(values: Mapping[str, Any]) -> list[Finding]:
        found = modelled(Inputs(Options("lengths", {"components": [fitted], **values}))).warnings
        return [item for item in found if item.code == "not-used"]

    def names(values: Mapping[str, Any]) -> list[Any]:
        return [item.facts["names"] for item in unused(values)]

    assert names({}) == []
    (small / "new.csv").write_bytes((small / "lbb.csv").read_bytes() + b"# once more\n")
    assert "other files" in unused({"lbb": [Path("new.csv")]})[0].message
    for lbb in (["new.csv"], ["lbb.csv", "new.csv"]):
        assert names({"lbb": [Path(name) for name in lbb]}) == [["new.csv"]]
    with pytest.raises(InputError, match=r"lbb\.cvs: no such file; did you mean 'lbb\.csv'"):
        names({"lbb": [Path("lbb.cvs")]})
    document = json.loads(fitted.read_text())
    fitted.write_text(json.dumps(document | {"inputs": []}))
    # A report that names no readings may be of these.
    (item,) = unused({})
    assert "other files" not in item.message


@pytest.mark.parametrize("name", ["dir_z=0", "dir_x=2", "dir_*=0.5"])
def test_a_direction_is_forth_or_back(name: str, small: Path) -> None:
    """As a column of points is."""
    text = (small / "machine.yaml").read_text()
    (small / "machine.yaml").write_text(text.replace("Ex: ", "Ex: 0.001*dir_x + "))
    for sign in ("-1", "-", "reverse"):
        assert Inputs(Options("lengths", {"at": [f"dir_*={sign}"]})).at == {"dir_*": -1.0}
    modelled(Inputs(Options("lengths", {"at": ["dir_*=-1"]})))
    words = r"--at dir_[xz]: out of range: '.*'; expected -1 or \+1"
    with pytest.raises(InputError, match=words):
        modelled(Inputs(Options("lengths", {"at": [name]})))


def test_streams_of_text_alone(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a notebook, or of `io.StringIO`."""
    for call, begin in (("lengths -o -", "{"), ("lengths", "The least"), ("lenghts", "")):
        monkeypatch.setattr(sys, "argv", ["mtu", *call.split()])
        out, error = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as ended:
            main()
        assert out.getvalue().startswith(begin)
        assert ended.value.code == (0 if begin else 2), error.getvalue()
