"""Covariates of the equations: of a call, and columns of measured points."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.files.covariates import DIRECTIONS, SENSOR_DEGC, is_temperature
from mtu_cli.files.headers import LISTED_FAULTS, cell_text
from mtu_cli.files.readings import Points, Readings
from mtu_cli.findings import Finding, InputError, error, finding, nearest
from mtu_cli.model.machine_model import (
    AXES,
    TIME,
    Covariates,
    MachineModel,
    missing_covariates,
    without_coordinate,
)
from mtu_cli.model.visits import Cells, axes_of
from mtu_cli.stats.groups import group_means
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray
from mtu_cli.stats.resolution import proportional, step_of

Columns = Mapping[str, np.ndarray]


def point_columns(points: Points) -> dict[str, np.ndarray]:
    """The points' columns (n,) by their names in equations: floats, nan where a cell is empty,
    or texts. A column without any value is none.
    """
    columns: dict[str, np.ndarray] = {
        **{f"dir_{axis}": points.direction[:, i] for i, axis in enumerate(AXES)},
        TIME: points.time_min,
        "sequence": points.sequence.astype(np.float64),
    }
    columns = {name: column for name, column in columns.items() if not np.isnan(column).all()}
    return columns | points.covariates


def given_covariates(
    model: MachineModel, at: Mapping[str, float], extra: Collection[str] = ()
) -> tuple[dict[str, float], list[Finding]]:
    """The covariates of --at for the model and `extra` ones, and warnings of those that no equation
    needs. A name with * and ? stands for all that it matches and that have no value of their own.

    Raises InputError for a value that no cell of its column may have.
    """
    needed = dict.fromkeys((*model.covariates(), *extra))
    values, warnings = dict(at), list[Finding]()
    for pattern in (name for name in at if "*" in name or "?" in name):
        if matches := fnmatch.filter(needed, pattern):
            value = values.pop(pattern)
            values |= {name: value for name in matches if name not in values}
    for name, value in values.items():
        check_cell(name, value)
    # The nearest of those names alone that the call would take.
    lacking = [name for name in model.covariates() if name not in values]
    for name in (name for name in values if name not in needed):
        place = {"path": f"--at {name}", "why": ": no equation needs it", "name": name}
        expected = f"a covariate: {name} is the position of a feature" if name in AXES else None
        meant = nearest(name, lacking)
        warnings.append(finding("option-not-used", **place, meant=meant, expected=expected))
    return values, warnings


def check_cell(name: str, value: float) -> None:
    """Raises InputError for a value that no cell of its column may have: a direction that is
    neither forth nor back, a temperature that no sensor reads, or a broken count.
    """
    place = {"path": f"--at {name}", "value": cell_text(value)}
    if name in DIRECTIONS and abs(value) != 1.0:
        raise error("out-of-range", **place, expected="-1 or +1")
    low, high = SENSOR_DEGC
    if is_temperature(name) and not low <= value <= high:
        raise error("out-of-range", **place, expected=f"degC, {low:g} to {high:g}")
    if name == "sequence" and value != int(value):
        raise error("wrong-type", **place, kind="a whole number")


def needed_covariates(
    model: MachineModel,
    points: Points,
    columns: Columns,
    at: Mapping[str, float],
    places: FloatArray,
) -> tuple[dict[str, FloatArray | float], list[Finding]]:
    """The model's covariates, one value a point (n,) or one for all; the points' `columns` come
    before `at`, with a warning. Times are added where a drift lags behind its temperatures.

    Raises InputError for a covariate that is neither a column nor given, for its cells that are
    empty or no number, and for `places` (n, 3) without a coordinate that an equation needs.
    """
    files, names = ", ".join(source.shown for source in points.sources), [*model.covariates()]
    problems = missing_covariates(model, {*columns, *at}, list(columns), file=files)
    values: dict[str, FloatArray | float] = {name: at[name] for name in names if name in at}
    times = [TIME] if any(drift.time_constants.any() for drift in model.drifts()) else []
    for name in (*names, *times):
        if name in columns:
            values[name] = numbers_of(points, name, columns[name], problems)

    def named(i: int) -> tuple[str, dict[str, Any]]:
        return points.features[points.feature[i]], points.place(i)

    if not problems and (lacking := without_coordinate(model, places, named)) is not None:
        problems.append(lacking)
    if problems:
        raise InputError(problems)
    reason = "the points have the column"
    idle = [name for name in names if name in columns and name in at]
    return values, [finding("not-used", what="--at", names=[x], reason=reason) for x in idle]


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
    result = _numbers(column)
    chosen = np.arange(len(result)) if rows is None else rows
    for i in chosen[~np.isfinite(result[chosen])][:LISTED_FAULTS].tolist():
        text = column[i] if column.dtype == object else ""
        problems.append(
            finding(
                "wrong-type" if text else "empty-cell",
                facts={"kind": "a number"} if text else {},
                column="time" if name == TIME else name,
                value=text or None,
                expected=f"a number: {name!r} of every point is needed",
                **points.place(i),
            )
        )
    return result


def _numbers(column: np.ndarray) -> FloatArray:
    """nan where a text is none."""
    import pandas as pd

    return np.asarray(pd.to_numeric(column, errors="coerce"), np.float64)


def rows_of(values: Covariates, rows: IntArray) -> dict[str, FloatArray | float]:
    """The covariates of some measurements."""
    return {name: x if np.ndim(x) == 0 else np.asarray(x)[rows] for name, x in values.items()}


ROUNDING = 1e-12
"""Means of repeats that differ by less than this share of their size are equal."""
DRAWN_MM = 0.1
"""The coarsest digit that a nominal place is written to."""


FEW_GAPS = 0.05
"""Share of the cells up to which a column that changes within parts may lack values."""
FILLED = "such a cell counts as the mean of its part or pass"
UNTESTED = "no effect of such a column can be tested"


def table_covariates(
    columns: Columns, cells: Cells, measured: Points | Readings, rows: IntArray
) -> tuple[dict[str, FloatArray], list[Finding]]:
    """Numeric columns (n,) as tables that broadcast to (parts, columns).

    (1, 1) where nothing differs, (parts, 1) where nothing does within a part, (1, columns)
    where nothing does within a column, else the cells' means; cells without a value hold the mean
    of their part. A column of text is left out, and with a warning one with too many gaps; `rows`
    (n,) of what was `measured`.
    """
    result, gaps = dict[str, FloatArray](), dict[str, list[str]]()
    for name, column in columns.items():
        if column.dtype == object:
            continue
        # Between one direction and the other there is none.
        known, share = np.isfinite(column), 0.0 if name.startswith("dir_") else FEW_GAPS
        table = _smallest(column.astype(np.float64), known, cells, share)
        if table is not None:
            result[name] = table
        if not known.all():
            first = "{file}, row {row}".format(**measured.place(int(rows[known.argmin()])))
            count = f"{int((~known).sum())} of {len(known)} rows, the first {first}"
            gaps.setdefault(UNTESTED if table is None else FILLED, []).append(f"{name} ({count})")
    return result, [
        finding("missing-values", what="cells", names=names, consequence=consequence)
        for consequence, names in gaps.items()
    ]


def _smallest(
    column: FloatArray, known: BoolArray, cells: Cells, share: float
) -> FloatArray | None:
    """The table of the `known` values (n,). None where some part has none, or more than a `share`
    of the cells lacks them, unless some may and all that is known of a part is the same.
    """
    gaps = 1 - len(np.unique(cells.cell[known])) / len(np.unique(cells.cell))
    if len(np.unique(cells.part[known])) < len(cells.parts) or (gaps and not share):
        return None
    size = cells.shape[0] * cells.shape[1]
    table = group_means(column[known], cells.cell[known], size).reshape(cells.shape)
    for axis in ((0, 1), (1,), (0,)):
        low, high = (f.reduce(table, axis=axis, keepdims=True) for f in (np.fmin, np.fmax))
        if (high - low <= ROUNDING * np.nanmax(np.abs(table))).all():
            return np.asarray(low)
    if gaps > share:
        return None
    return np.where(np.isnan(table), np.nanmean(table, axis=1, keepdims=True), table)


def text_warnings(measured: Points | Readings) -> list[Finding]:
    """One warning of all columns that are texts, by some of their cells or all."""
    texts = []
    for name, column in measured.covariates.items():
        if column.dtype == object:
            filled = column[column != ""]
            words = filled[np.isnan(_numbers(filled))]
            some = f"{len(words)} of {len(filled)} cells"
            part = f" ({some}, such as {words[0]!r})" if 0 < len(words) < len(filled) else ""
            texts.append(repr(name) + part)
    facts = {"what": "effects", "items": texts, "reason": "text, not numbers"}
    return [finding("not-tested", **facts)] if texts else []


def without_repeated(points: Points, needed: Collection[str]) -> tuple[Points, list[Finding]]:
    """The points without the columns that repeat their errors or nominal places, and warnings of
    these: an effect proportional to errors would explain everything and mean nothing, one to a
    nominal coordinate is the scale or squareness, which has its own test. Columns that the model's
    equations need stay.

    A column repeats what was measured where it is proportional to it at every point, to the last
    digit of both: in um, with the other sign, or as the diameter of a position.
    """
    numeric = {k: x for k, x in points.covariates.items() if k not in needed and x.dtype != object}
    axes, errors = list(axes_of(points)), points.measured - points.nominal
    digit = max((step_of(points.measured[:, k]) for k in axes), default=0.0)
    # What CMMs write of points: what it repeats, in words, values (n,) in mm, their last digit, and
    # the coarsest digit that they are repeated to; nominal places last, as measured ones are near.
    written = [(f"the error along {AXES[k]}", errors[:, k], digit, np.inf) for k in axes]
    written += [(f"the coordinate {AXES[k]}", points.measured[:, k], digit, np.inf) for k in axes]
    for count in range(2, len(axes) + 1):
        length = np.linalg.norm(errors[:, axes[:count]], axis=1)
        written.append(("the length of the error", length, count * digit, np.inf))
    written += [(f"the nominal {AXES[k]}", points.nominal[:, k], 0.0, DRAWN_MM) for k in axes]
    repeated = {
        name: what
        for name, column in numeric.items()
        for what, values, last, coarsest in written
        if proportional(column.astype(float), values, last, coarsest)
    }
    warnings = []
    if repeated:
        items = [f"{name!r} ({what})" for name, what in repeated.items()]
        reason = "they repeat what was measured, or its nominal place"
        warnings = [finding("not-tested", what="effects", items=items, reason=reason)]
    rest = {name: column for name, column in points.covariates.items() if name not in repeated}
    return (replace(points, covariates=rest) if repeated else points), warnings
