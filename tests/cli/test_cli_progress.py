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


def test_it_draws_neither_all_the_time_nor_what_is_done_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    terminal = terminal_of(monkeypatch)
    with late_bar("budget") as bar:
        bar(1, 2)
    assert terminal.getvalue() == ""
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 3600.0)
    with late_bar("close-loop") as bar:
        bar(1, 10)
        before = terminal.getvalue()
        bar(2, 10)
        assert terminal.getvalue() == before != ""


def test_closing_a_loop_tells_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal alone, and with the same report."""
    done(mtu("simulate", "--parts", "5", "--write-cmm", "cmm.csv", cwd=prepared(tmp_path)))
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 0.0)
    monkeypatch.chdir(tmp_path)
    call = ["close-loop", "--cmm", "cmm.csv", "--max-effects", "1", "-q", "-o", "out.json"]
    reports = set()
    for stream in (terminal_of(monkeypatch), io.StringIO()):
        monkeypatch.setattr(sys, "stderr", stream)
        app(call, standalone_mode=False)
        reports.add(Path("out.json").read_bytes())
        seen = stream.getvalue()
        shares = [int(share) for share in re.findall(r"(\d+)%", seen)]
        assert ("close-loop" in seen) == stream.isatty()
        assert shares == sorted(shares)
        assert not shares or shares[-1] == 100
        assert (len(set(shares)) > 2) == stream.isatty()
    assert len(reports) == 1
