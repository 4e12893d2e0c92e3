"""Does the prediction hold? Predicted errors and scatter against those of measured parts: a test of
bias and one of scatter of every item, the scatter of all features pooled, and the verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import needed_covariates, point_columns
from mtu_cli.model.features import guess_warnings, outside_warnings
from mtu_cli.model.machine_model import AXES, MachineModel, design
from mtu_cli.model.measurands import differences, length_measure
from mtu_cli.model.measured import (
    Label,
    MeasuredTables,
    feature_tables,
    judged_axes,
    length_tables,
    missing_entries,
    roundings,
    some,
)
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import aligned, operations_of, visits_of
from mtu_cli.stats.alignment import motion_basis, partial_out
from mtu_cli.stats.anova import OneWay, one_way, only, reml
from mtu_cli.stats.composed_variance import Variance, covariance_of
from mtu_cli.stats.coverage import FAMILY_RATE, holm
from mtu_cli.stats.groups import group_means
from mtu_cli.stats.least_squares import BoolArray, FloatArray, quotient
from mtu_cli.stats.resolution import hidden
from mtu_cli.stats.uncertain_variance import (
    f_tails,
    pooled_p,
    uncertain_variance,
)

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
FAULTS: tuple[Verdict, ...] = ("under-predicted", "biased", "over-predicted")
"""The gravest first: then no statement of uncertainty holds; a correction would mend a bias."""
JOINT_SHARE = 0.2
"""Of the family-wise rate what the pooled tests of all features of an operation may take."""
Answers = tuple[bool | None, ...]
"""One an item; None where it was not tested."""
FEWEST_PARTS = 5
"""With fewer, the scatter of the parts has three degrees of freedom or less: Student's t has
hardly a variance then, and a mean that is off is not separable from parts that scatter."""
ROUNDING = 1e-9
"""Share of an expected MS_between that is rounding: a datum leaves no more of some features."""
NOTHING = 1e-6
"""The same of the variance by the last digit."""
Ends = tuple[float, float]
Predicted = tuple[Prediction, FloatArray]
"""A prediction, and the rows A (items, rows of the prediction) that make items A E of it."""


@dataclass(frozen=True, slots=True)
class Side:
    """One side of the comparison, each (items,), mm: the mean error (actual minus nominal), the
    standard uncertainty u of one part's error about it, U = k u, and the range width
    2 (|mean| + U) of Gilsinn & Ling 2004, Table 10.
    """

    mean: FloatArray
    u: FloatArray
    U: FloatArray
    width: FloatArray

    @classmethod
    def of(cls, mean: FloatArray, variance: FloatArray, k: float) -> Side:
        """With the coverage factor `k`."""
        u = np.sqrt(variance)
        return cls(mean, u, k * u, 2 * (np.abs(mean) + k * u))


class Pooled(NamedTuple):
    """The test of the scatter of all `items` of an operation: `ratio` of the scatter from part to
    part to the predicted one, and two-sided `p`. Once it is judged, p is adjusted over the study,
    and `verdict` says what differs.
    """

    items: int
    ratio: float
    p: float
    verdict: Verdict | None = None


class Summary(NamedTuple):
    """The items of one operation, features or lengths (`kind`).

    `verdicts` counts each item once, by its gravest fault; `faults` every fault, with the least and
    the largest |bias| (mm), or ratio of scatter, of the items that have it.
    """

    kind: str
    operation: str
    items: int
    verdicts: dict[Verdict, int]
    faults: dict[Verdict, tuple[int, Ends | None]]
    pooled: Pooled | None

    @property
    def pooled_fault(self) -> Verdict | None:
        """What the pooled test shows and no item by itself."""
        verdict = None if self.pooled is None else self.pooled.verdict
        return None if verdict is None or self.faults[verdict][0] else verdict


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Items (features by axis, or lengths) with both sides; arrays (items,), mm and mm^2.

    `labels` (operation, id, axis). `independent` is predicted under the papers' independence;
    `measured` is of a future part by components of variance, `measured_paper` takes MS_between for
    the part variance (Gilsinn & Ling 2004, eq. (33), and for lengths eq. (22) on hole variances).

    `bias` = measured minus predicted mean; `u_difference` its standard uncertainty u,

        u^2 = C + (s_part^2 sum n_i^2/N^2 + s_repeat^2/N),

    C the coefficients' variance and s_part^2 the variance from part to part, measured or predicted
    (D + visit), whichever gives more; predicted alone with fewer than FEWEST_PARTS parts. `E_n` =
    bias/(k u) (ISO/IEC 17043:2023, B.3.1.3 e). `p_bias`: two-sided; nan where nothing is predicted
    to scatter and nothing differs. `ratio_ms` = MS_between/(MS_within + n0 (D + visit));
    `p_scatter`: twice the smaller tail of it, nan without MS_between. The other ratios are measured
    over predicted, nan where nothing is predicted; `ms_share` = sqrt(MS_between)/s_part. `pooled`:
    of every operation that can be tested. Once `judged`, p_bias and p_scatter are adjusted over the
    study, and `biased`, `under_predicted`, `over_predicted` say what each test shows.
    """

    labels: tuple[Label, ...]
    predicted: Side
    independent: Side
    measured: Side
    measured_paper: Side
    one_way: OneWay
    s_part: FloatArray
    bias: FloatArray
    u_difference: FloatArray
    E_n: FloatArray
    p_bias: FloatArray
    ratio_ms: FloatArray
    p_scatter: FloatArray
    ratio_u: FloatArray
    ratio_range: FloatArray
    ratio_scatter: FloatArray
    paper_ratio_u: FloatArray
    paper_ratio_range: FloatArray
    ms_share: FloatArray
    pooled: dict[str, Pooled]
    biased: Answers = ()
    under_predicted: Answers = ()
    over_predicted: Answers = ()

    def faults(self, i: int) -> list[Verdict]:
        """Every fault of item `i`, the gravest first."""
        answers = (self.under_predicted, self.biased, self.over_predicted)
        return [name for name, each in zip(FAULTS, answers, strict=True) if each[i]]

    @cached_property
    def verdicts(self) -> tuple[Verdict | None, ...]:
        """The gravest fault of each item, or consistent; None where nothing was tested."""
        pairs = zip(self.biased, self.under_predicted, strict=True)
        return tuple(
            None if answers == (None, None) else (*self.faults(i), "consistent")[0]
            for i, answers in enumerate(pairs)
        )

    @cached_property
    def outcome(self) -> list[str]:
        """Every fault of each item, or the verdict where it has none."""
        return [
            ", ".join(self.faults(i)) or verdict or "not tested"
            for i, verdict in enumerate(self.verdicts)
        ]

    @property
    def by_interest(self) -> list[int]:
        """Items in the order of the smaller p, those with a fault first; of equal p by |E_n|."""
        p = np.nan_to_num(np.fmin(self.p_bias, self.p_scatter), nan=1.0)
        faulty = [verdict not in (None, "consistent") for verdict in self.verdicts]
        size = np.abs(np.nan_to_num(self.E_n))
        return [int(i) for i in np.lexsort((-size, np.where(faulty, p, 2.0)))]

    @cached_property
    def summaries(self) -> list[Summary]:
        """One an operation, in the order in which they come."""

        def ends(values: FloatArray, rows: list[int]) -> Ends | None:
            finite = values[rows][np.isfinite(values[rows])]
            return (float(finite.min()), float(finite.max())) if len(finite) else None

        result = []
        sizes = dict.fromkeys(FAULTS, self.ratio_scatter) | {"biased": np.abs(self.bias)}
        for operation in dict.fromkeys(label[0] for label in self.labels):
            rows = [i for i, label in enumerate(self.labels) if label[0] == operation]
            verdicts = [self.verdicts[i] for i in rows]
            of_fault = {name: [i for i in rows if name in self.faults(i)] for name in FAULTS}
            summary = Summary(
                kind="features" if self.labels[0][2] else "lengths",
                operation=operation,
                items=len(rows),
                verdicts={name: verdicts.count(name) for name in VERDICTS},
                faults={name: (len(i), ends(sizes[name], i)) for name, i in of_fault.items()},
                pooled=self.pooled.get(operation),
            )
            result.append(summary)
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured."""

    features: Compared
    lengths: Compared | None
    datum: Datum
    coverage_factor: float
    warnings: tuple[Finding, ...]

    def failures(self, fault: Verdict) -> list[str] | None:
        """The items with a fault, and operations whose features pooled have it; of few parts a mean
        that is off is either. None where nothing was tested.
        """
        result, tested = list[str](), False
        for kind in filter(None, (self.features, self.lengths)):
            answers = kind.biased if fault == "biased" else kind.under_predicted
            few = kind.one_way.parts < FEWEST_PARTS
            for label, *flags, small in zip(kind.labels, answers, kind.biased, few, strict=True):
                verdicts = flags[: 1 + bool(small)]
                tested |= any(answer is not None for answer in verdicts)
                result += [" ".join(filter(None, label))] if any(verdicts) else []
        pooled = [item for item in self.features.summaries if item.pooled_fault == fault]
        result += [f"{item.operation} features pooled".strip() for item in pooled]
        return result if tested else None


def compare(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    settings: Settings,
    datum: Datum = "none",
    covariates: Mapping[str, float] | None = None,
) -> CompareResult:
    """Gilsinn & Ling 2004, section 5 and Table 10, with tests in place of a look.

    The machine is predicted once an operation, with `covariates` or those of the points: what these
    change from part to part is subtracted from the points. Means and scatter are tested item by
    item (`Compared`), and the scatter of all features at once, as one family (Holm, 5 %): of clean
    studies one in twenty is no "consistent".

    Raises InputError for points that share no axis with the machine, and for a missing covariate
    or one with gaps.
    """
    k, rounding = settings.coverage_factor, roundings(points)
    axes, warnings = judged_axes(model, points, ASIDE)
    predictions, points, notes = predict_operations(model, points, covariates or {})
    tables = feature_tables(aligned(points, axes, datum), axes, rounding)
    names, complete = [AXES[i] for i in axes], True
    of_operation: dict[str, Predicted] = {}
    for operation, prediction in predictions.items():
        n = tables.cells.n[[label[0] == operation for label in tables.labels]]
        complete &= bool((n == n.max(axis=0)).all())
        # Errors of features after the best-fit alignment to the datum.
        columns = [prediction.row(point, name) for point in prediction.ids for name in names]
        places = [
            prediction.ids.index(name) * len(axes) + names.index(axis)
            for op, name, axis in tables.labels
            if op == operation
        ]
        A = np.zeros((len(places), len(prediction.mean)))
        Q = motion_basis(prediction.points, axes, datum)
        A[:, columns] = partial_out(Q, np.eye(len(Q)))[places]
        of_operation[operation] = prediction, A
    kinds = [compared(tables, of_operation, k)]
    if (table := length_tables(points, visits_of(points), part)) is not None:
        ends = {entry.id: (entry.from_, entry.to) for entry in part.part.lengths}
        holes, V_p = kinds[0].labels, kinds[0].one_way.ms_between.tolist()
        # Hole variances less a datum are not those of lengths.
        of_holes = dict(zip(holes, V_p, strict=True)) if datum == "none" else {}
        variances = np.full(len(table.labels), np.nan)
        for operation, prediction in predictions.items():
            rows = [i for i, label in enumerate(table.labels) if label[0] == operation]
            ids = [table.labels[i][1] for i in rows]
            pairs = np.array([[*map(prediction.ids.index, ends[name])] for name in ids])
            pairs = pairs.reshape(-1, 2).astype(np.int64)
            delta = differences(prediction.points, pairs, ids, part.source.shown)
            _, _, A = length_measure(prediction, pairs, delta)
            of_operation[operation] = prediction, A
            labels = [(operation, name, x) for name in prediction.ids for x in prediction.axes]
            V_holes = np.array([of_holes.get(label, np.nan) for label in labels])
            variances[rows] = paper_length_variance(A, V_holes)
        kinds.append(compared(table, of_operation, k, variances))
    kinds = judged(*kinds)
    if datum != "none" and not complete:
        fitted = "the datum is fitted to the features that a part has"
        facts = {"what": "features of some parts", "names": ["--datum"], "consequence": fitted}
        warnings.append(finding("missing-values", **facts))
    return CompareResult(
        features=kinds[0],
        lengths=kinds[1] if kinds[1:] else None,
        datum=datum,
        coverage_factor=k,
        warnings=(*warnings, *notes, *_warnings(part, points, kinds)),
    )


def predict_operations(
    model: MachineModel, points: Points, covariates: Mapping[str, float]
) -> tuple[dict[str, Prediction], Points, list[Finding]]:
    """The prediction of every operation at its features; the points less what their covariates
    change in the modelled error, so that all readings of a feature are of one state of the
    machine; and warnings.

    A covariate is taken from `covariates`, else from the points. Means are over the readings of an
    (operation, feature) at their covariates; uncertainties are those at the covariates' mean.

    Raises InputError for a covariate that nobody gives, and for a column with gaps.
    """
    stated = {name: x for name, x in point_columns(points).items() if name not in covariates}
    values, _ = needed_covariates(model, points, stated, covariates, points.nominal)
    warnings = guess_warnings(model, points.nominal, values)
    measured, along = points.measured.copy(), [AXES.index(name) for name in model.axes]
    vary, a = any(np.ndim(values[name]) for name in model.covariates()), len(along)
    # Of all points: where a drift lags, they are its history.
    errors = design(model, points.nominal, values).mean.reshape(-1, a) if vary else np.zeros((0, a))
    result: dict[str, Prediction] = {}
    operations, operation = operations_of(points)
    for code, name in enumerate(operations):
        rows = np.flatnonzero(operation == code)
        if not len(rows):
            continue
        codes, first, of = np.unique(points.feature[rows], return_index=True, return_inverse=True)
        features, place = [points.features[i] for i in codes], points.nominal[rows[first]]
        means: dict[str, FloatArray | float] = {}
        for key in model.covariates():
            value = values[key]
            if isinstance(value, np.ndarray):
                value = group_means(value[rows], of, len(codes))
            means[key] = value
        prediction = predict(model, features, place, means)
        warnings += outside_warnings(prediction.outside)
        if vary:
            of_feature = group_means(errors[rows], of, len(codes))
            measured[rows[:, None], along] -= errors[rows] - of_feature[of]
            shift = of_feature.ravel() - design(model, place, means).mean
            prediction = replace(prediction, mean=prediction.mean + shift)
        result[name] = prediction
    return result, replace(points, measured=measured) if vary else points, warnings


def compared(
    tables: MeasuredTables,
    predicted: Mapping[str, Predicted],
    k: float,
    holes: FloatArray | None = None,
) -> Compared:
    """All items against the prediction of their operation, whose items are in the order of
    `tables`; `k` the coverage factor; `holes` (items,), of lengths, the variances that eq. (22)
    makes of hole variances, nan where it has none.
    """
    table, components = one_way(tables.cells, tables.rounding), reml(tables.cells)
    separable = np.isfinite(components.part)
    # Without repeats MS_between holds the CMM too, and stands for both.
    part = np.where(separable, components.part, table.ms_between)
    repeat = np.where(np.isfinite(components.repeat), components.repeat, 0.0)
    r = np.broadcast_to(tables.rounding, part.shape)
    rounding = hidden(part + repeat, r)
    of_mean = part * table.share + repeat / table.N
    mean, total, independent, D, u, p_bias, expected, p_scatter = np.zeros((8, len(part)))
    pooled: dict[str, Pooled] = {}
    for operation, (prediction, A) in predicted.items():
        rows = [i for i, label in enumerate(tables.labels) if label[0] == operation]
        if not rows:
            continue
        V, t = prediction.variance(A), only(table, rows)
        mean[rows], total[rows] = A @ prediction.mean, np.maximum(V.total, 0.0)
        independent[rows] = A**2 @ prediction.independent_variance
        D[rows] = np.maximum(V.passes + V.repeatability, 0.0)
        u[rows], p_bias[rows], expected[rows], p_scatter[rows] = _item_tests(
            t, t.mean - mean[rows], V, of_mean[rows], repeat[rows], rounding[rows], r[rows]
        )
        # The scatter of features, of which lengths are made, is pooled; that of the CMM is too
        # little to be seen at one item, and without repeats MS_between holds it.
        valid = np.isfinite(p_scatter[rows]) & (t.n0 * D[rows] > ROUNDING * expected[rows])
        valid &= t.df_within > 0
        if tables.labels[rows[0]][2] and valid.sum() > 1:
            pooled[operation] = _pooled(only(t, valid), expected[rows][valid], prediction, A[valid])
    s_part, bias = np.sqrt(components.part), table.mean - mean
    # V_p(m) (1 + 1/N), eq. (33); of lengths V_p(m) is what eq. (22) makes of hole variances.
    V_p = table.ms_between if holes is None else np.where(np.isnan(holes), table.ms_between, holes)
    model_side, paper_side = Side.of(mean, total, k), Side.of(mean, independent, k)
    measured = Side.of(table.mean, part + of_mean + rounding, k)
    paper = Side.of(table.mean, V_p * (1 + 1 / table.N), k)
    # Scatter where none at all is predicted is infinitely more.
    endless = (expected == 0) & (table.ms_between > 0)
    return Compared(
        labels=tables.labels,
        predicted=model_side,
        independent=paper_side,
        measured=measured,
        measured_paper=paper,
        one_way=table,
        s_part=s_part,
        bias=bias,
        u_difference=u,
        E_n=quotient(bias, k * u),
        p_bias=p_bias,
        ratio_ms=np.where(endless, inf, quotient(table.ms_between, expected)),
        p_scatter=p_scatter,
        ratio_u=quotient(measured.u, model_side.u),
        ratio_range=quotient(measured.width, model_side.width),
        ratio_scatter=quotient(np.sqrt(part), np.sqrt(D)),
        paper_ratio_u=quotient(paper.u, paper_side.u),
        paper_ratio_range=quotient(paper.width, paper_side.width),
        ms_share=quotient(np.sqrt(table.ms_between), s_part),
        pooled=pooled,
    )


def _item_tests(
    t: OneWay, bias: FloatArray, V: Variance, of_mean: FloatArray, repeat: FloatArray,
    rounding: FloatArray, r: FloatArray,
) -> FloatArray:  # fmt: skip
    """Each (items,): u of the difference of the means, and p of it against C and the scatter of the
    mean, of which `of_mean` is the measured variance, and what the last digit hides (`rounding`);
    MS_within + n0 D, of which MS_between has the expectation, and p of their ratio: n0 r by the
    last digit, of variance `r`, is neither more nor less scatter.
    """
    D, ms, squares = np.maximum(V.passes + V.repeatability, 0.0), t.ms_between, V.squares
    cmm = repeat / t.N
    expected_mean = D * t.share + cmm
    by_parts = (t.parts >= FEWEST_PARTS) & (of_mean >= expected_mean)
    known = np.full(len(bias), inf)
    variance = uncertain_variance(
        squares.of_mean + np.where(by_parts, 0.0, t.share) * squares.of_part,
        squares.dof,
        (rounding, known),
        (np.where(by_parts, of_mean, 0.0), t.df_between),
        (np.where(by_parts, 0.0, cmm), t.df_within),
    )
    u2 = np.maximum(V.coefficients, 0.0) + np.where(by_parts, of_mean, expected_mean)
    nothing = (u2 <= NOTHING * rounding) & (bias**2 < 3 * rounding)
    p_bias = np.where(nothing, np.nan, f_tails(bias**2, np.ones_like(bias), variance)[0])
    repeated = t.df_within > 0
    within, n0 = np.where(repeated, t.ms_within, 0.0), np.where(t.df_between > 0, t.n0, 0.0)
    hidden_ms = n0 * hidden(np.where(repeated, within, D), r)
    variance = uncertain_variance(
        n0 * squares.of_part, squares.dof, (hidden_ms, known), (within, t.df_within)
    )
    expected = within + n0 * D + hidden_ms
    high, _ = f_tails(ms, t.df_between, variance)
    _, low = f_tails(ms + hidden_ms * (ms < 3 * hidden_ms), t.df_between, variance)
    nothing = (expected - hidden_ms <= NOTHING * hidden_ms) & (ms < 3 * hidden_ms)
    p_scatter = np.where(nothing, np.nan, np.minimum(2 * np.fmin(high, low), 1.0))
    return np.array([np.sqrt(u2 + rounding), p_bias, expected, p_scatter])


def _pooled(t: OneWay, expected: FloatArray, prediction: Prediction, A: FloatArray) -> Pooled:
    """The test of the scatter of features A E with their tables and `expected` MS_between. Less the
    share w of the CMM the mean T of the ratios is of the parts alone: `ratio`^2 = (T - w)/(1 - w).
    """
    df, weights, within = t.df_between, t.n0 / expected, t.ms_within / expected
    # Of part means relative to their variance; the CMM is in the variances alone.
    of_part = covariance_of(prediction.blocks, len(prediction.axes), coefficients=0.0)
    correlation = (A @ of_part @ A.T) * np.sqrt(weights * weights[:, None])
    np.fill_diagonal(correlation, 1.0)
    squares = prediction.variance(A).squares
    times = [1.0 if each is None else each.independent(weights)
             for each in squares.passes]  # fmt: skip
    denominator = float((within**2 / t.df_within).sum())
    cmm = float(within.sum()) ** 2 / denominator if denominator else inf
    rows = np.append((squares.of_part * weights).mean(axis=1), within.mean())
    ratios, w = t.ms_between / expected, float(within.mean())
    p = pooled_p(
        ratios,
        correlation,
        2.0 * correlation**2 / np.maximum(df, df[:, None]),
        uncertain_variance(rows[:, None], np.append(squares.dof * times, cmm)),
    )
    ratio = float(np.sqrt(max(float(ratios.mean()) - w, 0.0) / (1 - w)))
    return Pooled(items=len(ratios), ratio=ratio, p=p)


def paper_length_variance(gradient: FloatArray, holes: FloatArray, N: float = inf) -> FloatArray:
    """Variance of lengths as Tables 8 and 9 have it: eq. (22), the `gradient` (..., rows), on the
    hole variances V_p(m) (rows,), times (1 + 1/N) for a future measurement, eq. (33). It is not
    the scatter of measured lengths: it takes V_p(m) for the part variance and the two ends for
    independent.
    """
    return np.where(gradient == 0, 0.0, gradient**2 * holes).sum(axis=-1) * (1 + 1 / N)


def judged(features: Compared, *lengths: Compared) -> list[Compared]:
    """Verdicts at a family-wise rate of 5 % over bias and scatter of features and lengths.

    The pooled tests of all features of an operation have JOINT_SHARE of the rate to themselves
    (weighted Bonferroni): among a hundred others they would see no more than these.
    """
    kinds = [features, *lengths]
    p = np.concatenate([np.stack([kind.p_bias, kind.p_scatter]) for kind in kinds], axis=1)
    share = JOINT_SHARE if features.pooled else 0.0
    adjusted = np.minimum(holm(p.ravel()) / (1 - share), 1.0).reshape(2, -1)
    pooled = {}
    p_pooled = holm(np.array([x.p for x in features.pooled.values()])) / JOINT_SHARE
    for (name, each), p_test in zip(features.pooled.items(), p_pooled.tolist(), strict=True):
        way: Verdict = "under-predicted" if each.ratio > 1 else "over-predicted"
        verdict = way if p_test <= FAMILY_RATE else None
        pooled[name] = each._replace(p=min(p_test, 1.0), verdict=verdict)
    result = list[Compared]()
    of_kinds = np.split(adjusted, [len(features.labels)], axis=1)[: len(kinds)]
    for kind, p in zip((replace(features, pooled=pooled), *lengths), of_kinds, strict=True):
        bias, scatter = p <= FAMILY_RATE
        under, over = scatter & (kind.ratio_ms > 1), scatter & ~(kind.ratio_ms > 1)
        # Parts too few to measure their scatter, but known to scatter more, explain a biased mean.
        bias &= ~((kind.one_way.parts < FEWEST_PARTS) & under)
        tests = {"biased": (bias, p[0]), "under_predicted": (under, p[1]),
                 "over_predicted": (over, p[1])}  # fmt: skip
        answers: dict[str, Any] = {
            name: tuple(np.where(np.isfinite(of), mask, np.array(None)).tolist())
            for name, (mask, of) in tests.items()
        }
        result.append(replace(kind, p_bias=p[0], p_scatter=p[1], **answers))
    return result


ASIDE = "the points are not compared there, and lengths have no predicted error along it"
SCATTER = "means are judged by the predicted scatter, and one that is off may be scatter"
CONDITIONS: tuple[tuple[str, Callable[[Compared], BoolArray], dict[str, Any]], ...] = (
    ("few-parts", lambda x: x.one_way.parts < FEWEST_PARTS, {"consequence": SCATTER}),
    (
        "no-repeats",
        lambda x: (x.one_way.df_within < 1) & (x.one_way.parts > 1),
        {"consequence": "MS_between contains the scatter of the CMM, which is not predicted"},
    ),
    (
        "not-tested",
        lambda x: np.array([verdict is None for verdict in x.verdicts]),
        {"what": "the difference", "reason": "no scatter is measured and none predicted"},
    ),
    (
        "not-estimable",
        lambda x: ~(x.predicted.u > 0),
        {"quantity": "ratios to the predicted scatter", "reason": "no uncertainty is predicted"},
    ),
    (
        "not-estimable",
        lambda x: (x.s_part == 0) & (x.one_way.parts > 1),
        {"quantity": "the parts' share of MS_between", "reason": "they do not scatter"},
    ),
)


def _warnings(part: LoadedPart, points: Points, kinds: Sequence[Compared]) -> Iterator[Finding]:
    """What was not compared, and what parts, repeats and predictions are too few for."""
    missing = [f"feature {name}" for name in part.part.features if name not in points.features]
    labels = [label for kind in kinds for label in kind.labels]
    lengths = [label for label in labels if not label[2]]
    yield from missing_entries("length", part.part.lengths, lengths)
    if missing:
        yield finding("not-measured", names=missing, reason="not among the points")
    for code, condition, facts in CONDITIONS:
        rows = np.concatenate([condition(kind) for kind in kinds])
        if code == "few-parts":
            facts = facts | {"parts": int(min(kind.one_way.parts.min() for kind in kinds))}
        names = dict.fromkeys(labels[i][1] for i in np.flatnonzero(rows))
        of = {"names": [*names]} if code == "not-estimable" else {"items": some(rows, "items")}
        if names:
            yield finding(code, **of, **facts)
