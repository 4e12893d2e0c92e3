"""Measured parts as arrays: errors of features, lengths and angles, and what was not measured."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measurands import Line, angle_error, check_square, differences, length_error
from mtu_cli.model.visits import (
    Visits,
    axes_of,
    check_repeats,
    only_features,
    operations_of,
)
from mtu_cli.stats.anova import Cells, cells_of
from mtu_cli.stats.groups import distinct
from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.stats.resolution import rounding_variance

Label = tuple[str, str, str]
"""Operation, name, axis; "" where there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTables:
    """Tables of one kind of quantity, one row a table and one column a part: `labels` (operation,
    id, axis; "" where there is none), `cells` the data of an analysis of variance, in mm or rad;
    `parts` the columns; `rounding` (tables,) the variance of a value by the last digit of the
    coordinates.
    """

    labels: tuple[tuple[str, str, str], ...]
    parts: tuple[str, ...]
    cells: Cells
    rounding: FloatArray = field(default_factory=lambda: np.zeros(1))


def roundings(points: Points) -> FloatArray:
    """The variance r (3,) mm^2 of a coordinate by its last digit, of the coarsest file along each
    axis. A coordinate that is the nominal one has the digits of the drawing.
    """
    read = np.where(points.measured == points.nominal, np.nan, points.measured)
    files = [read[points.file_index == code] for code in range(len(points.sources))]
    return np.max([[*map(rounding_variance, values.T)] for values in files], axis=0)


def feature_tables(
    points: Points, axes: tuple[int, ...] | None = None, rounding: FloatArray | None = None
) -> MeasuredTables:
    """One table an operation, feature and axis (0, 1, 2; else all): measured minus nominal, mm.
    `rounding` is that of the points as they were read, where these are not (`roundings`).

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    operations, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    axes = axes_of(points) if axes is None else axes
    check_repeats(points)
    used, table = distinct(operation.astype(np.int64) * features + points.feature)
    cell = table * parts + points.part
    errors = points.measured - points.nominal
    tables = [cells_of(errors[:, k], cell, len(used), parts) for k in axes]
    each = {x.name: [getattr(cells, x.name) for cells in tables] for x in fields(Cells)}
    r = roundings(points) if rounding is None else rounding
    return MeasuredTables(
        labels=tuple(
            (operations[g // features], points.features[g % features], AXES[axis])
            for axis in axes
            for g in used.tolist()
        ),
        parts=points.parts,
        cells=Cells(**{name: np.concatenate(arrays) for name, arrays in each.items()}),
        rounding=np.repeat(r[list(axes)], len(used)),
    )


def no_shared_axis(model: MachineModel, points: Points, measured: Sequence[int]) -> InputError:
    """The error of points with no axis of the machine's equations among the `measured` ones."""
    columns = listed(f"{AXES[i]}_mm" for i in measured)
    axes = listed(model.axes)
    return error(
        "not-applicable",
        reason=f"the machine {model.name!r} has equations for {axes}, the points have {columns}",
        file=", ".join(source.shown for source in points.sources),
        column=f"{model.axes[0]}_mm",
        expected=f"a column {model.axes[0]}_mm with its nominal, or an equation Ex or Ey",
    )


def judged_axes(
    model: MachineModel, points: Points, consequence: str
) -> tuple[tuple[int, ...], list[Finding]]:
    """The axes (0, 1, 2) that every point was measured along and an equation is for, and warnings
    of the others: with the `consequence`, of the axis {}, of those without an equation.

    Raises InputError where there is no such axis.
    """
    measured = axes_of(points)
    axes = tuple(k for k in measured if AXES[k] in model.axes)
    if not axes:
        raise no_shared_axis(model, points, measured)
    missing = "the E{} of the machine is not judged"
    return axes, axis_warnings(points, model.axes, consequence, missing)


def axis_warnings(
    points: Points, axes: Collection[str], without: str, missing: str, *, nominal: bool = True
) -> list[Finding]:
    """Warnings of axes that were measured and are none of the `axes` (of the equations), and of
    those of them that points lack a coordinate of, or its `nominal`; with the consequence of
    either, of the axis {}.
    """
    result = []
    unknown = {"points": np.isnan(points.measured)}
    if nominal:
        unknown["nominal places"] = np.isnan(points.nominal)
    for k, axis in enumerate(AXES):
        lacking = {name: rows for name, places in unknown.items() if (rows := places[:, k]).any()}
        if axis not in axes and not unknown["points"][:, k].all():
            facts = {"axis": axis, "consequence": without.format(axis)}
            result.append(finding("axis-without-equation", **facts))
        elif axis in axes and lacking:
            what = some(np.any([*lacking.values()], axis=0), " or ".join(lacking))
            facts = {"what": what, "axis": axis, "consequence": missing.format(axis)}
            result.append(finding("axis-not-measured", **facts))
    return result


def some(rows: BoolArray, name: str) -> str:
    """How many of all, such as "2 of 6 features and axes"."""
    count, total = int(rows.sum()), len(rows)
    return f"all {name}" if count == total else f"{count} of {total} {name}"


def missing_entries(what: str, entries: Iterable[Any], labels: Iterable[Label]) -> list[Finding]:
    """Lengths or angles of the part file without a measurement of a part that has all features."""
    ids = {label[1] for label in labels}
    names = [f"{what} {entry.id}" for entry in entries if entry.id not in ids]
    reason = "no measurement of a part, in one operation, has all of its features"
    return [finding("not-measured", names=names, reason=reason)] if names else []


def length_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and length of the part file: measured minus nominal, mm; free of error
    along an axis that not every end was measured along (`length_warnings` says so).

    Raises InputError for a length of which one end alone has a nominal z.
    """
    index = {name: i for i, name in enumerate(points.features)}
    entries = [e for e in part.part.lengths if e.from_ in index and e.to in index]
    if not entries:
        return None
    pairs = np.array([[index[e.from_], index[e.to]] for e in entries])
    ids = [e.id for e in entries]
    axes = list(length_axes(points, part))
    delta = differences(visits.nominal, pairs, ids, part.source.shown)
    nominal, along = np.linalg.norm(delta, axis=1), delta[:, axes]
    errors = visits.errors[:, :, axes]
    e = (errors[:, pairs[:, 1]] - errors[:, pairs[:, 0]]).transpose(2, 1, 0)
    # Of both ends, along the length.
    r = 2 * (along / nominal[:, None]) ** 2 @ roundings(points)[axes]
    return _visit_tables(points, visits, ids, length_error(nominal, along, e), r)


def length_axes(points: Points, part: LoadedPart) -> tuple[int, ...]:
    """The axes (0, 1, 2) along which every point at an end of a length was measured."""
    ends = {name for e in part.part.lengths for name in (e.from_, e.to)}
    return axes_of(only_features(points, sorted(ends)))


def length_warnings(points: Points, part: LoadedPart) -> list[Finding]:
    """Lengths with a nominal difference along z that was not measured at all their ends."""
    places = part.part.places()
    z = {name: places[name][2] for name in points.features if name in places}
    ends = ((e.id, z.get(e.from_), z.get(e.to)) for e in part.part.lengths)
    names = [id for id, a, b in ends if None not in (a, b) and a != b]
    if not names or 2 in length_axes(points, part):
        return []
    what, consequence = f"ends of {listed(names)}", "the lengths are taken as free of error along z"
    return [finding("axis-not-measured", what=what, names=names, axis="z", consequence=consequence)]


def angle_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and row-to-column angle, rad: eqs. (24)-(26), less the nominal.

    Raises InputError for a row or column that is off its axis by design.
    """
    index = {name: i for i, name in enumerate(points.features)}
    every = list(enumerate(part.part.orthogonality))
    measured = {i: x for i, x in every if {*x.row, *x.column} <= index.keys()}
    if not measured:
        return None
    check_square(part, measured)
    values, variances, r = [], [], roundings(points)
    for entry in measured.values():
        row, row_nominal = _line(visits, [index[name] for name in entry.row], 0, 1)
        column, column_nominal = _line(visits, [index[name] for name in entry.column], 1, 0)
        values.append(angle_error((row, column), (row_nominal, column_nominal)))
        # Of two slopes, each s^2/sum (x - mean x)^2.
        squares = [float((line[0] ** 2).sum()) for line in (row_nominal, column_nominal)]
        variances.append(r[1] / squares[0] + r[0] / squares[1])
    ids = [entry.id for entry in measured.values()]
    return _visit_tables(points, visits, ids, np.array(values), np.array(variances))


def _line(visits: Visits, which: list[int], along: int, across: int) -> tuple[Line, Line]:
    """A line as measured, (features, visits), and nominal; nan where a feature is missing."""
    place = visits.nominal[which]
    nominal = [place[:, [axis]] - place[:, axis].mean() for axis in (along, across)]
    placed = [visits.errors[:, which, axis].T for axis in (along, across)]
    u, v = (n + e - e.mean(axis=0) for n, e in zip(nominal, placed, strict=True))
    return (u, v), (nominal[0], nominal[1])


def _visit_tables(
    points: Points, visits: Visits, ids: list[str], values: FloatArray, rounding: FloatArray
) -> MeasuredTables | None:
    """Tables of quantities (ids, visits) by operation, `rounding` (ids,) the variance of each by
    the last digit; visits without a value are left out.
    """
    operations, _ = operations_of(points)
    of, visit = np.nonzero(np.isfinite(values))
    if not len(of):
        return None
    used, table = distinct(visits.operation[visit].astype(np.int64) * len(ids) + of)
    parts, quantity = len(points.parts), used % len(ids)
    return MeasuredTables(
        labels=tuple((operations[g // len(ids)], ids[g % len(ids)], "") for g in used.tolist()),
        parts=points.parts,
        cells=cells_of(values[of, visit], table * parts + visits.part[visit], len(used), parts),
        rounding=rounding[quantity],
    )
