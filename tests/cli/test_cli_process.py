"""The process: the same bytes everywhere; pipes, terminals, signals, full disks."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import time
from functools import cache
from pathlib import Path

import pytest
from cli_runner import MTU, SMALL, Listing, done, environment, listing, prepared, shell, started
from cli_runner import mtu as within
from support import CONFIGS

ESCAPE, COLOUR = "\x1b[", re.compile(r"\x1b\[[0-9;]*m")
SURROUNDINGS = [
    (1, {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C"}),
    (2, {"PYTHONHASHSEED": "1", "TZ": "Asia/Tokyo", "LC_ALL": "de_DE.UTF-8", "MPLBACKEND": "svg"}),
]
CALLS = {
    "lengths --plot out.svg -o out.json --csv out.csv": 0,
    f"budget {CONFIGS}/budgets/gum-h2-impedance.yaml --trials 20000 --plot out.pdf": 0,
    "anova --cmm lbb.csv": 2,
    "lenghts": 2,
}
"""With how each ends, in a folder of its own; a picture of every kind of file."""


@pytest.mark.parametrize("call", CALLS)
def test_a_process_does_what_a_call_of_the_tests_does(call: str, tmp_path: Path) -> None:
    found = []
    for name, way in (("within", within), ("process", started)):
        work = prepared(tmp_path / name / "work")
        result = done(way(*call.split(), cwd=work), CALLS[call])
        found.append((result.stdout, result.stderr, listing(work)))
    assert found[0] == found[1]


def outcome(folder: Path, threads: int, env: dict[str, str]) -> Listing:
    """All bytes of calls with absolute paths from another folder: files and standard streams."""
    work, away = prepared(folder / "secret-folder"), folder / "away"
    away.mkdir()
    files = ["-o", "out.json", "--csv", "out.csv", "--plot", "out.pdf"]
    words = ["--threads", threads, "--trials", 20_000]
    result = done(started("orthogonality", work / "mtu.yaml", *files, *words, cwd=away, env=env))
    made = ("--write-lbb", "a.csv", "--write-cmm", "b.csv")
    done(started("simulate", work / "mtu.yaml", *made, cwd=away, env=env))
    return listing(away) | {"": result.stdout.encode(), " ": result.stderr.encode()}


def test_threads_hash_seeds_languages_time_zones_and_places(tmp_path: Path) -> None:
    first, other = (outcome(tmp_path / str(n), n, env) for n, env in SURROUNDINGS)
    assert set(first) == {"", " ", "out.json", "out.csv", "out.pdf", "a.csv", "b.csv"}
    assert other == first
    for name, content in first.items():
        text = (content or b"").decode("utf-8", "replace")
        assert "secret-folder" not in text, name
        assert str(Path.home()) + "/" not in text, name
        assert not re.search(r"\b20\d\d-\d\d-\d\d|CreationDate", text), name
        assert '"path": "/' not in text, name


def test_the_seed_makes_the_difference(tmp_path: Path) -> None:
    texts: list[str] = []
    for seed in ("1", "1", "2"):
        path = tmp_path / f"{len(texts)}.json"
        done(within("orthogonality", SMALL, "--seed", seed, "--trials", "20000", "-o", path))
        texts.append(path.read_text("utf-8").replace(f'"seed": {seed}', '"seed"'))
    assert texts[0] == texts[1] != texts[2]


def start(*args: object, cwd: Path) -> subprocess.Popen[bytes]:
    """A call that runs while the test goes on."""
    return subprocess.Popen(
        [MTU, *map(str, args)],
        # A runner in the background hands an ignored interrupt on to its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        cwd=cwd,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@cache
def in_a_pipe() -> str:
    """What a process writes where nothing is said of terminals."""
    return done(started("lengths", SMALL)).stdout


def test_a_pipe_receives_plain_text() -> None:
    """Whatever terminal it was started from."""
    plain, strange = in_a_pipe(), {"COLUMNS": "40", "FORCE_COLOR": "1"}
    assert done(started("lengths", SMALL, env=strange)).stdout == plain
    assert re.search("\x1b|[\u2500-\u257f]| $", plain, re.MULTILINE) is None
    assert max(map(len, plain.splitlines())) <= 100


def on_a_terminal(*args: object, columns: int = 100) -> str:
    """What a call writes where standard output is a terminal."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [MTU, *map(str, args)],
        env=environment({"TERM": "xterm-256color", "COLUMNS": str(columns)}),
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs)
    found = b""
    while select.select([ours], [], [], 30)[0]:
        try:
            part = os.read(ours, 1 << 16)
        except OSError:
            break
        if not part:
            break
        found += part
    os.close(ours)
    assert process.wait(30) == 0
    return found.decode()


def test_a_terminal_receives_colour_and_a_narrow_one_loses_nothing() -> None:
    """Columns stand below each other there: all that a pipe receives is to be seen."""
    wide = on_a_terminal("lengths", SMALL)
    assert ESCAPE in wide
    lines = COLOUR.sub("", wide).splitlines()
    for line in in_a_pipe().splitlines()[3:5]:
        assert line.split() == next(x for x in lines if x.startswith(line[:3])).split()
    narrow = COLOUR.sub("", on_a_terminal("lengths", SMALL, columns=20))
    _, _, _, *rows = in_a_pipe().partition("\nU = ")[0].splitlines()
    for cell in (cell for row in rows for cell in re.split(" {2,}", row)):
        assert re.search(rf"(^| ){re.escape(cell)}( |\r?$)", narrow, re.MULTILINE)


@pytest.mark.parametrize("call", ["lengths --help", f"lengths {SMALL}"])
def test_a_reader_that_never_reads(call: str, tmp_path: Path) -> None:
    """Help is written by a library, which would have ended with 1."""
    process = start(*call.split(), cwd=tmp_path)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as stream:
        said = stream.read().splitlines()
    assert process.wait(30) == 0
    # Of three runs the study's own warning is all that is said.
    told = [b"few-degrees-of-freedom]"] if "small" in call else []
    assert [line.rpartition(b"[")[2] for line in said] == told


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_full_disks_closed_streams_pipes_and_bare_encodings(tmp_path: Path) -> None:
    message = done(shell(f"mtu lengths {SMALL} > /dev/full"), 2).stderr
    assert message.startswith("mtu: standard output: the system refuses")
    assert "no space left on device" in message
    message = done(within("lengths", SMALL, "-o", "/dev/full"), 2).stderr
    assert "mtu: /dev/full: cannot be written: no space left" in message
    assert done(shell(f"mtu lengths {SMALL} -o - 2>&-")).stdout.startswith("{")
    assert done(shell(f"mtu lengths {SMALL} >&- <&-")).stdout == ""
    fit = f"mtu fit-components -m {SMALL}/machine.yaml --lbb"
    told = done(within(*fit.split()[1:], f"{SMALL}/lbb.csv")).stdout
    assert done(shell(f"cat {SMALL}/lbb.csv | {fit} /dev/stdin")).stdout == told
    bare = {"PYTHONIOENCODING": "ascii"}
    assert "20.2 \\xb1 4.1" in done(started("fit-components", SMALL, env=bare)).stdout
    (gone := tmp_path / "gone").mkdir()
    gone_folder = shell(f"cd {gone} && rmdir ../gone && exec mtu lengths -o out.json")
    assert "no such file or directory" in done(gone_folder, 2).stderr


def test_interrupt(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    before = listing(work)
    process = start("orthogonality", "--trials", "1000000000", "-o", "out.json", cwd=work)
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    output, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert b"Traceback" not in error
    assert output == b""
    assert listing(work) == before
