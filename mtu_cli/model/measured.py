"""Measured parts as arrays: errors of features, lengths and angles, part by part."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.csv_table import perhaps_equal
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, error, finding, listed
from mtu_cli.model.angles import Line, angle_error, check_square
from mtu_cli.model.length_geometry import differences, length_error
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.visits import MOST_TOLD as MOST_TOLD
from mtu_cli.model.visits import IntArray as IntArray
from mtu_cli.model.visits import Visits as Visits
from mtu_cli.model.visits import axes_of as axes_of
from mtu_cli.model.visits import occurrence as occurrence
from mtu_cli.model.visits import only_features as only_features
from mtu_cli.model.visits import operations_of as operations_of
from mtu_cli.model.visits import refuse_doubled
from mtu_cli.model.visits import visits_of as visits_of
from mtu_cli.stats.anova import Cells, cells_of
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTables:
    """Tables of one kind of quantity, one row a table and one column a part.

    `labels` name each table (operation, id, axis; "" where there is none), `cells` hold what an
    analysis of variance needs, in mm or rad; `parts` the columns.
    """

    labels: tuple[tuple[str, str, str], ...]
    parts: tuple[str, ...]
    cells: Cells

    def only(self, kept: list[int]) -> MeasuredTables:
        """The tables at the indices `kept`."""
        cells = Cells(
            origin=self.cells.origin[kept],
            n=self.cells.n[kept],
            mean=self.cells.mean[kept],
            within=self.cells.within[kept],
            within_part=self.cells.within_part[kept],
        )
        return MeasuredTables(
            labels=tuple(self.labels[i] for i in kept), parts=self.parts, cells=cells
        )


def feature_tables(points: Points) -> MeasuredTables:
    """One table an operation, feature and axis: measured minus nominal, mm.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    operations, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    group = points.feature
    if len(operations) > 1:
        group = operation.astype(np.int64) * features + points.feature
    seen = np.zeros(len(operations) * features, bool)
    seen[group] = True
    used = np.flatnonzero(seen)
    table = group if len(used) == len(seen) else (np.cumsum(seen) - 1)[group]
    cell = np.multiply(table, parts, dtype=np.int64)
    cell += points.part
    _check_repeats(points, cell)

    def along(axis: int) -> Cells:
        errors = points.measured[:, axis] - points.nominal[:, axis]
        return cells_of(errors, cell, len(used), parts, spare=True)

    axes = axes_of(points)
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(along, axes))
    labels = [
        (operations[g // features], points.features[g % features], AXES[axis])
        for axis in axes
        for g in used.tolist()
    ]
    return MeasuredTables(labels=tuple(labels), parts=points.parts, cells=_stacked(found))


def check_repeats(points: Points) -> None:
    """Raises InputError for a feature that stands twice in one repeat of one part."""
    _, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    cell = (operation.astype(np.int64) * features + points.feature) * parts + points.part
    _check_repeats(points, cell)


def _check_repeats(points: Points, cell: IntArray) -> None:
    """Refuses a repeat that stands twice in a cell."""
    given = points.repeat >= 0
    if perhaps_equal([cell[given], points.repeat[given]]).any():
        code = np.unique(points.repeat, return_inverse=True)[1].reshape(-1)
        place = cell * (int(code.max()) + 1) + code
        if len(np.unique(place[given])) < int(given.sum()):
            refuse_doubled(points, place, given)


def _stacked(found: list[Cells]) -> Cells:
    return Cells(
        origin=np.concatenate([cells.origin for cells in found]),
        n=np.concatenate([cells.n for cells in found]),
        mean=np.concatenate([cells.mean for cells in found]),
        within=np.concatenate([cells.within for cells in found]),
        within_part=np.concatenate([cells.within_part for cells in found]),
    )


def left_out(points: Points) -> list[Finding]:
    """Axes that only some points have, or that have no nominal: they are not analysed."""
    measured = np.isfinite(points.measured).any(axis=0)
    lost = [k for k in np.flatnonzero(measured).tolist() if k not in axes_of(points)]
    what = "some of the points, or of their nominal places,"
    return [
        finding("axis-not-measured", what=what, axis=AXES[k], consequence=f"{AXES[k]} is left out")
        for k in lost
    ]


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


def not_measured(predicted: Sequence[str], points: Points) -> list[Finding]:
    """Of axes with an equation along which no point was measured: nothing is judged there."""
    measured = np.asarray(np.isfinite(points.measured).any(axis=0))
    lost = [name for k, name in enumerate(AXES) if name in predicted and not measured[k]]
    return [
        finding(
            "axis-not-measured",
            what="the points",
            axis=name,
            consequence=f"the E{name} of the machine is not judged",
        )
        for name in lost
    ]


def length_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and length of the part file: measured minus nominal, mm.

    Along an axis that not every end of a length was measured along the length is taken as free
    of error (`length_warnings` says so).

    Raises InputError for a length of which one end alone has a nominal z.
    """
    known = set(points.features)
    entries = [e for e in part.part.lengths if e.from_ in known and e.to in known]
    if not entries:
        return None
    index = {name: i for i, name in enumerate(points.features)}
    pairs = np.array([[index[e.from_], index[e.to]] for e in entries])
    ids = [e.id for e in entries]
    delta = differences(visits.nominal, pairs, ids, part.source.shown)
    axes = list(length_axes(points, part))
    errors = visits.errors[:, :, axes]
    e = np.moveaxis(errors[:, pairs[:, 1]] - errors[:, pairs[:, 0]], (0, 1, 2), (2, 1, 0))
    values = length_error(np.linalg.norm(delta, axis=1), delta[:, axes], e)
    return _visit_tables(points, visits, ids, values)


def length_axes(points: Points, part: LoadedPart) -> tuple[int, ...]:
    """The axes (0, 1, 2) along which every point at an end of a length was measured."""
    ends = {name for e in part.part.lengths for name in (e.from_, e.to)}
    return axes_of(only_features(points, sorted(ends)))


def length_warnings(points: Points, part: LoadedPart) -> list[Finding]:
    """Lengths with a nominal difference along z that was not measured at all their ends."""
    measured = set(points.features)
    places = part.part.places()
    if 2 in length_axes(points, part):
        return []
    lost = []
    for entry in part.part.lengths:
        z = [places[name][2] for name in (entry.from_, entry.to)]
        if {entry.from_, entry.to} <= measured and None not in z and z[0] != z[1]:
            lost.append(entry.id)
    what, free = f"ends of {listed(lost)}", "the lengths are taken as free of error along z"
    known = {"what": what, "names": lost, "axis": "z", "consequence": free}
    return [finding("axis-not-measured", **known)] if lost else []


def angle_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and row-to-column angle, rad: eqs. (24)-(26), less the nominal.

    Raises InputError for a row or column that is off its axis by design.
    """
    index = {name: i for i, name in enumerate(points.features)}
    ids, values = [], []
    measured = [
        i
        for i, entry in enumerate(part.part.orthogonality)
        if all(name in index for name in (*entry.row, *entry.column))
    ]
    check_square(part, measured)
    for entry in (part.part.orthogonality[i] for i in measured):
        lines = (
            _line(visits, [index[name] for name in entry.row], 0, 1),
            _line(visits, [index[name] for name in entry.column], 1, 0),
        )
        (row, row_nominal), (column, column_nominal) = lines
        ids.append(entry.id)
        values.append(angle_error((row, column), (row_nominal, column_nominal)))
    return _visit_tables(points, visits, ids, np.array(values)) if ids else None


def _line(visits: Visits, which: list[int], along: int, across: int) -> tuple[Line, Line]:
    """A line as measured, (features, visits), and nominal; nan where a feature is missing."""
    place = visits.nominal[which]
    nominal = [place[:, [axis]] - place[:, axis].mean() for axis in (along, across)]
    placed = [visits.errors[:, which, axis].T for axis in (along, across)]
    u, v = (n + e - e.mean(axis=0) for n, e in zip(nominal, placed, strict=True))
    return (u, v), (nominal[0], nominal[1])


def _visit_tables(
    points: Points, visits: Visits, ids: list[str], values: FloatArray
) -> MeasuredTables | None:
    """Tables of quantities (ids, visits) by operation; visits without a value are left out."""
    operations, _ = operations_of(points)
    labels, found = [], []
    parts = len(points.parts)
    for code, operation in enumerate(operations):
        for name, value in zip(ids, values, strict=True):
            kept = (visits.operation == code) & np.isfinite(value)
            if kept.any():
                labels.append((operation, name, ""))
                found.append(cells_of(value[kept], visits.part[kept], 1, parts))
    if not found:
        return None
    return MeasuredTables(labels=tuple(labels), parts=points.parts, cells=_stacked(found))
