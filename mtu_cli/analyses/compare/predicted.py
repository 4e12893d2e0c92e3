"""What the machine is predicted to do in each operation, at the operation's own covariates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.compare.evidence import (
    Evidence,
    Joint,
    Label,
    PredictedItems,
    paper_length_variance,
)
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import needed_covariates, point_columns, used_columns
from mtu_cli.model.effect_columns import with_effect_columns
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.features import outside_warnings
from mtu_cli.model.machine_model import AXES, TIME, MachineModel, design, theta
from mtu_cli.model.measurands import differences, length_gradient
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.model.variance import MeanSquares
from mtu_cli.model.visits import Datum, operations_of, projector
from mtu_cli.stats.least_squares import FloatArray

Values = Mapping[str, FloatArray | float]
PIECE = 8192
"""Points predicted at once, so that their design matrix stays in the cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OperationPredictions:
    """The prediction of every operation, and `points` less what their own covariates change in
    the modelled error, so that all readings of a feature are of one state of the machine.
    """

    predictions: dict[str, Prediction]
    points: Points
    warnings: tuple[Finding, ...]


def predict_operations(
    model: MachineModel, points: Points, given: Mapping[str, float]
) -> OperationPredictions:
    """The prediction of every operation, at its features.

    A covariate is what `given` says, else the points' own. Means are over the readings of an
    (operation, feature) of E = J theta + remainder at their own covariates, which the covariates'
    mean does not give where an effect is a step; uncertainties are those at the mean.

    Raises InputError for a covariate that nobody gives, and for a column with gaps.
    """
    stated = point_columns(points)
    columns = {name: column for name, column in stated.items() if name not in given}
    values = needed_covariates(model, points, columns, given).values
    nominal = np.full((len(points.features), 3), np.nan)
    nominal[points.feature] = points.nominal
    known = with_effect_columns(model, values, columns, given)
    warnings = effect_warnings_at(model, points.nominal, known)
    if overruled := [name for name in used_columns(model) if name in given and name in stated]:
        reason = "--at gives one value for all points"
        warnings.append(finding("not-used", what="columns", names=overruled, reason=reason))
    measured, along = points.measured.copy(), np.array([AXES.index(name) for name in model.axes])
    found: dict[str, Prediction] = {}
    moving: set[str] = set()
    operations, operation = operations_of(points)
    for code, name in enumerate(operations):
        rows = np.flatnonzero(operation == code)
        if not len(rows):
            continue
        seen, place = np.unique(points.feature[rows], return_inverse=True)
        place = place.reshape(-1)
        means = {key: _mean(values[key], rows, place) for key in model.covariates()}
        prediction = predict(model, tuple(points.features[i] for i in seen), nominal[seen], means)
        warnings += outside_warnings(prediction)
        warnings += temperature_warnings(model, nominal[seen], means)
        if differ := {key for key in means if _moves(values[key], rows, place)}:
            moving |= differ
            errors = _errors_of_rows(model, points, values)[rows]
            mean = np.column_stack([_mean(e, np.arange(len(rows)), place) for e in errors.T])
            measured[rows[:, None], along] -= errors - mean[place]
            shift = mean - _errors(model, nominal[seen], means)
            prediction = replace(prediction, mean=prediction.mean + shift.ravel())
        found[name] = prediction
    if moving:
        warnings.append(finding("covariate-averaged", names=sorted(moving)))
        points = replace(points, measured=measured)
    return OperationPredictions(predictions=found, points=points, warnings=tuple(warnings))


def _errors_of_rows(model: MachineModel, points: Points, values: Values) -> FloatArray:
    """The modelled errors (rows, a), mm, at the rows' own covariates; piece by piece, but all at
    once where a drift lags behind its temperatures: their history is that of all rows.
    """
    step = len(points) if TIME in values else PIECE
    found = [
        _errors(
            model,
            points.nominal[i : i + step],
            {k: v if np.ndim(v) == 0 else np.asarray(v)[i : i + step] for k, v in values.items()},
        )
        for i in range(0, len(points), step)
    ]
    return np.concatenate(found)


def _errors(model: MachineModel, places: FloatArray, values: Values) -> FloatArray:
    """J theta + remainder (n, a), mm."""
    rows = design(model, places, values)
    found: FloatArray = (rows.J @ theta(model) + rows.remainder).reshape(len(places), -1)
    return found


def _mean(value: FloatArray | float, rows: np.ndarray, place: np.ndarray) -> FloatArray | float:
    """The mean (features,) over the rows of each feature of a column (n,)."""
    if np.ndim(value) == 0:
        return value
    chosen = np.asarray(value)[rows]
    # Taken about one value: equal temperatures must stay equal, to the last digit.
    mean = chosen[0] + np.bincount(place, chosen - chosen[0]) / np.bincount(place)
    return np.asarray(mean, dtype=np.float64)


def _moves(value: FloatArray | float, rows: np.ndarray, place: np.ndarray) -> bool:
    """Whether a column differs among the rows of one feature."""
    if np.ndim(value) == 0:
        return False
    chosen = np.asarray(value)[rows]
    first = np.zeros(int(place.max()) + 1)
    first[place[::-1]] = chosen[::-1]
    return bool((chosen != first[place]).any())


Predictions = Mapping[str, Prediction]


def predicted_features(
    predictions: Predictions, labels: Sequence[Label], axes: tuple[int, ...], datum: Datum
) -> PredictedItems:
    """The errors of features less the freedoms of the datum, in the order of `labels`."""

    def rows(prediction: Prediction, members: Sequence[Label]) -> FloatArray:
        a, names = len(prediction.axes), [AXES[k] for k in axes]
        n = len(prediction.ids)
        columns = [i * a + prediction.axes.index(name) for i in range(n) for name in names]
        P = projector(prediction.points, axes, datum)
        index = {name: i for i, name in enumerate(prediction.ids)}
        chosen = [index[name] * len(axes) + names.index(axis) for _, name, axis in members]
        A = np.zeros((len(members), len(prediction.mean)))
        A[:, columns] = P[chosen]
        return A

    found, matrices = _gathered(predictions, labels, rows)
    joint = {}
    for operation, (A, squares) in matrices.items():
        one = predictions[operation]
        joint[operation] = Joint(one.scatter_of(A), squares, one.pass_squares(A))
    return replace(found, joint=joint)


def predicted_lengths(
    predictions: Predictions, labels: Sequence[Label], part: LoadedPart, holes: Evidence | None
) -> PredictedItems:
    """Length errors to first order, eq. (22); with what the paper's hole variances give."""
    ends = {entry.id: (entry.from_, entry.to) for entry in part.part.lengths}

    def rows(prediction: Prediction, members: Sequence[Label]) -> FloatArray:
        index = {name: i for i, name in enumerate(prediction.ids)}
        names = [label[1] for label in members]
        pairs = np.array([[index[end] for end in ends[name]] for name in names])
        delta = differences(prediction.points, pairs, names, part.source.shown)
        return length_gradient(prediction, pairs, delta)

    found, matrices = _gathered(predictions, labels, rows)
    if holes is None:
        return found
    squares = dict(zip(holes.labels, holes.one_way.ms_between.tolist(), strict=True))
    for operation, (A, _) in matrices.items():
        one = predictions[operation]
        V = [squares.get((operation, name, axis), np.nan) for name in one.ids for axis in one.axes]
        variances = [paper_length_variance(g, np.array(V)) for g in A]
        found.holes[[label[0] == operation for label in labels]] = variances
    return found


def _gathered(
    predictions: Predictions,
    labels: Sequence[Label],
    rows: Callable[[Prediction, Sequence[Label]], FloatArray],
) -> tuple[PredictedItems, dict[str, tuple[FloatArray, MeanSquares]]]:
    """The items of all operations, each from the prediction of its own; and of every operation
    the matrix A, of which its items are A E, and the mean squares of these.
    """
    m = len(labels)
    names = ("mean", "total", "coefficients", "scatter", "independent")
    columns = {name: np.zeros(m) for name in names}
    of_mean, of_part, dof = [np.zeros((0, m))], [np.zeros((0, m))], [np.zeros(0)]
    matrices = {}
    for operation, prediction in predictions.items():
        members = np.array([i for i, label in enumerate(labels) if label[0] == operation], int)
        if not len(members):
            continue
        A = rows(prediction, [labels[i] for i in members])
        found = prediction.variance(A)
        matrices[operation] = A, found.squares
        columns["mean"][members] = A @ prediction.mean
        columns["total"][members] = np.maximum(found.total, 0.0)
        columns["coefficients"][members] = np.maximum(found.coefficients, 0.0)
        columns["scatter"][members] = np.maximum(found.passes + found.repeatability, 0.0)
        columns["independent"][members] = A**2 @ prediction.independent_variance
        for rows_of, each in ((of_mean, found.squares.of_mean), (of_part, found.squares.of_part)):
            spread = np.zeros((len(each), m))
            spread[:, members] = each
            rows_of.append(spread)
        dof.append(found.squares.dof)
    items = PredictedItems(
        **columns,
        holes=np.full(m, np.nan),
        of_mean=np.concatenate(of_mean),
        of_part=np.concatenate(of_part),
        dof=np.concatenate(dof),
        joint={},
    )
    return items, matrices
