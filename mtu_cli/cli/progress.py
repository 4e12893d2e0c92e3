"""A progress bar on standard error for what takes more than a second."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

DELAY_S = 1.0
EVERY_S = 0.1


class LateBar:
    """Stays silent for a second, and where standard error is not a terminal.

    It draws when it is told what is done and has no thread of its own, which a process that is
    copied meanwhile would hold half of.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.start = self.drawn = time.monotonic()
        self.bar: Progress | None = None
        self.task: TaskID | None = None

    def __call__(self, done: int, total: int | None) -> None:
        now = time.monotonic()
        if not sys.stderr.isatty() or now - self.start < DELAY_S:
            return
        if self.bar is None:
            from rich.console import Console
            from rich.progress import Progress

            self.bar = Progress(
                console=Console(stderr=True),
                transient=True,
                auto_refresh=False,
                redirect_stdout=False,
                redirect_stderr=False,
            )
            self.bar.start()
            self.task = self.bar.add_task(self.text, total=total)
        elif now - self.drawn < EVERY_S:
            return
        if self.task is not None:
            self.bar.update(self.task, completed=done, total=total, refresh=True)
            self.drawn = now

    def __enter__(self) -> LateBar:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self.bar is not None:
            self.bar.stop()
