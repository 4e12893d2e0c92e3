"""Pieces of work shared with a second process, whatever either does giving the same bytes.

Threads gain nothing where the work is many small steps of an interpreter that runs one at a time.
The second process is a copy of the first: nothing need be sent to it or imported there.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Generic, NoReturn, Self, TypeVar

from mtu_cli.stats.threads import available_threads

T = TypeVar("T")
MOST_PIECES = 256
"""A piece is claimed by one byte, its number."""


@dataclass(frozen=True, slots=True)
class _Second:
    """The second process: its number, the descriptor that stays its own when the number is another
    process's, and the ends of pipes from which pieces are claimed and what it has done is read.
    """

    pid: int
    process: int
    pieces: int
    answers: int


class SideBySide(Generic[T]):
    """Does `work` of the pieces 0 ... `count` - 1, meanwhile in a second process where there is
    a processor for it and the platform can copy a process (Linux); else in this one alone.

    In the context the second process has begun; `results` does what it has not, waits for it and
    gives all in order. `work` must be a function of its number alone, and what it gives must be
    picklable. A piece whose process fails, in whatever way, is done again in this one, so that
    errors are raised here. A second process does not outlive the context.

    Raises ValueError for more than `MOST_PIECES`.
    """

    def __init__(self, work: Callable[[int], T], count: int) -> None:
        if count > MOST_PIECES:
            raise ValueError(f"{count} pieces, at most {MOST_PIECES}")
        self._work, self._count = work, count
        self._second: _Second | None = None

    def __enter__(self) -> Self:
        if self._count < 2 or not _can_copy():
            return self
        try:
            # Without descriptors or processes left, this one does all.
            with _interrupts_held(), suppress(OSError):
                self._start()
        except KeyboardInterrupt:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            with _interrupts_held():
                self._end()
        except KeyboardInterrupt:
            # It may have come just before they were held.
            self._end()
            raise

    def _end(self) -> None:
        second, self._second = self._second, None
        if second is not None:
            # Where the shell has children's ends ignored, it is gone already.
            with suppress(ProcessLookupError, ChildProcessError):
                signal.pidfd_send_signal(second.process, signal.SIGKILL)
                os.waitpid(second.pid, 0)
            for end in (second.process, second.pieces, second.answers):
                os.close(end)

    def results(self, tell: Callable[[int], None] = lambda done: None) -> list[T]:
        """What `work` gives of every piece; `tell` hears in this process how many are done, those
        of the second one all at once. Raises what `work` raises.
        """
        done: dict[int, T] = {}
        if self._second is not None:
            for piece in _claimed(self._second.pieces):
                done[piece] = self._work(piece)
                tell(len(done))
            done |= self._answered(self._second.answers)
            tell(len(done))
        for piece in range(self._count):
            if piece not in done:
                done[piece] = self._work(piece)
                tell(len(done))
        return [done[piece] for piece in range(self._count)]

    def _start(self) -> None:
        first = os.getpid()
        with ExitStack() as undone, ExitStack() as given_away:
            pieces, asked = _pipe(undone, given_away)
            answers, answer = _pipe(undone, given_away)
            os.write(asked, bytes(range(self._count)))
            pid = _copied()
            if pid == 0:
                # Held open here, what nobody reads any more would be waited for.
                os.close(answers)
                os.close(asked)
                self._second_does(pieces, answer, first)
            process = _descriptor_of(pid)
            self._second = _Second(pid=pid, process=process, pieces=pieces, answers=answers)
            undone.pop_all()

    def _second_does(self, pieces: int, answer: int, first: int) -> NoReturn:
        """Sends what it has done in one go: the first process reads when its own work is done."""
        code = 1
        try:
            # From the keyboard it reaches the first process too, which ends this one.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            done = {}
            for piece in _claimed(pieces):
                if os.getppid() != first:
                    break
                done[piece] = self._work(piece)
            with os.fdopen(answer, "wb") as file:
                pickle.dump(done, file, pickle.HIGHEST_PROTOCOL)
            code = 0
        finally:
            # Whatever was wrong: what is not sent is done again, and raised there.
            os._exit(code)

    def _answered(self, answers: int) -> dict[int, T]:
        try:
            with os.fdopen(answers, "rb", closefd=False) as file:
                done: dict[int, T] = pickle.load(file)
        except (EOFError, OSError, pickle.UnpicklingError):
            return {}
        return done


def _claimed(pieces: int) -> Iterator[int]:
    """The pieces that nobody has begun: what a pipe holds is read by one process."""
    while number := os.read(pieces, 1):
        yield number[0]


def _pipe(reading: ExitStack, writing: ExitStack) -> tuple[int, int]:
    """Both ends of a pipe, each closed with others of its kind."""
    ends = os.pipe()
    for end, closed in zip(ends, (reading, writing), strict=True):
        closed.callback(os.close, end)
    return ends


def _can_copy() -> bool:
    """Not elsewhere: on macOS system libraries do not survive a copy of their process. Nor where
    Python was built without descriptors of processes.
    """
    described = hasattr(os, "pidfd_open") and hasattr(signal, "pidfd_send_signal")
    return sys.platform == "linux" and described and available_threads() > 1


def _copied() -> int:
    """The number of a copy of this process, 0 in the copy."""
    with warnings.catch_warnings():
        # Threads of linear algebra end before a copy and start after it by themselves.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _descriptor_of(pid: int) -> int:
    """Of a process just copied, which is ended where there is none to be had. Raises OSError."""
    try:
        return os.pidfd_open(pid)
    except ProcessLookupError:
        # It is gone already, without a trace: its number may be another's.
        raise
    except OSError:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        raise


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """An interrupt from the keyboard meanwhile is heard afterwards: a process half begun or half
    ended would be left over. Held is what Python makes of it, which only its main thread hears:
    a mask would be no use, since the system may choose any thread.
    """
    heard = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(heard):
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: held.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, heard)
        if held:
            heard(*held[0])
