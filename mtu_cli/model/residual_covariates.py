"""Covariates of measured points: as numbers, with gaps, and as tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.covariates import closest_covariate
from mtu_cli.files.points import Points
from mtu_cli.files.readings import Readings
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    MachineModel,
    of_feature,
    sensors_of,
    without_coordinate,
)
from mtu_cli.model.residual_layout import Cells, IntArray, only_rows
from mtu_cli.model.temperatures import moment_problem
from mtu_cli.model.visits import MOST_TOLD
from mtu_cli.stats.least_squares import FloatArray

FEW = 0.05
"""Share of the rows up to which they are left out: without its covariate an effect cannot be named,
and looks like one that the library lacks."""


def without_gaps(points: Points, needed: Collection[str]) -> tuple[Points, list[Finding]]:
    """The points without rows that lack a covariate which nearly all others have (`_few`). Not of
    `needed` ones, whose gaps are faults.
    """
    columns = point_columns(points)
    gone, named = _few(
        {name: column for name, column in columns.items() if name not in needed},
        (points.part, points.feature, points.file_index),
    )
    if not named:
        return points, []
    first = int(gone.argmax())
    place = f"{points.sources[points.file_index[first]].shown}, row {points.row[first]}"
    return only_rows(points, ~gone), [_left_out(named, gone, place)]


def rows_without_gaps(
    readings: Readings,
    rows: NDArray[np.int64],
    columns: Mapping[str, NDArray[Any]],
    groups: Sequence[NDArray[np.int64]],
) -> tuple[NDArray[np.int64], list[Finding]]:
    """The readings `rows` (n,) of a component without those that lack one of the `columns` (n,)
    which nearly all others have; `groups` (n,) are codes of which each keeps a reading.
    """
    files = readings.file_index[rows]
    gone, named = _few(columns, (*groups, files))
    if not named:
        return rows, []
    first = int(gone.argmax())
    component = readings.components[readings.code[rows[first]]]
    place = f"{readings.sources[files[first]].shown}, row {readings.row[rows[first]]}"
    return rows[~gone], [_left_out(named, gone, place, f" of {component}")]


def _few(
    columns: Mapping[str, NDArray[Any]], groups: Sequence[NDArray[np.int64]]
) -> tuple[NDArray[np.bool_], list[str]]:
    """Rows (n,) to leave out for gaps, and the columns that have these; the columns with the
    fewest come first. Not of those that are the same everywhere, nor gaps that are all that there
    is of a part, feature, pass, target or file.
    """
    empty = {
        name: ~np.isfinite(column)
        for name, column in columns.items()
        if column.dtype != object and not np.isfinite(column).all() and _differs(column)
    }
    gone, named = np.zeros(len(groups[0]), bool), []
    for name in sorted(empty, key=lambda name: int(empty[name].sum())):
        both = gone | empty[name]
        if both.sum() <= FEW * len(gone) and not _takes_all(groups, both):
            gone = both
            named.append(name)
    return gone, named


def _left_out(
    named: Sequence[str], gone: NDArray[np.bool_], place: str, whose: str = ""
) -> Finding:
    consequence = f"{int(gone.sum())} of {len(gone)} rows{whose} left out, the first {place}"
    return finding("missing-values", what="cells", names=named, consequence=consequence)


def _differs(column: FloatArray) -> bool:
    return len(np.unique(column[np.isfinite(column)])) > 1


def _takes_all(groups: Sequence[NDArray[np.int64]], gone: NDArray[np.bool_]) -> bool:
    """Whether some group is in no other row."""
    return any(len(np.unique(code)) > len(np.unique(code[~gone])) for code in groups)


ROUNDING = 1e-12
"""Means of repeats that differ by less than this share of their size are equal."""

Values = dict[str, FloatArray | float]
Columns = Mapping[str, np.ndarray]


def point_columns(points: Points) -> dict[str, np.ndarray]:
    """The points' columns (n,) by their names in equations: floats, nan where a cell is empty,
    or texts. A column without any value is none.
    """
    named: dict[str, np.ndarray] = {
        **{f"dir_{axis}": points.direction[:, i] for i, axis in enumerate(AXES)},
        TIME: points.time_min,
        "sequence": points.sequence.astype(np.float64),
    }
    named = {name: column for name, column in named.items() if not np.isnan(column).all()}
    return named | points.covariates


def table_covariates(
    columns: Columns, cells: Cells, files: tuple[IntArray, Sequence[Source]]
) -> tuple[dict[str, FloatArray], tuple[Finding, ...]]:
    """Numeric columns (n,) as tables that broadcast to (parts, columns).

    (1, 1) where nothing differs, (parts, 1) where nothing does within a part, (1, columns)
    where nothing does within a column, else the cells' means; missing cells hold the mean of
    their part. A column of text is left out, one with gaps with a warning; `files` are the file
    of each row (n,) and all files.
    """
    found: dict[str, FloatArray] = {}
    gaps: list[str] = []
    for name, column in columns.items():
        if column.dtype == object:
            continue
        known = np.isfinite(column)
        if known.all():
            found[name] = _smallest(column.astype(np.float64), cells)
        else:
            gaps.append(f"{name} ({_where(known, *files)})")
    if not gaps:
        return found, ()
    consequence = "no effect of such a column can be tested"
    gap = finding("missing-values", what="cells", names=gaps, consequence=consequence)
    return found, (gap,)


def _where(known: NDArray[np.bool_], index: IntArray, sources: Sequence[Source]) -> str:
    """The files that have no cell of a column, or how many rows have none."""
    without = [sources[f].shown for f in np.unique(index) if not known[index == f].any()]
    rows = f"{int((~known).sum())} of {len(known)} rows"
    return f"{rows}, all of {' and '.join(without)}" if without else rows


def _smallest(column: FloatArray, cells: Cells) -> FloatArray:
    for part, along in ((False, False), (True, False), (False, True)):
        table = _reduced(column, cells, part=part, along=along)
        if table is not None:
            return table
    means = cells.means(column)
    table = cells.table(means)
    size = ROUNDING * np.abs(means).max()
    for axis in (1, 0):
        low, high = (f(table, axis=axis, keepdims=True) for f in (np.nanmin, np.nanmax))
        if (high - low <= size).all():
            return np.asarray(low)
    of_part = np.nanmean(table, axis=1, keepdims=True)
    return np.where(np.isnan(table), of_part, table)


def _reduced(column: FloatArray, cells: Cells, *, part: bool, along: bool) -> FloatArray | None:
    """The column by part, by column or as one value, if it differs by nothing else."""
    size = cells.parts if part else cells.columns if along else 1
    code = cells.part if part else cells.column if along else np.zeros(len(column), np.int64)
    table = np.empty(size)
    table[code[::-1]] = column[::-1]
    if not (column == table[code]).all():
        return None
    return table[:, None] if part else table[None, :]


@dataclass(frozen=True, slots=True, kw_only=True)
class Needed:
    """What the model's equations need, by name: one value a measurement (n,), or one for all."""

    values: Values
    warnings: tuple[Finding, ...]


def needed_covariates(
    model: MachineModel,
    points: Points,
    columns: Columns,
    at: Mapping[str, float],
    *,
    at_nominal: bool = False,
) -> Needed:
    """The model's covariates at every point; the points' own `columns` come before `at`. A model
    that is asked `at_nominal` places has no use for measured coordinates in their place.

    Times are added where a drift lags behind its temperatures.

    Raises InputError for a covariate that is neither a column nor given, for its cells that are
    empty or no number, and for temperatures of one moment that cannot both be right
    where a drift lags behind them, with their rows.
    """
    values: Values = {}
    problems: list[Finding] = []
    for name in model.covariates():
        if name in columns:
            values[name] = numbers_of(points, name, columns[name], problems)
        elif name in at:
            values[name] = at[name]
        else:
            problems.append(_missing(model, points, name, list(columns)))
    if TIME in columns and any(drift.time_constants.any() for drift in model.drifts()):
        values[TIME] = numbers_of(points, TIME, columns[TIME], problems)
    if not problems and (problem := moment_problem(model, points, values)) is not None:
        problems.append(problem)
    if not problems:
        problems += _without_place(model, points, at_nominal=at_nominal)
    if problems:
        raise InputError(problems)
    return Needed(values=values, warnings=tuple(_of_the_points(model, columns, at)))


def _of_the_points(
    model: MachineModel, columns: Columns, at: Mapping[str, float]
) -> Iterator[Finding]:
    """Of columns that `at` does not stand in for."""
    for name in used_columns(model):
        if name in columns and name in at:
            yield finding(
                "not-used", what="--at", names=[name], reason="the points have the column"
            )


def used_columns(model: MachineModel) -> list[str]:
    """The covariates of the equations, and those that tell where declared effects hold."""
    within = (name for effect in model.effects for name in effect.within)
    return list(dict.fromkeys([*model.covariates(), *within]))


def _without_place(model: MachineModel, points: Points, *, at_nominal: bool) -> Iterator[Finding]:
    """Points without a coordinate that an equation needs, neither measured nor nominal."""
    places = points.nominal
    if not at_nominal:
        places = np.where(np.isnan(places), points.measured, places)
    found = without_coordinate(model, places)
    if found is not None:
        lacking, problem = found
        i = int(lacking[0])
        yield of_feature(
            problem,
            points.features[points.feature[i]],
            len(lacking) - 1,
            file=points.sources[points.file_index[i]].shown,
            row=int(points.row[i]),
        )


def _missing(model: MachineModel, points: Points, name: str, known: Sequence[str]) -> Finding:
    drifts = sensors_of(model)
    if name in drifts:
        return missing_sensor(points, name, drifts[name], known)
    return _lacks(points, name, known, f"the machine {model.name!r}")


def missing_sensor(
    points: Points, name: str, drifts: Sequence[str], known: Sequence[str]
) -> Finding:
    """The Problem of a sensor that the points, whose columns are `known`, do not have, and that
    the drifts of these components need.
    """
    return _lacks(points, name, known, f"the drift of {listed(drifts)}")


def _lacks(points: Points, name: str, known: Sequence[str], owner: str) -> Finding:
    near = closest_covariate(name, known)
    there = f" (there is {near!r})" if near else ""
    return finding(
        "missing-input",
        what=f"a value of {name} for {owner}",
        names=[name],
        file=", ".join(source.shown for source in points.sources),
        column=name,
        expected=f"a column of this name{there}, or --at {name}=VALUE",
    )


def numbers_of(
    points: Points,
    name: str,
    column: np.ndarray,
    problems: list[Finding],
    rows: IntArray | None = None,
) -> FloatArray:
    """The column (n,) as numbers; cells of `rows` (all of them unless given) that are none
    become problems.
    """
    texts = column.tolist() if column.dtype == object else None
    found = np.array([number(text) for text in texts]) if texts else column.astype(np.float64)
    chosen = np.arange(len(found)) if rows is None else rows
    for i in chosen[~np.isfinite(found[chosen])][:MOST_TOLD].tolist():
        text = texts[i] if texts else ""
        problems.append(_not_a_number(points, i, name, text or None))
    return found


def _not_a_number(measured: Points, i: int, name: str, value: str | None) -> Finding:
    """What is wrong with the cell of row i, which holds this text or nothing."""
    return finding(
        "wrong-type" if value else "empty-cell",
        facts={"kind": "a number"} if value else {},
        file=measured.sources[measured.file_index[i]].shown,
        row=int(measured.row[i]),
        column="time" if name == TIME else name,
        value=value,
        expected=f"a number: {name!r} of every point is needed",
    )


def number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
