"""Drift readings as compressed rows, one piece a component, position and cycle."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.stats.compressed import Compressed, compress, together
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

SENSOR = re.compile(r"T_.+_degC")
HOTTEST = 1000.0
"""degC: no sensor of a machine reads more, nor less than minus this."""
MOST_RUNS = 64
"""Runs of one component, position and cycle in a block; where there are more, rows are sorted."""
FEWEST_KEPT = 20_000
"""Rows of every component that are kept one by one, however late it comes ..."""
MOST_KEPT = 200_000
"""Rows that are kept one by one, for lags, residuals and pictures; beyond them the first block of
each component alone."""

Key = tuple[float | None, str]
"""(position in mm or None, cycle)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Readings of one component kept row by row, in the order of the file.

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

    `pieces` hold the columns 1, T_1 - reference, ..., T_s - reference, reading. `lowest` and
    `highest` (s,) are the sensors' over all rows, `spans` theirs by cycle.
    """

    name: str
    cycles: list[str] = field(default_factory=list)
    pieces: dict[Key, Compressed] = field(default_factory=dict)
    spans: dict[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    blocks: list[Kept] = field(default_factory=list)
    n: int = 0
    complete: bool = True

    @property
    def positions(self) -> tuple[float | None, ...]:
        """Observed positions in ascending order; (None,) without an axis."""
        found = {position for position, _ in self.pieces}
        return tuple(sorted(found, key=lambda value: -np.inf if value is None else value))

    @property
    def kept_rows(self) -> int:
        """How many rows were kept."""
        return sum(len(block.error) for block in self.blocks)

    def kept(self) -> Kept:
        """The rows that were kept, as one table."""
        return Kept(
            **{
                name: np.concatenate([getattr(block, name) for block in self.blocks])
                for name in ("temperature", "error", "time", "position", "cycle")
            }
        )

    def range(self) -> FloatArray:
        """Lowest and highest temperature (s, 2) of every sensor, degC."""
        low = np.min([low for low, _ in self.spans.values()], axis=0)
        high = np.max([high for _, high in self.spans.values()], axis=0)
        return np.column_stack([low, high])


def read_series(
    blocks: Iterable[Readings], reference: float
) -> tuple[dict[str, Series], tuple[str, ...]]:
    """All components' series, and the sensors: the columns T_<sensor>_degC.

    Raises InputError where there is no sensor, or a temperature is not given.
    """
    series: dict[str, Series] = {}
    sensors: tuple[str, ...] | None = None
    kept = 0
    for block in blocks:
        if sensors is None:
            sensors = _sensors(block)
        Z = _columns(block, sensors, reference)
        for rows in _groups(block):
            name = block.components[int(block.code[rows][0])]
            own = series.setdefault(name, Series(name=name))
            _add(own, block, rows, Z[rows])
            # Every component keeps some, however late it comes.
            if own.kept_rows < (MOST_KEPT if kept < MOST_KEPT else FEWEST_KEPT):
                _keep(own, block, rows, Z[rows, 1:-1] + reference)
                kept += len(Z[rows])
            else:
                own.complete = False
    if sensors is None:
        raise fault("no drift readings are given", expected="--drift FILE")
    for own in series.values():
        own.spans = {
            cycle: (low + reference, high + reference) for cycle, (low, high) in own.spans.items()
        }
    return series, sensors


def _sensors(block: Readings) -> tuple[str, ...]:
    found = [name for name in block.covariates if SENSOR.fullmatch(name)]
    if not found:
        names = ", ".join(block.covariates) or "none"
        raise fault(
            "no column holds temperatures",
            file=block.sources[0].shown,
            expected=f"columns such as T_01_degC (columns beside the readings': {names})",
        )
    return tuple(sorted(found))


def _columns(block: Readings, sensors: tuple[str, ...], reference: float) -> FloatArray:
    """1, T - reference of every sensor, reading: (n, s + 2), column by column in memory.

    Raises InputError naming the first empty cell of every sensor.
    """
    Z = np.empty((len(block), len(sensors) + 2), order="F")
    Z[:, 0] = 1.0
    sound = True
    for s, name in enumerate(sensors):
        column = block.covariates.get(name)
        if column is None or column.dtype == object:
            sound = False
            continue
        np.subtract(column.astype(np.float64, copy=False), reference, out=Z[:, s + 1])
        extreme = float(np.abs(Z[:, s + 1]).max())
        sound = sound and extreme <= HOTTEST
    if not sound:
        raise InputError(_temperature_problems(block, sensors))
    Z[:, -1] = block.error
    return Z


def _temperature_problems(block: Readings, sensors: tuple[str, ...]) -> list[Problem]:
    problems = []
    for name in sensors:
        column = block.covariates.get(name)
        if column is None or column.dtype == object:
            what = "not a column of temperatures"
            shown = block.sources[-1].shown if block.sources else None
            problems.append(
                Problem(what=what, file=shown, column=name, expected="numbers in every file")
            )
            continue
        values = column.astype(np.float64)
        faulty = np.flatnonzero(~(np.abs(values) <= HOTTEST))
        if len(faulty):
            first = int(faulty[0])
            more = f" (and {len(faulty) - 1} more)" if len(faulty) > 1 else ""
            problems.append(
                Problem(
                    what=f"no temperature{more}",
                    value=None if np.isnan(values[first]) else f"{values[first]:g}",
                    file=block.sources[block.file_index[first]].shown,
                    row=int(block.row[first]),
                    column=name,
                    expected=f"a number in degC, at most {HOTTEST:g} in size: leave out the "
                    "column, or the rows",
                )
            )
    return problems


def _groups(block: Readings) -> list[slice | np.ndarray]:
    """Rows of one component, position and cycle: runs of them, or all where runs are short."""
    position = np.nan_to_num(np.asarray(block.position_mm, np.float64), nan=np.inf)
    changed = block.code[1:] != block.code[:-1]
    changed |= position[1:] != position[:-1]
    changed |= block.cycle[1:] != block.cycle[:-1]
    ends = np.flatnonzero(changed) + 1
    if len(ends) < MOST_RUNS:
        edges = [0, *ends.tolist(), len(block)]
        return [slice(a, b) for a, b in pairwise(edges)]
    keys = np.column_stack([block.code, position, block.cycle])
    _, inverse = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(inverse.reshape(-1), kind="stable")
    counts = np.bincount(inverse.reshape(-1))
    return list(np.split(order, np.cumsum(counts)[:-1]))


def _add(series: Series, block: Readings, rows: slice | np.ndarray, Z: FloatArray) -> None:
    first = block.position_mm[rows][0]
    cycle = _cycle(series, block, rows)
    key = (None if np.isnan(first) else float(first), cycle)
    known = series.pieces.get(key)
    piece = compress(Z, known)
    series.pieces[key] = piece if known is None else together([known, piece])
    series.n += len(Z)
    own = range(1, Z.shape[1] - 1)
    low = np.array([Z[:, s].min() for s in own])
    high = np.array([Z[:, s].max() for s in own])
    if cycle in series.spans:
        before = series.spans[cycle]
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    series.spans[cycle] = (low, high)


def _keep(
    series: Series, block: Readings, rows: slice | np.ndarray, temperature: FloatArray
) -> None:
    cycle = series.cycles.index(_cycle(series, block, rows))
    series.blocks.append(
        Kept(
            temperature=temperature,
            error=np.array(block.error[rows], np.float64),
            time=np.array(block.time_min[rows], np.float64),
            position=np.array(block.position_mm[rows], np.float64),
            cycle=np.full(len(temperature), cycle),
        )
    )


def _cycle(series: Series, block: Readings, rows: slice | np.ndarray) -> str:
    """The cycle of a group; readings without one are one cycle."""
    code = int(block.cycle[rows][0])
    label = block.cycles[code] if code >= 0 else ""
    if label not in series.cycles:
        series.cycles.append(label)
    return label
