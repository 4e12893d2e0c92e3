"""What a call must not write over: what it, or its study, names."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import Any

import pytest
from cli_runner import mtu, prepared

from mtu_cli.cli.emit import check_outputs
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.findings import InputError

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
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study of all kinds of files, in its folder."""
    work = prepared(tmp_path / "work")
    (work / "mtu.yaml").write_text(STUDY)
    for name in ("cmm.csv", "lbb.csv", "known.json", "apart.csv"):
        (work / name).write_text("# Synthetic")
    (work / "link.csv").symlink_to("cmm.csv")
    monkeypatch.chdir(work)
    return work


def refused(command: str, **values: Any) -> str:
    paths = {name: None if value is None else Path(value) for name, value in values.items()}
    with pytest.raises(InputError) as caught:
        check_outputs(Inputs(Options(command, paths)))
    (problem,) = caught.value.findings
    return str(problem)


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
    ],
)
def test_what_is_named_is_not_overwritten(
    command: str, values: dict[str, Any], words: str, work: Path
) -> None:
    (work / "x").mkdir()
    assert words in refused(command, **values)


@pytest.mark.parametrize(
    ("command", "values"),
    [
        ("anova", {"out": "a.json", "csv": "apart.csv", "plot": "p.png"}),
        ("fit-components", {"out": "known.json"}),
        ("simulate", {"write_lbb": "lbb.csv", "write_cmm": "cmm.csv"}),
        ("simulate", {"machine": "truth.yaml", "write_cmm": "cmm.csv"}),
        ("close-loop", {"write_machine": "new.yaml", "write_components": "new.json"}),
    ],
)
def test_what_a_command_is_there_to_make_may_be_made_again(
    command: str, values: dict[str, Any], work: Path
) -> None:
    assert (work / "known.json").exists()
    check_outputs(Inputs(Options(command, {key: Path(item) for key, item in values.items()})))


def test_simulate_overwrites_files_of_its_own_alone(tmp_path: Path) -> None:
    """Readings and points that somebody has measured do not begin as those of simulate do."""
    work = prepared(tmp_path / "work")
    files = {"--write-lbb": work / "made-lbb.csv", "--write-cmm": work / "made-cmm.csv"}
    call = ["simulate", ".", "-q"]
    call += [str(item) for pair in files.items() for item in pair]
    assert mtu(*call, "--seed", "1", cwd=work).returncode == 0
    first = [path.read_bytes() for path in files.values()]
    again = mtu(*call, "--seed", "2", cwd=work)
    assert again.returncode == 0, again.stderr
    second = [path.read_bytes() for path in files.values()]
    assert all(a != b for a, b in zip(first, second, strict=True))
    measured = second[1].partition(b"\n")[2]
    files["--write-cmm"].write_bytes(measured)
    told = mtu(*call, "--seed", "3", cwd=work)
    assert told.returncode == 2
    assert told.stderr == (
        f"mtu: {files['--write-cmm']}: not overwritten, as it does not begin with "
        "'# Synthetic'; expected another name\n"
    )
    assert [path.read_bytes() for path in files.values()] == [second[0], measured]
    for nothing in (b"", b"\n", codecs.BOM_UTF8 + b" \r\n" * 100_000):
        files["--write-cmm"].write_bytes(nothing)
        assert mtu(*call, "--seed", "3", cwd=work).returncode == 0
    files["--write-cmm"].write_bytes(b"\n" * 100_000 + measured)
    assert mtu(*call, "--seed", "3", cwd=work).returncode == 2
    files["--write-cmm"].write_bytes(b"\n" * 100_000 + second[1])
    assert mtu(*call, "--seed", "3", cwd=work).returncode == 0
