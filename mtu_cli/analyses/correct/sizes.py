"""Diameters and lengths of the part file, in each part before and after the correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from math import hypot, inf, nan, sqrt
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.analyses.correct.rows import RowErrors
from mtu_cli.analyses.correct.scatter import Kind, PointScatter, Ring, ring_space
from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, counted, error, finding, nearest
from mtu_cli.model.covariates import numbers_of, point_columns
from mtu_cli.model.geometry import GeometryError, fit_circle, fit_sphere
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.model.visits import IntArray, only_features, operations_of, visits_of
from mtu_cli.stats.coverage import coverage_factor, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A size of the part file. Of circles and spheres `calibrated` (k, 2): diameters, mm, by
    ascending temperature, degC, with the expanded uncertainty `U_reference` (k = 2, nan: not
    given).

    `temperature` (n,) of every point, nan where it is not known; `ranged` whether the diameter was
    stated with a temperature.
    """

    kind: Kind
    id: str
    features: tuple[str, ...]
    U_reference: float = nan
    calibrated: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    temperature: FloatArray = field(default_factory=lambda: np.zeros(0))
    ranged: bool = False

    @property
    def name(self) -> str:
        """Kind and id: ``circle 'ring'``."""
        return f"{self.kind} {self.id!r}"

    def reference(self, temperature: float) -> float:
        """The calibrated diameter: linear between calibrated temperatures and beyond, constant with
        one; nan without any.
        """
        if len(self.calibrated) < 2:
            return float(self.calibrated[0, 1]) if len(self.calibrated) else nan
        from scipy.interpolate import make_interp_spline

        at, diameters = self.calibrated.T
        return float(make_interp_spline(at, diameters, k=1)(temperature))


class Task(NamedTuple):
    """A size, the `order`-th of the part file, in one visit: `rows` of its features, in their
    order, among the points.
    """

    wanted: Wanted
    order: int
    part: str
    operation: str
    visit: int
    rows: IntArray


def wanted_of(
    part: LoadedPart, points: Points, at: Mapping[str, float]
) -> tuple[list[Wanted], list[Finding]]:
    """The sizes of the part file of which at least one feature was measured.

    Raises InputError for a temperature that a calibration needs and is not known everywhere.
    """
    wanted, absent = list[Wanted](), list[str]()
    rounds: dict[Kind, Sequence[Any]] = {"circle": part.part.circles, "sphere": part.part.spheres}
    for kind, items in rounds.items():
        for index, item in enumerate(items):
            if set(item.features).isdisjoint(points.features):
                absent.append(f"{kind} {item.id!r}")
            else:
                wanted.append(_calibrated(part, kind, index, item, points, at))
    for length in part.part.lengths:
        ends = (length.from_, length.to)
        if set(ends).isdisjoint(points.features):
            absent.append(f"length {length.id!r}")
        else:
            wanted.append(Wanted(kind="length", id=length.id, features=ends))
    reason = "none of its features was measured"
    return wanted, [finding("not-measured", names=absent, reason=reason)] if absent else []


def _calibrated(
    part: LoadedPart,
    kind: Kind,
    index: int,
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
) -> Wanted:
    """The circle or sphere at `index` of its list in the part file, with its calibration."""
    table = sorted((item.calibrated_mm or {}).items())
    columns, name = point_columns(points), item.temperature or ""
    known, temperature = [*columns, *at], np.full(len(points), nan)
    if name in columns:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Finding] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        temperature = numbers_of(points, name, columns[name], problems, rows)
        if problems:
            raise InputError(problems)
    elif name in at:
        temperature[:] = at[name]
    elif name and table:
        near = nearest(name, known)
        there = f" (there is {' or '.join(map(repr, near))})" if near else ""
        raise error(
            "unknown-name",
            what="temperature",
            file=part.source.shown,
            line=part.line_of(f"{kind}s", index, "temperature"),
            path=f"{kind}s[{index}].temperature",
            value=name,
            expected=f"a column of this name{there}, or --at {name}=VALUE",
        )
    return Wanted(
        kind=kind,
        id=item.id,
        features=tuple(item.features),
        U_reference=nan if item.U_um is None else item.U_um * UM,
        calibrated=np.array(table, np.float64).reshape(-1, 2),
        temperature=temperature,
        ranged=isinstance(part.document.at(f"{kind}s", index, "calibrated_mm"), dict),
    )


def tasks_of(wanted: Sequence[Wanted], points: Points) -> tuple[list[Task], list[Finding]]:
    """Every size in every visit that measured all its features, visit by visit.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    used = only_features(points, [name for item in wanted for name in item.features])
    if not len(used):
        return [], []
    visits, (operations, _) = visits_of(used), operations_of(used)
    # The last column stands for features that nobody measured.
    row = np.full((len(visits.part), len(used.features) + 1), -1)
    codes = [points.features.index(name) for name in used.features]
    row[visits.of_point, used.feature] = np.flatnonzero(np.isin(points.feature, codes))
    columns = {name: i for i, name in enumerate(used.features)}
    places = [[columns.get(name, -1) for name in item.features] for item in wanted]
    tasks, partial = [], dict[str, list[str]]()
    for visit, (code, operation) in enumerate(zip(visits.part, visits.operation, strict=True)):
        for order, item in enumerate(wanted):
            rows, part = row[visit, places[order]], used.parts[code]
            if (rows >= 0).all():
                tasks.append(Task(item, order, part, operations[operation], visit, rows))
            elif (rows >= 0).any():
                partial.setdefault(item.name, []).append(part)
    warned = []
    for name, visited in partial.items():
        # Repeats are no parts of their own.
        count = counted(len(set(visited)), "part")
        reason = f"not all its features were measured on {count} ({visited[0]!r})"
        warned.append(finding("not-measured", names=[name], reason=reason))
    return tasks, warned


Sides = tuple[float, float]
"""(before, after) the correction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A diameter or length of one part before and after the correction; mm.

    `reference` is the calibrated diameter or nominal length (nan: none) with expanded
    uncertainty `U_reference` (k = 2, nan: not given), `form` the range of the radial residuals
    (nan for lengths). `u`, `dof` are those of the corrected size. Of a part that was measured
    `n_repeats` times all are means, of which `s_repeats` (after, nan for one) is the scatter.
    `sensitivity` is the sum of the squared gradients of the size in the coordinates; `k` the
    coverage factor of `U`.
    """

    kind: Kind
    id: str
    part: str
    operation: str
    size: Sides
    reference: float
    U_reference: float
    u: float
    dof: float
    sensitivity: float
    temperature: float = nan
    form: Sides = (nan, nan)
    n_repeats: int = 1
    s_repeats: float = nan
    k: float = 2.0

    @property
    def error(self) -> Sides:
        """Measured minus reference, before and after; nan without a reference."""
        return self.size[0] - self.reference, self.size[1] - self.reference

    @property
    def u_error(self) -> float:
        """Standard uncertainty of the error after: the correction's and the calibration's."""
        return hypot(self.u, float(np.nan_to_num(self.U_reference)) / 2)

    @property
    def dof_error(self) -> float:
        """Effective degrees of freedom of `u_error` (JCGM 100, eq. (G.2b))."""
        parts = np.array([self.u**2, float(np.nan_to_num(self.U_reference)) ** 2 / 4])
        return welch_satterthwaite(parts, np.array([self.dof, inf]))

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
    def reduction_percent(self) -> float:
        """100 (1 - |after|/|before|) (Valdes et al., Tables 1 and 2); nan without an error."""
        before, after = self.error
        return 100 * (1 - abs(after) / abs(before)) if before else nan


def mean_size(repeats: Sequence[Size]) -> Size:
    """The mean over the repeats of one part.

    Its uncertainty by the machine is the mean of theirs: what the machine did to a part is in every
    repeated measurement of it. Where the machine itself repeated the measurement this is an upper
    bound.
    """
    names = ("temperature", "reference", "u", "sensitivity")
    means: dict[str, Any] = {
        name: float(np.mean([getattr(x, name) for x in repeats])) for name in names
    }
    size, form = (np.array([getattr(x, name) for x in repeats]) for name in ("size", "form"))
    (before, after), (was, left) = size.mean(axis=0).tolist(), form.mean(axis=0).tolist()
    return replace(
        repeats[0],
        **means,
        size=(before, after),
        form=(was, left),
        dof=min(item.dof for item in repeats),
        s_repeats=float(size[:, 1].std(ddof=1)) if len(size) > 1 else nan,
        n_repeats=len(repeats),
    )


def with_scatter(size: Size, scatter: PointScatter | None) -> Size:
    """The size with the scatter of its points, which repeats that show it average out; the form
    of a ring is the same in every repeat.
    """
    if scatter is None:
        return size
    n = size.n_repeats if scatter.origin == "repeats" else 1
    u, dof = scatter.added(np.array([size.u]), np.array([size.dof]), size.sensitivity, n)
    return replace(size, u=float(u[0]), dof=float(dof[0]))


class Measure(NamedTuple):
    """Figures of a `Size`, and its gradient (m, 3) in the corrected points. Of circles and spheres
    the `residuals` (m,) after, mm, and the unit vectors `away` (m, 3) from the centre, in the plane
    of a circle.
    """

    figures: dict[str, Any]
    gradient: FloatArray
    residuals: FloatArray | None = None
    away: FloatArray | None = None


def sizes_of(
    tasks: Sequence[Task], rows: RowErrors, corrected: FloatArray
) -> tuple[list[Size], list[Ring]]:
    """The sizes of every part by the machine's u alone: means over its repeats, in the order of
    the part file; and its circles and spheres in every visit. The variance of a size is that of
    gradient' E over the points of its visit.

    Raises InputError for points that do not determine a circle or sphere, with their row.
    """
    groups: dict[tuple[int, str, str], list[Size]] = {}
    rings: list[Ring] = []
    problems: list[Finding] = []
    for _, visit in groupby(tasks, lambda task: task.visit):
        measured: list[tuple[Task, Measure]] = []
        for task in visit:
            try:
                measure = _length if task.wanted.kind == "length" else _round
                found = measure(task, rows.points.measured, corrected, rows.points.nominal)
                measured.append((task, found))
            except GeometryError as fault:
                points, row, item = rows.points, int(task.rows[0]), task.wanted
                of = f"the points of {item.id!r}, part {task.part!r}: {fault}"
                around = "points of its features all around it"
                problem = finding(
                    "too-little-data",
                    what=f"no {item.kind} goes through {of}",
                    file=points.sources[points.file_index[row]].shown,
                    row=int(points.row[row]),
                    expected="two ends apart" if item.kind == "length" else around,
                )
                problems.append(problem)
        if problems:
            continue
        chosen = np.unique(np.concatenate([task.rows for task, _ in measured]))
        prediction = rows.predicted(chosen)
        A = np.zeros((len(measured), len(chosen), len(rows.columns)))
        for line, (task, found) in enumerate(measured):
            where = np.searchsorted(chosen, task.rows)
            A[line, where] = found.gradient[:, rows.columns]
            if found.residuals is None or found.away is None:
                continue
            m, worst, item = len(found.away), inf, task.wanted
            along = np.zeros((m, len(prediction.points), len(rows.columns)))
            along[np.arange(m), where] = found.away[:, rows.columns]
            radial = along.reshape(m, -1)
            if (Q := ring_space(found.away, item.kind)) is not None:
                # Those of the form's direction whose variance is known worst.
                squares, nu = rows.variances(prediction, Q.T @ radial)
                worst = float(nu[np.argmax(squares**2 / nu)])
            K, known = (
                rows.covariance(prediction, radial),
                bool(np.isfinite(found.figures["reference"])),
            )
            named = (item.kind, item.id, task.operation, known)
            rings.append(Ring(*named, found.residuals, found.away, K, worst))
        variance, dof = rows.variances(prediction, A.reshape(len(measured), -1))
        for (task, found), v, nu in zip(measured, variance.tolist(), dof.tolist(), strict=True):
            size = Size(
                kind=task.wanted.kind,
                id=task.wanted.id,
                part=task.part,
                operation=task.operation,
                U_reference=task.wanted.U_reference,
                u=sqrt(max(v, 0.0)),
                dof=nu,
                sensitivity=float((found.gradient**2).sum()),
                **found.figures,
            )
            groups.setdefault((task.order, task.operation, task.part), []).append(size)
    if problems:
        raise InputError(problems)
    return [mean_size(groups[key]) for key in sorted(groups, key=lambda key: key[0])], rings


def _round(task: Task, measured: FloatArray, corrected: FloatArray, _: FloatArray) -> Measure:
    """A circle, in the plane of x and y where z is not known, or a sphere."""
    before, after = measured[task.rows], corrected[task.rows]
    flat, sphere = np.isnan(before[:, 2]).any(), task.wanted.kind == "sphere"
    if sphere and flat:
        raise GeometryError("its points have no z_mm")
    fit, d = fit_sphere if sphere else fit_circle, 2 if flat else 3
    first, last = fit(before[:, :d]), fit(after[:, :d])
    gradient, away = np.zeros((2, len(after), 3))
    gradient[:, :d], away[:, :d] = 2 * last.radius_gradient, last.away
    T = float(task.wanted.temperature[task.rows].mean())
    figures = {
        "size": (2 * first.radius, 2 * last.radius),
        "form": (first.form, last.form),
        "temperature": T,
        "reference": task.wanted.reference(T),
    }
    return Measure(figures, gradient, last.residuals, away)


def _length(
    task: Task, measured: FloatArray, corrected: FloatArray, nominal: FloatArray
) -> Measure:
    """End minus start; along z nothing is off where only the nominal z is known."""
    drawn = nominal[task.rows]
    ends = [drawn, measured[task.rows], corrected[task.rows]]
    ends = [np.where(np.isnan(each), drawn, each) for each in ends]
    for each in ends:
        # A z that only one end has counts for neither.
        each[:, 2] = 0.0 if np.isnan(each[:, 2]).any() else each[:, 2]
    deltas = [each[1] - each[0] for each in ends]
    reference, before, after = (float(np.linalg.norm(delta)) for delta in deltas)
    if after == 0:
        raise GeometryError("its ends stand at the same place")
    unit = deltas[2] / after
    gradient = np.where(np.isfinite(measured[task.rows]), [-unit, unit], 0.0)
    return Measure({"size": (before, after), "reference": reference}, gradient)
