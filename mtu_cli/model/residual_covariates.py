"""Covariates of measured cells in the smallest shape, and those that the model needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.errors import InputError, Problem, closest
from mtu_cli.files.points import Points
from mtu_cli.model.basis import TIME
from mtu_cli.model.machine_model import AXES, MachineModel, sensors_of
from mtu_cli.model.measured import MOST_TOLD
from mtu_cli.model.residual_cells import Cells
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

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
    columns: Columns, cells: Cells
) -> tuple[dict[str, FloatArray], tuple[Warned, ...]]:
    """Numeric columns (n,) as tables that broadcast to (parts, columns).

    (1, 1) where nothing differs, (parts, 1) where nothing does within a part, (1, columns)
    where nothing does within a column, else the cells' means; missing cells hold the mean of
    their part. A column with gaps, or of text, is left out with a warning.
    """
    found: dict[str, FloatArray] = {}
    gaps: list[str] = []
    texts = [
        repr(name)
        for name, column in columns.items()
        if column.dtype == object and np.isnan(_number(str(column[0])))
    ]
    warned = [] if not texts else [_texts(texts)]
    for name, column in columns.items():
        if column.dtype == object:
            continue
        known = np.isfinite(column)
        if known.all():
            found[name] = _smallest(column.astype(np.float64), cells)
        elif known.any():
            gaps.append(f"{name!r} ({int((~known).sum())} of {len(known)} rows)")
    if not gaps:
        return found, tuple(warned)
    text = (
        f"empty cells in {', '.join(gaps)}: left out, so that no effect of "
        f"{'it' if len(gaps) == 1 else 'them'} can be tested"
    )
    return found, (Warned(code="covariate-gaps", message=text), *warned)


def _texts(names: list[str]) -> Warned:
    text = f"{', '.join(names)}: text, not numbers, so that no effect of it can be tested"
    return Warned(code="covariate-is-text", message=text)


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
    warnings: tuple[Warned, ...]


def needed_covariates(
    model: MachineModel, points: Points, columns: Columns, at: Mapping[str, float]
) -> Needed:
    """The model's covariates at every point; the points' own `columns` come before `at`.

    Times are added where a drift lags behind its temperatures.

    Raises InputError for a covariate that is neither a column nor given, and for its cells
    that are empty or no number, with their rows.
    """
    values: Values = {}
    problems: list[Problem] = []
    warnings: list[Warned] = []
    for name in model.covariates():
        if name in columns:
            values[name] = _numbers(points, name, columns[name], problems)
            if name in at:
                text = f"the points' own column {name!r} is used, not --at {name}"
                warnings.append(Warned(code="covariate-of-the-points", message=text))
        elif name in at:
            values[name] = at[name]
        else:
            problems.append(_missing(model, points, name, list(columns)))
    if any(drift.time_constants.any() for drift in model.drifts()):
        if TIME in columns:
            values[TIME] = _numbers(points, TIME, columns[TIME], problems)
        else:
            text = "the points have no times: every drift that lags behind counts as settled"
            warnings.append(Warned(code="lag-without-time", message=text))
    if problems:
        raise InputError(problems)
    return Needed(values=values, warnings=tuple(warnings))


def _missing(model: MachineModel, points: Points, name: str, known: Sequence[str]) -> Problem:
    drifts = sensors_of(model)
    near = closest(name, known)
    return Problem(
        what=f"the drift of {', '.join(drifts[name])} needs the temperature {name!r}"
        if name in drifts
        else f"the equations of {model.name!r} need the covariate {name!r}",
        file=", ".join(source.shown for source in points.sources),
        column=name,
        expected=f"a column of this name{f' (there is {near!r})' if near else ''}, or "
        f"--at {name}=VALUE",
    )


def _numbers(points: Points, name: str, column: np.ndarray, problems: list[Problem]) -> FloatArray:
    values = column
    if column.dtype == object:
        values = np.array([_number(text) for text in column.tolist()])
    for i in np.flatnonzero(~np.isfinite(values))[:MOST_TOLD].tolist():
        text = column[i] if column.dtype == object else ""
        problems.append(
            Problem(
                what="not a number" if text else "the cell is empty",
                file=points.sources[points.file_index[i]].shown,
                row=int(points.row[i]),
                column="time" if name == TIME else name,
                value=text or None,
                expected=f"a number: the prediction needs {name!r} of every point",
            )
        )
    found: FloatArray = values.astype(np.float64)
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
