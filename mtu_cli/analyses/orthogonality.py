"""How far from a right angle will a row and a column of features be?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.part import Orthogonality as RightAngle
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.features import NO_U, dof_warnings, feature_points, outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measurands import AngleTrials, Line, angle_error, check_square, contrasts
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import (
    PROBABILITY,
    Settings,
    convergence_warnings,
    validation_warnings,
)
from mtu_cli.model.trials import Conformance, Measure, PointTrials, conformance_of
from mtu_cli.model.variance import Shares
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import IntArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.threads import one_blas_thread
from mtu_cli.stats.validation import Validation
from mtu_cli.stats.workspace import Workspace
from mtu_cli.units import ARCSEC

DRAWN = 2**18
"""Trials kept for the histogram."""


class FirstOrder(NamedTuple):
    """A mean and its standard uncertainty of first order, with effective degrees of freedom and
    mean -+ t u at these.
    """

    mean: float
    u: float
    dof: float
    interval95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Orthogonality:
    """One angle less 90 degrees, in rad, from the row's +x to the column's +y.

    `run` holds the Monte Carlo (mean, u, interval, samples; u is nan where the trials'
    distribution has none), `independent` the same trials under the papers' independence, with
    `independent_u` of first order; `k` the coverage factor. `u_of_next_trial` is of one more trial
    about the mean of all (Gilsinn & Ling 2004, eq. (28)), and `scale` the u that figures are
    rounded to: that of first order where the trials have none. `shares` split the variance of first
    order; None under that independence and where there is no variance. `conformance` is of first
    order too; None without a tolerance. `outside`: whether a feature is beyond the measured range
    of a component.
    """

    id: str
    row: tuple[str, ...]
    column: tuple[str, ...]
    prediction: Prediction
    run: MonteCarloResult
    u_of_next_trial: float
    scale: float
    first_order: FirstOrder
    independent: MonteCarloResult
    independent_u: float
    validation: Validation
    shares: Shares | None
    conformance: Conformance | None
    outside: bool
    k: float


@dataclass(frozen=True, slots=True, kw_only=True)
class OrthogonalityResult:
    """All angles of a part."""

    angles: tuple[Orthogonality, ...]
    warnings: tuple[Finding, ...]


def predict_orthogonality(
    model: MachineModel,
    part: LoadedPart,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> OrthogonalityResult:
    """Predicts every row-to-column angle of the part: Gilsinn & Ling 2004, eqs. (23)-(28).

    A feature in both lines is one physical feature: it is drawn once. The trials are those
    of `settings`; the independent figures use the same count where it is given: one that
    adapts does so for each by itself.

    Raises InputError for a missing covariate or coordinate.
    """
    for axis in ("x", "y"):
        if axis not in model.axes:
            raise error(
                "not-applicable",
                reason=f"the machine {model.name!r} has no equation E{axis}",
                expected="Ex and Ey: an angle in the plane needs both",
            )
    if not part.part.orthogonality:
        raise error(
            "not-applicable",
            reason="the part has no orthogonality to predict",
            file=part.source.shown,
            expected="orthogonality: [{id: xy, row: [...], column: [...]}]",
        )
    check_square(part, range(len(part.part.orthogonality)))
    angles: list[Orthogonality] = []
    warnings: list[Finding] = []
    for entry in part.part.orthogonality:
        ids, points, noted = feature_points(part, model, [*entry.row, *entry.column])
        prediction = predict(model, ids, points, covariates)
        angles.append(_angle(entry, prediction, settings))
        warnings += [*noted, *outside_warnings(prediction)]
        warnings += effect_warnings_at(model, points, covariates or {})
        warnings += dof_warnings([entry.id], np.array([angles[-1].first_order.dof]))
    names, validations = [x.id for x in angles], [x.validation for x in angles]
    if without_u := [x.id for x in angles if not np.isfinite(x.run.u[0])]:
        warnings.append(finding("few-degrees-of-freedom", names=without_u, how=NO_U))
    warnings += validation_warnings(names, validations, "arcsec", ARCSEC)
    warnings += [each for item in angles for each in convergence_warnings(item.run)]
    return OrthogonalityResult(angles=tuple(angles), warnings=tuple(dict.fromkeys(warnings)))


def _angle(entry: RightAngle, prediction: Prediction, settings: Settings) -> Orthogonality:
    name, row, column = entry.id, entry.row, entry.column
    papers = angle_trials(name, row, column, prediction, independent=True)
    chosen = angle_trials(name, row, column, prediction, independent=settings.independent)
    independent = settings.run(papers, keep=DRAWN)
    run = independent if settings.independent else settings.run(chosen, keep=DRAWN)
    mean, dof = float(chosen.linear_mean[0]), float(chosen.dof[0])
    u, by_trials = float(chosen.linear_u[0, 0]), float(run.u[0])
    half = coverage_factor(PROBABILITY, dof) * u
    gradient = angle_gradient(prediction, *_places(prediction, row, column))[None, :]
    return Orthogonality(
        id=name,
        row=tuple(row),
        column=tuple(column),
        prediction=prediction,
        run=run,
        u_of_next_trial=float(by_trials * np.sqrt(1.0 + 1.0 / run.trials)),
        scale=by_trials if np.isfinite(by_trials) else u,
        first_order=FirstOrder(mean, u, dof, (mean - half, mean + half)),
        independent=independent,
        independent_u=float(papers.linear_u[0, 0]),
        validation=settings.validate(mean, u, dof, run, 0),
        shares=None if settings.independent else prediction.variance(gradient).shares(0),
        conformance=conformance_of(entry.tolerance, ARCSEC, mean, u, dof),
        outside=bool(prediction.outside),
        k=settings.coverage_factor,
    )


def angle_trials(
    name: str,
    row: Sequence[str],
    column: Sequence[str],
    prediction: Prediction,
    *,
    independent: bool,
) -> AngleTrials:
    """The Monte Carlo model of one angle, with its first-order form."""
    # Threads of linear algebra that wait for such small matrices take longer than the trials.
    with one_blas_thread():
        plain = plain_angle_trials(name, row, column, prediction, independent=independent)
        return AngleTrials(plain, _by_design(prediction, *_places(prediction, row, column)))


def plain_angle_trials(
    name: str,
    row: Sequence[str],
    column: Sequence[str],
    prediction: Prediction,
    *,
    independent: bool,
) -> PointTrials:
    """The same with all errors drawn and the two lines laid through them: slow, for reference."""
    places = _places(prediction, row, column)
    measure, combine = angle_measure(prediction, *places)
    mean = measure((combine @ prediction.mean)[:, None], Workspace())[:, 0].copy()
    gradient = angle_gradient(prediction, *places)[None, :]
    return PointTrials(
        prediction,
        (name,),
        measure,
        combine,
        np.zeros(len(combine), np.int64),
        mean,
        gradient,
        np.full(1, np.inf) if independent else prediction.variance(gradient).dof,
        independent=independent,
    )


def _places(
    prediction: Prediction, row: Sequence[str], column: Sequence[str]
) -> tuple[IntArray, IntArray]:
    of_row, of_column = (np.array([prediction.ids.index(i) for i in ids]) for ids in (row, column))
    return of_row, of_column


def angle_measure(
    prediction: Prediction, row: IntArray, column: IntArray
) -> tuple[Measure, FloatArray]:
    """dtheta = -b1(column) - b1(row), eqs. (24)-(26), and the combinations it needs.

    A slope is sum (u - mean u)(v - mean v) / sum (u - mean u)^2, the same of n - 1 orthonormal
    contrasts of the coordinates as of the n coordinates less their mean.
    """
    along = [_select(prediction, row, "x"), _select(prediction, column, "y")]
    across = [_select(prediction, row, "y"), _select(prediction, column, "x")]
    combine = np.vstack(
        [contrasts(len(each)) @ each for pair in zip(along, across, strict=True) for each in pair]
    )
    lines = _by_design(prediction, row, column)
    nominal = np.concatenate(lines)
    n = len(row) - 1, len(column) - 1

    def measure(combined: FloatArray, work: Workspace) -> FloatArray:
        placed = np.add(combined, nominal, out=work.array("placed", combined.shape))
        return angle_error(_lines(placed, n), _lines(nominal, n))[None, :]

    return measure, combine


def _by_design(
    prediction: Prediction, row: IntArray, column: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Contrasts (features - 1, 1) of the coordinates along and across the row, then the column."""
    x, y = (prediction.points[:, [AXES.index(axis)]] for axis in ("x", "y"))
    H_r, H_c = contrasts(len(row)), contrasts(len(column))
    return H_r @ x[row], H_r @ y[row], H_c @ y[column], H_c @ x[column]


def _lines(coordinates: FloatArray, n: tuple[int, int]) -> tuple[Line, Line]:
    """Row and column out of contrasts (2 n_r + 2 n_c, m): along, then across, of each."""
    row, column = coordinates[: 2 * n[0]], coordinates[2 * n[0] :]
    return (row[: n[0]], row[n[0] :]), (column[: n[1]], column[n[1] :])


def _select(prediction: Prediction, which: IntArray, axis: str) -> FloatArray:
    """The matrix (features, rows) that picks the errors along an axis."""
    a = len(prediction.axes)
    picked = np.zeros((len(which), len(prediction.mean)))
    picked[np.arange(len(which)), which * a + prediction.axes.index(axis)] = 1.0
    return picked


def angle_gradient(prediction: Prediction, row: IntArray, column: IntArray) -> FloatArray:
    """d(dtheta)/dE (rows,) at the predicted points.

    For a slope b = S_uv / S_uu: db/dv = (u - mean u)/S_uu, db/du = ((v - mean v) - 2 b
    (u - mean u))/S_uu.
    """
    a = len(prediction.axes)
    ix, iy = prediction.axes.index("x"), prediction.axes.index("y")
    gradient = np.zeros(len(prediction.mean))
    errors = prediction.mean.reshape(-1, a)
    for which, along, across in ((row, 0, 1), (column, 1, 0)):
        places = (ix, iy)
        u = prediction.points[which, along] + errors[which, places[along]]
        v = prediction.points[which, across] + errors[which, places[across]]
        u, v = u - u.mean(), v - v.mean()
        b = float(u @ v / (u @ u))
        np.add.at(gradient, which * a + places[across], -u / (u @ u))
        np.add.at(gradient, which * a + places[along], -(v - 2 * b * u) / (u @ u))
    return gradient
