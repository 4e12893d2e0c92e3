"""Diameters and lengths of each part before and after the correction, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import nan

import numpy as np

from mtu_cli.analyses.correct.rows import RowErrors
from mtu_cli.analyses.correct.scatter import PointScatter, Ring, ring_space
from mtu_cli.analyses.correct.wanted import Kind, Task
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.geometry import DIMENSIONS, GeometryError, fit_circle, fit_sphere
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.coverage import coverage_factor, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray

Sides = tuple[float, float]
"""(before, after) the correction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A diameter or length of one part before and after the correction; mm.

    `reference` is the calibrated diameter or nominal length (nan: none) with expanded
    uncertainty `U_reference` (k = 2, nan: not given), `form` the range of the radial residuals
    (nan for lengths). `u`, `dof` are those of the corrected size. `repeat` is None in a mean
    over repeats, whose scatter `s_repeats` (after, nan for one) has. `sensitivity` is the sum of
    the squared gradients of the size in the coordinates; `k` the coverage factor of `U`.
    """

    kind: Kind
    id: str
    part: str
    operation: str
    repeat: int | None
    temperature: float
    size: Sides
    form: Sides
    reference: float
    U_reference: float
    u: float
    dof: float
    sensitivity: float
    s_repeats: float = nan
    k: float = 2.0
    repeats: tuple[Size, ...] = ()

    @property
    def error(self) -> Sides:
        """Measured minus reference, before and after; nan without a reference."""
        return self.size[0] - self.reference, self.size[1] - self.reference

    @property
    def u_error(self) -> float:
        """Standard uncertainty of the error after: the correction's and the calibration's."""
        return float(np.hypot(self.u, self._u_reference))

    @property
    def _u_reference(self) -> float:
        return 0.0 if np.isnan(self.U_reference) else self.U_reference / 2

    @property
    def dof_error(self) -> float:
        """Effective degrees of freedom of `u_error` (JCGM 100, eq. (G.2b))."""
        return welch_satterthwaite(
            np.array([self.u**2, self._u_reference**2]), np.array([self.dof, np.inf])
        )

    @property
    def interval95(self) -> Sides:
        """The 95 % interval of the corrected size."""
        half = coverage_factor(PROBABILITY, self.dof) * self.u
        return self.size[1] - half, self.size[1] + half

    @property
    def error_interval95(self) -> Sides:
        """The 95 % interval of the error after, the calibration's uncertainty included."""
        half = coverage_factor(PROBABILITY, self.dof_error) * self.u_error
        return self.error[1] - half, self.error[1] + half

    @property
    def U(self) -> float:
        """Expanded uncertainty k u of the corrected size, mm (JCGM 100, eq. (18))."""
        return self.k * self.u

    @property
    def E_n(self) -> float:  # ISO 13528
        """The error after over its expanded uncertainty, k u and that of the calibration; nan
        where neither is known (ISO 13528, 9.7).
        """
        expanded = float(np.hypot(self.U, np.nan_to_num(self.U_reference)))
        return self.error[1] / expanded if expanded > 0 else nan

    @property
    def reduction_percent(self) -> float:
        """100 (1 - |after|/|before|) (Valdes et al., Tables 1 and 2); nan without an error."""
        before, after = self.error
        return 100 * (1 - abs(after) / abs(before)) if before else nan

    @property
    def reduction_shown(self) -> float | None:
        """The reduction; None where the error before is within the uncertainty of that after."""
        return self.reduction_percent if abs(self.error[0]) > self.u_error else None


def mean_size(repeats: Sequence[Size]) -> Size:
    """The mean over the repeats of one part.

    Its uncertainty by the machine is the mean of theirs: what the machine did to a part, its
    state and each visit, is in every repeated measurement of it (coefficients are in any case),
    so that no mean over repeats makes it smaller. Where the machine itself repeated the
    measurement this is an upper bound.
    """
    first, after = repeats[0], np.array([item.size[1] for item in repeats])

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values))

    return replace(
        first,
        repeat=None,
        temperature=mean([item.temperature for item in repeats]),
        size=(mean([item.size[0] for item in repeats]), float(after.mean())),
        form=(mean([item.form[0] for item in repeats]), mean([item.form[1] for item in repeats])),
        reference=mean([item.reference for item in repeats]),
        u=mean([item.u for item in repeats]),
        dof=min(item.dof for item in repeats),
        sensitivity=mean([item.sensitivity for item in repeats]),
        s_repeats=float(after.std(ddof=1)) if len(after) > 1 else nan,
        repeats=tuple(repeats),
    )


def with_scatter(size: Size, scatter: PointScatter | None) -> Size:
    """The size with the scatter of its points, which repeats that show it average out; the form
    of a ring is the same in every repeat.
    """
    if scatter is None:
        return size
    n = max(len(size.repeats), 1) if scatter.origin == "repeats" else 1
    u, dof = scatter.added(np.array([size.u]), np.array([size.dof]), size.sensitivity, n)
    repeats = tuple(with_scatter(item, scatter) for item in size.repeats)
    return replace(size, u=float(u[0]), dof=float(dof[0]), repeats=repeats)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A size before and after, and its gradient (m, 3) in the corrected points, mm.

    Of circles and spheres the `residuals` (m,) after, mm, and the unit vectors `away` (m, 3)
    from the centre, in the plane of a circle.
    """

    size: Sides
    form: Sides
    temperature: float
    reference: float
    gradient: FloatArray
    residuals: FloatArray | None = None
    away: FloatArray | None = None


def sizes_of(
    tasks: Sequence[Task], rows: RowErrors, corrected: FloatArray
) -> tuple[list[Size], list[Ring]]:
    """The sizes of every part by the machine's u alone: means over its repeats, in the order of
    the part file; and its circles and spheres in every visit.

    Raises InputError for points that do not determine a circle or sphere, with their row.
    """
    measures: list[Measure] = []
    problems: list[Finding] = []
    for task in tasks:
        try:
            measure = _length if task.wanted.kind == "length" else _round
            measures.append(measure(task, rows, corrected))
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


def _round(task: Task, rows: RowErrors, corrected: FloatArray) -> Measure:
    """A circle, in the plane of x and y where z is not known, or a sphere."""
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
    T = nan if calibration is None else float(calibration.temperature[task.rows].mean())
    return Measure(
        size=(2 * first.radius, 2 * last.radius),
        form=(first.form, last.form),
        temperature=T,
        reference=nan if calibration is None else calibration.at(T),
        gradient=gradient,
        residuals=last.residuals,
        away=away,
    )


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
        temperature=nan,
        reference=float(np.linalg.norm(np.diff(_ends(nominal, nominal), axis=0))),
        gradient=np.where(known, [-unit, unit], 0.0),
    )


def _ends(ends: FloatArray, nominal: FloatArray) -> FloatArray:
    """Coordinates (2, 3); a z that only one end has counts for neither."""
    both = np.where(np.isnan(ends), nominal, ends)
    if np.isnan(both[:, 2]).any():
        both[:, 2] = 0.0
    return both


def _with_u(
    tasks: Sequence[Task], measures: Sequence[Measure], rows: RowErrors
) -> tuple[list[Size], list[Ring]]:
    """Every task as a size: its variance is that of gradient' E over the points of its visit."""
    visits = [list(group) for _, group in groupby(range(len(tasks)), lambda i: tasks[i].visit)]
    points = [np.unique(np.concatenate([tasks[i].rows for i in group])) for group in visits]
    columns = [AXES.index(axis) for axis in rows.model.axes]
    sizes: list[Size] = []
    rings: list[Ring] = []
    for start, end in rows.together(points):
        chosen = np.concatenate(points[start:end])
        members = [i for group in visits[start:end] for i in group]
        place = {int(row): k for k, row in enumerate(chosen)}
        prediction = rows.predicted(chosen)
        A = np.zeros((len(members), len(chosen), len(columns)))
        for line, i in enumerate(members):
            where = np.array([place[int(row)] for row in tasks[i].rows])
            A[line, where] = measures[i].gradient[:, columns]
            rings += _ring(tasks[i], measures[i], where, rows, prediction)
        variance, dof = rows.variances(prediction, A.reshape(len(members), -1))
        sizes += [
            _size(tasks[i], measures[i], float(variance[line]), float(dof[line]))
            for line, i in enumerate(members)
        ]
    return sizes, rings


def _ring(
    task: Task, measure: Measure, where: np.ndarray, rows: RowErrors, prediction: Prediction
) -> list[Ring]:
    """The ring, whose points stand at `where` in the prediction; of a length none."""
    if measure.residuals is None or measure.away is None:
        return []
    columns = [AXES.index(axis) for axis in rows.model.axes]
    along = measure.away[:, columns]
    return [
        Ring(
            kind=task.wanted.kind,
            id=task.wanted.id,
            operation=task.operation,
            calibrated=bool(np.isfinite(measure.reference)),
            residuals=measure.residuals,
            away=measure.away,
            K=rows.covariance(prediction, where, along),
            dof=_dof_of_form(task.wanted.kind, measure.away, where, rows, prediction),
        )
    ]


def _dof_of_form(
    kind: Kind, away: FloatArray, where: np.ndarray, rows: RowErrors, prediction: Prediction
) -> float:
    """Degrees of freedom of the form's direction whose variance is known worst."""
    Q = ring_space(away, DIMENSIONS[kind])
    if Q is None:
        return np.inf
    columns = [AXES.index(axis) for axis in rows.model.axes]
    A = np.zeros((Q.shape[1], len(prediction.points), len(columns)))
    A[:, where] = Q.T[:, :, None] * away[:, columns]
    variance, dof = rows.variances(prediction, A.reshape(len(A), -1))
    return float(dof[np.argmax(variance**2 / dof)])


def _size(task: Task, measure: Measure, variance: float, dof: float) -> Size:
    return Size(
        kind=task.wanted.kind,
        id=task.wanted.id,
        part=task.part,
        operation=task.operation,
        repeat=task.repeat if task.repeat >= 0 else None,
        temperature=measure.temperature,
        size=measure.size,
        form=measure.form,
        reference=measure.reference,
        U_reference=task.wanted.U_reference,
        u=float(np.sqrt(max(variance, 0.0))),
        dof=dof,
        sensitivity=float((measure.gradient**2).sum()),
    )
