"""What the machine is predicted to do in each operation, at the operation's own covariates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mtu_cli.analyses.compare.evidence import Evidence, Foretold, paper_length_variance
from mtu_cli.errors import InputError, Problem
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.model.datum import Datum, projector
from mtu_cli.model.features import outside_warnings
from mtu_cli.model.length_geometry import differences, length_gradient
from mtu_cli.model.machine_model import AXES, MachineModel, check_covariates
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Warned
from mtu_cli.model.temperature_warnings import temperature_warnings
from mtu_cli.model.variance import MeanSquares
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.least_squares import FloatArray

Label = tuple[str, str, str]
Rows = Callable[[Prediction, Sequence[Label]], FloatArray]


def predict_operations(
    model: MachineModel, points: Points, given: Mapping[str, float]
) -> tuple[dict[str, Prediction], list[Warned]]:
    """The prediction of every operation, at its features, and what to warn of.

    A covariate is what `given` says, else the mean of the points' column over all parts and
    repeats of the (operation, feature).

    Raises InputError for a covariate that nobody gives, and for a column with gaps.
    """
    values = _covariates(model, points, given)
    operations, operation = operations_of(points)
    places = np.full((len(points.features), 3), np.nan)
    places[points.feature] = points.nominal
    found: dict[str, Prediction] = {}
    warnings: list[Warned] = []
    moving: set[str] = set()
    for code, name in enumerate(operations):
        rows = np.flatnonzero(operation == code)
        if not len(rows):
            continue
        seen, place = np.unique(points.feature[rows], return_inverse=True)
        own = {key: _mean(value, rows, place.reshape(-1)) for key, value in values.items()}
        moving |= {key for key in values if _moves(values[key], rows, place.reshape(-1))}
        ids = tuple(points.features[i] for i in seen)
        found[name] = predict(model, ids, places[seen], own)
        warnings += outside_warnings(found[name])
        warnings += temperature_warnings(model, places[seen], own)
    if moving:
        warnings.append(_averaged(sorted(moving)))
    return found, warnings


def _covariates(
    model: MachineModel, points: Points, given: Mapping[str, float]
) -> dict[str, FloatArray | float]:
    values: dict[str, FloatArray | float] = dict(given)
    problems: list[Problem] = []
    for name in model.covariates():
        if name in given:
            continue
        column = _column(points, name, problems)
        if column is not None:
            values[name] = column
    if problems:
        raise InputError(problems)
    check_covariates(model, values)
    return values


def _column(points: Points, name: str, problems: list[Problem]) -> FloatArray | None:
    """A column of the points (n,) by its name in equations; None where no point has a value."""
    known: dict[str, np.ndarray] = {
        "time_min": points.time_min,
        "sequence": points.sequence.astype(np.float64),
        **{f"dir_{axis}": points.direction[:, i] for i, axis in enumerate(AXES)},
    }
    column = known.get(name, points.covariates.get(name))
    if column is None:
        return None
    if column.dtype == object:
        bad = np.array([not _is_number(text) for text in column.tolist()])
    else:
        bad = ~np.isfinite(column)
        if bad.all():
            return None
    if not bad.any():
        return column.astype(np.float64)
    first = int(np.argmax(bad))
    text = column[first] if column.dtype == object else ""
    problems.append(
        Problem(
            what=f"{name!r} has gaps: {int(bad.sum())} of {len(bad)} points have no number",
            file=points.sources[points.file_index[first]].shown,
            row=int(points.row[first]),
            column=name,
            value=text or None,
            expected=f"a number at every point, or --at {name}=VALUE for all of them",
        )
    )
    return None


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _mean(value: FloatArray | float, rows: np.ndarray, place: np.ndarray) -> FloatArray | float:
    """The mean (features,) of a column over the rows of each feature."""
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


def _averaged(names: list[str]) -> Warned:
    return Warned(
        code="covariate-averaged",
        message=f"{', '.join(names)} differs from part to part: predicted is its mean, and what "
        "it adds to the measured scatter is not in the predicted one",
    )


def foretold_features(
    predictions: Mapping[str, Prediction],
    labels: Sequence[Label],
    axes: tuple[int, ...],
    datum: Datum,
) -> Foretold:
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


def foretold_lengths(
    predictions: Mapping[str, Prediction],
    labels: Sequence[Label],
    part: LoadedPart,
    holes: Evidence | None,
) -> Foretold:
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
) -> Foretold:
    """The items of all operations, each from the prediction of its own."""
    m = len(labels)
    columns = {name: np.zeros(m) for name in ("mean", "total", "coefficients", "scatter")}
    independent, hole_variance = np.zeros(m), np.full(m, np.nan)
    squares: list[MeanSquares] = []
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
        if holes is not None:
            V = _of_holes(prediction, holes, operation)
            hole_variance[own] = [paper_length_variance(g, V) for g in A]
    return Foretold(
        **columns,
        independent=independent,
        holes=hole_variance,
        of_mean=np.concatenate([item.of_mean for item in squares]),
        of_part=np.concatenate([item.of_part for item in squares]),
        dof=np.concatenate([item.dof for item in squares]),
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
