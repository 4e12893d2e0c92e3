"""Drift readings gathered into compressed rows, one piece a component, position and cycle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.files.covariates import TEMPERATURE_EXPECTED, is_temperature, no_temperature
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.stats.compressed import Compressed, compress, together
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import LENGTH

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

ROUNDING = 1e-12
"""Share of the readings that is rounding where it is all they differ by."""
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

    def by_position(self) -> Iterator[Compressed]:
        """All rows of each position."""
        pieces: dict[float | None, list[Compressed]] = {}
        for (position, _), piece in self.pieces.items():
            pieces.setdefault(position, []).append(piece)
        return map(together, pieces.values())

    @property
    def still(self) -> bool:
        """Whether the readings of every position differ by rounding only."""
        for rows in self.by_position():
            one, reading = rows.factor[:, [0, -1]].T
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
            component, part = _series_of(series, block, rows), Z[rows]
            T = part[:, 1:-1]
            span = np.stack([T.min(axis=0), T.max(axis=0)]) + reference
            if no_temperature(span).any():
                _refuse(block, sensors)
            cycle = _add(component, block, rows, part, span)
            # Every component keeps some, however late it comes.
            if component.kept_rows < (MOST_KEPT if kept < MOST_KEPT else FEWEST_KEPT):
                component.blocks.append(
                    Kept(
                        temperature=T + reference,
                        error=np.array(block.error[rows], np.float64),
                        time=np.array(block.time_min[rows], np.float64),
                        position=np.array(block.position_mm[rows], np.float64),
                        cycle=np.full(len(part), cycle),
                    )
                )
                kept += len(part)
            else:
                component.complete = False
    if sensors is None:
        raise error("missing-input", what="a file of drift readings", expected="--drift FILE")
    return series, sensors


def _series_of(series: dict[str, Series], block: Readings, rows: slice | np.ndarray) -> Series:
    """The series that rows of one component and position belong to.

    Raises InputError where these are of another kind than those before.
    """
    name, kinds = block.components[int(block.code[rows][0])], np.asarray(block.dimension[rows])
    own = series.setdefault(name, Series(name=name, dimension=int(kinds[0])))
    unplaced = bool(np.isnan(block.position_mm[rows][0]))
    other = [key for key in own.pieces if (key[0] is None) != unplaced]
    faulty = np.flatnonzero(kinds != own.dimension)
    if not len(faulty) and not other:
        return own
    at = int(np.arange(len(block))[rows][int(faulty[0]) if len(faulty) else 0])
    place: dict[str, Any] = {
        "file": block.sources[block.file_index[at]].shown,
        "row": int(block.row[at]),
    }
    if len(faulty):
        unit, wanted = (
            ("a length", "an angle") if kinds[faulty[0]] == LENGTH else ("an angle", "a length")
        )
        place |= {"column": "unit", "expected": "lengths or angles in all files"}
        raise error("wrong-unit", of=f"the unit of {name!r}", unit=unit, wanted=wanted, **place)
    rest = f"the other readings of {name!r}"
    expected = "a position in all files, or in none"
    raise error("contradicts", other=rest, column="position_mm", expected=expected, **place)


def _sensors(block: Readings) -> tuple[str, ...]:
    found = [name for name in block.covariates if is_temperature(name)]
    if not found:
        names = ", ".join(block.covariates) or "none"
        raise error(
            "missing-column",
            column="T_<sensor>_degC",
            file=block.sources[0].shown,
            expected=f"columns such as T_01_degC (columns beside the readings': {names})",
        )
    return tuple(sorted(found))


def _columns(block: Readings, sensors: tuple[str, ...], reference: float) -> FloatArray:
    """1, T - reference of every sensor, reading: (n, s + 2), column by column in memory.

    Raises InputError where a sensor's column holds no numbers.
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
    if not sound:
        _refuse(block, sensors)
    Z[:, -1] = block.error
    return Z


def _refuse(block: Readings, sensors: tuple[str, ...]) -> None:
    """Raises InputError with every empty or impossible cell of the sensors."""
    problems: list[Finding] = []
    for name in sensors:
        column = block.covariates.get(name)
        if column is None or column.dtype == object:
            shown = block.sources[-1].shown if block.sources else None
            place = {"file": shown, "column": name, "expected": "numbers in every file"}
            problems.append(finding("wrong-type", kind="a number", **place))
        else:
            problems += _cell_problems(block, name, column.astype(np.float64))
    if problems:
        raise InputError(problems)


def _cell_problems(block: Readings, name: str, values: FloatArray) -> list[Finding]:
    """Cells of a sensor that are empty or no temperature; of a file without any, one problem."""
    faulty = np.flatnonzero(no_temperature(values))
    of_file = np.asarray(block.file_index)
    problems = []
    for file in np.unique(of_file[faulty]).tolist():
        shown = block.sources[file].shown
        if np.isnan(values[of_file == file]).all():
            expected = "the column in every file, or in none"
            problems.append(finding("missing-column", column=name, file=shown, expected=expected))
            continue
        problems += [
            finding(
                "empty-cell" if np.isnan(values[i]) else "out-of-range",
                value=None if np.isnan(values[i]) else f"{values[i]:g}",
                file=shown,
                row=int(block.row[i]),
                column=name,
                expected=TEMPERATURE_EXPECTED,
            )
            for i in faulty[of_file[faulty] == file].tolist()
        ]
    return problems


def _groups(block: Readings) -> list[slice | np.ndarray]:
    """Rows of one component, position and cycle: runs of them, or all where runs are short."""
    given = np.asarray(block.position_mm, np.float64)
    position = np.where(np.isnan(given), np.inf, given)
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


def _add(
    series: Series, block: Readings, rows: slice | np.ndarray, Z: FloatArray, span: FloatArray
) -> int:
    """Rows of one position and cycle join their piece; returns the index of the cycle.

    Readings without a cycle are one.
    """
    first, code = block.position_mm[rows][0], int(block.cycle[rows][0])
    cycle = block.cycles[code] if code >= 0 else ""
    if cycle not in series.cycles:
        series.cycles.append(cycle)
    key = (None if np.isnan(first) else float(first), cycle)
    known = series.pieces.get(key)
    piece = compress(Z, known)
    series.pieces[key] = piece if known is None else together([known, piece])
    of_file = block.file_index[rows]
    # Most often all are of one file: no need to sort them.
    files = of_file[:1] if (of_file == of_file[0]).all() else np.unique(of_file)
    series.files.setdefault(key, set()).update(block.sources[i].shown for i in files.tolist())
    series.n += len(Z)
    low, high = span
    if cycle in series.spans:
        before = series.spans[cycle]
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    series.spans[cycle] = (low, high)
    return series.cycles.index(cycle)
