"""The Snakefile of configs/pipeline: the reports of make and of single commands; its gates."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli_runner import MTU, done, environment, listing, mtu
from pipeline_runner import PART, make, placed
from support import CONFIGS

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
    by_make = make(tmp_path / "make", "-j2", f"ROOT={tmp_path / 'shop'}")
    assert by_make.returncode == 0, by_make.stderr
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
