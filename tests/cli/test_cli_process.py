"""The process: pipes, terminals, signals, full disks, and what a kill leaves behind."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest
from cli_runner import MTU, SMALL, done, environment, listing, prepared, shell
from cli_runner import mtu as plain_call
from cli_runner import started as mtu

ESCAPE = "\x1b["
BOXES = re.compile("[\u2500-\u257f]")
OLD = b'{"old": true}\n'


INTERRUPTED = """
import signal, sys

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            signal.raise_signal(signal.SIGINT)

module = sys.argv.pop(1)
sys.meta_path.insert(0, Interrupts())
from mtu_cli.cli.main import main
main()
"""
"""The entry point, interrupted as it comes to import one module."""


def start(*args: object, cwd: Path, program: Sequence[object] = (MTU,)) -> subprocess.Popen[bytes]:
    """A call that runs while the test goes on."""
    return subprocess.Popen(
        [*map(str, program), *map(str, args)],
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
    return done(mtu("lengths", SMALL)).stdout


def test_a_pipe_receives_plain_text() -> None:
    """Whatever terminal it was started from."""
    plain = in_a_pipe()
    strange = {"COLUMNS": "40", "FORCE_COLOR": "1"}
    assert done(mtu("lengths", SMALL, env=strange)).stdout == plain
    assert ESCAPE not in plain
    assert BOXES.search(plain) is None
    assert max(map(len, plain.splitlines())) <= 100
    assert not any(line.endswith(" ") for line in plain.splitlines())


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


def test_a_terminal_receives_colour() -> None:
    shown = on_a_terminal("lengths", SMALL)
    assert ESCAPE in shown
    bare = re.sub(r"\x1b\[[0-9;]*m", "", shown)
    for line in in_a_pipe().splitlines()[3:5]:
        assert line.split() == next(x for x in bare.splitlines() if x.startswith(line[:3])).split()


def test_a_narrow_terminal_loses_nothing() -> None:
    """Columns stand below each other there: all that a pipe receives is to be seen."""
    shown = re.sub(r"\x1b\[[0-9;]*m", "", on_a_terminal("lengths", SMALL, columns=20))
    _, _, _, *rows = in_a_pipe().partition("\nU = ")[0].splitlines()
    for cell in (cell for row in rows for cell in re.split(" {2,}", row)):
        assert re.search(rf"(^| ){re.escape(cell)}( |\r?$)", shown, re.MULTILINE)


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
def test_full_disks_and_closed_streams() -> None:
    message = done(shell(f"mtu lengths {SMALL} > /dev/full"), 2).stderr
    assert message.startswith("mtu: standard output cannot be written")
    assert "no space left on device" in message
    message = done(plain_call("lengths", SMALL, "-o", "/dev/full"), 2).stderr
    assert message.startswith("mtu: /dev/full: cannot be written: no space left")
    assert done(shell(f"mtu lengths {SMALL} -o - 2>&-")).stdout.startswith("{")
    assert done(shell(f"mtu lengths {SMALL} >&- <&-")).stdout == ""


def test_pipes_are_read() -> None:
    fit = f"mtu fit-components -m {SMALL}/machine.yaml --lbb"
    told = done(plain_call(*fit.split()[1:], f"{SMALL}/lbb.csv")).stdout
    assert done(shell(f"cat {SMALL}/lbb.csv | {fit} /dev/stdin")).stdout == told


def test_an_output_that_lacks_letters() -> None:
    bare = {"PYTHONIOENCODING": "ascii"}
    assert "20.2 \\xb1 4.1" in done(mtu("fit-components", SMALL, env=bare)).stdout


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


def test_interrupt_while_it_imports(tmp_path: Path) -> None:
    call = ("mtu_cli.cli.analyse", "lengths", SMALL)
    process = start(*call, cwd=tmp_path, program=[sys.executable, "-c", INTERRUPTED])
    assert process.communicate(timeout=30) == (b"", b"")
    assert process.returncode == 130


def large(folder: Path) -> list[str]:
    """A study and a call with a report of 2 MB, so that writing it takes a while."""
    work = prepared(folder)
    features = "".join(f"  f{i}: {{x_mm: {i / 2}, y_mm: {i / 3:.4f}}}\n" for i in range(160))
    (work / "part.yaml").write_text(f"schema: mtu/part/1\nname: grid\nfeatures:\n{features}")
    (work / "out.json").write_bytes(OLD)
    words = "predict-points --covariance --trials 1000 -q -o out.json --csv out.csv"
    return words.split()


def test_interrupt_while_writing(tmp_path: Path) -> None:
    """The moment is found by looking for the temporary file."""
    call = large(tmp_path / "work")
    work = tmp_path / "work"
    kept = 0
    for delay in (0.0, 0.03):
        (work / "out.json").write_bytes(OLD)
        (work / "out.csv").unlink(missing_ok=True)
        process = start(*call, cwd=work)
        while process.poll() is None and not any(work.glob(".out.json*.tmp")):
            time.sleep(0.0005)
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=30)
        assert b"Traceback" not in error
        content = (work / "out.json").read_bytes()
        if content == OLD:
            kept += 1
            assert process.returncode == 130
        else:
            report = json.loads(content)
            assert len(report["results"]["covariance_um2"]) == 320
        assert not any(work.glob(".out*"))
        assert (content == OLD) == (not (work / "out.csv").exists())
    assert kept >= 1
