"""Diameters and lengths before and after the correction, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from math import nan

import numpy as np

from mtu_cli.analyses.correct.leaning import askew, bore
from mtu_cli.analyses.correct.quantity import Kind, Sides, Size, mean_size
from mtu_cli.analyses.correct.roundness import Shape
from mtu_cli.analyses.correct.rows import RowErrors
from mtu_cli.analyses.correct.scatter import Squares, ring_squares
from mtu_cli.analyses.correct.strain import levers_of
from mtu_cli.analyses.correct.wanted import Task
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.geometry import DIMENSIONS, GeometryError, fit_circle, fit_sphere
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A size before and after, and its gradient (m, 3) in the corrected points, mm.

    Of circles and spheres the `residuals` (m,) after, mm, and the unit vectors `away` (m, 3)
    from the centre, in the plane of a circle.
    """

    size: Sides
    form: Sides
    reference: float
    gradient: FloatArray
    residuals: FloatArray | None = None
    away: FloatArray | None = None


Key = tuple[Kind, str, str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Rings:
    """What the form of circles and spheres tells of the scatter of points, and their shapes."""

    squares: list[Squares] = field(default_factory=list)
    shapes: dict[Key, Shape] = field(default_factory=dict)


def sizes_of(
    tasks: Sequence[Task], rows: RowErrors, corrected: FloatArray
) -> tuple[list[Size], Rings]:
    """The sizes of every part: means over its repeats, in the order of the part file; and the
    form of its circles and spheres.

    Raises InputError for points that do not determine a circle or sphere, with their row.
    """
    measures: list[Measure] = []
    problems: list[Finding] = []
    for task in tasks:
        try:
            measures.append(_measure(task, rows, corrected))
        except GeometryError as error:
            problems.append(_problem(task, rows, error))
    if problems:
        raise InputError(problems)
    single, rings = _with_u(tasks, measures, rows)
    groups: dict[tuple[int, str, str], list[Size]] = {}
    for task, size in zip(tasks, single, strict=True):
        groups.setdefault((task.order, task.operation, task.part), []).append(size)
    ordered = sorted(groups, key=lambda key: key[0])
    return [mean_size(groups[key]) for key in ordered], rings


def _problem(task: Task, rows: RowErrors, error: GeometryError) -> Finding:
    points, first, own = rows.points, int(task.rows[0]), task.wanted
    return finding(
        "too-little-data",
        what=f"no {own.kind} goes through the points of {own.id!r}, part {task.part!r}: {error}",
        file=points.sources[points.file_index[first]].shown,
        row=int(points.row[first]),
        expected="points of its features all around it"
        if own.kind != "length"
        else "two ends apart from each other",
    )


def _measure(task: Task, rows: RowErrors, corrected: FloatArray) -> Measure:
    if task.wanted.kind == "length":
        return _length(task, rows, corrected)
    before, after = rows.points.measured[task.rows], corrected[task.rows]
    flat = np.isnan(before[:, 2]).any()
    sphere = task.wanted.kind == "sphere"
    if sphere and flat:
        raise GeometryError("its points have no z_mm")
    fit, d = fit_sphere if sphere else fit_circle, 2 if flat else 3
    first, last = fit(before[:, :d]), fit(after[:, :d])
    gradient, away = np.zeros((2, len(after), 3))
    gradient[:, :d], away[:, :d] = 2 * last.radius_gradient, last.away
    calibration = task.wanted.calibration
    return Measure(
        size=(2 * first.radius, 2 * last.radius),
        form=(first.form, last.form),
        reference=nan if calibration is None else calibration.at(_temperature(task)),
        gradient=gradient,
        residuals=last.residuals,
        away=away,
    )


def _temperature(task: Task) -> float:
    """The mean temperature of the points of a circle or sphere; nan where it is not known."""
    calibration = task.wanted.calibration
    return nan if calibration is None else float(calibration.temperature[task.rows].mean())


def _length(task: Task, rows: RowErrors, corrected: FloatArray) -> Measure:
    """End minus start; along z nothing is off where only the nominal z is known."""
    nominal = rows.points.nominal[task.rows]
    before = _ends(rows.points.measured[task.rows], nominal)
    after = _ends(corrected[task.rows], nominal)
    delta = after[1] - after[0]
    length = float(np.linalg.norm(delta))
    if length == 0:
        raise GeometryError("its ends stand at the same place")
    unit = delta / length
    known = np.isfinite(rows.points.measured[task.rows])
    return Measure(
        size=(float(np.linalg.norm(before[1] - before[0])), length),
        form=(nan, nan),
        reference=float(np.linalg.norm(np.diff(_ends(nominal, nominal), axis=0))),
        gradient=np.where(known, [-unit, unit], 0.0),
    )


def _ends(ends: FloatArray, nominal: FloatArray) -> FloatArray:
    """Coordinates (2, 3); a z that only one end has counts for neither."""
    found = np.where(np.isnan(ends), nominal, ends)
    if np.isnan(found[:, 2]).any():
        found[:, 2] = 0.0
    return found


def _with_u(
    tasks: Sequence[Task], measures: Sequence[Measure], rows: RowErrors
) -> tuple[list[Size], Rings]:
    """Every task as a size: its variance is that of gradient' E over the points of its visit."""
    visits = [list(group) for _, group in groupby(range(len(tasks)), lambda i: tasks[i].visit)]
    points = [np.unique(np.concatenate([tasks[i].rows for i in group])) for group in visits]
    columns = [AXES.index(axis) for axis in rows.model.axes]
    sizes: list[Size] = []
    rings = Rings()
    for start, end in rows.together(points):
        chosen = np.concatenate(points[start:end])
        own = [i for group in visits[start:end] for i in group]
        place = {int(row): k for k, row in enumerate(chosen)}
        prediction = rows.predicted(chosen)
        A = np.zeros((len(own), len(chosen), len(columns)))
        for line, i in enumerate(own):
            where = np.array([place[int(row)] for row in tasks[i].rows])
            A[line, where] = measures[i].gradient[:, columns]
            _add_form(rings, tasks[i], measures[i], where, rows, prediction)
        variance, dof = rows.variances(prediction, A.reshape(len(own), -1))
        sizes += [
            _size(tasks[i], measures[i], float(variance[line]), float(dof[line]))
            for line, i in enumerate(own)
        ]
    return sizes, rings


def _add_form(
    rings: Rings,
    task: Task,
    measure: Measure,
    where: np.ndarray,
    rows: RowErrors,
    prediction: Prediction,
) -> None:
    """Adds what the form of a ring tells, `where` in the prediction its points are."""
    if measure.residuals is None or measure.away is None:
        return
    columns = [AXES.index(axis) for axis in rows.model.axes]
    K = rows.covariance(prediction, where, measure.away[:, columns])
    squares = ring_squares(measure.residuals, measure.away, K, DIMENSIONS[task.wanted.kind])
    rings.squares.extend([] if squares is None else [squares])
    shape = _shape(task, measure.size[1] / 2, (measure.residuals, measure.away, K), rows)
    calibrated = np.isfinite(measure.reference)
    dof = _dof_of_strain(shape, where, rows, prediction) if calibrated else None
    if dof is not None:
        shape = replace(shape, dof=dof, judged=True)
    names = tuple(rows.points.features[code] for code in rows.points.feature[task.rows])
    key = (shape.kind, shape.id, shape.operation, names)
    known = rings.shapes.get(key)
    rings.shapes[key] = shape if known is None else known.and_another(shape)


def _shape(
    task: Task, radius: float, ring: tuple[FloatArray, FloatArray, FloatArray], rows: RowErrors
) -> Shape:
    """The ring of one visit, not judged, by residuals, directions from its centre and K."""
    residuals, away, K = ring
    drawn = rows.points.nominal[task.rows]
    bored = np.zeros(3) if task.wanted.kind == "sphere" else bore(drawn)
    return Shape(
        kind=task.wanted.kind,
        id=task.wanted.id,
        operation=task.operation,
        radius=radius,
        residuals=residuals,
        away=away,
        K=K,
        dof=np.inf,
        bore=bored,
        oblique=askew(np.linalg.svd(away)[2][-1], bored),
        judged=False,
    )


def _dof_of_strain(
    shape: Shape, where: np.ndarray, rows: RowErrors, prediction: Prediction
) -> float | None:
    """The fewest degrees of freedom of the strains that a ring shows, whose points are `where` in
    the prediction; None where it shows none.
    """
    levers = levers_of(shape.kind, shape.radius, shape.away)
    if levers is None:
        return None
    columns = [AXES.index(axis) for axis in rows.model.axes]
    A = np.zeros((len(levers.estimator), len(prediction.points), len(columns)))
    A[:, where] = levers.estimator[:, :, None] * shape.away[:, columns]
    _, dof = rows.variances(prediction, A.reshape(len(A), -1))
    return float(dof.min())


def _size(task: Task, measure: Measure, variance: float, dof: float) -> Size:
    return Size(
        kind=task.wanted.kind,
        id=task.wanted.id,
        part=task.part,
        operation=task.operation,
        repeat=task.repeat if task.repeat >= 0 else None,
        temperature=_temperature(task),
        size=measure.size,
        form=measure.form,
        reference=measure.reference,
        U_reference=task.wanted.U_reference,
        u=float(np.sqrt(max(variance, 0.0))),
        dof=dof,
        points=len(task.rows),
        sensitivity=float((measure.gradient**2).sum()),
    )
