"""What is seen on a terminal of what takes longer than a second."""

from __future__ import annotations

import io
import sys
import threading

import pytest

from mtu_cli.cli import progress
from mtu_cli.cli.progress import LateBar


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
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    monkeypatch.setattr(progress, "EVERY_S", 0.0)
    # Libraries that a test before loaded may have threads of their own.
    before = threading.active_count()
    with LateBar("close-loop") as bar:
        bar(3, 10)
        assert threading.active_count() == before
        assert "30%" in terminal.getvalue()
        bar(7, 10)
        assert "70%" in terminal.getvalue()
    assert "close-loop" in terminal.getvalue()
    # The cursor is shown again.
    assert terminal.getvalue().rindex("\x1b[?25h") > terminal.getvalue().rindex("\x1b[?25l")


def test_it_does_not_draw_all_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    monkeypatch.setattr(progress, "EVERY_S", 3600.0)
    with LateBar("close-loop") as bar:
        bar(1, 10)
        before = terminal.getvalue()
        bar(2, 10)
        assert terminal.getvalue() == before


def test_what_is_done_at_once_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with LateBar("budget") as bar:
        bar(1, 2)
    assert terminal.getvalue() == ""


def test_nothing_is_written_where_no_one_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)
    with LateBar("budget") as bar:
        bar(1, 2)
    assert pipe.getvalue() == ""
