"""What the machine is predicted to do in each operation, at the operation's own covariates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.compare.evidence import Evidence, PredictedItems, paper_length_variance
from mtu_cli.analyses.compare.pooled import Joint
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.basis import TIME
from mtu_cli.model.datum import Datum, projector
from mtu_cli.model.design import design, theta
from mtu_cli.model.effect_columns import with_effect_columns
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.features import outside_warnings
from mtu_cli.model.length_geometry import differences, length_gradient
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.residual_covariates import needed_covariates, point_columns, used_columns
from mtu_cli.model.residual_factors import PIECE
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.model.variance import MeanSquares
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.least_squares import FloatArray

Label = tuple[str, str, str]
Rows = Callable[[Prediction, Sequence[Label]], FloatArray]


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
    own_columns = point_columns(points)
    columns = {name: c for name, c in own_columns.items() if name not in given}
    values = needed_covariates(model, points, columns, given).values
    places = _places(points)
    measured, along = points.measured.copy(), np.array([AXES.index(name) for name in model.axes])
    found: dict[str, Prediction] = {}
    known = with_effect_columns(model, values, columns, given)
    warnings = effect_warnings_at(model, points.nominal, known)
    warnings += _overruled([x for x in used_columns(model) if x in given and x in own_columns])
    moving: set[str] = set()
    operations, operation = operations_of(points)
    for code, name in enumerate(operations):
        rows = np.flatnonzero(operation == code)
        if not len(rows):
            continue
        seen, place = np.unique(points.feature[rows], return_inverse=True)
        place = place.reshape(-1)
        own = {key: _mean(values[key], rows, place) for key in model.covariates()}
        found[name] = predict(model, tuple(points.features[i] for i in seen), places[seen], own)
        warnings += outside_warnings(found[name])
        warnings += temperature_warnings(model, places[seen], own)
        if differ := {key for key in own if _moves(values[key], rows, place)}:
            moving |= differ
            errors = _errors_of_rows(model, points, values, rows)
            mean = np.column_stack([_mean(e, np.arange(len(rows)), place) for e in errors.T])
            measured[rows[:, None], along] -= errors - mean[place]
            shift = mean - _errors(model, places[seen], own)
            found[name] = replace(found[name], mean=found[name].mean + shift.ravel())
    warnings += _averaged(sorted(moving))
    moved = replace(points, measured=measured) if moving else points
    return OperationPredictions(predictions=found, points=moved, warnings=tuple(warnings))


def _places(points: Points) -> FloatArray:
    """Nominal places (features, 3), mm."""
    found = np.full((len(points.features), 3), np.nan)
    found[points.feature] = points.nominal
    return found


def _errors_of_rows(
    model: MachineModel, points: Points, values: Mapping[str, FloatArray | float], rows: np.ndarray
) -> FloatArray:
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
    every: FloatArray = np.concatenate(found)
    own: FloatArray = every[rows]
    return own


def _errors(
    model: MachineModel, places: FloatArray, values: Mapping[str, FloatArray | float]
) -> FloatArray:
    """J theta + remainder (n, a), mm."""
    rows = design(model, places, values)
    found: FloatArray = (rows.J @ theta(model) + rows.remainder).reshape(len(places), -1)
    return found


def _mean(value: FloatArray | float, rows: np.ndarray, place: np.ndarray) -> FloatArray | float:
    """The mean (features,) over the rows of each feature of a column (n,)."""
    if np.ndim(value) == 0:
        return value
    own = np.asarray(value)[rows]
    # Taken about one value: equal temperatures must stay equal, to the last digit.
    mean = own[0] + np.bincount(place, own - own[0]) / np.bincount(place)
    return np.asarray(mean, dtype=np.float64)


def _moves(value: FloatArray | float, rows: np.ndarray, place: np.ndarray) -> bool:
    """Whether a column differs among the rows of one feature."""
    if np.ndim(value) == 0:
        return False
    own = np.asarray(value)[rows]
    first = np.zeros(int(place.max()) + 1)
    first[place[::-1]] = own[::-1]
    return bool((own != first[place]).any())


def _overruled(names: list[str]) -> list[Finding]:
    """Columns of the points that --at stands in for: what they say of each part is lost."""
    reason = "--at gives one value for all points"
    return [finding("not-used", what="columns", names=names, reason=reason)] if names else []


def _averaged(names: list[str]) -> list[Finding]:
    """Covariates that differ from part to part."""
    return [finding("covariate-averaged", names=names)] if names else []


def predicted_features(
    predictions: Mapping[str, Prediction],
    labels: Sequence[Label],
    axes: tuple[int, ...],
    datum: Datum,
) -> PredictedItems:
    """The errors of features less the freedoms of the datum, in the order of `labels`."""

    def rows(prediction: Prediction, own: Sequence[Label]) -> FloatArray:
        a, names = len(prediction.axes), [AXES[k] for k in axes]
        n = len(prediction.ids)
        columns = [i * a + prediction.axes.index(name) for i in range(n) for name in names]
        P = projector(prediction.points, axes, datum)
        index = {name: i for i, name in enumerate(prediction.ids)}
        chosen = [index[label[1]] * len(axes) + names.index(label[2]) for label in own]
        A = np.zeros((len(own), len(prediction.mean)))
        A[:, columns] = P[chosen]
        return A

    return _gathered(predictions, labels, rows, None)


def predicted_lengths(
    predictions: Mapping[str, Prediction],
    labels: Sequence[Label],
    part: LoadedPart,
    holes: Evidence | None,
) -> PredictedItems:
    """Length errors to first order, eq. (22); with what the paper's hole variances give."""
    entries = {entry.id: entry for entry in part.part.lengths}

    def rows(prediction: Prediction, own: Sequence[Label]) -> FloatArray:
        index = {name: i for i, name in enumerate(prediction.ids)}
        names = [label[1] for label in own]
        pairs = np.array([[index[entries[x].from_], index[entries[x].to]] for x in names])
        delta = differences(prediction.points, pairs, names, part.source.shown)
        return length_gradient(prediction, pairs, delta)

    return _gathered(predictions, labels, rows, holes)


def _gathered(
    predictions: Mapping[str, Prediction],
    labels: Sequence[Label],
    rows: Rows,
    holes: Evidence | None,
) -> PredictedItems:
    """The items of all operations, each from the prediction of its own."""
    m = len(labels)
    columns = {name: np.zeros(m) for name in ("mean", "total", "coefficients", "scatter")}
    independent, hole_variance = np.zeros(m), np.full(m, np.nan)
    squares: list[MeanSquares] = []
    joint: dict[str, Joint] = {}
    for operation, prediction in predictions.items():
        own = np.array([i for i, label in enumerate(labels) if label[0] == operation], int)
        if not len(own):
            continue
        A = rows(prediction, [labels[i] for i in own])
        found = prediction.variance(A)
        columns["mean"][own] = A @ prediction.mean
        columns["total"][own] = np.maximum(found.total, 0.0)
        columns["coefficients"][own] = np.maximum(found.coefficients, 0.0)
        columns["scatter"][own] = np.maximum(found.passes + found.repeatability, 0.0)
        independent[own] = A**2 @ prediction.independent_variance
        squares.append(_spread(found.squares, own, m))
        joint[operation] = Joint(
            prediction.scatter_of(A), found.squares, prediction.pass_squares(A)
        )
        if holes is not None:
            V = _of_holes(prediction, holes, operation)
            hole_variance[own] = [paper_length_variance(g, V) for g in A]
    return PredictedItems(
        **columns,
        independent=independent,
        holes=hole_variance,
        of_mean=np.concatenate([item.of_mean for item in squares]),
        of_part=np.concatenate([item.of_part for item in squares]),
        dof=np.concatenate([item.dof for item in squares]),
        joint=joint,
    )


def _spread(squares: MeanSquares, own: np.ndarray, m: int) -> MeanSquares:
    """The mean squares of one operation's items among all m."""
    of_mean, of_part = (np.zeros((len(squares.dof), m)) for _ in range(2))
    of_mean[:, own], of_part[:, own] = squares.of_mean, squares.of_part
    return MeanSquares(of_mean=of_mean, of_part=of_part, dof=squares.dof)


def _of_holes(prediction: Prediction, holes: Evidence, operation: str) -> FloatArray:
    """MS_between (rows,) of the holes of an operation, in the rows of the prediction."""
    V = np.full(len(prediction.mean), np.nan)
    index = {name: i for i, name in enumerate(prediction.ids)}
    a = len(prediction.axes)
    for (where, name, axis), ms in zip(holes.labels, holes.one_way.ms_between, strict=True):
        if where == operation:
            V[index[name] * a + prediction.axes.index(axis)] = ms
    return V
