"""What is seen on a terminal of what takes longer than a second."""

from __future__ import annotations

import io
import re
import sys
import threading
from pathlib import Path

import pytest
from cli_runner import done, mtu, prepared

from mtu_cli.cli import emit
from mtu_cli.cli.commands import app
from mtu_cli.cli.emit import late_bar
from mtu_cli.close_loop_sealed.stats import side_by_side


class Terminal(io.StringIO):
    """Standard error that is one."""

    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    found = Terminal()
    monkeypatch.setattr(sys, "stderr", found)
    monkeypatch.setenv("TERM", "xterm")
    return found


def test_it_tells_what_is_done_without_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 0.0)
    # Libraries that a test before loaded may have threads of their own.
    before = threading.active_count()
    with late_bar("close-loop") as bar:
        bar(3, 10)
        assert threading.active_count() == before
        assert "30%" in terminal.getvalue()
        bar(7, 10)
        assert "70%" in terminal.getvalue()
    assert "close-loop" in terminal.getvalue()
    # The line is left empty.
    assert terminal.getvalue().endswith("\r\x1b[K")


def test_it_does_not_draw_all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 3600.0)
    with late_bar("close-loop") as bar:
        bar(1, 10)
        before = terminal.getvalue()
        bar(2, 10)
        assert terminal.getvalue() == before


def test_what_is_done_at_once_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with late_bar("budget") as bar:
        bar(1, 2)
    assert terminal.getvalue() == ""


def closed(folder: Path, threads: int, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """The report on a loop that was closed by so many threads."""
    words = "close-loop --cmm cmm.csv --max-effects 1 --exclude cyclic --exclude warm-up -q"
    monkeypatch.setattr(side_by_side, "available_threads", lambda: threads)
    monkeypatch.setattr(sys, "argv", ["mtu", *words.split(), "-o", "out.json"])
    monkeypatch.chdir(folder)
    app(sys.argv[1:], standalone_mode=False)
    return Path("out.json").read_bytes()


def test_closing_a_loop_tells_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether folds are searched in a second process or not, and with the same report."""
    done(mtu("simulate", "--parts", "5", "--write-cmm", "cmm.csv", cwd=prepared(tmp_path)))
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 0.0)
    reports = set()
    for threads in (1, 2):
        terminal = terminal_of(monkeypatch)
        reports.add(closed(tmp_path, threads, monkeypatch))
        seen = terminal.getvalue()
        shares = [int(share) for share in re.findall(r"(\d+)%", seen)]
        assert "close-loop" in seen
        assert shares == sorted(shares)
        assert shares[-1] == 100
        assert len(set(shares)) > threads
    quiet = io.StringIO()
    monkeypatch.setattr(sys, "stderr", quiet)
    reports.add(closed(tmp_path, 1, monkeypatch))
    assert "close-loop" not in quiet.getvalue()
    assert len(reports) == 1
