"""Blocks of drift readings gathered into the series of their components."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain, islice, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.thermal_fit.series import Kept, Series
from mtu_cli.files.covariates import TEMPERATURE_EXPECTED, is_temperature, no_temperature
from mtu_cli.findings import Finding, InputError, error, finding
from mtu_cli.stats.compressed import compress, together
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import dimension_name

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

MOST_RUNS = 64
"""Runs of one component, position and cycle in a block; where there are more, rows are sorted."""
FEWEST_KEPT = 20_000
"""Rows of every component that are kept one by one, however late it comes ..."""
MOST_KEPT = 200_000
"""Rows that are kept one by one, for lags, residuals and pictures; beyond them the first block of
each component alone."""


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
            own = _series_of(series, block, rows)
            span = _span(Z[rows]) + reference
            if no_temperature(span).any():
                _refuse(block, sensors)
            _add(own, block, rows, Z[rows], span)
            # Every component keeps some, however late it comes.
            if own.kept_rows < (MOST_KEPT if kept < MOST_KEPT else FEWEST_KEPT):
                _keep(own, block, rows, Z[rows, 1:-1] + reference)
                kept += len(Z[rows])
            else:
                own.complete = False
    if sensors is None:
        raise error("missing-input", what="the file of drift readings", expected="--drift FILE")
    return series, sensors


def columns_beside(blocks: Iterable[Readings]) -> tuple[tuple[str, ...], Iterator[Readings]]:
    """The columns that are neither the readings' own nor sensors, and all the blocks."""
    rest = iter(blocks)
    first = list(islice(rest, 1))
    names = (name for block in first for name in block.covariates if not is_temperature(name))
    return tuple(names), chain(first, rest)


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
        expected = "lengths or angles in all files"
        unit, wanted = dimension_name(int(kinds[faulty[0]])), dimension_name(own.dimension)
        facts = {"of": f"the unit of {name!r}", "unit": unit, "wanted": wanted}
        raise error("wrong-unit", **facts, column="unit", expected=expected, **place)
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
    """Raises InputError where a temperature of the block is none."""
    if problems := _temperature_problems(block, sensors):
        raise InputError(problems)


def _temperature_problems(block: Readings, sensors: tuple[str, ...]) -> list[Finding]:
    """Every empty or impossible cell of the sensors."""
    problems = []
    for name in sensors:
        column = block.covariates.get(name)
        if column is None or column.dtype == object:
            shown = block.sources[-1].shown if block.sources else None
            facts = {"kind": "a number", "expected": "numbers in every file"}
            problems.append(finding("wrong-type", file=shown, column=name, **facts))
            continue
        problems += _cell_problems(block, name, column.astype(np.float64))
    return problems


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


def _span(Z: FloatArray) -> FloatArray:
    """Lowest and highest (2, s) of the temperatures among the columns Z; nan where one is."""
    found: FloatArray = np.stack([Z[:, 1:-1].min(axis=0), Z[:, 1:-1].max(axis=0)])
    return found


def _add(
    series: Series, block: Readings, rows: slice | np.ndarray, Z: FloatArray, span: FloatArray
) -> None:
    first = block.position_mm[rows][0]
    cycle = _cycle(series, block, rows)
    key = (None if np.isnan(first) else float(first), cycle)
    known = series.pieces.get(key)
    piece = compress(Z, known)
    series.pieces[key] = piece if known is None else together([known, piece])
    here = _different(block.file_index[rows])
    series.files.setdefault(key, set()).update(block.sources[i].shown for i in here)
    series.n += len(Z)
    low, high = span
    if cycle in series.spans:
        before = series.spans[cycle]
        low, high = np.minimum(low, before[0]), np.maximum(high, before[1])
    series.spans[cycle] = (low, high)


def _different(values: np.ndarray) -> list[int]:
    # Most often all are one: no need to sort or hash them.
    first = int(values[0])
    return [first] if (values == first).all() else list(map(int, np.unique(values)))


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
