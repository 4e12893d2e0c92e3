"""Columns of measured points as covariates of the equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    MachineModel,
    missing_covariates,
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
    empty or no number, for temperatures of one moment that cannot both be right, with their rows,
    and for points without a coordinate that an equation needs.
    """
    files = ", ".join(source.shown for source in points.sources)
    problems = [
        problem.at(column=problem.facts["names"][0])
        for problem in missing_covariates(model, {*columns, *at}, list(columns), file=files)
    ]
    needed = [*model.covariates()]
    if any(drift.time_constants.any() for drift in model.drifts()):
        needed.append(TIME)
    values: Values = {name: at[name] for name in model.covariates() if name in at}
    for name in needed:
        if name in columns:
            values[name] = numbers_of(points, name, columns[name], problems)
    places = points.nominal
    if not at_nominal:
        places = np.where(np.isnan(places), points.measured, places)
    if not problems:
        found = [
            moment_problem(model, points, values),
            without_coordinate(model, places, lambda i: _feature(points, i)),
        ]
        problems += [problem for problem in found if problem is not None]
    if problems:
        raise InputError(problems)
    reason = "the points have the column"
    idle = [name for name in used_columns(model) if name in columns and name in at]
    warnings = [finding("not-used", what="--at", names=[name], reason=reason) for name in idle]
    return Needed(values=values, warnings=tuple(warnings))


def _feature(points: Points, i: int) -> tuple[str, dict[str, Any]]:
    return points.features[points.feature[i]], _row(points, i)


def _row(points: Points, i: int) -> dict[str, Any]:
    return {"file": points.sources[points.file_index[i]].shown, "row": int(points.row[i])}


def used_columns(model: MachineModel) -> list[str]:
    """The covariates of the equations, and those that tell where declared effects hold."""
    within = (name for effect in model.effects for name in effect.within)
    return list(dict.fromkeys([*model.covariates(), *within]))


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
        problems.append(
            finding(
                "wrong-type" if text else "empty-cell",
                facts={"kind": "a number"} if text else {},
                column="time" if name == TIME else name,
                value=text or None,
                expected=f"a number: {name!r} of every point is needed",
                **_row(points, i),
            )
        )
    return found


def number(text: str) -> float:
    """nan where it is none."""
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
