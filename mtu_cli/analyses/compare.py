"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.model.datum import Datum, freed, projector
from mtu_cli.model.length_geometry import differences, length_gradient
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import (
    MeasuredTables,
    axes_of,
    feature_tables,
    length_tables,
    visits_of,
)
from mtu_cli.model.measured_checks import check_measured
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings, Warned
from mtu_cli.stats.anova import Cells, OneWay, one_way
from mtu_cli.stats.family import f_tails, holm, t_tail
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted"]
FAMILY_RATE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Mean, u of one part and its variance by nature, each (items,); mm and mm^2."""

    mean: FloatArray
    u: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """Items (features by axis, or lengths) with both sides; arrays (items,), mm.

    `labels` (operation, id, axis). `measured_paper` has the paper's u, which takes MS_between
    for the part variance. `u_difference` is that of measured mean minus predicted mean: the
    coefficients' covariance and the scatter of the mean over the measured parts, predicted or
    seen, whichever is larger. `p_bias`, `p_scatter` are Holm-adjusted over all items.
    """

    labels: tuple[tuple[str, str, str], ...]
    predicted: Side
    independent: Side
    measured: Side
    measured_paper: Side
    one_way: OneWay
    bias: FloatArray
    u_difference: FloatArray
    E_n: FloatArray
    p_bias: FloatArray
    p_scatter: FloatArray
    scatter_ratio: FloatArray
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured."""

    features: Compared
    lengths: Compared | None
    datum: Datum
    coverage_factor: float
    warnings: tuple[Warned, ...]


def compare(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    settings: Settings,
    datum: Datum = "none",
    covariates: Mapping[str, float] | None = None,
) -> CompareResult:
    """Gilsinn & Ling 2004, section 5 and Table 10, with tests in place of a look.

    The mean is judged by bias against what the difference of the two means may be, the
    scatter by MS_between against what the prediction makes of it, s_repeat^2 + n0 s_part^2,
    with F. Both are Holm-adjusted over all items of a kind.

    Raises InputError for points that cannot be what they claim, or a missing covariate.
    """
    warnings = list(check_measured(points))
    axes = tuple(i for i in axes_of(points) if AXES[i] in model.axes)
    loose, complete = freed(points, axes, datum)
    if not complete:
        warnings.append(
            Warned(
                code="incomplete-datum",
                message="parts with missing features were freed with the features they have; "
                "the prediction is freed with all",
            )
        )
    prediction = _predict_features(model, part, points, covariates)
    a = len(prediction.axes)
    columns = [i * a + model.axes.index(AXES[k]) for i in range(len(prediction.ids)) for k in axes]
    P = np.zeros((len(columns), len(prediction.mean)))
    P[:, columns] = projector(prediction.points, axes, datum)
    tables = _of_axes(feature_tables(loose), axes)
    rows = [
        prediction.ids.index(name) * len(axes) + [AXES[k] for k in axes].index(axis)
        for _, name, axis in tables.labels
    ]
    features = _compared(tables, prediction, P[rows], settings)
    holes = features if datum == "none" else None
    return CompareResult(
        features=features,
        lengths=_lengths(prediction, part, points, settings, holes),
        datum=datum,
        coverage_factor=settings.coverage_factor,
        warnings=tuple(warnings),
    )


def _predict_features(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    covariates: Mapping[str, float] | None,
) -> Prediction:
    """The prediction at every measured feature; covariates given, or the feature's mean."""
    places = np.full((len(points.features), 3), np.nan)
    places[points.feature] = points.nominal
    seen = np.unique(points.feature)
    values: dict[str, FloatArray | float] = dict(covariates or {})
    count = np.bincount(points.feature, minlength=len(points.features))
    for name in model.covariates():
        column = _covariate(points, name)
        if name not in values and column is not None:
            mean = np.bincount(points.feature, column, minlength=len(points.features))
            values[name] = (mean / np.maximum(count, 1))[seen]
    ids = tuple(points.features[i] for i in seen)
    return predict(model, ids, places[seen], values)


def _covariate(points: Points, name: str) -> FloatArray | None:
    """A numeric column of the points by its name in equations, or None."""
    known: dict[str, FloatArray] = {
        "time_min": points.time_min,
        "sequence": points.sequence.astype(np.float64),
        **{f"dir_{axis}": points.direction[:, i] for i, axis in enumerate(AXES)},
    }
    column = known.get(name, points.covariates.get(name))
    if column is None or column.dtype == object or not np.isfinite(column).all():
        return None
    return column.astype(np.float64)


def _of_axes(tables: MeasuredTables, axes: tuple[int, ...]) -> MeasuredTables:
    names = {AXES[i] for i in axes}
    kept = [i for i, label in enumerate(tables.labels) if label[2] in names]
    cells = tables.cells
    return MeasuredTables(
        labels=tuple(tables.labels[i] for i in kept),
        parts=tables.parts,
        cells=Cells(
            origin=cells.origin[kept],
            n=cells.n[kept],
            mean=cells.mean[kept],
            within=cells.within[kept],
        ),
    )


def _lengths(
    prediction: Prediction,
    part: LoadedPart,
    points: Points,
    settings: Settings,
    holes: Compared | None,
) -> Compared | None:
    """Lengths; with the paper's u from its hole variances, eq. (22), where they are at hand."""
    tables = length_tables(points, visits_of(points), part)
    if tables is None:
        return None
    entries = {entry.id: entry for entry in part.part.lengths}
    pairs = np.array(
        [
            [prediction.ids.index(entries[name].from_), prediction.ids.index(entries[name].to)]
            for _, name, _ in tables.labels
        ]
    )
    names = [name for _, name, _ in tables.labels]
    delta = differences(prediction.points, pairs, names, part.source.shown)
    gradient = length_gradient(prediction, pairs, delta)
    found = _compared(tables, prediction, gradient, settings)
    if holes is None:
        return found
    variances = [_hole_variances(prediction, holes, label[0]) for label in tables.labels]
    u = [
        np.sqrt(paper_length_variance(g, V, N))
        for g, V, N in zip(gradient, variances, found.one_way.N, strict=True)
    ]
    paper = replace(found.measured_paper, u=np.array(u))
    return replace(found, measured_paper=paper)


def _hole_variances(prediction: Prediction, holes: Compared, operation: str) -> FloatArray:
    """MS_between (rows,) of the holes of an operation, in the rows of the prediction."""
    V = np.full(len(prediction.mean), np.nan)
    for label, ms in zip(holes.labels, holes.one_way.ms_between, strict=True):
        if label[0] == operation:
            V[prediction.row(label[1], label[2])] = ms
    return V


def paper_length_variance(gradient: FloatArray, holes: FloatArray, N: float) -> float:
    """Variance of a length as Tables 8 and 9 have it: eq. (22) on the hole variances V_p(m)
    (rows,), times (1 + 1/N) for a future measurement, eq. (33). It is not the scatter of
    measured lengths: it takes V_p(m) for the part variance and the two ends for independent.
    """
    used = gradient != 0
    return float(gradient[used] ** 2 @ holes[used]) * (1 + 1 / N)


def _compared(
    tables: MeasuredTables,
    prediction: Prediction,
    A: FloatArray,
    settings: Settings,
) -> Compared:
    variance = prediction.variance(A)
    table = one_way(tables.cells)
    components = reml(tables.cells)
    n = tables.cells.n
    future = variance.passes + variance.repeatability
    apart = np.isfinite(components.part)
    repeat = np.where(apart, components.repeat, 0.0)
    part = np.where(apart, components.part, table.ms_between)
    spread = (n**2).sum(axis=1) / table.N**2
    seen = part * spread + repeat / table.N
    expected = np.maximum(future, 0.0) * spread + repeat / table.N
    of_mean = np.maximum(seen, expected)
    predicted = A @ prediction.mean
    bias = table.mean - predicted
    u_difference = np.sqrt(variance.coefficients + of_mean)
    p_bias = holm(t_tail(bias / u_difference, np.maximum(table.df_between, 1.0)))
    ms_expected = repeat + table.n0 * future
    ratio = table.ms_between / ms_expected
    p_high, p_low = f_tails(ratio, table.df_between, variance.dof)
    p_scatter = holm(2 * np.minimum(p_high, p_low))
    independent = A**2 @ prediction.independent_variance
    return Compared(
        labels=tables.labels,
        predicted=Side(mean=predicted, u=np.sqrt(variance.total)),
        independent=Side(mean=predicted, u=np.sqrt(independent)),
        measured=Side(mean=table.mean, u=np.sqrt(part + seen)),
        measured_paper=Side(mean=table.mean, u=np.sqrt(table.ms_between * (1 + 1 / table.N))),
        one_way=table,
        bias=bias,
        u_difference=u_difference,
        E_n=bias / (settings.coverage_factor * u_difference),
        p_bias=p_bias,
        p_scatter=p_scatter,
        scatter_ratio=ratio,
        verdicts=tuple(
            _verdict(p_bias[i], p_scatter[i], ratio[i]) for i in range(len(tables.labels))
        ),
    )


def _verdict(p_bias: float, p_scatter: float, ratio: float) -> Verdict:
    """Scatter beyond the prediction comes first: it makes every other statement void."""
    if p_scatter <= FAMILY_RATE and ratio > 1:
        return "under-predicted"
    if p_bias <= FAMILY_RATE:
        return "biased"
    if p_scatter <= FAMILY_RATE:
        return "over-predicted"
    return "consistent"
