"""The drift readings of one component, sorted by position, cycle and time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.covariates import TEMPERATURE_EXPECTED, is_temperature, no_temperature
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.stats.least_squares import FloatArray

Ints = NDArray[np.int64]
ROUNDING = 1e-12
"""Share of the readings that is rounding where it is all they differ by."""
MOST_ROWS = 1_000_000
"""Readings of a component that are fitted; of more every second, third, ... of a cycle."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """Readings of one component by position, by cycle as these follow each other, and by time, or
    in the order of the file where times are not given.

    `T` (n, s) degC, `y` (n,) mm or rad, `time` (n,) min (nan: not given); `place` and `cycle` (n,)
    index `positions` (mm, ascending; (None,) without an axis) and `cycles`. `range` (s, 2) of the
    sensors; `total` readings of which every `every`-th is here; `files` that hold them.
    """

    name: str
    dimension: int
    positions: tuple[float | None, ...]
    cycles: tuple[str, ...]
    T: FloatArray
    y: FloatArray
    time: FloatArray
    place: Ints
    cycle: Ints
    range: FloatArray
    total: int
    every: int
    files: tuple[str, ...]

    @cached_property
    def place_starts(self) -> Ints:
        """The first row of each position."""
        return np.flatnonzero(np.diff(self.place, prepend=-1))

    @cached_property
    def piece(self) -> Ints:
        """The number (n,) of each row's position and cycle, in ascending order."""
        changed = np.diff(self.place, prepend=-1) | np.diff(self.cycle, prepend=-1)
        return np.cumsum(changed != 0) - 1

    @cached_property
    def piece_starts(self) -> Ints:
        """The first row of each position and cycle."""
        return np.flatnonzero(np.diff(self.piece, prepend=-1))

    @cached_property
    def runs(self) -> dict[tuple[int, int], slice]:
        """The rows of each position and cycle, by their indices."""
        edges = [*self.piece_starts.tolist(), len(self.y)]
        return {
            (int(self.place[low]), int(self.cycle[low])): slice(low, high)
            for low, high in pairwise(edges)
        }

    @cached_property
    def still(self) -> bool:
        """Whether the readings of every position differ by rounding only."""
        left, _ = about_means(self.y, self.place_starts)
        return float(np.linalg.norm(left)) <= ROUNDING * float(np.linalg.norm(self.y))


def about_means(values: FloatArray, starts: Ints) -> tuple[FloatArray, FloatArray]:
    """Values (n, ...) less the means of their runs, and these means; a run begins at each of the
    `starts`.
    """
    count = np.diff(np.append(starts, len(values)))
    first = values[starts]
    # About one of them: equal values leave nothing.
    away = values - np.repeat(first, count, axis=0)
    shift = np.add.reduceat(away, starts, axis=0) / count.reshape(-1, *(1,) * (values.ndim - 1))
    return away - np.repeat(shift, count, axis=0), first + shift


def sensors_of(readings: Readings) -> tuple[str, ...]:
    """The sensors: columns T_<sensor>_degC.

    Raises InputError where there is none, with every cell that is empty or no temperature.
    """
    sensors = tuple(sorted(name for name in readings.covariates if is_temperature(name)))
    if not sensors:
        names = ", ".join(readings.covariates) or "none"
        raise error(
            "missing-column",
            column="T_<sensor>_degC",
            file=readings.sources[0].shown,
            expected=f"columns such as T_01_degC (columns beside the readings': {names})",
        )
    if problems := [each for name in sensors for each in _problems(readings, name)]:
        raise InputError(problems)
    return sensors


def _problems(readings: Readings, name: str) -> Iterator[Finding]:
    """Cells of a sensor that are empty or no temperature; of a file without any, one problem."""
    values = readings.covariates[name].astype(np.float64, copy=False)
    faulty = np.flatnonzero(no_temperature(values))
    for file in np.unique(readings.file_index[faulty]).tolist():
        inside = readings.file_index == file
        shown = readings.sources[file].shown
        if np.isnan(values[inside]).all():
            expected = "the column in every file, or in none"
            yield finding("missing-column", column=name, file=shown, expected=expected)
            continue
        for i in faulty[inside[faulty]].tolist():
            empty = bool(np.isnan(values[i]))
            yield finding(
                "empty-cell" if empty else "out-of-range",
                value=None if empty else f"{values[i]:g}",
                file=shown,
                row=int(readings.row[i]),
                column=name,
                expected=TEMPERATURE_EXPECTED,
            )


def read_series(readings: Readings, sensors: tuple[str, ...]) -> Iterator[Series]:
    """The series of every component, in the order in which the files have them."""
    import pandas as pd

    component, codes = pd.factorize(readings.code)
    for i, code in enumerate(codes.tolist()):
        yield _series(readings, sensors, readings.components[code], np.flatnonzero(component == i))


def _series(readings: Readings, sensors: tuple[str, ...], name: str, rows: Ints) -> Series:
    import pandas as pd

    positions, place = np.unique(readings.position_mm[rows], return_inverse=True)
    cycle, labels = pd.factorize(readings.cycle[rows])
    columns = [readings.covariates[sensor].astype(np.float64, copy=False) for sensor in sensors]
    spans = [(float(T[rows].min()), float(T[rows].max())) for T in columns]
    total, piece = len(rows), place * len(labels) + cycle
    every = -(-total // MOST_ROWS)
    if every > 1:
        kept = pd.Series(piece).groupby(piece).cumcount().to_numpy() % every == 0
        rows, place, cycle, piece = rows[kept], place[kept], cycle[kept], piece[kept]
    time = readings.time_min[rows].astype(np.float64)
    order = np.lexsort((cycle, place))
    if not np.isnan(time).any():
        start = np.full(len(labels), np.inf)
        np.minimum.at(start, cycle, time)
        # Cycles follow each other in time, too, whichever the file has first.
        order = np.lexsort((time, cycle, start[cycle], place))
    cycles = tuple(readings.cycles[c] if c >= 0 else "" for c in labels.tolist())
    files = np.unique(readings.file_index[rows]).tolist()
    return Series(
        name=name,
        dimension=int(readings.dimension[rows[0]]),
        positions=tuple(None if np.isnan(p) else p for p in positions.tolist()),
        cycles=cycles,
        T=np.column_stack([T[rows[order]] for T in columns]),
        y=readings.error[rows[order]].astype(np.float64),
        time=time[order],
        place=place[order],
        cycle=cycle[order],
        range=np.array(spans),
        total=total,
        every=every,
        files=tuple(sorted({readings.sources[i].shown for i in files})),
    )
