"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.anova.summary import missing_entries, some
from mtu_cli.analyses.compare.evidence import (
    FEWEST_PARTS,
    Compared,
    Summary,
    Verdict,
    compared,
    joined,
    judged,
    paper_length_variance,
    summarised,
)
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import needed_covariates, point_columns
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.features import outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel, design, theta
from mtu_cli.model.measurands import differences, length_gradient
from mtu_cli.model.measured import (
    MeasuredTables,
    feature_tables,
    left_out,
    length_tables,
    no_shared_axis,
    not_measured,
    roundings,
)
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings
from mtu_cli.model.temperatures import temperature_warnings
from mtu_cli.model.visits import (
    IntArray,
    axes_of,
    freed,
    incomplete_datum,
    operations_of,
    projector,
    visits_of,
)
from mtu_cli.stats.least_squares import BoolArray, FloatArray

__all__ = ["CompareResult", "Compared", "Summary", "Verdict", "compare", "judged"]

Label = tuple[str, str, str]
"""Operation, feature or length, axis."""
Values = Mapping[str, FloatArray | float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured; the summaries have one entry an
    operation.
    """

    features: Compared
    lengths: Compared | None
    feature_summaries: tuple[Summary, ...]
    length_summaries: tuple[Summary, ...]
    datum: Datum
    coverage_factor: float
    warnings: tuple[Finding, ...]


def compare(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    settings: Settings,
    datum: Datum = "none",
    covariates: Mapping[str, float] | None = None,
) -> CompareResult:
    """Gilsinn & Ling 2004, section 5 and Table 10, with tests in place of a look.

    The machine is predicted once an operation, with `covariates`, or the points' own: what these
    change from part to part is taken out of the points. Means and scatter are tested item by item
    (`Compared`), and the scatter of all features at once, as one family (Holm, 5 %): of clean
    studies one in twenty is no "consistent".

    Raises InputError for points that share no axis with the machine, and for a missing covariate
    or one with gaps.
    """
    measured, k, rounding = axes_of(points), settings.coverage_factor, roundings(points)
    axes = tuple(i for i in measured if AXES[i] in model.axes)
    if not axes:
        raise no_shared_axis(model, points, measured)
    warnings = left_out(points)
    predictions, points, noted = predict_operations(model, points, covariates or {})
    loose, complete = freed(points, axes, datum)
    if not complete:
        warnings.append(incomplete_datum())
    tables, names = feature_tables(loose, rounding), {AXES[i] for i in axes}
    tables = tables.only([i for i, label in enumerate(tables.labels) if label[2] in names])
    of_features = partial(feature_rows, axes=axes, datum=datum)
    features = _compared(tables, predictions, of_features, k, {})
    lengths, long = None, length_tables(points, visits_of(points), part)
    if long is not None:
        # Hole variances less a datum are not those of lengths.
        known = features.labels if datum == "none" else ()
        holes = dict(zip(known, features.one_way.ms_between.tolist(), strict=False))
        lengths = _compared(long, predictions, partial(length_rows, part=part), k, holes)
    features, lengths = judged(features, lengths)
    kinds = [features] if lengths is None else [features, lengths]
    return CompareResult(
        features=features,
        lengths=lengths,
        feature_summaries=summarised(features),
        length_summaries=() if lengths is None else summarised(lengths, "lengths"),
        datum=datum,
        coverage_factor=k,
        warnings=(*warnings, *noted, *_warnings(model, part, points, kinds)),
    )


def _compared(
    tables: MeasuredTables,
    predictions: Mapping[str, Prediction],
    rows: Callable[[Prediction, Sequence[Label]], FloatArray],
    k: float,
    holes: Mapping[Label, float],
) -> Compared:
    """The items of all operations, each against its own prediction; `holes`: MS_between there."""
    found, places = [], []
    for operation, prediction in predictions.items():
        own = [i for i, label in enumerate(tables.labels) if label[0] == operation]
        if not own:
            continue
        of_own = tables.only(own)
        A, variances = rows(prediction, of_own.labels), None
        if holes:
            labels = [(operation, name, x) for name in prediction.ids for x in prediction.axes]
            V_p = np.array([holes.get(label, np.nan) for label in labels])
            variances = paper_length_variance(A, V_p)
        found.append(compared(of_own, prediction, A, k, variances))
        places += own
    whole: Compared = joined(found, np.argsort(places))
    return whole


def feature_rows(
    prediction: Prediction, labels: Sequence[Label], axes: tuple[int, ...], datum: Datum
) -> FloatArray:
    """A of the errors of features less the freedoms of the datum."""
    names = [AXES[k] for k in axes]
    columns = [prediction.row(point, name) for point in prediction.ids for name in names]
    index = {name: i for i, name in enumerate(prediction.ids)}
    chosen = [index[name] * len(axes) + names.index(axis) for _, name, axis in labels]
    A = np.zeros((len(labels), len(prediction.mean)))
    A[:, columns] = projector(prediction.points, axes, datum)[chosen]
    return A


def length_rows(prediction: Prediction, labels: Sequence[Label], part: LoadedPart) -> FloatArray:
    """A of the errors of lengths to first order, eq. (22)."""
    index = {name: i for i, name in enumerate(prediction.ids)}
    ends = {entry.id: [index.get(entry.from_), index.get(entry.to)] for entry in part.part.lengths}
    names = [label[1] for label in labels]
    pairs = np.array([ends[name] for name in names])
    delta = differences(prediction.points, pairs, names, part.source.shown)
    return length_gradient(prediction, pairs, delta)


def predict_operations(
    model: MachineModel, points: Points, given: Mapping[str, float]
) -> tuple[dict[str, Prediction], Points, list[Finding]]:
    """The prediction of every operation at its features; the points less what their own covariates
    change in the modelled error, so that all readings of a feature are of one state of the
    machine; and warnings.

    A covariate is what `given` says, else the points' own. Means are over the readings of an
    (operation, feature) at their own covariates; uncertainties are those at the covariates' mean.

    Raises InputError for a covariate that nobody gives, and for a column with gaps.
    """
    stated = point_columns(points)
    columns = {name: column for name, column in stated.items() if name not in given}
    values = needed_covariates(model, points, columns, given).values
    warnings = effect_warnings_at(model, points.nominal, values)
    if overruled := [name for name in model.covariates() if name in given and name in stated]:
        reason = "--at gives one value for all points"
        warnings.append(finding("not-used", what="columns", names=overruled, reason=reason))
    measured, along = points.measured.copy(), [AXES.index(name) for name in model.axes]
    result: dict[str, Prediction] = {}
    moving: set[str] = set()
    operations, operation = operations_of(points)
    for code, name in enumerate(operations):
        rows = np.flatnonzero(operation == code)
        if not len(rows):
            continue
        seen, first, of = np.unique(points.feature[rows], return_index=True, return_inverse=True)
        features, place = [points.features[i] for i in seen], points.nominal[rows[first]]
        means: dict[str, FloatArray | float] = {}
        differ = set()
        for key in model.covariates():
            means[key] = values[key]
            if np.ndim(values[key]) > 0:
                means[key], moves = _mean(np.asarray(values[key])[rows], first, of)
                differ |= {key} if moves else set()
        prediction = predict(model, features, place, means)
        warnings += outside_warnings(prediction)
        warnings += temperature_warnings(model, place, means)
        if differ:
            moving |= differ
            # Of all points: where a drift lags, they are its history.
            errors = _errors(model, points.nominal, values)[rows]
            mean = np.column_stack([_mean(each, first, of)[0] for each in errors.T])
            measured[rows[:, None], along] -= errors - mean[of]
            shift = mean - _errors(model, place, means)
            prediction = replace(prediction, mean=prediction.mean + shift.ravel())
        result[name] = prediction
    if moving:
        warnings.append(finding("covariate-averaged", names=sorted(moving)))
        points = replace(points, measured=measured)
    return result, points, warnings


def _errors(model: MachineModel, places: FloatArray, values: Values) -> FloatArray:
    """J theta + remainder (n, a), mm."""
    rows = design(model, places, values)
    return np.asarray(rows.J @ theta(model) + rows.remainder).reshape(len(places), -1)


def _mean(values: FloatArray, first: IntArray, of: IntArray) -> tuple[FloatArray, bool]:
    """The mean (features,) of `values` (rows,) by the feature that each row is `of`, taken about
    the `first` one, so that equal values stay equal; and whether any differ.
    """
    away = values - values[first][of]
    return values[first] + np.bincount(of, away) / np.bincount(of), bool(away.any())


def _warnings(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    kinds: list[Compared],
) -> list[Finding]:
    """All warnings on the items."""
    without = [AXES[i] for i in axes_of(points) if AXES[i] not in model.axes]
    aside = "the points are not compared there, and lengths have no predicted error along it"
    missing = [f"feature {name}" for name in part.part.features if name not in points.features]
    lengths = kinds[1].labels if len(kinds) > 1 else ()
    result = [
        *not_measured(model.axes, points),
        *(finding("axis-without-equation", axis=x, consequence=aside) for x in without),
        *missing_entries("length", part.part.lengths, lengths),
    ]
    if missing:
        result.append(finding("not-measured", names=missing, reason="not among the points"))
    # What parts, repeats and predictions are too few for, item by item.
    parts, repeats, u, s_part = (
        np.concatenate(each)
        for each in zip(
            *((x.one_way.parts, x.one_way.df_within, x.predicted.u, x.s_part) for x in kinds),
            strict=True,
        )
    )
    untested = np.array([verdict is None for kind in kinds for verdict in kind.verdicts])
    few = parts < FEWEST_PARTS
    scatter = "means are judged by the predicted scatter, and one that is off may be scatter"
    cmm = "MS_between contains the scatter of the CMM, which is not predicted"
    nothing = "no scatter is measured and none predicted"
    least = int(parts.min(initial=FEWEST_PARTS))
    cases: tuple[tuple[str, BoolArray, dict[str, Any]], ...] = (
        ("few-parts", few, {"parts": least, "consequence": scatter}),
        ("no-repeats", (repeats < 1) & (parts > 1), {"consequence": cmm}),
        ("not-tested", untested, {"what": "the difference", "reason": nothing}),
    )
    result += [finding(x, items=some(rows, "items"), **y) for x, rows, y in cases if rows.any()]
    ids = np.array([label[1] for kind in kinds for label in kind.labels], object)
    for rows, quantity, reason in (
        (~(u > 0), "ratios to the predicted scatter", "no uncertainty is predicted"),
        ((s_part == 0) & (parts > 1), "the parts' share of MS_between", "they do not scatter"),
    ):
        if names := [*dict.fromkeys(ids[rows])]:
            result.append(finding("not-estimable", quantity=quantity, names=names, reason=reason))
    return result
