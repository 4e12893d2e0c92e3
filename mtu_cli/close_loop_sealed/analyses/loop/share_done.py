"""How much is done of closing the loop, told while it is being done."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.stats.monte_carlo import Progress

FINE = 1000
"""Steps that every table counts for: how many it really has is known when it is begun."""


@dataclass(frozen=True, slots=True)
class ShareDone:
    """Tells `progress`, if anybody listens, what is done of table `number` of `count`."""

    progress: Progress | None = None
    number: int = 0
    count: int = 1

    def __call__(self, done: int, total: int) -> None:
        """`done` of `total` steps of this table."""
        if self.progress is not None:
            self.progress(self.number * FINE + FINE * done // total, self.count * FINE)


NOBODY = ShareDone()
"""Nobody listens."""
