"""How far off will a feature-to-feature length be, and will it conform?"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mtu_cli.files.part import Length as LengthEntry
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.conformance import Conformance, conformance_of, joint_conformance
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.features import dof_warnings, feature_points, outside_warnings
from mtu_cli.model.length_geometry import differences, length_gradient, length_measure
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import (
    PROBABILITY,
    Settings,
    convergence_warnings,
    validation_warnings,
)
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.model.trials import Measure, PointTrials
from mtu_cli.model.variance import Shares, root
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation
from mtu_cli.stats.workspace import Workspace
from mtu_cli.units import UM

Bounds = tuple[tuple[float, float], tuple[str, str] | None]
"""u with a correlation of -1 and of +1, and the pair that is correlated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Length:
    """One length; mm and mm^2. `variance` follows the settings' correlation.

    `variance_uncorrelated` leaves out the measured correlation between components;
    `u_bounds` are what u could be if the two largest contributors among components that do
    not share passes were correlated with -1 or +1 (`pair` names them, None where there are
    not two). `shares` split the variance; None under the papers' independence and where there
    is no variance. `outside`: whether an end is beyond the measured range of a component.
    """

    id: str
    start: str
    end: str
    nominal: float
    error: float
    variance: float
    dof: float
    k: float
    interval95: tuple[float, float]
    independent_variance: float
    variance_uncorrelated: float
    u_bounds: tuple[float, float]
    pair: tuple[str, str] | None
    shares: Shares | None
    conformance: Conformance | None
    validation: Validation
    outside: bool

    @property
    def estimated(self) -> float:
        """The predicted length."""
        return self.nominal + self.error

    @property
    def u(self) -> float:
        """Standard uncertainty."""
        return float(np.sqrt(self.variance))

    @property
    def U(self) -> float:
        """Expanded uncertainty k u."""
        return self.k * self.u

    @property
    def interval(self) -> tuple[float, float]:
        """error -+ U."""
        return self.error - self.U, self.error + self.U

    @property
    def independent_u(self) -> float:
        """Standard uncertainty where ends and components are independent."""
        return root(self.independent_variance)

    @property
    def independent_U(self) -> float:
        """k times it."""
        return self.k * self.independent_u

    @property
    def u_uncorrelated(self) -> float:
        """Standard uncertainty without the measured correlation between components."""
        return root(self.variance_uncorrelated)


class JointConformance(NamedTuple):
    """Probability that all `lengths` with a tolerance of one part conform, and its standard
    error.
    """

    lengths: tuple[str, ...]
    probability: float
    se: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthsResult:
    """All lengths of a part; `joint_conformance` None where fewer than two have a tolerance."""

    prediction: Prediction
    lengths: tuple[Length, ...]
    joint_conformance: JointConformance | None
    run: MonteCarloResult
    warnings: tuple[Finding, ...]


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
    geometry, prediction, warnings = _predicted(model, part, covariates)
    alone = settings.independent
    variances = _variances(model, geometry, prediction, covariates, independent=alone)
    trials = _trials(geometry, prediction, variances.dof, independent=alone)
    run = settings.run(trials)
    lengths = tuple(
        _length(entry, i, geometry, variances, settings, run, prediction.beyond)
        for i, entry in enumerate(part.part.lengths)
    )
    joint = joint_conformance(trials, [length.conformance for length in lengths], settings)
    toleranced = tuple(length.id for length in lengths if length.conformance is not None)
    return LengthsResult(
        prediction=prediction,
        lengths=lengths,
        joint_conformance=None if joint is None else JointConformance(toleranced, *joint),
        run=run,
        warnings=(
            *warnings,
            *_planar_warnings(model, geometry.delta, geometry.names),
            *outside_warnings(prediction),
            *temperature_warnings(model, prediction.points, covariates or {}),
            *effect_warnings_at(model, prediction.points, covariates or {}),
            *dof_warnings(geometry.names, variances.dof),
            *validation_warnings(
                geometry.names, [length.validation for length in lengths], "um", UM
            ),
            *convergence_warnings(run),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Geometry:
    """The m lengths as functions of the predicted errors, in mm.

    `delta` (m, 3) end minus start, `errors` (m,) at the mean of the prediction, `gradient`
    (m, rows); `measure` of the combinations `combine` of errors, as `PointTrials` has them.
    """

    names: tuple[str, ...]
    delta: FloatArray
    errors: FloatArray
    gradient: FloatArray
    measure: Measure
    combine: FloatArray


def _predicted(
    model: MachineModel, part: LoadedPart, covariates: Mapping[str, float] | None
) -> tuple[_Geometry, Prediction, list[Finding]]:
    entries = part.part.lengths
    if not entries:
        raise error(
            "not-applicable",
            reason="the part has no lengths to predict",
            file=part.source.shown,
            expected="lengths: [{from: '3', to: '9'}]",
        )
    used = [name for entry in entries for name in (entry.from_, entry.to)]
    ids, points, warnings = feature_points(part, model, used)
    prediction = predict(model, ids, points, covariates)
    names = tuple(entry.id for entry in entries)
    pairs = np.array([[ids.index(entry.from_), ids.index(entry.to)] for entry in entries])
    delta = differences(points, pairs, names, part.source.shown)
    measure, combine = length_measure(prediction, pairs, delta)
    geometry = _Geometry(
        names=names,
        delta=delta,
        errors=measure((combine @ prediction.mean)[:, None], Workspace())[:, 0],
        gradient=length_gradient(prediction, pairs, delta),
        measure=measure,
        combine=combine,
    )
    return geometry, prediction, list(warnings)


def _trials(
    geometry: _Geometry, prediction: Prediction, dof: FloatArray, *, independent: bool
) -> PointTrials:
    names = geometry.names
    return PointTrials(
        prediction,
        names,
        geometry.measure,
        geometry.combine,
        np.tile(np.arange(len(names)), len(prediction.axes)),
        geometry.errors,
        geometry.gradient,
        dof,
        independent=independent,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Variances:
    """Variances (m,) of the lengths, mm^2, and what they could be; see `Length`.

    `total` with `dof` and `shares` follows the settings' correlation; `bounds` are (u's, their
    pair).
    """

    total: FloatArray
    dof: FloatArray
    independent: FloatArray
    uncorrelated: FloatArray
    bounds: tuple[Bounds, ...]
    shares: tuple[Shares | None, ...]


def _variances(
    model: MachineModel,
    geometry: _Geometry,
    prediction: Prediction,
    covariates: Mapping[str, float] | None,
    *,
    independent: bool,
) -> _Variances:
    gradient = geometry.gradient
    shared = prediction.variance(gradient)
    alone = gradient**2 @ prediction.independent_variance
    apart = predict(replace(model, joint=()), prediction.ids, prediction.points, covariates)
    return _Variances(
        total=alone if independent else shared.total,
        dof=np.full(len(alone), np.inf) if independent else shared.dof,
        independent=alone,
        uncorrelated=apart.variance(gradient).total,
        bounds=tuple(_bounds(prediction, own) for own in shared.by_block.T),
        shares=tuple(None if independent else shared.shares(i) for i in range(len(alone))),
    )


def _length(
    entry: LengthEntry,
    i: int,
    geometry: _Geometry,
    variances: _Variances,
    settings: Settings,
    run: MonteCarloResult,
    beyond: Collection[str],
) -> Length:
    error, variance = float(geometry.errors[i]), float(variances.total[i])
    u, dof = float(np.sqrt(variance)), float(variances.dof[i])
    k95 = coverage_factor(PROBABILITY, dof)
    bounds, pair = variances.bounds[i]
    return Length(
        id=entry.id,
        start=entry.from_,
        end=entry.to,
        nominal=float(np.linalg.norm(geometry.delta, axis=1)[i]),
        error=error,
        variance=variance,
        dof=dof,
        k=settings.coverage_factor,
        interval95=(error - k95 * u, error + k95 * u),
        independent_variance=float(variances.independent[i]),
        variance_uncorrelated=float(variances.uncorrelated[i]),
        u_bounds=bounds,
        pair=pair,
        shares=variances.shares[i],
        conformance=conformance_of(entry.tolerance_um, error, u, dof),
        validation=settings.validate(error, u, dof, run, i),
        outside=entry.from_ in beyond or entry.to in beyond,
    )


def _bounds(prediction: Prediction, by_block: FloatArray) -> Bounds:
    """u if the two largest blocks were correlated with -1 or +1."""
    total = float(by_block.sum())
    largest = np.argsort(-by_block, kind="stable")[:2]
    if len(largest) < 2 or by_block[largest[1]] <= 0:
        u = float(np.sqrt(total))
        return (u, u), None
    cross = 2 * float(np.sqrt(by_block[largest[0]] * by_block[largest[1]]))
    names = [" + ".join(prediction.blocks[b].names) for b in largest]
    low = float(np.sqrt(max(total - cross, 0.0)))
    return (low, float(np.sqrt(total + cross))), (names[0], names[1])


def _planar_warnings(model: MachineModel, delta: FloatArray, names: Sequence[str]) -> list[Finding]:
    missing = [axis for axis in AXES if axis not in model.axes]
    return [
        finding(
            "axis-without-equation",
            axis=axis,
            consequence=f"lengths along {axis} ({names[i]}, ...) have no predicted error there",
        )
        for axis in missing
        for i in np.flatnonzero(np.abs(delta[:, AXES.index(axis)]) > 1e-9)[:1]
    ]
