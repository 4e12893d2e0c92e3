"""Pieces of work shared with a second process, whatever either does giving the same bytes.

Threads gain nothing where the work is many small steps of an interpreter that runs one at a time.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from mtu_cli.stats.runner import available_threads

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess

T = TypeVar("T")
MOST_PIECES = 256
"""A piece is claimed by one byte, its number."""


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
        self._second: ForkProcess | None = None

    def __enter__(self) -> Self:
        self._pieces, writing = os.pipe()
        os.write(writing, bytes(range(self._count)))
        os.close(writing)
        if self._count > 1 and _can_copy():
            self._start()
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._pieces)
        if self._second is not None:
            self._second.kill()
            self._second.join()
            self._second.close()
            self._from_second.close()

    def results(self) -> list[T]:
        """What `work` gives of every piece. Raises what it raises."""
        done = {piece: self._work(piece) for piece in self._claimed()}
        if self._second is not None:
            done.update(self._sent())
        return [done[i] if i in done else self._work(i) for i in range(self._count)]

    def _claimed(self) -> Iterator[int]:
        """The pieces that nobody has begun: what a pipe holds is read by one process."""
        while number := os.read(self._pieces, 1):
            yield number[0]

    def _start(self) -> None:
        from multiprocessing import get_context

        context = get_context("fork")
        self._from_second, to_first = context.Pipe(duplex=False)
        second = context.Process(target=self._second_does, args=(to_first, os.getpid()))
        second.daemon = True
        try:
            with _copying():
                second.start()
        except OSError:
            self._from_second.close()
        else:
            self._second = second
        to_first.close()

    def _second_does(self, to_first: Connection, first: int) -> None:
        """Sends what it has done in one go: the first process reads when its own work is done."""
        done = {}
        try:
            for piece in self._claimed():
                if os.getppid() != first:
                    break
                done[piece] = self._work(piece)
            to_first.send(done)
        except BaseException:
            os._exit(1)

    def _sent(self) -> dict[int, T]:
        try:
            done: dict[int, T] = self._from_second.recv()
        except (EOFError, OSError):
            return {}
        return done


def _can_copy() -> bool:
    """Not elsewhere: on macOS system libraries do not survive a copy of their process."""
    if sys.platform != "linux" or available_threads() < 2:
        return False
    from multiprocessing import current_process

    return not current_process().daemon


@contextmanager
def _copying() -> Iterator[None]:
    """An interrupt from the keyboard reaches the first process alone, which ends the second."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        with warnings.catch_warnings():
            # Threads of linear algebra end before a copy and start after it by themselves.
            warnings.simplefilter("ignore", DeprecationWarning)
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
