"""How far from a right angle will a row and a column of features be?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.part import Orthogonality as RightAngle
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.features import NO_U, dof_warnings, feature_points, prediction_warnings
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.measurands import AngleTrials, Conformance, check_square, conformance_of
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings, convergence_warnings, validation_warnings
from mtu_cli.model.variance import Shares
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.monte_carlo import MonteCarloResult, Validation
from mtu_cli.stats.threads import one_blas_thread
from mtu_cli.units import ARCSEC

DRAWN = 2**18
"""Trials kept for the histogram."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orthogonality:
    """One angle less 90 degrees, in rad, from the row's +x to the column's +y.

    `run` holds the Monte Carlo (mean, u, interval, samples; u is nan where the trials'
    distribution has none), `model` with its first order, of `interval95` mean -+ t u, and
    `independent` the same trials under the papers' independence; `k` the coverage factor. `scale`
    is the u that figures are rounded to: that of first order where the trials have none. `shares`
    split the variance of first order; None under that independence and where there is no variance.
    `conformance` is of first order too; None without a tolerance. `outside`: whether a feature is
    beyond the measured range of a component.
    """

    id: str
    row: tuple[str, ...]
    column: tuple[str, ...]
    prediction: Prediction
    run: MonteCarloResult
    scale: float
    model: AngleTrials
    interval95: tuple[float, float]
    independent: MonteCarloResult
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

    A feature in both lines is one physical feature: it is drawn once. A count that adapts does so
    for the independent figures by itself.

    Raises InputError for a missing covariate or coordinate.
    """
    entries = part.part.orthogonality
    for axis in ("x", "y"):
        if axis not in model.axes:
            reason = f"the machine {model.name!r} has no equation E{axis}"
            expected = "Ex and Ey: an angle in the plane needs both"
            raise error("not-applicable", reason=reason, expected=expected)
    if not entries:
        reason = "the part has no orthogonality to predict"
        expected = "orthogonality: [{id: xy, row: [...], column: [...]}]"
        raise error("not-applicable", reason=reason, file=part.source.shown, expected=expected)
    check_square(part, range(len(entries)))
    angles: list[Orthogonality] = []
    warnings: list[Finding] = []
    for entry in entries:
        ids, points, notes = feature_points(part, model, [*entry.row, *entry.column])
        prediction = predict(model, ids, points, covariates)
        angles.append(_angle(entry, prediction, settings))
        warnings += [*notes, *prediction_warnings(model, prediction, covariates)]
        warnings += dof_warnings([entry.id], angles[-1].model.dof)
    names, validations = [x.id for x in angles], [x.validation for x in angles]
    if without_u := [x.id for x in angles if not np.isfinite(x.run.u[0])]:
        warnings.append(finding("few-degrees-of-freedom", names=without_u, how=NO_U))
    warnings += validation_warnings(names, validations, "arcsec", ARCSEC)
    warnings += [each for item in angles for each in convergence_warnings(item.run)]
    return OrthogonalityResult(angles=tuple(angles), warnings=tuple(dict.fromkeys(warnings)))


def _angle(entry: RightAngle, prediction: Prediction, settings: Settings) -> Orthogonality:
    def trials(*, independent: bool) -> tuple[AngleTrials, MonteCarloResult]:
        # Threads of linear algebra that wait for such small matrices take longer than the trials.
        with one_blas_thread():
            model = AngleTrials(
                prediction, entry.id, entry.row, entry.column, independent=independent
            )
        return model, settings.run(model, keep=DRAWN)

    first_order, independent = trials(independent=True)
    run = independent
    if not settings.independent:
        first_order, run = trials(independent=False)
    mean, dof = float(first_order.linear_mean[0]), float(first_order.dof[0])
    u, by_trials = float(first_order.linear_u[0, 0]), float(run.u[0])
    half = coverage_factor(PROBABILITY, dof) * u
    return Orthogonality(
        id=entry.id,
        row=tuple(entry.row),
        column=tuple(entry.column),
        prediction=prediction,
        run=run,
        scale=by_trials if np.isfinite(by_trials) else u,
        model=first_order,
        interval95=(mean - half, mean + half),
        independent=independent,
        validation=settings.validate(mean, u, dof, run, 0),
        shares=None if first_order.variance is None else first_order.variance.shares(0),
        conformance=conformance_of(entry.tolerance, ARCSEC, mean, u, dof),
        outside=bool(prediction.outside),
        k=settings.coverage_factor,
    )
