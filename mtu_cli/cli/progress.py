"""A progress bar on standard error for what takes more than a second."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

DELAY_S = 1.0


class LateBar:
    """Stays silent for a second, and where standard error is not a terminal. It begins by itself:
    not all that takes long counts what is done.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.bar: Progress | None = None
        self.task: TaskID | None = None
        self.timer: threading.Timer | None = None

    def __call__(self, done: int, total: int | None) -> None:
        if self.bar is not None and self.task is not None:
            self.bar.update(self.task, completed=done, total=total)

    def _begin(self) -> None:
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), *Progress.get_default_columns()[:2], TimeElapsedColumn())
        bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self.task = bar.add_task(self.text, total=None)
        bar.start()
        self.bar = bar

    def __enter__(self) -> LateBar:
        if sys.stderr.isatty():
            self.timer = threading.Timer(DELAY_S, self._begin)
            self.timer.daemon = True
            self.timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self.timer is not None:
            self.timer.cancel()
            # One that has begun to draw is let finish.
            self.timer.join()
        if self.bar is not None:
            self.bar.stop()
