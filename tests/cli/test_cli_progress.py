"""What is seen on a terminal of what takes longer than a second."""

from __future__ import annotations

import io
import re
import sys
import threading

import pytest

from mtu_cli.cli import emit
from mtu_cli.cli.emit import late_bar


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
