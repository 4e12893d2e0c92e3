"""Work shared with a second process: the same results, whatever becomes of that process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mtu_cli.stats import side_by_side
from mtu_cli.stats.side_by_side import MOST_PIECES, SideBySide

COUNT = 6
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="a process is copied on Linux alone")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "available_threads", lambda: 2)


def shared(work: Callable[[int], object]) -> list[object]:
    with SideBySide(work, COUNT) as pieces:
        return pieces.results()


def slow_square(piece: int) -> tuple[int, int]:
    time.sleep(0.02)
    return piece**2, os.getpid()


def squares(found: list[object]) -> list[int]:
    return [one[0] for one in found if isinstance(one, tuple)]


@LINUX
def test_both_processes_do_some_of_the_work_and_the_order_is_that_of_the_pieces() -> None:
    found = shared(slow_square)

    assert squares(found) == [0, 1, 4, 9, 16, 25]
    who = {one[1] for one in found if isinstance(one, tuple)}
    assert len(who) == 2
    assert os.getpid() in who


@LINUX
def test_the_second_process_works_while_the_first_does_something_else() -> None:
    with SideBySide(slow_square, COUNT) as pieces:
        time.sleep(1.0)
        found = pieces.results()

    assert all(one[1] != os.getpid() for one in found)


@LINUX
def test_no_second_process_outlives_the_context_even_when_it_fails() -> None:
    seen: list[int] = []

    def fail() -> None:
        with SideBySide(lambda piece: time.sleep(60), COUNT) as pieces:
            second = pieces._second
            assert second is not None
            assert second.pid is not None
            seen.append(second.pid)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(ProcessLookupError):
        os.kill(seen[0], 0)


def test_one_processor_does_all_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "available_threads", lambda: 1)
    found = shared(slow_square)

    assert squares(found) == [0, 1, 4, 9, 16, 25]
    assert {one[1] for one in found if isinstance(one, tuple)} == {os.getpid()}


def test_a_process_that_cannot_be_copied_does_all_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(os, "fork", refused)
    assert squares(shared(slow_square)) == [0, 1, 4, 9, 16, 25]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_pieces(count: int) -> None:
    with SideBySide(slow_square, count) as pieces:
        assert [one[0] for one in pieces.results()] == [i**2 for i in range(count)]


def test_more_pieces_than_a_byte_counts_are_refused() -> None:
    with pytest.raises(ValueError, match="257 pieces, at most 256"):
        SideBySide(slow_square, MOST_PIECES + 1)


def killed(piece: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def ended(piece: int) -> None:
    sys.exit(3)


def failed(piece: int) -> None:
    raise RuntimeError(f"piece {piece}")


@pytest.mark.parametrize("fails", [killed, ended, failed], ids=["killed", "ended", "failed"])
def test_what_a_second_process_does_not_give_is_done_again(
    fails: Callable[[int], None], capfd: pytest.CaptureFixture[str]
) -> None:
    first = os.getpid()

    def work(piece: int) -> tuple[int, int]:
        if os.getpid() != first and piece == 1:
            fails(piece)
        return slow_square(piece)

    assert squares(shared(work)) == [0, 1, 4, 9, 16, 25]
    assert capfd.readouterr() == ("", "")


def test_what_cannot_be_sent_is_done_again() -> None:
    found = shared(lambda piece: lambda: piece)
    assert [one() for one in found if callable(one)] == list(range(COUNT))


def test_errors_are_raised_in_the_first_process() -> None:
    def work(piece: int) -> int:
        if piece == 3:
            raise ArithmeticError("piece 3")
        return piece

    with pytest.raises(ArithmeticError, match="piece 3"):
        shared(work)


@LINUX
def test_an_interrupt_does_not_reach_the_second_process() -> None:
    first = os.getpid()

    def work(piece: int) -> tuple[int, int]:
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGINT)
        return slow_square(piece)

    with SideBySide(work, COUNT) as pieces:
        time.sleep(1.0)
        found = pieces.results()
    assert squares(list(found)) == [0, 1, 4, 9, 16, 25]
    assert all(one[1] != first for one in found)


ENDLESS = """
import os, sys, time
from mtu_cli.stats import side_by_side
side_by_side.available_threads = lambda: 2
with side_by_side.SideBySide(lambda piece: time.sleep(0.1), 256) as pieces:
    print(pieces._second.pid, flush=True)
    time.sleep(60)
"""


@LINUX
def test_a_second_process_ends_by_itself_when_the_first_is_killed(tmp_path: Path) -> None:
    first = subprocess.Popen([sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    with first.stdout as said:
        second = int(said.readline())
    first.kill()
    first.wait()

    # Nobody may be there to take note of its end: what ended is a zombie then.
    until = time.monotonic() + 20
    while state_of(second) not in ("", "Z") and time.monotonic() < until:
        time.sleep(0.05)
    assert state_of(second) in ("", "Z")


def state_of(pid: int) -> str:
    """The state of a process as Linux tells it, empty when there is none."""
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return ""
