"""How far off will a feature-to-feature length be, and will it conform?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.features import dof_warnings, feature_points, prediction_warnings
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measurands import (
    Conformance,
    JointConformance,
    PointTrials,
    conformance_of,
    differences,
    joint_conformance,
    length_gradient,
    length_measure,
)
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings, convergence_warnings, validation_warnings
from mtu_cli.model.variance import Shares
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, Validation
from mtu_cli.units import UM


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

    prediction: Prediction
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
    shares: tuple[Shares | None, ...]
    conformance: tuple[Conformance | None, ...]
    validation: tuple[Validation, ...]
    outside: tuple[bool, ...]
    coverage_factor: float
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
    entries = part.part.lengths
    if not entries:
        reason, expected = "the part has no lengths to predict", "lengths: [{from: '3', to: '9'}]"
        raise error("not-applicable", reason=reason, file=part.source.shown, expected=expected)
    names, ends = tuple(x.id for x in entries), tuple((x.from_, x.to) for x in entries)
    features, points, notes = feature_points(part, model, [name for pair in ends for name in pair])
    prediction = predict(model, features, points, covariates)
    pairs = np.array([[features.index(name) for name in pair] for pair in ends])
    delta = differences(points, pairs, names, part.source.shown)
    gradient = length_gradient(prediction, pairs, delta)
    split = prediction.variance(gradient)
    independent = gradient**2 @ prediction.independent_variance
    variance, dof = split.total, split.dof
    if settings.independent:
        variance, dof = independent, np.full(len(names), np.inf)
    u = np.sqrt(variance)
    measure, combine = length_measure(prediction, pairs, delta)
    owner = np.tile(np.arange(len(names)), len(prediction.axes))
    alone = settings.independent
    trials = PointTrials(
        prediction, names, measure, combine, owner, gradient, None if alone else split
    )
    run, errors = settings.run(trials), trials.linear_mean
    half = np.array([coverage_factor(PROBABILITY, each) for each in dof]) * u
    separate = predict(replace(model, joint=()), prediction.ids, prediction.points, covariates)
    uncorrelated = separate.variance(gradient).total
    bounds = [_bounds(prediction, by_block) for by_block in split.by_block.T]
    rows = list(zip(errors.tolist(), u.tolist(), dof.tolist(), strict=True))
    conformance = [
        conformance_of(x.tolerance, UM, *row) for x, row in zip(entries, rows, strict=True)
    ]
    validation = tuple(settings.validate(*row, run, i) for i, row in enumerate(rows))
    missing = []
    for axis, mask in zip(AXES, np.abs(delta).T > 1e-9, strict=True):
        if axis not in model.axes and mask.any():
            first = names[int(np.argmax(mask))]
            consequence = f"lengths along {axis} ({first}, ...) have no predicted error there"
            missing.append(finding("axis-without-equation", axis=axis, consequence=consequence))
    return LengthsResult(
        prediction=prediction,
        ids=names,
        ends=ends,
        nominal=np.linalg.norm(delta, axis=1),
        error=errors,
        variance=variance,
        dof=dof,
        interval95=np.column_stack([errors - half, errors + half]),
        independent_variance=independent,
        u_uncorrelated=np.sqrt(np.where(uncorrelated >= 0, uncorrelated, np.nan)),
        u_bounds=np.array([ends for ends, _ in bounds]),
        pair=tuple(pair for _, pair in bounds),
        shares=tuple(None if alone else split.shares(i) for i in range(len(names))),
        conformance=tuple(conformance),
        validation=validation,
        outside=tuple(not prediction.beyond.keys().isdisjoint(pair) for pair in ends),
        coverage_factor=settings.coverage_factor,
        joint_conformance=joint_conformance(trials, conformance, settings),
        run=run,
        warnings=(
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
    total = float(by_block.sum())
    largest = np.argsort(-by_block, kind="stable")[:2]
    if len(largest) < 2 or by_block[largest[1]] <= 0:
        u = float(np.sqrt(total))
        return (u, u), None
    cross = 2 * float(np.sqrt(by_block[largest[0]] * by_block[largest[1]]))
    first, second = (" + ".join(prediction.blocks[b].names) for b in largest)
    low, high = np.sqrt(max(total - cross, 0.0)), np.sqrt(total + cross)
    return (float(low), float(high)), (first, second)
