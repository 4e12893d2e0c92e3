"""Studies for the pipeline of configs/pipeline, and runs of it."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import made_files
import pytest
from cli_runner import MTU, done, environment, listing, mtu
from support import CONFIGS

GILSINN_LING = CONFIGS / "gilsinn-ling"
STUDY = "schema: mtu/study/1\nmachine: machine.yaml\npart: part.yaml\n"
PART = """\
schema: mtu/part/1
name: two holes
features: {a: {x_mm: 10, y_mm: 10}, b: {x_mm: 140, y_mm: 10}}
lengths: [{from: a, to: b, tolerance_um: 5}]
"""


def placed(study: Path, more: str = "") -> None:
    """A study of two holes whose lengths are as their tolerance asks for."""
    study.mkdir(parents=True)
    (study / "machine.yaml").write_bytes((GILSINN_LING / "machine.yaml").read_bytes())
    (study / "part.yaml").write_text(PART.replace("tolerance_um: 5", "tolerance_um: 50"), "utf-8")
    (study / "mtu.yaml").write_text(STUDY + more, "utf-8")


def quick(folder: Path) -> str:
    """In place of mtu, what makes its files, and fails where the study's `fails` names the command
    or its readings have gone: of a test that asks for make.
    """
    path = folder / "quick-mtu"
    path.write_text(
        "#!/bin/sh\n"
        'grep -q "$1" "$2/fails" 2>/dev/null && exit 3\n'
        'grep -q bar.csv "$2/mtu.yaml" && [ ! -f "$2/bar.csv" ] && exit 2\n'
        'for word; do case "$last" in -o|--csv|--plot) : > "$word";; esac; last=$word; done\n',
        "utf-8",
    )
    path.chmod(0o755)
    return f"MTU={path}"


def make(
    out: Path, *args: str, called: Path | None = None, code: int = 0
) -> subprocess.CompletedProcess[str]:
    """A run of the pipeline, as if it were `called` from that folder, that ends with `code`."""
    env = {"MAKEFLAGS": ""} if called is None else {"MAKEFLAGS": "", "PWD": str(called)}
    ran = subprocess.run(
        ["make", "-C", str(CONFIGS / "pipeline"), f"OUT={out}", f"MTU={MTU}", *args],
        env=environment(env),
        cwd=called,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=90,
        check=False,
    )
    assert ran.returncode == code, ran.stderr
    return ran


# The Makefile pipeline of configs/pipeline: steps by what a study names, gates, nothing twice.


FEATURES = PART[: PART.index("lengths:")]
RENAME = "make takes letters, digits and . _ + @ - in names alone: rename the folder"


def steps(tmp_path: Path) -> dict[str, list[str]]:
    """The calls of mtu that a gate would make for the studies, by command, in words."""
    ran = make(tmp_path / "out", "-n", "GATE=1", f"ROOT={tmp_path / 'shop'}")
    calls = [line.split()[1:] for line in ran.stdout.splitlines() if line.startswith(str(MTU))]
    return {words[0]: words for words in calls}


def test_a_study_runs_once_and_a_gate_stops_every_time(tmp_path: Path) -> None:
    study, out = tmp_path / "shop" / "mill-1", tmp_path / "out"
    placed(study)
    (study / "part.yaml").write_text(PART, "utf-8")
    root = f"ROOT={study.parent}"
    ran = make(out, "-j2", root)
    assert f"reports, tables and pictures: {out}/<study>/" in ran.stdout.splitlines()
    made = {path.name for path in (out / "mill-1").iterdir()}
    assert made == {"points.json", "points.png", "lengths.json", "lengths.csv", "lengths.done"}
    make(out, "-q", root)
    for _ in range(2):
        stopped = make(out, root, "GATE=1", code=2)
        assert "Error 3" in stopped.stderr
        assert "gate nonconforming" in stopped.stderr


def test_a_gate_stops_parts_that_are_off_or_scatter_more_than_predicted(tmp_path: Path) -> None:
    placed(tmp_path / "shop" / "mill", "cmm: [cmm.csv]\n")
    (tmp_path / "shop" / "mill" / "cmm.csv").touch()
    words = steps(tmp_path)["compare"]
    assert words[words.index("--fail-if") + 1] == "biased,under-predicted"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("ROOT={}/none", "*** no study: no {}/none/*/mtu.yaml here"),
        ("ROOT={}/shop", "'{}/shop/mill 1': " + RENAME),
        ("OUT={}/my out", "OUT='{}/my out': " + RENAME),
        ("STUDIES=a%b", "STUDIES='a%b': " + RENAME),
        ("ROOT=", "ROOT= names no folder"),
        ("OUT=", "OUT= names no folder"),
    ],
)
def test_a_gate_that_finds_no_study_does_not_pass(tmp_path: Path, call: str, words: str) -> None:
    study = tmp_path / "shop" / "mill 1"
    study.mkdir(parents=True)
    (study / "mtu.yaml").write_text(STUDY, "utf-8")
    ran = make(tmp_path / "out", "GATE=1", call.format(tmp_path), code=2)
    assert words.format(tmp_path) in ran.stderr


def test_a_gate_runs_all_studies_and_sums_them_up(tmp_path: Path) -> None:
    """One of them meets the gate of its lengths, one lacks a file; folders count from the call.
    Studies may be called as targets of the Makefile are.
    """
    names = ("-x", "all", "clean", "fr\u00e4se.1", "mill-2", "mill-3")
    for name in names:
        placed(tmp_path / "shop" / name, "lbb: [bar.csv]\n" if name == "mill-3" else "")
    gate, bar = tmp_path / "shop" / "mill-2" / "fails", tmp_path / "shop" / "mill-3" / "bar.csv"
    gate.write_text("lengths", "utf-8")
    call = ("ROOT=shop", "GATE=1", quick(tmp_path))
    ran = make(Path("out"), "-j2", *call, called=tmp_path, code=2)
    assert "No rule" not in ran.stderr
    left = {"mill-2": "lengths", "mill-3": "fit-components iso230 predict-points lengths"}
    told = {f"{x}: {f'not passed: {left[x]}' if x in left else 'passed'}" for x in names}
    assert told <= set(ran.stdout.splitlines())
    passed = {path.parent.name for path in (tmp_path / "out").glob("*/lengths.passed")}
    assert passed == {*names} - {*left}
    gate.unlink()
    bar.touch()
    again = make(Path("out"), *call, called=tmp_path)
    assert {"mill-2: passed", "mill-3: passed"} <= set(again.stdout.splitlines())


def test_clean_takes_away_what_the_pipeline_has_made_alone(tmp_path: Path) -> None:
    placed(tmp_path / "shop" / "mill")
    mine, out, root = tmp_path / "mine", tmp_path / "out", f"ROOT={tmp_path / 'shop'}"
    mine.mkdir()
    (mine / "measured.csv").write_text("1\n", "utf-8")
    ran = make(mine, "clean", code=2)
    assert "was there before this pipeline" in ran.stderr
    assert (mine / "measured.csv").is_file()
    make(out, root, quick(tmp_path))
    make(out, "clean", root)
    assert not out.exists()


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
    study = tmp_path / "shop" / "mill"
    placed(study)
    (study / "part.yaml").write_text(f"{FEATURES}lengths:\n{lengths}", "utf-8")
    assert ("--fail-if" in steps(tmp_path)["lengths"]) == gated
    # Where the part is not found, mtu has to say so.
    (study / "part.yaml").unlink()
    asked = steps(tmp_path)
    assert asked.keys() == {"predict-points", "lengths", "orthogonality"}
    assert "--fail-if" in asked["lengths"]


def test_reports_do_not_go_where_the_studies_are(tmp_path: Path) -> None:
    """A report that a study names was removed before the step that reads it."""
    study = tmp_path / "shop" / "mill"
    placed(study, "components: components.json\nlbb: [lbb.csv]\n")
    (study / "components.json").write_text("{}", "utf-8")
    (tmp_path / "link").symlink_to(study.parent)
    for out in (study.parent, tmp_path / "link"):
        ran = make(out, f"ROOT={study.parent}", code=2)
        assert "holds the studies: name another folder" in ran.stderr
    assert (study / "components.json").is_file()


def test_runs_that_need_a_unit_or_a_profile_are_fitted_and_a_part_is_not_asked_for(
    tmp_path: Path,
) -> None:
    study, out = tmp_path / "shop" / "mill", tmp_path / "out"
    study.mkdir(parents=True)
    for name, text in (
        ("laser.txt", made_files.LASER),
        ("map.yaml", made_files.MAP),
        ("mapped.csv", made_files.MAPPED),
        (
            "machine.yaml",
            "schema: mtu/machine/1\nname: m\ncomponents: {dx_x: {of: x, unit: um}}\n"
            "equations: {Ex: dx_x}\n",
        ),
        (
            "mtu.yaml",
            "schema: mtu/study/1\nmachine: machine.yaml\nlaser:\n"
            "- {file: laser.txt, component: dx_x, unit: um}\n- {file: mapped.csv, map: map.yaml}\n",
        ),
    ):
        (study / name).write_text(text)
    root, made = f"ROOT={study.parent}", f"{out}/mill/components.json"
    assert made in make(out, root, "-n").stdout
    assert "predict-points" not in make(out, root, "-n").stdout
    make(out, root, quick(tmp_path), made)
    make(out, root, "-q", made)
    os.utime(study / "map.yaml", (2e9, 2e9))
    make(out, root, "-q", made, code=1)


# The Snakefile of configs/pipeline: the reports of make and of single commands; its gates.


BESIDE = Path(sys.executable).parent / "snakemake"
SNAKEMAKE = str(BESIDE) if BESIDE.exists() else shutil.which("snakemake")
WITH_SNAKEMAKE = pytest.mark.skipif(
    SNAKEMAKE is None, reason="snakemake is not installed (pip install 'mtu-cli[cluster]')"
)


def snakemake(folder: Path, *config: str) -> subprocess.CompletedProcess[str]:
    """A run of all studies in the `folder`'s shop, from a folder beside: reports name the files
    of others without theirs.
    """
    (work := folder / "work").mkdir(exist_ok=True)
    file = CONFIGS / "pipeline" / "Snakefile"
    call = [str(SNAKEMAKE), "-s", str(file), "--cores", "2", "--nocolor", "--keep-going"]
    own = (f"root={folder / 'shop'}", f"out={folder / 'cluster'}", f"mtu={MTU}")
    return subprocess.run(
        [*call, "--config", *own, *config],
        env=environment({"HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}),
        cwd=work,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=280,
        check=False,
    )


@WITH_SNAKEMAKE
def test_reports_are_those_of_make_and_of_single_commands(tmp_path: Path) -> None:
    """A laser's own files, parts, and the loop: every step but the drift test."""
    for name in ("configs", "data"):
        shutil.copytree(CONFIGS.parent / name / "laser-mill", tmp_path / name / "laser-mill")
    (tmp_path / "shop").symlink_to("configs")
    ran = snakemake(tmp_path)
    assert ran.returncode == 0, ran.stderr
    made = listing(tmp_path / "cluster" / "laser-mill")
    assert {"components.json", "iso230.json", "loop.json"} < made.keys()
    make(tmp_path / "make", "-j2", f"ROOT={tmp_path / 'shop'}")
    other = listing(tmp_path / "make" / "laser-mill")
    assert made == {name: other[name] for name in made}
    assert {name for name in other if name not in made} == {
        f"{step}.done" for step in ("lengths", "anova", "compare", "loop")
    }
    study, models = tmp_path / "shop" / "laser-mill", tmp_path / "cluster" / "laser-mill"
    for step, command in (
        ("iso230", f"iso230 {study}"),
        ("compare", f"compare {study} -c {models}/components.json"),
    ):
        done(mtu(*shlex.split(command), "-q", "-o", "alone.json", cwd=tmp_path / "work"))
        assert (tmp_path / "work" / "alone.json").read_bytes() == made[f"{step}.json"]


@WITH_SNAKEMAKE
def test_a_gate_keeps_the_reports_and_stops_no_other_study(tmp_path: Path) -> None:
    for name in ("mill-1", "mill-2"):
        placed(tmp_path / "shop" / name)
    (tmp_path / "shop" / "mill-2" / "part.yaml").write_text(PART, "utf-8")
    for _ in range(2):
        ran = snakemake(tmp_path, "gate=1")
        assert ran.returncode != 0
        assert "mill-2/lengths.exit" in ran.stderr
    out = tmp_path / "cluster"
    assert (out / "mill-1" / "passed").is_file()
    assert not (out / "mill-2" / "passed").exists()
    assert (out / "mill-2" / "lengths.json").is_file()
    (tmp_path / "shop" / "mill-2" / "part.yaml").write_text(
        PART.replace("tolerance_um: 5", "tolerance_um: 50"), "utf-8"
    )
    again = snakemake(tmp_path, "gate=1", "studies=mill-2")
    assert again.returncode == 0, again.stderr
    assert (out / "mill-2" / "passed").is_file()
