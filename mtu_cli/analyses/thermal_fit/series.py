"""Drift readings as compressed rows, one piece a component, position and cycle."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.stats.compressed import Compressed, compress, together
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

SENSOR = re.compile(r"T_.+_degC")
MOST_KEPT = 500_000
"""Rows that are kept one by one, for lags, residuals and pictures; beyond them every n-th block."""

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
        temperature = _temperatures(block, sensors)
        keep = kept < MOST_KEPT
        kept += len(block) if keep else 0
        for code in np.unique(block.code):
            name = block.components[code]
            rows = np.flatnonzero(block.code == code)
            own = series.setdefault(name, Series(name=name))
            _add(own, block, rows, temperature[rows], reference, keep=keep)
    if sensors is None:
        raise fault("no drift readings are given", expected="--drift FILE")
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


def _temperatures(block: Readings, sensors: tuple[str, ...]) -> FloatArray:
    """Temperatures (n, s) of all rows.

    Raises InputError naming the first empty cell of every sensor.
    """
    problems = []
    columns = []
    for name in sensors:
        column = block.covariates.get(name)
        if column is None or column.dtype == object:
            what = "not a column of temperatures"
            shown = block.sources[-1].shown
            problems.append(
                Problem(what=what, file=shown, column=name, expected="numbers in every file")
            )
            continue
        empty = np.flatnonzero(np.isnan(column))
        if len(empty):
            first = int(empty[0])
            more = f" (and {len(empty) - 1} more)" if len(empty) > 1 else ""
            problems.append(
                Problem(
                    what=f"no temperature{more}",
                    file=block.sources[block.file_index[first]].shown,
                    row=int(block.row[first]),
                    column=name,
                    expected="a number in degC: leave out the column, or the rows",
                )
            )
        columns.append(column)
    if problems:
        raise InputError(problems)
    return np.column_stack(columns).astype(np.float64)


def _add(
    series: Series,
    block: Readings,
    rows: np.ndarray,
    temperature: FloatArray,
    reference: float,
    *,
    keep: bool,
) -> None:
    position = block.position_mm[rows]
    cycle = _cycle_indices(series, block, rows)
    error = block.error[rows]
    Z = np.column_stack([np.ones(len(rows)), temperature - reference, error])
    for c in np.unique(cycle):
        label = series.cycles[c]
        inside = cycle == c
        _widen(series, label, temperature[inside])
        for place in np.unique(position[inside]):
            here = inside & (np.isnan(position) if np.isnan(place) else position == place)
            key = (None if np.isnan(place) else float(place), label)
            piece = compress(Z[here])
            known = series.pieces.get(key)
            series.pieces[key] = piece if known is None else together([known, piece])
    series.n += len(rows)
    if keep:
        series.blocks.append(
            Kept(
                temperature=temperature,
                error=error,
                time=np.asarray(block.time_min[rows], np.float64),
                position=np.asarray(position, np.float64),
                cycle=cycle,
            )
        )
    else:
        series.complete = False


def _cycle_indices(series: Series, block: Readings, rows: np.ndarray) -> np.ndarray:
    """The cycle (n,) of each row in the series' own list; readings without one are one cycle."""
    codes, first, inverse = np.unique(block.cycle[rows], return_index=True, return_inverse=True)
    found = np.empty(len(codes), np.int64)
    for i in np.argsort(first):
        label = block.cycles[codes[i]] if codes[i] >= 0 else ""
        if label not in series.cycles:
            series.cycles.append(label)
        found[i] = series.cycles.index(label)
    return found[inverse.reshape(-1)]


def _widen(series: Series, cycle: str, temperature: FloatArray) -> None:
    low, high = temperature.min(axis=0), temperature.max(axis=0)
    if cycle in series.spans:
        before = series.spans[cycle]
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    series.spans[cycle] = (low, high)
