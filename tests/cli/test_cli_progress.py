"""What is seen on a terminal of what takes longer than a second."""

from __future__ import annotations

import io
import sys
import time

import pytest

from mtu_cli.cli import progress
from mtu_cli.cli.progress import LateBar


class Terminal(io.StringIO):
    """Standard error that is one."""

    def isatty(self) -> bool:
        return True


def wait_for(bar: LateBar) -> None:
    for _ in range(1000):
        if bar.bar is not None:
            return
        time.sleep(0.01)


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    found = Terminal()
    monkeypatch.setattr(sys, "stderr", found)
    monkeypatch.setenv("TERM", "xterm")
    return found


def test_it_begins_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    with LateBar("close-loop") as bar:
        wait_for(bar)
        bar(3, 10)
        assert bar.bar is not None
        bar.bar.refresh()
    assert "close-loop" in terminal.getvalue()


def test_what_is_done_at_once_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with LateBar("budget") as bar:
        bar(1, 2)
    assert terminal.getvalue() == ""
    assert bar.bar is None


def test_nothing_is_written_where_no_one_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)
    with LateBar("budget") as bar:
        time.sleep(0.05)
        bar(1, 2)
    assert bar.timer is None
    assert pipe.getvalue() == ""
