"""Drift readings as compressed rows, one piece a component, position and cycle."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mtu_cli.stats.compressed import Compressed, together
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 1e-12
"""Share of the readings that is rounding where it is all they differ by."""

Key = tuple[float | None, str]
"""(position in mm or None, cycle)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Readings of one component kept row by row, those of a position and cycle in the order of
    their times, or of the file without them.

    `temperature` (n, s) degC, `error` (n,) mm or rad, `time` (n,) min (nan: not given),
    `position` (n,) mm (nan: none), `cycle` (n,) an index into the component's cycles.
    """

    temperature: FloatArray
    error: FloatArray
    time: FloatArray
    position: FloatArray
    cycle: FloatArray

    def at(self, position: float | None, cycle: int) -> np.ndarray:
        """Rows of a position and cycle."""
        here = np.isnan(self.position) if position is None else self.position == position
        found: np.ndarray = np.flatnonzero(here & (self.cycle == cycle))
        return found


@dataclass(kw_only=True)
class Series:
    """The drift readings of one component.

    `pieces` hold the columns 1, T_1 - reference, ..., T_s - reference, reading, in the order of
    the files. `spans` are the lowest and highest (s,) of the sensors by cycle, `files` the
    names of those that hold a piece; `dimension` is that of all readings.
    """

    name: str
    dimension: int
    cycles: list[str] = field(default_factory=list)
    pieces: dict[Key, Compressed] = field(default_factory=dict)
    spans: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    files: dict[Key, set[str]] = field(default_factory=dict)
    blocks: list[Kept] = field(default_factory=list)
    n: int = 0
    complete: bool = True
    _table: Kept | None = None
    _shuffled: bool = False

    @property
    def positions(self) -> tuple[float | None, ...]:
        """Observed positions in ascending order; (None,) without an axis."""
        found = {position for position, _ in self.pieces}
        return tuple(sorted(found, key=lambda value: -np.inf if value is None else value))

    @property
    def still(self) -> bool:
        """Whether the readings of every position differ by rounding only."""
        by_position: dict[float | None, list[Compressed]] = {}
        for (position, _), piece in self.pieces.items():
            by_position.setdefault(position, []).append(piece)
        for items in by_position.values():
            rows = together(items).factor[:, [0, -1]]
            one, reading = rows.T
            left = reading - one * float(one @ reading) / float(one @ one)
            if float(np.linalg.norm(left)) > ROUNDING * float(np.linalg.norm(reading)):
                return False
        return True

    @property
    def kept_rows(self) -> int:
        """How many rows were kept."""
        return sum(len(block.error) for block in self.blocks)

    def kept(self) -> Kept:
        """The rows that were kept, as one table."""
        if self._table is None or len(self._table.error) != self.kept_rows:
            columns = {
                name: np.concatenate([getattr(block, name) for block in self.blocks])
                for name in ("temperature", "error", "time", "position", "cycle")
            }
            cycle, time, position = columns["cycle"], columns["time"], columns["position"]
            order = np.lexsort((cycle, position))
            if not np.isnan(time).any():
                in_time = np.lexsort((time, cycle, position))
                self._shuffled = not np.array_equal(order, in_time)
                # Cycles follow each other in time, too, whichever the file tells of first.
                start = np.array(
                    [time[cycle == c].min(initial=np.inf) for c in range(cycle.max() + 1)]
                )
                order = np.lexsort((time, cycle, start[cycle], position))
            self._table = Kept(**{name: column[order] for name, column in columns.items()})
        return self._table

    @property
    def shuffled(self) -> bool:
        """Whether the files hold rows of a position and cycle in another order than their times."""
        self.kept()
        return self._shuffled

    def range(self) -> FloatArray:
        """Lowest and highest temperature (s, 2) of every sensor, degC."""
        low = np.min([low for low, _ in self.spans.values()], axis=0)
        high = np.max([high for _, high in self.spans.values()], axis=0)
        return np.column_stack([low, high])
