"""Studies for the pipeline of configs/pipeline, and runs of it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from cli_runner import MTU, environment
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


def make(out: Path, *args: str, called: Path | None = None) -> subprocess.CompletedProcess[str]:
    """A run of the pipeline, as if it were `called` from that folder."""
    env = {"MAKEFLAGS": ""} if called is None else {"MAKEFLAGS": "", "PWD": str(called)}
    return subprocess.run(
        ["make", "-C", str(CONFIGS / "pipeline"), f"OUT={out}", f"MTU={MTU}", *args],
        env=environment(env),
        cwd=called,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=90,
        check=False,
    )
