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


def test_closing_a_loop_tells_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal alone, and with the same report."""
    done(mtu("simulate", "--parts", "5", "--write-cmm", "cmm.csv", cwd=prepared(tmp_path)))
    monkeypatch.setattr(emit, "DELAY_S", 0.0)
    monkeypatch.setattr(emit, "EVERY_S", 0.0)
    monkeypatch.chdir(tmp_path)
    call = ["close-loop", "--cmm", "cmm.csv", "--max-effects", "1", "-q", "-o", "out.json"]
    reports = set()
    for stream in (Terminal(), io.StringIO()):
        monkeypatch.setattr(sys, "stderr", stream)
        app(call, standalone_mode=False)
        reports.add(Path("out.json").read_bytes())
        shares = [int(share) for share in re.findall(r"close-loop: (\d+)%", stream.getvalue())]
        assert shares == sorted(shares)
        assert (len(set(shares)) > 2 and shares[-1] == 100) == stream.isatty()
    assert len(reports) == 1
