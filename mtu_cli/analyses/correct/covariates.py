"""Covariates of measured points: from their own columns, else from the call."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.errors import InputError, Problem, closest
from mtu_cli.files.covariates import HOTTEST_DEGC, is_temperature
from mtu_cli.files.points import Points
from mtu_cli.model.basis import TIME
from mtu_cli.model.machine_model import AXES, MachineModel, sensors_of
from mtu_cli.model.measured import MOST_TOLD
from mtu_cli.model.moments import moment_problem
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

Values = dict[str, FloatArray | float]


@dataclass(frozen=True, slots=True, kw_only=True)
class RowCovariates:
    """Covariates by name: one value a point (n,), or one for all."""

    values: Values
    warnings: tuple[Warned, ...]


def column_of(points: Points, name: str) -> np.ndarray | None:
    """The points' own column by its name in equations; None where no row has a value."""
    named: dict[str, np.ndarray] = {
        TIME: points.time_min,
        "sequence": points.sequence.astype(np.float64),
        **{f"dir_{axis}": points.direction[:, i] for i, axis in enumerate(AXES)},
    }
    if name in named:
        return None if np.isnan(named[name]).all() else named[name]
    return points.covariates.get(name)


def row_covariates(
    model: MachineModel, points: Points, at: Mapping[str, float] | None = None
) -> RowCovariates:
    """What the model needs at every point; the rows' own columns come before `at`.

    Times are added where the drift lags behind the temperatures.

    Raises InputError for a covariate that is neither a column nor given (the column is named),
    and for cells that are empty or no number, with their rows.
    """
    given = at or {}
    values: Values = {}
    problems: list[Problem] = []
    warnings: list[Warned] = []
    for name in model.covariates():
        column = column_of(points, name)
        if column is not None:
            values[name] = numbers_of(points, name, column, np.arange(len(points)), problems)
            warnings += _passed_over(name, given)
        elif name in given:
            values[name] = given[name]
        else:
            problems.append(_missing(model, points, name))
    if any(drift.time_constants.any() for drift in model.drifts()):
        times = column_of(points, TIME)
        if times is not None:
            values[TIME] = numbers_of(points, TIME, times, np.arange(len(points)), problems)
    if not problems and (problem := moment_problem(model, points, values)) is not None:
        problems.append(problem)
    if problems:
        raise InputError(problems)
    return RowCovariates(values=values, warnings=tuple(warnings))


def _passed_over(name: str, given: Mapping[str, float]) -> list[Warned]:
    if name not in given:
        return []
    text = f"the points' own column {name!r} is used, not --at {name}"
    return [Warned(code="covariate-of-the-points", message=text)]


def _missing(model: MachineModel, points: Points, name: str) -> Problem:
    drifts = sensors_of(model)
    near = closest(name, points.covariates)
    return Problem(
        what=f"the drift of {', '.join(drifts[name])} needs the temperature {name!r}"
        if name in drifts
        else f"the equations of {model.name!r} need the covariate {name!r}",
        file=", ".join(source.shown for source in points.sources),
        column=name,
        expected=f"a column of this name{f' (there is {near!r})' if near else ''}, or "
        f"--at {name}=VALUE",
    )


def numbers_of(
    points: Points, name: str, column: np.ndarray, rows: np.ndarray, problems: list[Problem]
) -> FloatArray:
    """The column (n,) as numbers; cells of `rows` that are none become problems."""
    values, texts = column, None
    if column.dtype == object:
        texts = column
        values = np.array([_number(text) for text in column.tolist()])
    bad = rows[~np.isfinite(values[rows])]
    problems += [
        Problem(
            what="not a number" if texts is not None and texts[i] else "the cell is empty",
            file=points.sources[points.file_index[i]].shown,
            row=int(points.row[i]),
            column="time" if name == TIME else name,
            value=(texts[i] or None) if texts is not None else None,
            expected=f"a number: the correction needs {name!r} of every point",
        )
        for i in bad[:MOST_TOLD]
    ]
    found: FloatArray = values.astype(np.float64)
    if is_temperature(name):
        far = rows[np.isfinite(found[rows]) & (np.abs(found[rows]) > HOTTEST_DEGC)]
        problems += [
            Problem(
                what="no temperature",
                file=points.sources[points.file_index[i]].shown,
                row=int(points.row[i]),
                column=name,
                value=f"{found[i]:g}",
                expected=f"degC, at most {HOTTEST_DEGC:g} in size",
            )
            for i in far[:MOST_TOLD]
        ]
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def rows_of(values: Mapping[str, FloatArray | float], rows: np.ndarray) -> Values:
    """The covariates of some rows."""
    return {
        name: value if np.ndim(value) == 0 else np.asarray(value)[rows]
        for name, value in values.items()
    }


def known_names(points: Points, at: Iterable[str]) -> list[str]:
    """Every covariate that the points or the call give."""
    named = (TIME, "sequence", *(f"dir_{axis}" for axis in AXES))
    own = [name for name in named if column_of(points, name) is not None]
    return [*points.covariates, *at, *own]
