"""How far from a right angle will a row and a column of features be?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.model.features import dof_warnings, feature_points, outside_warnings
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import PROBABILITY, Settings, Warned
from mtu_cli.model.trials import Measure, PointTrials
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation
from mtu_cli.stats.workspace import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class Orthogonality:
    """One angle, in rad: positive where the corner opens beyond 90 degrees.

    `run` holds the Monte Carlo (mean, u, interval, samples), `first_order` (mean, u, dof),
    `independent` the same trials under the papers' independence, (mean, u).
    """

    id: str
    row: tuple[str, ...]
    column: tuple[str, ...]
    prediction: Prediction
    run: MonteCarloResult
    first_order: tuple[float, float, float]
    independent: MonteCarloResult
    independent_first_order: tuple[float, float]
    validation: Validation


@dataclass(frozen=True, slots=True, kw_only=True)
class OrthogonalityResult:
    """All angles of a part."""

    angles: tuple[Orthogonality, ...]
    warnings: tuple[Warned, ...]


def predict_orthogonality(
    model: MachineModel,
    part: LoadedPart,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> OrthogonalityResult:
    """Predicts every row-to-column angle of the part: Gilsinn & Ling 2004, eqs. (23)-(28).

    A feature in both lines is one physical feature: it is drawn once. The trials are those
    of `settings`; the independent figures use the same count.

    Raises InputError for a missing covariate or coordinate.
    """
    angles: list[Orthogonality] = []
    warnings: list[Warned] = []
    for entry in part.part.orthogonality:
        ids, points, noted = feature_points(part, model, [*entry.row, *entry.column])
        prediction = predict(model, ids, points, covariates)
        angles.append(_angle(entry.id, entry.row, entry.column, prediction, settings))
        warnings += [*noted, *outside_warnings(prediction)]
        warnings += dof_warnings([entry.id], np.array([angles[-1].first_order[2]]))
    return OrthogonalityResult(angles=tuple(angles), warnings=tuple(dict.fromkeys(warnings)))


def _angle(
    name: str,
    row: Sequence[str],
    column: Sequence[str],
    prediction: Prediction,
    settings: Settings,
) -> Orthogonality:
    rows = np.array([prediction.ids.index(i) for i in row])
    columns = np.array([prediction.ids.index(i) for i in column])
    measure = angle_measure(prediction, rows, columns)
    mean = measure(prediction.mean[:, None], Workspace())[:, 0]
    gradient = angle_gradient(prediction, rows, columns)[None, :]
    variance = prediction.variance(gradient)
    u, dof = float(np.sqrt(variance.total[0])), float(variance.dof[0])
    u_independent = float(np.sqrt(gradient[0] ** 2 @ prediction.independent_variance))

    def run(independent: bool) -> MonteCarloResult:
        model = PointTrials(prediction, (name,), measure, mean, gradient, independent=independent)
        return settings.run(model)

    apart = run(True)
    main = apart if settings.independent else run(False)
    if settings.independent:
        u, dof = u_independent, np.inf
    return Orthogonality(
        id=name,
        row=tuple(row),
        column=tuple(column),
        prediction=prediction,
        run=main,
        first_order=(float(mean[0]), u, dof),
        independent=apart,
        independent_first_order=(float(mean[0]), u_independent),
        validation=settings.validate(float(mean[0]), u, dof, main, 0),
    )


def first_order_interval(angle: Orthogonality) -> tuple[float, float]:
    """mean -+ t u at the effective degrees of freedom."""
    mean, u, dof = angle.first_order
    k = coverage_factor(PROBABILITY, dof)
    return mean - k * u, mean + k * u


def angle_measure(prediction: Prediction, row: FloatArray, column: FloatArray) -> Measure:
    """dtheta = -b1(column) - b1(row), eqs. (24)-(26), of the nominal points plus errors."""
    a = len(prediction.axes)
    ix, iy = prediction.axes.index("x"), prediction.axes.index("y")

    def slope(
        errors: FloatArray, which: FloatArray, along: int, across: int, work: Workspace
    ) -> FloatArray:
        nominal = prediction.points[which]
        shape = (len(which), errors.shape[1])
        u = work.array("along", shape)
        v = work.array("across", shape)
        np.take(errors, which * a + (ix, iy)[along], axis=0, out=u)
        np.take(errors, which * a + (ix, iy)[across], axis=0, out=v)
        u += (nominal[:, along] - nominal[:, along].mean())[:, None]
        v += (nominal[:, across] - nominal[:, across].mean())[:, None]
        u -= u.mean(axis=0)
        # Sum (u - mean) v equals the centred product: v need not be centred too.
        top = np.einsum("pm,pm->m", u, v)
        return top / np.einsum("pm,pm->m", u, u)

    def measure(errors: FloatArray, work: Workspace) -> FloatArray:
        angle = -slope(errors, column, 1, 0, work)
        angle -= slope(errors, row, 0, 1, work)
        return angle[None, :]

    return measure


def angle_gradient(prediction: Prediction, row: FloatArray, column: FloatArray) -> FloatArray:
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
