"""Work shared with a second process: the same results, whatever becomes of that process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

from mtu_cli.close_loop_sealed.stats import side_by_side
from mtu_cli.close_loop_sealed.stats.side_by_side import MOST_PIECES, SideBySide

COUNT = 6
PATIENCE_S = 60.0
"""A busy machine may take its time; nothing here waits so long on one that is not."""
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="a process is copied on Linux alone")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "available_threads", lambda: 2)


@pytest.fixture
def heard() -> Iterator[None]:
    """Interrupts are: a process that was started in the background may have them ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not true() and time.monotonic() < end:
        time.sleep(0.01)
    assert true()


def shared(work: Callable[[int], object], begun: Path | None = None) -> list[object]:
    """All results; where a file is named, only when the second process has begun and made it."""
    with SideBySide(work, COUNT) as pieces:
        if begun is not None:
            until(begun.exists)
        return pieces.results()


def square(piece: int) -> tuple[int, int]:
    return piece**2, os.getpid()


SQUARES = [0, 1, 4, 9, 16, 25]


def squares(found: list[object]) -> list[int]:
    return [one[0] for one in found if isinstance(one, tuple)]


def processes(found: list[object]) -> list[int]:
    return [one[1] for one in found if isinstance(one, tuple)]


def descriptors() -> list[str]:
    return sorted(os.listdir("/proc/self/fd"))


@LINUX
def test_both_processes_do_some_of_the_work_and_the_order_is_that_of_the_pieces(
    tmp_path: Path,
) -> None:
    first, seconds, firsts = os.getpid(), tmp_path / "second", tmp_path / "first"

    def work(piece: int) -> tuple[int, int]:
        # Each waits in its first piece until the other has one.
        own, other = (firsts, seconds) if os.getpid() == first else (seconds, firsts)
        own.touch()
        until(other.exists)
        return square(piece)

    found = shared(work)
    assert squares(found) == SQUARES
    assert len({*processes(found)}) == 2
    assert first in processes(found)


@LINUX
def test_the_second_process_works_while_the_first_does_something_else(tmp_path: Path) -> None:
    last = tmp_path / "last"

    def work(piece: int) -> tuple[int, int]:
        if piece == COUNT - 1:
            last.touch()
        return square(piece)

    found = shared(work, last)
    assert squares(found) == SQUARES
    assert os.getpid() not in processes(found)


@LINUX
def test_no_second_process_outlives_the_context_even_when_it_fails() -> None:
    seen: list[int] = []

    def fail() -> None:
        with SideBySide(lambda piece: time.sleep(PATIENCE_S), COUNT) as pieces:
            assert pieces._second is not None
            seen.append(pieces._second.pid)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    with pytest.raises(ProcessLookupError):
        os.kill(seen[0], 0)


def test_one_processor_does_all_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "available_threads", lambda: 1)
    found = shared(square)

    assert squares(found) == SQUARES
    assert {*processes(found)} == {os.getpid()}


def refused() -> int:
    raise BlockingIOError("no more processes")


def none_left() -> tuple[int, int]:
    raise OSError(24, "Too many open files")


@LINUX
@pytest.mark.parametrize(("name", "instead"), [("fork", refused), ("pipe", none_left)])
def test_a_process_that_cannot_be_copied_does_all_itself(
    monkeypatch: pytest.MonkeyPatch, name: str, instead: Callable[[], object]
) -> None:
    before = descriptors()
    monkeypatch.setattr(os, name, instead)
    found = shared(square)

    assert squares(found) == SQUARES
    assert {*processes(found)} == {os.getpid()}
    assert descriptors() == before


@LINUX
def test_no_descriptor_is_left() -> None:
    before = descriptors()
    shared(square)
    assert descriptors() == before


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_pieces(count: int) -> None:
    with SideBySide(square, count) as pieces:
        assert [one[0] for one in pieces.results()] == [i**2 for i in range(count)]


def test_more_pieces_than_a_byte_counts_are_refused() -> None:
    with pytest.raises(ValueError, match="257 pieces, at most 256"):
        SideBySide(square, MOST_PIECES + 1)


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def ended() -> None:
    sys.exit(3)


def failed() -> None:
    raise RuntimeError("of this process")


def interrupted() -> None:
    raise KeyboardInterrupt


@LINUX
@pytest.mark.parametrize("fails", [killed, ended, failed, interrupted])
def test_what_a_second_process_does_not_give_is_done_again(
    fails: Callable[[], None], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    first, begun = os.getpid(), tmp_path / "begun"

    def work(piece: int) -> tuple[int, int]:
        if os.getpid() != first:
            begun.touch()
            fails()
        return square(piece)

    found = shared(work, begun)
    assert squares(found) == SQUARES
    assert {*processes(found)} == {first}
    assert capfd.readouterr() == ("", "")


@LINUX
def test_what_cannot_be_sent_is_done_again(tmp_path: Path) -> None:
    first, begun = os.getpid(), tmp_path / "begun"

    def work(piece: int) -> object:
        if os.getpid() != first:
            begun.touch()
            return lambda: piece
        return square(piece)

    found = shared(work, begun)
    assert squares(found) == SQUARES
    assert {*processes(found)} == {first}


@pytest.mark.parametrize("wrong", range(COUNT))
def test_errors_are_raised_in_the_first_process(wrong: int) -> None:
    def work(piece: int) -> int:
        if piece == wrong:
            raise ArithmeticError(f"piece {piece}")
        return piece

    with pytest.raises(ArithmeticError, match=f"piece {wrong}"):
        shared(work)


@LINUX
def test_an_interrupt_does_not_reach_the_second_process(tmp_path: Path) -> None:
    first, last = os.getpid(), tmp_path / "last"

    def work(piece: int) -> tuple[int, int]:
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGINT)
        if piece == COUNT - 1:
            last.touch()
        return square(piece)

    found = shared(work, last)
    assert squares(found) == SQUARES
    assert first not in processes(found)


@LINUX
@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize("moment", ["fork", "pidfd_open", "waitpid", "close"])
def test_an_interrupt_while_it_begins_or_ends_leaves_nothing(
    moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, real, copied = descriptors(), getattr(os, moment), list[int]()
    first, fork = os.getpid(), os.fork

    def copy() -> int:
        copied.append(fork())
        return copied[-1]

    def interrupted(*given: int) -> object:
        result = (copy if moment == "fork" else real)(*given)
        if os.getpid() == first and copied:
            os.kill(first, signal.SIGINT)
        return result

    monkeypatch.setattr(os, "fork", copy)
    monkeypatch.setattr(os, moment, interrupted)
    with pytest.raises(KeyboardInterrupt), SideBySide(lambda piece: time.sleep(0.1), COUNT):
        pass
    monkeypatch.undo()
    assert len(copied) == 1
    assert state_of(copied[0]) == ""
    assert descriptors() == known


@LINUX
@pytest.mark.usefixtures("heard")
def test_an_interrupt_just_before_it_ends_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    real, asked, begun = signal.getsignal, list[int](), SideBySide(lambda _: time.sleep(0.1), COUNT)

    def interrupted(number: int) -> object:
        asked.append(number)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return real(number)

    monkeypatch.setattr(signal, "getsignal", interrupted)
    seen = []
    with pytest.raises(KeyboardInterrupt), begun:
        seen.append(begun._second)
    assert seen[0] is not None
    assert state_of(seen[0].pid) == ""


@LINUX
@pytest.mark.parametrize("module", [os, signal])
def test_without_descriptors_of_processes_this_one_does_all(
    module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(module, "pidfd_open" if module is os else "pidfd_send_signal")
    found = shared(square)
    assert squares(found) == SQUARES
    assert {*processes(found)} == {os.getpid()}


@LINUX
def test_a_copy_that_was_gone_at_once_is_not_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(_: int) -> int:
        raise ProcessLookupError

    killed: list[int] = []
    monkeypatch.setattr(os, "pidfd_open", gone)
    monkeypatch.setattr(os, "kill", lambda pid, number: killed.append(pid))
    assert squares(shared(square)) == SQUARES
    assert not killed


@contextmanager
def ends_of_children_ignored() -> Iterator[None]:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)


@LINUX
def test_where_the_ends_of_children_are_ignored() -> None:
    """As under some daemons: the second process is gone without a trace once it has ended."""
    with ends_of_children_ignored():
        assert squares(shared(square)) == SQUARES
        with SideBySide(square, COUNT) as pieces:
            assert pieces._second is not None
            until(lambda: state_of(pieces._second.pid) == "")  # type: ignore[union-attr]
            assert squares(list(pieces.results())) == SQUARES


@LINUX
def test_a_process_of_the_same_number_is_not_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of one that is gone without a trace is free for another."""
    killed: list[int] = []
    with ends_of_children_ignored(), SideBySide(square, COUNT) as pieces:
        second = pieces._second
        assert second is not None
        until(lambda: state_of(second.pid) == "")
        monkeypatch.setattr(os, "kill", lambda pid, number: killed.append(pid))
    assert not killed


ENDLESS = """
import os, sys, time
from mtu_cli.close_loop_sealed.stats import side_by_side
side_by_side.available_threads = lambda: 2
def work(piece):
    {work}
with side_by_side.SideBySide(work, 256) as pieces:
    print(pieces._second.pid, flush=True)
    time.sleep(60)
"""


@LINUX
@pytest.mark.parametrize("work", ["time.sleep(0.1)", "return bytes(100_000)"])
def test_a_second_process_ends_by_itself_when_the_first_is_killed(work: str) -> None:
    """Also in the middle of sending more than a pipe holds, which nobody reads any more."""
    script = ENDLESS.format(work=work)
    first = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    with first.stdout as said:
        second = int(said.readline())
    if "bytes" in work:
        until(lambda: state_of(second) == "S")
    first.kill()
    first.wait()
    # Nobody may be there to take note of its end: what ended is a zombie then.
    until(lambda: state_of(second) in ("", "Z"))


def state_of(pid: int) -> str:
    """The state of a process as Linux tells it, empty when there is none."""
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return ""


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_done_is_told_in_this_process_alone(
    threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the second process in one go, so that some numbers may be left out."""
    monkeypatch.setattr(side_by_side, "available_threads", lambda: threads)
    told: list[tuple[int, int]] = []
    with SideBySide(square, COUNT) as pieces:
        found = pieces.results(lambda done: told.append((done, os.getpid())))
    assert squares(list(found)) == SQUARES
    counts = [done for done, _ in told]
    assert counts == sorted(counts)
    assert counts[-1] == COUNT
    assert {process for _, process in told} == {os.getpid()}
    if threads == 1:
        assert counts == [1, 2, 3, 4, 5, 6]
