"""What a part will be like: errors of its features, lengths between them, and right angles, each
with its uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.part import Orthogonality as RightAngle
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.features import (
    NO_U,
    dof_warnings,
    feature_points,
    one_direction,
    prediction_warnings,
)
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measurands import (
    AngleTrials,
    Conformance,
    JointConformance,
    PointTrials,
    check_square,
    conformance_of,
    differences,
    joint_conformance,
    length_measure,
    position_conformance,
)
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings, convergence_warnings, validation_warnings
from mtu_cli.stats.composed_variance import Variance, covariance_of
from mtu_cli.stats.coverage import t_interval
from mtu_cli.stats.least_squares import FloatArray, quotient
from mtu_cli.stats.monte_carlo import MonteCarloResult, Validation
from mtu_cli.stats.threads import one_blas_thread
from mtu_cli.units import ARCSEC, UM

INDEFINITE = 1e-9
"""Of the largest eigenvalue: what is further below 0 is no rounding."""


@dataclass(frozen=True, kw_only=True)
class PointsResult:
    """Errors (rows,) at all features, rows being (feature, axis); mm and mm^2.

    `variance`, `dof` under the settings' correlation; `interval95` (rows, 2) with t; `split` is the
    variance with covariance by its nature; `independent` whether the papers'
    independence was asked for. `conformance` (features,) is None without a tolerance of position.
    """

    prediction: Prediction
    coverage_factor: float
    variance: FloatArray
    dof: FloatArray
    interval95: FloatArray
    split: Variance
    independent: bool
    conformance: tuple[Conformance | None, ...]
    warnings: tuple[Finding, ...]

    @property
    def conformances(self) -> dict[str, Conformance]:
        """Of the features that have a tolerance."""
        pairs = zip(self.prediction.ids, self.conformance, strict=True)
        return {name: item for name, item in pairs if item is not None}

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (rows, rows), which of many features is made only where it is asked for."""
        if self.independent:
            return np.diag(self.variance)
        return reportable(self.prediction, self.variance)

    @cached_property
    def own_covariances(self) -> FloatArray:
        """Covariance (features, axes, axes) of the errors of each feature alone, mm^2."""
        a = len(self.prediction.axes)
        variance = self.variance.reshape(-1, a)
        if self.independent:
            return np.asarray(variance[:, :, None] * np.eye(a))
        each = covariance_of(self.prediction.blocks, a, drawable=True, by_point=True)
        return rescaled(each, variance)


def reportable(prediction: Prediction, variance: FloatArray) -> FloatArray:
    """The covariance (rows, rows) with the variances (rows,), without negative eigenvalues, as
    reports show it: D that is estimated without bias may have a negative part; correlations are
    those without it. The prediction's covariance where it has both already.
    """
    covariance = prediction.covariance
    if np.allclose(np.diag(covariance), variance, rtol=1e-9, atol=0.0):
        values = np.linalg.eigvalsh(covariance)
        if values[0] >= -INDEFINITE * abs(values[-1]):
            return covariance
    return rescaled(prediction.drawable, variance)


def rescaled(covariance: FloatArray, variance: FloatArray) -> FloatArray:
    """The correlations of a covariance (..., rows, rows) with other variances (..., rows)."""
    ratio = np.sqrt(quotient(variance, np.einsum("...ii->...i", covariance), 0.0))
    return covariance * ratio[..., :, None] * ratio[..., None, :]


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
    return PointsResult(
        prediction=prediction,
        coverage_factor=settings.coverage_factor,
        variance=total,
        dof=dof,
        interval95=np.array([*map(t_interval, prediction.mean, np.sqrt(total), dof)]),
        split=split,
        independent=settings.independent,
        conformance=(None,) * len(ids),
        warnings=(*prediction_warnings(model, prediction, covariates), *dof_warnings(names, dof)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthsResult:
    """All m lengths of a part, from and to the features `ends`; arrays (m,) in mm and mm^2.

    `variance` with its `dof` follows the settings' correlation; `interval95` (m, 2) by t.
    `independent_variance` is that of the papers, `u_uncorrelated` leaves out the measured
    correlation between components; `u_bounds` (m, 2) are what u could be if the two largest
    contributors among components that do not share passes were correlated with -1 or +1 (`pair`
    names them, None where there are not two). `shares` split the variance; None under the papers'
    independence and where there is no variance. `outside`: whether an end is beyond the measured
    range of a component. `joint_conformance` is None where fewer than two have a tolerance.
    """

    ids: tuple[str, ...]
    ends: tuple[tuple[str, str], ...]
    nominal: FloatArray
    error: FloatArray
    variance: FloatArray
    dof: FloatArray
    interval95: FloatArray
    independent_variance: FloatArray
    u_uncorrelated: FloatArray
    u_bounds: FloatArray
    pair: tuple[tuple[str, str] | None, ...]
    shares: tuple[dict[str, float] | None, ...]
    conformance: tuple[Conformance | None, ...]
    validation: tuple[Validation, ...]
    outside: tuple[bool, ...]
    coverage_factor: float
    joint_conformance: JointConformance | None
    run: MonteCarloResult
    warnings: tuple[Finding, ...]

    @property
    def conformances(self) -> dict[str, Conformance]:
        """Of the lengths that have a tolerance."""
        pairs = zip(self.ids, self.conformance, strict=True)
        return {name: item for name, item in pairs if item is not None}


def predict_lengths(
    model: MachineModel,
    part: LoadedPart,
    settings: Settings,
    covariates: Mapping[str, float] | None = None,
) -> LengthsResult:
    """Predicts every length of the part: Gilsinn & Ling 2004, eqs. (20)-(22), with the
    covariance of the two ends.

    Raises InputError for a missing covariate or coordinate, or a part without lengths.
    """
    entries = part.part.lengths
    if not entries:
        reason, expected = "the part has no lengths to predict", "lengths: [{from: '3', to: '9'}]"
        raise error("not-applicable", reason=reason, file=part.source.shown, expected=expected)
    names, ends = tuple(x.id for x in entries), tuple((x.from_, x.to) for x in entries)
    features, points, notes = feature_points(part, model, [name for pair in ends for name in pair])
    prediction = predict(model, features, points, covariates)
    pairs = np.array([[features.index(name) for name in pair] for pair in ends])
    delta = differences(points, pairs, names, part.source.shown)
    measure, combine, gradient = length_measure(prediction, pairs, delta)
    split = prediction.variance(gradient)
    independent = gradient**2 @ prediction.independent_variance
    variance, dof = split.total, split.dof
    if settings.independent:
        variance, dof = independent, np.full(len(names), np.inf)
    u = np.sqrt(variance)
    owner = np.tile(np.arange(len(names)), len(prediction.axes))
    alone = settings.independent
    trials = PointTrials(
        prediction, names, measure, combine, owner, gradient, None if alone else split
    )
    run, errors = settings.run(trials), trials.linear_mean
    separate = predict(replace(model, joint=()), prediction.ids, prediction.points, covariates)
    uncorrelated = separate.variance(gradient).total
    bounds = [_bounds(prediction, by_block) for by_block in split.by_block.T]
    rows = list(zip(errors.tolist(), u.tolist(), dof.tolist(), strict=True))
    conformance = [
        conformance_of(x.tolerance, UM, *row) for x, row in zip(entries, rows, strict=True)
    ]
    validation = tuple(settings.validate(*row, run, i) for i, row in enumerate(rows))
    beyond = {name for points in prediction.outside.values() for name in points}
    missing = []
    for axis, mask in zip(AXES, np.abs(delta).T > 1e-9, strict=True):
        if axis not in model.axes and mask.any():
            first = names[int(np.argmax(mask))]
            consequence = f"lengths along {axis} ({first}, ...) have no predicted error there"
            missing.append(finding("axis-without-equation", axis=axis, consequence=consequence))
    return LengthsResult(
        ids=names,
        ends=ends,
        nominal=np.linalg.norm(delta, axis=1),
        error=errors,
        variance=variance,
        dof=dof,
        interval95=np.array([*map(t_interval, errors, u, dof)]),
        independent_variance=independent,
        u_uncorrelated=np.sqrt(np.where(uncorrelated >= 0, uncorrelated, np.nan)),
        u_bounds=np.array([ends for ends, _ in bounds]),
        pair=tuple(pair for _, pair in bounds),
        shares=tuple(None if alone else split.shares(i) for i in range(len(names))),
        conformance=tuple(conformance),
        validation=validation,
        outside=tuple(not beyond.isdisjoint(pair) for pair in ends),
        coverage_factor=settings.coverage_factor,
        joint_conformance=joint_conformance(trials, conformance, settings),
        run=run,
        warnings=(
            *part.warnings,
            *one_direction(model, covariates or {}),
            *notes,
            *missing,
            *prediction_warnings(model, prediction, covariates),
            *dof_warnings(names, dof),
            *validation_warnings(names, validation, "um", UM),
            *convergence_warnings(run),
        ),
    )


def _bounds(
    prediction: Prediction, by_block: FloatArray
) -> tuple[tuple[float, float], tuple[str, str] | None]:
    """u if the two largest blocks were correlated with -1 or +1, and their names."""
    total, cross, pair = float(by_block.sum()), 0.0, None
    largest = np.argsort(-by_block, kind="stable")[:2]
    if len(largest) == 2 and by_block[largest[1]] > 0:
        cross = 2 * float(np.sqrt(by_block[largest].prod()))
        first, second = (" + ".join(prediction.blocks[b].names) for b in largest)
        pair = first, second
    return (float(np.sqrt(max(total - cross, 0.0))), float(np.sqrt(total + cross))), pair


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
    prediction: Prediction
    run: MonteCarloResult
    scale: float
    model: AngleTrials
    interval95: tuple[float, float]
    independent: MonteCarloResult
    validation: Validation
    shares: dict[str, float] | None
    conformance: Conformance | None
    outside: bool
    k: float


@dataclass(frozen=True, slots=True, kw_only=True)
class OrthogonalityResult:
    """All angles of a part."""

    angles: tuple[Orthogonality, ...]
    warnings: tuple[Finding, ...]

    @property
    def conformances(self) -> dict[str, Conformance]:
        """Of the angles that have a tolerance."""
        return {x.id: x.conformance for x in self.angles if x.conformance is not None}


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
    warnings = one_direction(model, covariates or {})
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
    return Orthogonality(
        id=entry.id,
        prediction=prediction,
        run=run,
        scale=by_trials if np.isfinite(by_trials) else u,
        model=first_order,
        interval95=t_interval(mean, u, dof),
        independent=independent,
        validation=settings.validate(mean, u, dof, run, 0),
        shares=None if first_order.variance is None else first_order.variance.shares(0),
        conformance=conformance_of(entry.tolerance, ARCSEC, mean, u, dof),
        outside=bool(prediction.outside),
        k=settings.coverage_factor,
    )
