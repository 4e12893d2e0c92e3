"""How far off will a feature-to-feature length be, and will it conform?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.errors import fault
from mtu_cli.files.part import LoadedPart
from mtu_cli.model.conformance import Conformance, conformance_of, joint_conformance
from mtu_cli.model.features import dof_warnings, feature_points, outside_warnings
from mtu_cli.model.length_geometry import differences, length_gradient, length_measure
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import PROBABILITY, Settings, Warned
from mtu_cli.model.temperature_warnings import temperature_warnings
from mtu_cli.model.trials import PointTrials
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult
from mtu_cli.stats.validation import Validation
from mtu_cli.stats.workspace import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class Length:
    """One length; mm and mm^2. `variance` follows the settings' correlation.

    `variance_uncorrelated` leaves out the measured correlation between components;
    `u_bounds` are what u could be if the two largest contributors among components that do
    not share passes were correlated with -1 or +1 (`pair` names them, None where there are
    not two).
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
    conformance: Conformance | None
    validation: Validation

    @property
    def u(self) -> float:
        """Standard uncertainty."""
        return float(np.sqrt(self.variance))


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthsResult:
    """All lengths of a part; `joint_conformance` (probability, its standard error)."""

    prediction: Prediction
    lengths: tuple[Length, ...]
    joint_conformance: tuple[float, float] | None
    run: MonteCarloResult
    warnings: tuple[Warned, ...]


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
        raise fault(
            "the part has no lengths to predict",
            file=part.source.shown,
            expected="lengths: [{from: '3', to: '9'}]",
        )
    used = [name for entry in entries for name in (entry.from_, entry.to)]
    ids, points, warnings = feature_points(part, model, used)
    prediction = predict(model, ids, points, covariates)
    pairs = np.array([[ids.index(entry.from_), ids.index(entry.to)] for entry in entries])
    delta = differences(points, pairs, [entry.id for entry in entries], part.source.shown)
    nominal = np.linalg.norm(delta, axis=1)
    gradient = length_gradient(prediction, pairs, delta)
    measure, combine = length_measure(prediction, pairs, delta)
    errors = measure((combine @ prediction.mean)[:, None], Workspace())[:, 0]
    names = tuple(entry.id for entry in entries)
    trial_model = PointTrials(
        prediction,
        names,
        measure,
        combine,
        np.tile(np.arange(len(names)), len(prediction.axes)),
        errors,
        gradient,
        np.full(len(names), np.inf) if settings.independent else prediction.variance(gradient).dof,
        independent=settings.independent,
    )
    run = settings.run(trial_model)
    lengths = _lengths(
        model, part, settings, prediction, gradient, nominal, errors, run, covariates
    )
    dof = np.array([length.dof for length in lengths])
    return LengthsResult(
        prediction=prediction,
        lengths=lengths,
        joint_conformance=joint_conformance(
            trial_model, [length.conformance for length in lengths], settings
        ),
        run=run,
        warnings=(
            *warnings,
            *_planar_warnings(model, delta, names),
            *outside_warnings(prediction),
            *temperature_warnings(model, points, covariates or {}),
            *dof_warnings(names, dof),
        ),
    )


def _lengths(
    model: MachineModel,
    part: LoadedPart,
    settings: Settings,
    prediction: Prediction,
    gradient: FloatArray,
    nominal: FloatArray,
    errors: FloatArray,
    run: MonteCarloResult,
    covariates: Mapping[str, float] | None,
) -> tuple[Length, ...]:
    shared = prediction.variance(gradient)
    independent = gradient**2 @ prediction.independent_variance
    total = independent if settings.independent else shared.total
    dofs = np.full(len(total), np.inf) if settings.independent else shared.dof
    apart = predict(replace(model, joint=()), prediction.ids, prediction.points, covariates)
    uncorrelated = apart.variance(gradient).total
    lengths = []
    for i, entry in enumerate(part.part.lengths):
        u, dof = float(np.sqrt(total[i])), float(dofs[i])
        k95 = coverage_factor(PROBABILITY, dof)
        bounds, pair = _bounds(prediction, shared.by_block[:, i])
        lengths.append(
            Length(
                id=entry.id,
                start=entry.from_,
                end=entry.to,
                nominal=float(nominal[i]),
                error=float(errors[i]),
                variance=float(total[i]),
                dof=dof,
                k=settings.coverage_factor,
                interval95=(float(errors[i] - k95 * u), float(errors[i] + k95 * u)),
                independent_variance=float(independent[i]),
                variance_uncorrelated=float(uncorrelated[i]),
                u_bounds=bounds,
                pair=pair,
                conformance=conformance_of(entry.tolerance_um, float(errors[i]), u, dof),
                validation=settings.validate(float(errors[i]), u, dof, run, i),
            )
        )
    return tuple(lengths)


def _bounds(
    prediction: Prediction, by_block: FloatArray
) -> tuple[tuple[float, float], tuple[str, str] | None]:
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


def _planar_warnings(model: MachineModel, delta: FloatArray, names: Sequence[str]) -> list[Warned]:
    missing = [axis for axis in AXES if axis not in model.axes]
    return [
        Warned(
            code="axis-without-equation",
            message=f"the machine has no E{axis}: lengths along {axis} ({names[i]}, ...) are "
            "taken as free of error there",
        )
        for axis in missing
        for i in np.flatnonzero(np.abs(delta[:, AXES.index(axis)]) > 1e-9)[:1]
    ]
