"""Diameters and lengths of the part file, in each part before and after the correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, inf, nan
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.correct.rows import RowErrors
from mtu_cli.analyses.correct.scatter import Kind, PointScatter, Ring, ring_space
from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, counted, error, finding, nearest
from mtu_cli.model.covariates import numbers_of, point_columns
from mtu_cli.model.geometry import GeometryError, fit_circle, fit_sphere
from mtu_cli.model.visits import IntArray, only_features, operations_of, visits_of
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

SLACK_DEGC = 1e-9
Sides = tuple[float, float]
"""(before, after) the correction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A size of the part file. Of circles and spheres `calibrated` (k, 2): diameters, mm, by
    ascending temperature, degC, with the expanded uncertainty `U_reference` (k = 2, nan: not
    given); `temperature` (n,) of every point, nan where it is not known; `ranged` whether the
    diameter was stated with a temperature.
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

    def warnings(self, temperatures: Sequence[float]) -> list[Finding]:
        """Of a circle or sphere without calibration, or measured at `temperatures` outside it."""
        if not len(self.calibrated):
            facts = {"quantity": "errors and their reduction", "reason": "no calibrated_mm"}
            return [finding("not-estimable", names=[self.name], **facts)]
        low, high = self.calibrated[[0, -1], 0].tolist()
        off = {max(low - T, T - high): T for T in temperatures if np.isfinite(T)}
        if not self.ranged or max(off, default=0.0) <= SLACK_DEGC:
            return []
        facts = {"what": f"{off[max(off)]:.4g} degC", "low": low, "high": high, "unit": "degC"}
        names = [f"the calibration of {self.name}"]
        return [finding("outside-measured-range", names=names, **facts)]


def wanted_of(
    part: LoadedPart, points: Points, at: Mapping[str, float]
) -> tuple[list[Wanted], list[Finding]]:
    """The sizes of the part file of which at least one feature was measured.

    Raises InputError for a temperature that a calibration needs and is not known everywhere.
    """
    wanted, absent = list[Wanted](), list[str]()
    rounds: dict[Kind, Sequence[Circle | Sphere]] = {
        "circle": part.part.circles,
        "sphere": part.part.spheres,
    }
    for kind, items in rounds.items():
        for index, item in enumerate(items):
            if set(item.features).isdisjoint(points.features):
                absent.append(f"{kind} {item.id!r}")
                continue
            own = Wanted(
                kind=kind,
                id=item.id,
                features=tuple(item.features),
                U_reference=nan if item.U_um is None else item.U_um * UM,
                calibrated=np.array(sorted((item.calibrated_mm or {}).items())).reshape(-1, 2),
                temperature=_temperature(part, (f"{kind}s", index), item, points, at),
                ranged=isinstance(part.document.at(f"{kind}s", index, "calibrated_mm"), dict),
            )
            wanted.append(own)
    for length in part.part.lengths:
        ends = (length.from_, length.to)
        if set(ends).isdisjoint(points.features):
            absent.append(f"length {length.id!r}")
        else:
            wanted.append(Wanted(kind="length", id=length.id, features=ends))
    reason = "none of its features was measured"
    return wanted, [finding("not-measured", names=absent, reason=reason)] if absent else []


def _temperature(
    part: LoadedPart,
    path: tuple[str, int],
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
) -> FloatArray:
    """That of every point (n,) by the covariate that the circle or sphere at `path` names."""
    columns, name = point_columns(points), item.temperature or ""
    if name in columns:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Finding] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        result = numbers_of(points, name, columns[name], problems, rows)
        if problems:
            raise InputError(problems)
        return result
    if name and name not in at and item.calibrated_mm:
        near = nearest(name, [*columns, *at])
        there = f" (there is {' or '.join(map(repr, near))})" if near else ""
        raise error(
            "unknown-name",
            what="temperature",
            file=part.source.shown,
            line=part.line_of(*path, "temperature"),
            path=f"{path[0]}[{path[1]}].temperature",
            value=name,
            expected=f"a column of this name{there}, or --at {name}=VALUE",
        )
    return np.full(len(points), at.get(name, nan))


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A diameter or length of one part before and after the correction; mm.

    `reference` is the calibrated diameter or nominal length (nan: none) with expanded
    uncertainty `U_reference` (k = 2, nan: not given), `form` the range of the radial residuals
    (nan for lengths). `u`, `dof` are those of the corrected size. Of a part that was measured
    `n_repeats` times all are means, of which `s_repeats` (after, nan for one) is the scatter; `k`
    is the coverage factor of `U`.
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
    temperature: float
    form: Sides
    n_repeats: int
    s_repeats: float
    k: float

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


class Measure(NamedTuple):
    """A size in one visit, mm: before and after with the `form` of each, its reference and
    temperature, its `gradient` (m, 3) in the corrected points, and its u and dof by the machine
    alone. Of circles and spheres `residuals` (m,) after and unit vectors `away` (m, 3) from the
    centre, in the plane of a circle.
    """

    size: Sides
    reference: float
    gradient: FloatArray
    form: Sides = (nan, nan)
    temperature: float = nan
    residuals: FloatArray = np.zeros(0)
    away: FloatArray = np.zeros((0, 3))
    u: float = nan
    dof: float = inf


Visits = dict[tuple[int, str, str], list[Measure]]
"""Of every size, by its number in the part file, operation and part: its visits."""


def measured_sizes(
    wanted: Sequence[Wanted], rows: RowErrors, corrected: FloatArray
) -> tuple[Visits, list[Ring], list[Finding]]:
    """The sizes in every visit that measured all their features, their circles and spheres, and
    what was measured in part.

    Raises InputError for a feature that stands twice in one repeat of one part, and for points that
    do not determine a size, with their row.
    """
    points, result, rings = rows.points, Visits(), list[Ring]()
    used = only_features(points, [name for item in wanted for name in item.features])
    if not len(used):
        return result, rings, []
    visits, (operations, _) = visits_of(used), operations_of(used)
    # The last column stands for features that nobody measured.
    row = np.full((len(visits.part), len(used.features) + 1), -1)
    codes = [points.features.index(name) for name in used.features]
    row[visits.of_point, used.feature] = np.flatnonzero(np.isin(points.feature, codes))
    columns = {name: i for i, name in enumerate(used.features)}
    places = [[columns.get(name, -1) for name in item.features] for item in wanted]
    partial, problems = dict[str, list[str]](), list[Finding]()
    for visit, (code, which) in enumerate(zip(visits.part, visits.operation, strict=True)):
        part, operation = used.parts[code], operations[which]
        found: list[tuple[int, IntArray, Measure]] = []
        for order, item in enumerate(wanted):
            own = row[visit, places[order]]
            if (own < 0).all():
                continue
            if (own < 0).any():
                partial.setdefault(item.name, []).append(part)
                continue
            try:
                measure = _length if item.kind == "length" else _round
                found.append((order, own, measure(item, own, points, corrected)))
            except GeometryError as fault:
                of = f"the points of {item.id!r}, part {part!r}: {fault}"
                around = "points of its features all around it"
                problem = finding(
                    "too-little-data",
                    what=f"no {item.kind} goes through {of}",
                    file=points.sources[points.file_index[own[0]]].shown,
                    row=int(points.row[own[0]]),
                    expected="two ends apart" if item.kind == "length" else around,
                )
                problems.append(problem)
        if found and not problems:
            measures, round_ = _by_machine(wanted, operation, found, rows)
            rings += round_
            for (order, _, _), each in zip(found, measures, strict=True):
                result.setdefault((order, operation, part), []).append(each)
    if problems:
        raise InputError(problems)
    warned = []
    for name, visited in partial.items():
        # Repeats are no parts of their own.
        count = counted(len(set(visited)), "part")
        reason = f"not all its features were measured on {count} ({visited[0]!r})"
        warned.append(finding("not-measured", names=[name], reason=reason))
    return result, rings, warned


def _by_machine(
    wanted: Sequence[Wanted],
    operation: str,
    found: Sequence[tuple[int, IntArray, Measure]],
    rows: RowErrors,
) -> tuple[list[Measure], list[Ring]]:
    """The sizes `found` in one visit, each with its number and rows, with u: the variance of
    gradient' E over all points of the visit; and its circles and spheres.
    """
    chosen = np.unique(np.concatenate([own for _, own, _ in found]))
    prediction = rows.predicted(chosen)

    def measurands(own: IntArray, vectors: FloatArray) -> FloatArray:
        """A of the `vectors` (k, m, 3) in the points `own` (m,)."""
        A = np.zeros((len(vectors), len(chosen), len(rows.columns)))
        A[:, np.searchsorted(chosen, own)] = vectors[:, :, rows.columns]
        return A.reshape(len(vectors), -1)

    A = np.concatenate([measurands(own, each.gradient[None]) for _, own, each in found])
    variance, dof = rows.variances(prediction, A)
    u = np.sqrt(np.maximum(variance, 0.0))
    sizes = [
        each._replace(u=s, dof=nu)
        for (_, _, each), s, nu in zip(found, u.tolist(), dof.tolist(), strict=True)
    ]
    rings = []
    for order, own, each in found:
        item = wanted[order]
        if item.kind == "length":
            continue
        radial = measurands(own, np.eye(len(own))[:, :, None] * each.away)
        Q, worst = ring_space(each.away, item.kind), inf
        if Q.size:
            # Those of the form's direction whose variance is known worst.
            squares, nu = rows.variances(prediction, Q.T @ radial)
            worst = float(nu[np.argmax(squares**2 / nu)])
        K, known = rows.covariance(prediction, radial), bool(np.isfinite(each.reference))
        of = item.kind, item.id, operation
        rings.append(Ring(of, known, each.residuals, each.away, K, worst))
    return sizes, rings


def _round(item: Wanted, rows: IntArray, points: Points, corrected: FloatArray) -> Measure:
    """A circle, in the plane of x and y where z is not known, or a sphere."""
    before, after = points.measured[rows], corrected[rows]
    flat, sphere = np.isnan(before[:, 2]).any(), item.kind == "sphere"
    if sphere and flat:
        raise GeometryError("its points have no z_mm")
    fit, d = fit_sphere if sphere else fit_circle, 2 if flat else 3
    first, last = fit(before[:, :d]), fit(after[:, :d])
    gradient, away = np.zeros((2, len(after), 3))
    gradient[:, :d], away[:, :d] = 2 * last.radius_gradient, last.away
    T = float(item.temperature[rows].mean())
    return Measure(
        size=(2 * first.radius, 2 * last.radius),
        reference=item.reference(T),
        gradient=gradient,
        form=(first.form, last.form),
        temperature=T,
        residuals=last.residuals,
        away=away,
    )


def _length(item: Wanted, rows: IntArray, points: Points, corrected: FloatArray) -> Measure:
    """End minus start; along z nothing is off where only the nominal z is known."""
    drawn, measured = points.nominal[rows], points.measured[rows]
    ends = [np.where(np.isnan(each), drawn, each) for each in (drawn, measured, corrected[rows])]
    for each in ends:
        # A z that only one end has counts for neither.
        each[:, 2] = 0.0 if np.isnan(each[:, 2]).any() else each[:, 2]
    deltas = [each[1] - each[0] for each in ends]
    reference, before, after = (float(np.linalg.norm(delta)) for delta in deltas)
    if after == 0:
        raise GeometryError("its ends stand at the same place")
    unit = deltas[2] / after
    gradient = np.where(np.isfinite(measured), [-unit, unit], 0.0)
    return Measure(size=(before, after), reference=reference, gradient=gradient)


def mean_sizes(
    wanted: Sequence[Wanted], visits: Visits, scatter: PointScatter | None, k: float
) -> list[Size]:
    """The mean of every size over the repeats of each part, in the order of the part file, with
    the `scatter` of its points, which repeats that show it average out.

    Its uncertainty by the machine is the mean of theirs: what the machine did to a part is in every
    repeated measurement of it. Where the machine itself repeated the measurement this is an upper
    bound. The form of a ring is the same in every repeat.
    """
    result = []
    for (order, operation, part), repeats in sorted(visits.items(), key=lambda item: item[0][0]):
        item, n = wanted[order], len(repeats)
        after = np.array([x.size[1] for x in repeats])
        mean = np.mean([[*x.size, *x.form, x.temperature, x.reference, x.u] for x in repeats], 0)
        before, last, was, left, temperature, reference, u = mean.tolist()
        sensitivity = float(np.mean([(x.gradient**2).sum() for x in repeats]))
        dof = min(x.dof for x in repeats)
        if scatter is not None:
            averaged = n if scatter.origin == "repeats" else 1
            u, dof = scatter.added(u, dof, sensitivity, averaged)
        size = Size(
            kind=item.kind,
            id=item.id,
            part=part,
            operation=operation,
            size=(before, last),
            reference=reference,
            U_reference=item.U_reference,
            u=u,
            dof=dof,
            temperature=temperature,
            form=(was, left),
            n_repeats=n,
            s_repeats=float(after.std(ddof=1)) if n > 1 else nan,
            k=k,
        )
        result.append(size)
    return result
