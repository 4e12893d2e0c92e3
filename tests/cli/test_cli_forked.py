"""A child of the fork server does what a started process does, for every command."""

from __future__ import annotations

import shutil
import subprocess
from math import sin
from pathlib import Path

import cli_runner
import pytest
import typer
from cli_runner import (
    MTU,
    SMALL,
    Listing,
    done,
    environment,
    fork_server,
    forked,
    listing,
    mtu,
    prepared,
    started,
)
from fork_server import SET_BEFORE
from forked_calls import POSSIBLE, ForkServer
from support import CONFIGS

from mtu_cli.cli.commands import app

pytestmark = pytest.mark.skipif(not POSSIBLE, reason="every call starts a process")

FEW_EFFECTS = "--max-effects 1 --exclude cyclic --exclude warm-up --exclude covariate"
"""What is looked for longest is looked for by the same process as the rest."""
CALLS = {
    "fit-components": "",
    "thermal-fit": "--drift drift.csv --model ridge",
    "predict-points": "--covariance",
    "lengths": "--plot out.svg",
    "orthogonality": "--trials 20000",
    "anova": "--cmm cmm.csv",
    "close-loop": f"--cmm cmm.csv --write-machine new.yaml --plot out.png {FEW_EFFECTS}",
    "compare": "--cmm cmm.csv",
    "correct": "--cmm cmm.csv",
    "budget": "budget.yaml --trials 20000 --plot out.pdf",
    "simulate": "--write-lbb out.csv",
    "graph check": "graph.yaml",
    "graph draw": "graph.yaml --to out.dot",
    "graph simulate": "graph.yaml --trials 20000",
    "graph sweep": "graph.yaml --vary axis_um=0.5:2.5:2 --of d_AC --trials 20000",
    "schema": "machine",
    "help": "budget",
}
"""What each is called with in the folder of `study`; a picture of every kind of file."""
WITHOUT_REPORT = ("simulate", "graph check", "graph draw", "help", "schema")
FAULTY = ("machine.yaml", "part.yaml", "budget.yaml", "graph.yaml", "drift.csv")
Ended = tuple[int, str, str, Listing]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which every command has what it needs."""
    folder = prepared(tmp_path_factory.mktemp("forked") / "study")
    done(mtu("simulate", "--parts", "3", "--write-cmm", "cmm.csv", cwd=folder))
    shutil.copy(CONFIGS / "budgets" / "gum-h2-impedance.yaml", folder / "budget.yaml")
    shutil.copy(CONFIGS / "graphs" / "axes-a-and-c.yaml", folder / "graph.yaml")
    rows = ["component,cycle,time_min,position_mm,error,unit,T_1_degC,T_2_degC"]
    for cycle in (1, 2, 3):
        for time in range(20):
            warm, room = cycle * time / 20, sin(cycle + time)
            error = 5 * warm - room + 0.1 * sin(7 * time)
            rows.append(f"dx_x,{cycle},{time},100,{error:.3f},um,{20 + warm:.3f},{20 + room:.3f}")
    (folder / "drift.csv").write_text("\n".join(rows) + "\n")
    return folder


def ended(ways: Path, study: Path, command: str, words: str) -> tuple[Ended, Ended]:
    """How a call ends in a child and as a process, each in its own copy of a folder."""
    call = [*command.split(), *words.split()]
    if command not in WITHOUT_REPORT:
        call += ["-o", "out.json", "--csv", "out.csv"]
    found = []
    for name, way in (("child", forked), ("process", started)):
        folder = ways / name / "work"
        shutil.copytree(study, folder)
        result = way(*call, cwd=folder)
        found.append((result.returncode, result.stdout, result.stderr, listing(folder)))
    return found[0], found[1]


def test_every_command_is_compared() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]  # a group has them
    graph = commands.pop("graph").commands
    assert set(CALLS) == {*commands, *(f"graph {name}" for name in graph)}


@pytest.mark.parametrize("command", CALLS)
def test_the_same_bytes_and_files(command: str, study: Path, tmp_path: Path) -> None:
    child, process = ended(tmp_path, study, command, CALLS[command])
    assert child == process
    assert child[0] == 0, child[2]


@pytest.mark.parametrize("command", CALLS)
def test_the_same_refusal(command: str, study: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(study, broken)
    for name in FAULTY:
        (broken / name).write_text((study / name).read_text("utf-8") + "?:[\n", "utf-8")
    words = {"schema": "machin", "help": "budgt"}.get(command, CALLS[command])
    child, process = ended(tmp_path, broken, command, words)
    assert child == process
    assert child[:2] == (2, "")
    assert child[2].startswith("mtu: ")
    assert child[3] == listing(broken)


def test_a_changed_environment_is_that_of_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = mtu("fit-components", SMALL).stdout
    assert not plain.isascii()
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    assert mtu("fit-components", SMALL).stdout.isascii()


def test_a_width_is_that_of_a_process() -> None:
    width = {"COLUMNS": "60"}
    child = forked("lengths", "--help", env=width).stdout
    assert child == started("lengths", "--help", env=width).stdout
    assert child != forked("lengths", "--help").stdout


def test_what_the_command_sets_itself_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plain call is a child, also after a test that ran the command within its own process."""
    monkeypatch.delattr(cli_runner, "started")
    for name in SET_BEFORE:
        monkeypatch.setenv(name, "7")
    done(mtu("--version"))


def test_a_call_that_takes_too_long_is_killed_and_the_next_is_made(study: Path) -> None:
    forever = ["orthogonality", "--trials", "1000000000"]
    with pytest.raises(subprocess.TimeoutExpired):
        fork_server().call(forever, study, environment(), 0.3)
    assert forked("--version").stdout == started("--version").stdout


def test_the_server_ends_when_nobody_can_ask_it() -> None:
    server = ForkServer(MTU, environment())
    assert server.process.poll() is None
    server.close()
    assert server.process.returncode == 0
