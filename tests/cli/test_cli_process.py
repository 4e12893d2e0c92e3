"""The process: the same bytes everywhere; pipes, terminals, signals, full disks."""

import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path

import pytest
from cli_runner import (
    MTU,
    SMALL,
    Listing,
    done,
    environment,
    listing,
    mtu,
    prepared,
    refused,
    shell,
    started,
)
from cli_runner import mtu as within
from support import CONFIGS

from mtu_cli.cli import emit
from mtu_cli.cli.emit import late_bar

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


BYTES = {
    "orthogonality {}/study/mtu.yaml --trials 20000 --plot o.pdf": "o.json o.csv o.pdf",
    "simulate {}/study/mtu.yaml --write-lbb a.csv --write-cmm b.csv": "a.csv b.csv",
    f"graph simulate {CONFIGS}/graphs/work-coordinates.yaml --plot o.svg": "o.json o.csv o.svg",
    f"compare {CONFIGS}/gilsinn-ling-parts --plot o.png": "o.json o.csv o.png",
}
"""Calls with absolute paths, and what they write in another folder."""


@pytest.mark.parametrize("call", BYTES)
def test_threads_hash_seeds_languages_time_zones_and_places(call: str, tmp_path: Path) -> None:
    found: list[Listing] = []
    for threads, env in SURROUNDINGS:
        folder = tmp_path / str(threads) / "secret-folder"
        prepared(folder / "study")
        (away := folder / "away").mkdir()
        words = call.format(folder).split()
        if words[0] != "simulate":
            words += ["--threads", str(threads), "-o", "o.json", "--csv", "o.csv"]
        result = done(started(*words, cwd=away, env=env))
        found.append(listing(away) | {"": result.stdout.encode(), " ": result.stderr.encode()})
    assert found[0].keys() == {"", " ", *BYTES[call].split()}
    assert found[0] == found[1]
    for name, content in found[0].items():
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
    """What is written where nothing is said of terminals."""
    return done(within("lengths", SMALL)).stdout


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


# What is seen on a terminal of what takes longer than a second.


class Terminal(io.StringIO):
    """Standard error that is one."""

    def isatty(self) -> bool:
        return True


def test_it_tells_what_is_done_without_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither all the time, nor of what is done at once."""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    with late_bar("budget") as bar:
        bar(1, 2)
    assert terminal.getvalue() == ""
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    # Libraries that a test before loaded may have threads of their own.
    before = threading.active_count()
    for every, shares in ((0.0, ["30", "70"]), (3600.0, ["30"])):
        monkeypatch.setattr(emit, "EVERY_S", every)
        terminal.truncate(0)
        with late_bar("close-loop") as bar:
            bar(3, 10)
            bar(7, 10)
            assert threading.active_count() == before
        assert re.findall(r"close-loop: (\d+)%", terminal.getvalue()) == shares
        # The line is left empty.
        assert terminal.getvalue().endswith("\r\x1b[K")


# Calls that are at fault: options, values, gates, reports of another machine.


OUTPUTS = ["-o", "out.json", "--csv", "out.csv", "--plot", "out.png"]


def test_all_settings_out_of_range_are_told_at_once(small: Path) -> None:
    values = {"--k": "nan", "--digits": "5", "--seed": "-1", "--correlation": "some"}
    values |= {"--trials": "999", "--threads": "0"}
    call = [word for pair in values.items() for word in pair]
    found = refused(small, "lengths", *call, *OUTPUTS).removeprefix("mtu: ").splitlines()
    assert len(found) == len(values)
    begun = {line.partition("; expected ")[0] for line in found}
    assert begun == {f"{option}: out of range: '{value}'" for option, value in values.items()}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["lengths", "--outptu", "a"], "no such option: --outptu (Possible options: --out"),
        (["graph", "draw", "--to"], "option '--to' requires an argument"),
        (["close-loop", "--fail-if", "found,drifts"],
         "unknown gate: 'drifts'; expected suspicious"),
        (["lengths", "--out", "-q"], "-q: -o does not write a file without an ending; expected"),
        (["lengths", "--fail-if", "nonconforming=1"],
         "--fail-if nonconforming: out of range: 'nonconforming=1'; expected a probability"),
        (["lengths", "--fail-if", "nonconforming=0.5,nonconforming=0.1"],
         "--fail-if nonconforming appears twice: 'nonconforming=0.1'"),
        (["lengths", "--fail-if", "nonconforming"], "unknown gate: 'nonconforming'; expected susp"),
        (["graph", "sweep", "g.yaml"], "missing option '--vary'"),
        (["graph", "chek"], "no such command 'chek'. Did you mean 'check' (see mtu graph --help)"),
        (["lengths", "--at", "-o"], "--at: not NAME=VALUE: '-o'"),
        (["simulate", "--cmm-room", "22:25"],
         "invalid value for '--cmm-room': not a number: '22:25'"),
        (["simulate", "--passes", "0"], "--passes: out of range: '0'; expected from 1 to 10000"),
        (["lengths", "-p", ""], "invalid value for '-p' / '--part': it names no file"),
        (["\u65e5\u672c" * 40], "no such command '\u65e5\u672c"),
        (["lengths", "--a\x1b[31m\n"], "no such option: --a\\x1b[31m"),
    ],
    ids=lambda value: ascii(" ".join(value)[:20]) if isinstance(value, list) else "",
)  # fmt: skip
def test_calls_that_are_none_are_told_in_one_line(call: list[str], words: str, small: Path) -> None:
    message = refused(small, *call, env={"COLUMNS": "30"})
    assert message.startswith(f"mtu: {words}")
    assert len(message.splitlines()) == 1


def test_sizes_of_a_machine_in_another_unit_are_asked_about(small: Path) -> None:
    text = (small / "machine.yaml").read_text().replace("travel_mm: [0, 300]", "travel_mm: [0, 3]")
    text = text.replace("components:", "constants: {z0: 127000}\ncomponents:")
    (small / "machine.yaml").write_text(text.replace("of: y", "of: x"))
    told = done(mtu("fit-components", ".", "-q", cwd=small)).stderr
    for words in ("axes.y.travel_mm: a travel of 3 mm", "constants.z0: a constant of 127000 mm"):
        assert f"{words} is hardly meant; probably " in told


# Input made to break things: bombs, code, bytes that are no text, names that are no UTF-8.


MACHINE = "schema: mtu/machine/1\nname: m\ncomponents: {a: {unit: um}}\n"
SECONDS = 10.0
"""Generous: a refusal takes 0.4 s, and an expanded bomb would take hours or all memory."""


def bomb() -> str:
    """Nine levels of nine aliases: four hundred million values."""
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    for above, name in zip("abcdefgh", "bcdefghi", strict=True):
        lines.append(f"{name}: &{name} [{', '.join([f'*{above}'] * 9)}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (bomb(), "machine.yaml:6: more than 500000 values"),
        (MACHINE + f"equations: {{Ex: '{'a*' + '9' * 9000}'}}",
         "machine.yaml:4: equations.Ex: not a finite number at column 3: '999"),
        ("!!python/object/apply:os.system ['touch stolen']\n",
         "machine.yaml:1: the tag '!!python/object/apply:os.system' is not accepted"),
    ],
    ids=["aliases", "digits", "tag"],
)  # fmt: skip
def test_hostile_yaml_is_refused_at_once(text: str, words: str, tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    (work / "machine.yaml").write_text(text, "utf-8")
    start = time.perf_counter()
    message = refused(work, "fit-components", "-o", "out.json")
    assert time.perf_counter() - start < SECONDS
    assert words in message
    assert len(message.splitlines()) == 1


def test_names_that_are_no_text_or_move_the_cursor(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    name = os.fsdecode(b"l\xe9\x1b[31m.csv")
    try:
        (work / name).write_bytes((SMALL / "lbb.csv").read_bytes())
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    result = done(mtu("fit-components", "--lbb", name, "-o", "-", cwd=work))
    assert r"l\\xe9\\x1b[31m.csv" in result.stdout
    (work / name).write_bytes(b"component,error,unit\naxy,x,urad\n")
    message = refused(work, "fit-components", "--lbb", name, "-o", "out.json")
    assert r"l\xe9\x1b[31m.csv, row 2, column 'error': not a number: 'x'" in message
