"""Modelled errors of measured points, a few at a time, with the history that lags need; diameters
and lengths of the part file, in each part before and after the correction; and the scatter of
measured points beyond the machine's model.

Corrected coordinates scatter by the probing, too. Its variance s^2 is the unexplained one of

- repeats of one feature of one part about their mean: errors of the manufacture are in all of
  them. Where the machine itself repeated the measurement, its repeatability counts twice, and so
  does the noise of temperature readings: an upper bound;
- form: residuals of circles and spheres, less the shape that the model's covariance gives a ring;
  the rest holds the form error of the ring itself.

With squares S_j of k_j degrees of freedom and modelled variances m_j, E S_j = k_j (m_j + s^2),
the likelihood of normal errors is largest at

    s^2 = sum w_j (S_j - k_j m_j) / sum w_j k_j,    w_j = (m_j + s^2)^-2,

whose variance is 2/sum w_j k_j (Searle, Casella & McCulloch 1992, section 6.2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, inf, isfinite, nan, sqrt
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import fdtrc

from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.readings import Points
from mtu_cli.findings import Finding, InputError, counted, error, finding, nearest
from mtu_cli.model.covariates import numbers_of, point_columns, rows_of
from mtu_cli.model.geometry import DIMENSIONS, GeometryError, fit_circle, fit_round
from mtu_cli.model.machine_model import AXES, TIME, MachineModel
from mtu_cli.model.measured import roundings
from mtu_cli.model.prediction import Outside, Prediction, predict
from mtu_cli.model.visits import only_features, operations_of, visits_of
from mtu_cli.stats.coverage import ENDLESS, t_interval, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.resolution import hidden
from mtu_cli.units import UM

PIECE = 64
"""Points whose variances are predicted at once."""
REACH = 12.0
"""Time constants after which a temperature is forgotten: exp(-12) is 6e-6."""
MOMENTS = 512
"""Earlier moments that a lag is given at most."""
SLACK = 0.005
"""Share of a measured range by which points, which carry the errors, may leave it."""
SLACK_DEGC = 1e-9
Kind = Literal["circle", "sphere", "length"]
Sides = tuple[float, float]
"""(before, after) the correction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowErrors:
    """The machine at the measured points: `places` (n, 3) mm, covariates by name.

    `outside` gathers what lies beyond the measured ranges, once a feature and component.
    """

    model: MachineModel
    points: Points
    places: FloatArray
    covariates: Mapping[str, FloatArray | float]
    independent: bool
    outside: Outside = field(default_factory=dict)

    @property
    def columns(self) -> list[int]:
        """The axes (0, 1, 2) of the model's equations."""
        return [AXES.index(axis) for axis in self.model.axes]

    def predicted(self, rows: IntArray) -> Prediction:
        """The prediction at `rows` (m,), under the earlier temperatures where a drift lags."""
        every = np.concatenate([rows, self._history(rows)])
        names = [self.points.features[code] for code in self.points.feature[every]]
        places = self.places[every]
        # Of other moments only the temperatures matter.
        places[len(rows) :] = places[0]
        prediction = predict(self.model, names, places, rows_of(self.covariates, every))
        prediction = prediction.first(len(rows))
        for key, points in prediction.outside.items():
            _, low, high = key
            for name, position in points.items():
                if max(low - position, position - high) > SLACK * (high - low):
                    self.outside.setdefault(key, {}).setdefault(name, position)
        return prediction

    def _history(self, rows: IntArray) -> IntArray:
        """Rows (m,) of earlier and intermediate moments, one a moment, thinned evenly."""
        longest = max((d.time_constants.max() for d in self.model.drifts()), default=0.0)
        times = np.asarray(self.covariates.get(TIME, 0.0))
        if longest == 0 or times.ndim == 0:
            return np.zeros(0, np.int64)
        now = times[rows]
        near = (times >= now.min() - REACH * longest) & (times <= now.max())
        result = np.flatnonzero(near & ~np.isin(times, now))
        result = result[np.unique(times[result], return_index=True)[1]]
        if len(result) > MOMENTS:
            result = result[np.linspace(0, len(result) - 1, MOMENTS).round().astype(int)]
        return result

    def variances(self, prediction: Prediction, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variances (m,) of the measurands A E and their effective degrees of freedom (m,)."""
        if self.independent:
            return A**2 @ prediction.independent_variance, np.full(len(A), np.inf)
        result = prediction.variance(A)
        # A difference of mean squares may be a little below 0.
        return np.maximum(result.total, 0.0), result.dof

    def covariance(self, prediction: Prediction, A: FloatArray) -> FloatArray:
        """Covariance (m, m) of the measurands A E, mm^2."""
        if self.independent:
            return np.diag(A**2 @ prediction.independent_variance)
        return np.asarray(A @ prediction.covariance @ A.T)

    def errors(self) -> tuple[FloatArray, FloatArray]:
        """Error and standard uncertainty (n, 3), mm: nan along axes that have no equation or were
        not measured.
        """
        n, a = len(self.points), len(self.model.axes)
        error, u = np.full((2, n, 3), np.nan)
        for start in range(0, n, PIECE):
            rows = np.arange(start, min(start + PIECE, n))
            prediction, place = self.predicted(rows), np.ix_(rows, np.array(self.columns))
            variance, _ = self.variances(prediction, np.eye(len(rows) * a))
            error[place] = prediction.mean.reshape(-1, a)
            u[place] = np.sqrt(variance).reshape(-1, a)
        missing = np.isnan(self.points.measured)
        return np.where(missing, np.nan, error), np.where(missing, np.nan, u)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurand:
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
        gaps = {max(low - T, T - high): T for T in temperatures if np.isfinite(T)}
        if not self.ranged or max(gaps, default=0.0) <= SLACK_DEGC:
            return []
        facts = {"what": f"{gaps[max(gaps)]:.4g} degC", "low": low, "high": high, "unit": "degC"}
        names = [f"the calibration of {self.name}"]
        return [finding("outside-measured-range", names=names, **facts)]


def measurands_of(
    part: LoadedPart, points: Points, at: Mapping[str, float]
) -> tuple[list[Measurand], list[Finding]]:
    """The sizes of the part file of which at least one feature was measured.

    Raises InputError for a temperature that a calibration needs and is not known everywhere.
    """
    measurands, absent, columns = list[Measurand](), list[str](), point_columns(points)
    rounds: dict[Kind, Sequence[Circle | Sphere]] = {
        "circle": part.part.circles,
        "sphere": part.part.spheres,
    }
    for kind, items in rounds.items():
        for index, item in enumerate(items):
            if set(item.features).isdisjoint(points.features):
                absent.append(f"{kind} {item.id!r}")
                continue
            name = item.temperature or ""
            temperature = np.full(len(points), at.get(name, nan))
            if name in columns:
                codes = [i for i, feature in enumerate(points.features) if feature in item.features]
                problems, of = list[Finding](), np.flatnonzero(np.isin(points.feature, codes))
                temperature = numbers_of(points, name, columns[name], problems, of)
                if problems:
                    raise InputError(problems)
            elif name and name not in at and item.calibrated_mm:
                near = " or ".join(map(repr, nearest(name, [*columns, *at])))
                near = f" (there is {near})" if near else ""
                raise error(
                    "unknown-name",
                    what="temperature",
                    expected=f"a column of this name{near}, or --at {name}=VALUE",
                    value=name,
                    **part.place(f"{kind}s", index, "temperature"),
                )
            measurand = Measurand(
                kind=kind,
                id=item.id,
                features=tuple(item.features),
                U_reference=nan if item.U_um is None else item.U_um * UM,
                calibrated=np.array(sorted((item.calibrated_mm or {}).items())).reshape(-1, 2),
                temperature=temperature,
                ranged=isinstance(part.document.at(f"{kind}s", index, "calibrated_mm"), dict),
            )
            measurands.append(measurand)
    for length in part.part.lengths:
        ends = (length.from_, length.to)
        if set(ends).isdisjoint(points.features):
            absent.append(f"length {length.id!r}")
        else:
            measurands.append(Measurand(kind="length", id=length.id, features=ends))
    reason = "none of its features was measured"
    return measurands, [finding("not-measured", names=absent, reason=reason)] if absent else []


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A diameter or length of one part before and after the correction; mm.

    `reference` is the calibrated diameter or nominal length (nan: none) with expanded
    uncertainty `U_reference` (k = 2, nan: not given), `form` the range of the radial residuals
    (nan for lengths). `u`, `dof` are those of the corrected size, `U` = k u (JCGM 100, eq. (18)),
    `interval95` its interval. Of a part that was measured `n_repeats` times all are means, of which
    `s_repeats` (after, nan for one) is the scatter.

    `error` is measured minus reference, before and after, nan without one; `u_error` that of the
    error after, the correction's and the calibration's, with `error_interval95`;
    `reduction_percent` 100 (1 - |after|/|before|) (Valdes et al., Tables 1 and 2).
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
    U: float
    interval95: Sides
    temperature: float
    form: Sides
    n_repeats: int
    s_repeats: float
    error: Sides
    u_error: float
    error_interval95: Sides
    reduction_percent: float


class Measure(NamedTuple):
    """A size in one visit, mm: before and after with the `form` of each, its reference and
    temperature, its `gradient` (m, 3) in the corrected points, and its u and dof by the machine
    alone. Of circles and spheres `residuals` (m,) after, unit vectors `normals` (m, 3) from the
    centre, in the plane of a circle, and the modelled covariance `K` (m, m) of the points along
    them, mm^2, with degrees of freedom `K_dof`.
    """

    size: Sides
    reference: float
    gradient: FloatArray
    form: Sides = (nan, nan)
    temperature: float = nan
    residuals: FloatArray = np.zeros(0)
    normals: FloatArray = np.zeros((0, 3))
    u: float = nan
    dof: float = inf
    K: FloatArray = np.zeros((0, 0))
    K_dof: float = inf


Visits = dict[tuple[int, str, str], list[Measure]]
"""Of every size, by its number in the part file, operation and part: its visits."""
Ring = tuple[tuple[Kind, str, str], Measure]
"""A circle or sphere in one visit, and what it is of: kind, id, operation."""


def measured_sizes(
    measurands: Sequence[Measurand], rows: RowErrors, corrected: FloatArray
) -> tuple[Visits, list[Ring], list[Finding]]:
    """The sizes in every visit that measured all their features, their circles and spheres, and
    what was measured in part.

    Raises InputError for a feature that stands twice in one repeat of one part, and for points that
    do not determine a size, with their row.
    """
    points, result, rings = rows.points, Visits(), list[Ring]()
    subset = only_features(points, [name for item in measurands for name in item.features])
    if not len(subset):
        return result, rings, []
    visits, (operations, _) = visits_of(subset), operations_of(subset)
    # The last column stands for features that nobody measured.
    row = np.full((len(visits.part), len(subset.features) + 1), -1)
    codes = [points.features.index(name) for name in subset.features]
    row[visits.of_point, subset.feature] = np.flatnonzero(np.isin(points.feature, codes))
    columns = {name: i for i, name in enumerate(subset.features)}
    places = [[columns.get(name, -1) for name in item.features] for item in measurands]
    partial, problems = dict[str, list[str]](), list[Finding]()
    for visit, (code, which) in enumerate(zip(visits.part, visits.operation, strict=True)):
        part, operation = subset.parts[code], operations[which]
        entries: list[tuple[int, IntArray, Measure]] = []
        for order, item in enumerate(measurands):
            indices = row[visit, places[order]]
            if (indices < 0).all():
                continue
            if (indices < 0).any():
                partial.setdefault(item.name, []).append(part)
                continue
            try:
                measure = _length if item.kind == "length" else _round
                entries.append((order, indices, measure(item, indices, points, corrected)))
            except GeometryError as fault:
                of = f"the points of {item.id!r}, part {part!r}: {fault}"
                around = "points of its features all around it"
                problem = finding(
                    "too-little-data",
                    what=f"no {item.kind} goes through {of}",
                    expected="two ends apart" if item.kind == "length" else around,
                    **points.place(indices[0]),
                )
                problems.append(problem)
        if entries and not problems:
            measures = _by_machine(measurands, entries, rows)
            for (order, _, _), each in zip(entries, measures, strict=True):
                item = measurands[order]
                result.setdefault((order, operation, part), []).append(each)
                if item.kind != "length":
                    rings.append(((item.kind, item.id, operation), each))
    if problems:
        raise InputError(problems)
    notes = []
    for name, parts in partial.items():
        # Repeats are not counted as parts.
        count = counted(len(set(parts)), "part")
        reason = f"not all its features were measured on {count} ({parts[0]!r})"
        notes.append(finding("not-measured", names=[name], reason=reason))
    return result, rings, notes


def _by_machine(
    measurands: Sequence[Measurand],
    entries: Sequence[tuple[int, IntArray, Measure]],
    rows: RowErrors,
) -> Iterator[Measure]:
    """The sizes `entries` of one visit, each with its number and rows, with u: the variance of
    gradient' E over all points of the visit; circles and spheres with K.
    """
    union = np.unique(np.concatenate([indices for _, indices, _ in entries]))
    prediction = rows.predicted(union)

    def matrix(indices: IntArray, vectors: FloatArray) -> FloatArray:
        """A of the `vectors` (k, m, 3) in the points `indices` (m,)."""
        A = np.zeros((len(vectors), len(union), len(rows.columns)))
        A[:, np.searchsorted(union, indices)] = vectors[:, :, rows.columns]
        return A.reshape(len(vectors), -1)

    A = np.concatenate([matrix(indices, each.gradient[None]) for _, indices, each in entries])
    variance, dof = rows.variances(prediction, A)
    us, dofs = np.sqrt(np.maximum(variance, 0.0)).tolist(), dof.tolist()
    for (order, indices, each), u, nu in zip(entries, us, dofs, strict=True):
        kind, K, worst = measurands[order].kind, each.K, inf
        if kind != "length":
            radial = matrix(indices, np.eye(len(indices))[:, :, None] * each.normals)
            K = rows.covariance(prediction, radial)
            if (Q := ring_space(each.normals, kind)).size:
                # Those of the form's direction whose variance is known worst.
                squares, of_form = rows.variances(prediction, Q.T @ radial)
                worst = float(of_form[np.argmax(squares**2 / of_form)])
        yield each._replace(u=u, dof=nu, K=K, K_dof=worst)


def _round(item: Measurand, rows: IntArray, points: Points, corrected: FloatArray) -> Measure:
    """A circle, in the plane of x and y where z is not known, or a sphere."""
    before, after = points.measured[rows], corrected[rows]
    flat, sphere = np.isnan(before[:, 2]).any(), item.kind == "sphere"
    if sphere and flat:
        raise GeometryError("its points have no z_mm")
    fit, d = fit_round if sphere else fit_circle, 2 if flat else 3
    first, last = fit(before[:, :d]), fit(after[:, :d])
    gradient, normals = np.zeros((2, len(after), 3))
    gradient[:, :d], normals[:, :d] = 2 * last.radius_gradient, last.away
    T = float(item.temperature[rows].mean())
    return Measure(
        size=(2 * first.radius, 2 * last.radius),
        reference=item.reference(T),
        gradient=gradient,
        form=(first.form, last.form),
        temperature=T,
        residuals=last.residuals,
        normals=normals,
    )


def _length(item: Measurand, rows: IntArray, points: Points, corrected: FloatArray) -> Measure:
    """End minus start; along z nothing is off where only the nominal z is known."""
    ideal, measured = points.nominal[rows], points.measured[rows]
    ends = [np.where(np.isnan(each), ideal, each) for each in (ideal, measured, corrected[rows])]
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
    measurands: Sequence[Measurand], visits: Visits, scatter: PointScatter | None, k: float
) -> Iterator[Size]:
    """The mean of every size over the repeats of each part, in the order of the part file, with
    the `scatter` of its points, which repeats that show it average out.

    Its uncertainty by the machine is the mean of theirs: what the machine did to a part is in every
    repeated measurement of it. Where the machine itself repeated the measurement this is an upper
    bound. The form of a ring is the same in every repeat.
    """
    for (order, operation, part), repeats in sorted(visits.items(), key=lambda item: item[0][0]):
        item, n = measurands[order], len(repeats)
        after = np.array([x.size[1] for x in repeats])
        mean = np.mean([[*x.size, *x.form, x.temperature, x.reference, x.u] for x in repeats], 0)
        before, last, form_before, form_after, temperature, reference, u = mean.tolist()
        sensitivity = float(np.mean([(x.gradient**2).sum() for x in repeats]))
        dof = min(x.dof for x in repeats)
        if scatter is not None:
            averaged = n if scatter.origin == "repeats" else 1
            u, dof = scatter.added(u, dof, sensitivity, averaged)
        error_before, error_after = before - reference, last - reference
        u_calibration = float(np.nan_to_num(item.U_reference)) / 2
        u_error = hypot(u, u_calibration)
        # Effective degrees of freedom: JCGM 100, eq. (G.2b).
        variances = np.array([u**2, u_calibration**2])
        dof_error = float(welch_satterthwaite(variances, np.array([dof, inf])))
        yield Size(
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
            form=(form_before, form_after),
            n_repeats=n,
            s_repeats=float(after.std(ddof=1)) if n > 1 else nan,
            U=k * u,
            interval95=t_interval(last, u, dof),
            error=(error_before, error_after),
            u_error=u_error,
            error_interval95=t_interval(error_after, u_error, dof_error),
            reduction_percent=100 * (1 - abs(error_after / error_before)) if error_before else nan,
        )


Origin = Literal["repeats", "form"]
FEWEST = 3
"""Degrees of freedom from which on repeats are preferred to the form."""
ITERATIONS = 200
NOTHING_MM = 1e-9
"""A scatter below a picometre is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointScatter:
    """Variance of a measured coordinate, mm^2, half the variance of that estimate (`spread`), and
    the degrees of freedom behind it; `rounding`, mm^2, is what the last digit hides of it.
    """

    variance: float
    spread: float
    dof: float
    origin: Origin
    rounding: float = 0.0

    @property
    def s(self) -> float:
        """The standard deviation, mm."""
        return sqrt(self.variance + self.rounding)

    def added(self, u: float, dof: float, sensitivity: float, repeats: int) -> tuple[float, float]:
        """u and effective dof (JCGM 100, eq. (G.2b), never fewer than the least of both) with
        `sensitivity` (s^2/`repeats` + rounding) added to u^2: the sum of the squared gradients in
        the coordinates.
        """
        share = sensitivity / repeats
        total = u**2 + share * self.variance + sensitivity * self.rounding
        if self.variance == 0:
            return sqrt(total), dof
        spread = u**4 / dof + share**2 * self.spread
        return sqrt(total), max(total**2 / spread, min(dof, self.dof))


class FormTest(NamedTuple):
    """The mean form of a ring over its `visits`: root mean square `rms` of its residuals, and
    `explained`, that of the model's uncertainty and the points' scatter, mm; F, p.
    """

    kind: Kind
    id: str
    operation: str
    calibrated: bool
    visits: int
    rms: float
    explained: float
    F: float
    p: float


def point_scatter(
    points: Points, corrected: FloatArray, rings: Sequence[Ring]
) -> PointScatter | None:
    """The scatter from repeats, where these have `FEWEST` degrees of freedom, else from `rings`:
    of each in the space that the fit leaves, one square a direction of K.
    """
    r = float(roundings(points).max())
    _, operation = operations_of(points)
    cell = (operation.astype(np.int64) * len(points.parts) + points.part) * len(points.features)
    code = np.unique(cell + points.feature, return_inverse=True)[1].reshape(-1)
    squares = []
    for values in corrected.T:
        finite = np.isfinite(values)
        group, value = code[finite], values[finite]
        count = np.bincount(group)
        deviation = value - (np.bincount(group, value) / np.maximum(count, 1))[group]
        squares.append([deviation @ deviation, len(value) - np.count_nonzero(count), 0.0])
    repeats = np.array(squares, np.float64).T
    if repeats[1].sum() >= FEWEST:
        return estimate(repeats, "repeats", r)
    of_form = [np.zeros((3, 0))]
    for (kind, *_), ring in rings:
        Q = ring_space(ring.normals, kind)
        modelled, vectors = np.linalg.eigh(Q.T @ ring.K @ Q)
        each: FloatArray = (vectors.T @ Q.T @ ring.residuals) ** 2
        of_form.append(np.array([each, np.ones(len(each)), np.clip(modelled, 0.0, None)]))
    form = np.concatenate(of_form, axis=1)
    return estimate(form, "form", r) if form.size else None


def ring_space(normals: FloatArray, kind: Kind) -> FloatArray:
    """Orthonormal (n, n - d - 1): the directions of n residuals that centre and radius of a circle
    (d = 2) or sphere (3) leave; `normals` (n, 3): see `Measure`.
    """
    # Vectors of a circle lie in its plane: two of the four columns and the ones have rank 3.
    U: FloatArray = np.linalg.svd(np.column_stack([normals, np.ones(len(normals))]))[0]
    return U[:, DIMENSIONS[kind] + 1 :]


def estimate(squares: FloatArray, origin: Origin, r: float) -> PointScatter:
    """s^2 of `squares` (3, j): sums of squares mm^2, their degrees of freedom and modelled
    variances; `r` is the variance of a coordinate by its last digit.
    """
    sums, dof, modelled = squares
    least, excess = NOTHING_MM**2, sums - dof * modelled
    variance = max(float(excess.sum() / dof.sum()), 0.0)
    for _ in range(ITERATIONS):
        weights = np.maximum(modelled + variance, least) ** -2
        last, variance = variance, max(float(weights @ excess / (weights @ dof)), 0.0)
        if abs(variance - last) <= 1e-10 * max(variance, least):
            break
    variance = variance if variance > least else 0.0
    return PointScatter(
        variance=variance,
        spread=1.0 / float(np.maximum(modelled + variance, least) ** -2 @ dof),
        dof=float(dof.sum()),
        origin=origin,
        rounding=float(hidden(variance, r)) if r > least else 0.0,
    )


def form_tests(rings: Sequence[Ring], scatter: PointScatter | None, r: float) -> Iterator[FormTest]:
    """The mean form of every ring against what the model and the scatter of points explain.

    F = |e|^2 / tr V of the mean residuals e (k,) of n visits, V = K + s^2/n, with what the last
    digit hides of s in all of them alike (`r` is the variance of a coordinate by it). What the
    machine did is taken to be in all visits, so that K is that of one. Both mean squares have the
    degrees of freedom of a sum of unequal variances (Box 1954; Welch-Satterthwaite). s is the
    scatter of the repeats or else of the visits about their mean, so that the form itself takes no
    part in it; a ring of one visit without either is not tested.
    """
    for of in dict.fromkeys(of for of, _ in rings):
        visits = [ring for key, ring in rings if key == of]
        Q = ring_space(np.mean([ring.normals for ring in visits], axis=0), of[0])
        n, k = len(visits), Q.shape[1]
        e = np.array([ring.residuals for ring in visits]) @ Q
        mean = e.mean(axis=0)
        if scatter is not None and scatter.origin == "repeats":
            s2, dof = scatter.variance, scatter.dof
        else:
            dof = (n - 1.0) * k
            s2 = float(((e - mean) ** 2).sum()) / max(dof, 1.0)
        if not k * dof:
            continue
        noise = max(s2 / n + float(hidden(s2, r)), NOTHING_MM**2)
        V = Q.T @ np.mean([ring.K for ring in visits], axis=0) @ Q + noise * np.eye(k)
        total = float(np.trace(V))
        df1 = total**2 / float((V**2).sum())
        parts = np.maximum([total - k * noise, k * noise], 0.0)
        dofs = np.array([min(ring.K_dof for ring in visits), dof])
        df2 = float(welch_satterthwaite(parts, dofs))
        F = float(mean @ mean) / total
        p = float(fdtrc(df1, min(max(df2, 1.0), ENDLESS), F))
        sizes = float(np.sqrt(mean @ mean / k)), float(np.sqrt(total / k))
        calibrated = any(isfinite(ring.reference) for ring in visits)
        yield FormTest(*of, calibrated, n, *sizes, F, p)
