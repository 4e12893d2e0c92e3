"""Covariates of measured points: as numbers, with gaps, and as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.covariates import closest_covariate
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    MachineModel,
    of_feature,
    sensors_of,
    without_coordinate,
)
from mtu_cli.model.temperatures import moment_problem
from mtu_cli.model.visits import MOST_TOLD, IntArray
from mtu_cli.stats.least_squares import FloatArray

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


def rows_of(
    values: Mapping[str, FloatArray | float], rows: IntArray
) -> dict[str, FloatArray | float]:
    """The covariates of some measurements."""
    return {
        name: value if np.ndim(value) == 0 else np.asarray(value)[rows]
        for name, value in values.items()
    }
