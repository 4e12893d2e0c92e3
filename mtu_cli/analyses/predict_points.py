"""How far off will each feature be, and how sure is that?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import dof_warnings, feature_points, prediction_warnings
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.measurands import PositionConformance, position_conformance
from mtu_cli.model.prediction import Prediction, predict, reportable, rescaled
from mtu_cli.model.settings import Settings
from mtu_cli.model.variance import Variance
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class PointsResult:
    """Errors (rows,) at all features, rows being (feature, axis); mm and mm^2.

    `variance`, `dof` under the settings' correlation; `interval95` (rows, 2) with t; `split` is the
    variance with covariance by its nature; `independent` whether the papers'
    independence was asked for. `conformance` (features,) is None without a tolerance of position.
    """

    prediction: Prediction
    points: FloatArray
    coverage_factor: float
    variance: FloatArray
    dof: FloatArray
    interval95: FloatArray
    split: Variance
    independent: bool
    conformance: tuple[PositionConformance | None, ...]
    warnings: tuple[Finding, ...]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (rows, rows), which of many features is made only where it is asked for."""
        if self.independent:
            return np.diag(self.variance)
        return reportable(self.prediction, self.variance)

    @cached_property
    def own_covariances(self) -> FloatArray:
        """Covariance (features, axes, axes) of the errors of each feature alone, mm^2."""
        variance = self.variance.reshape(-1, len(self.prediction.axes))
        if self.independent:
            return np.asarray(variance[:, :, None] * np.eye(variance.shape[1]))
        return rescaled(self.prediction.assembled(drawable=True, by_point=True), variance)


def predict_points(
    model: MachineModel,
    part: LoadedPart,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> PointsResult:
    """Predicts every feature of the part: eq. (1) and (18) of Gilsinn & Ling 2004, with the
    covariance of shared coefficients and passes. Errors are linear in the components, and
    uncertain constants are taken to second order: there is nothing for a Monte Carlo to check.

    Raises InputError for a missing covariate or coordinate.
    """
    ids, points, warnings = feature_points(part, model)
    result = predict_places(model, ids, points, settings, covariates)
    zones = [part.part.features[name].position_um for name in ids]
    consequence = "positions have no predicted error along it"
    warnings += [
        finding("axis-without-equation", axis=axis, consequence=consequence)
        for axis in "xy"
        if axis not in model.axes and any(zones)
    ]
    return replace(
        result,
        conformance=position_conformance(result.prediction, zones, settings),
        warnings=(*warnings, *result.warnings),
    )


def predict_places(
    model: MachineModel,
    ids: Sequence[str],
    points: FloatArray,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> PointsResult:
    """The same at any places (n, 3) in mm, such as a grid over the machine's volume."""
    prediction = predict(model, ids, points, covariates)
    split = prediction.variance()
    total, dof = split.total, split.dof
    if settings.independent:
        total = prediction.independent_variance
        dof = np.full(len(total), np.inf)
    names = tuple(f"{i}.{axis}" for i in ids for axis in prediction.axes)
    u = np.sqrt(total)
    factor = np.array([coverage_factor(PROBABILITY, value) for value in dof])
    return PointsResult(
        prediction=prediction,
        points=points,
        coverage_factor=settings.coverage_factor,
        variance=total,
        dof=dof,
        interval95=np.column_stack([prediction.mean - factor * u, prediction.mean + factor * u]),
        split=split,
        independent=settings.independent,
        conformance=(None,) * len(ids),
        warnings=(
            *prediction_warnings(model, prediction, covariates),
            *dof_warnings(names, dof),
        ),
    )
