"""The tests of bias and of scatter, by item and pooled by operation, and their verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import inf
from typing import Any, Literal, get_args

import numpy as np

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.variance import MeanSquares, Variance
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.anova import OneWay, one_way
from mtu_cli.stats.family import FAMILY_RATE, holm
from mtu_cli.stats.least_squares import BoolArray, FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.resolution import hidden
from mtu_cli.stats.uncertain_variance import (
    UncertainVariance,
    f_tails,
    mean_square_tails,
    t_tail,
    uncertain_variance,
)

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted"]
FAULTS: tuple[Verdict, ...] = ("under-predicted", "biased", "over-predicted")
"""The gravest first: then no statement of uncertainty holds; a correction would mend a bias."""
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
JOINT_SHARE = 0.2
"""Of that rate what the pooled tests of all features of an operation may take."""
Answers = tuple[bool | None, ...]
"""One an item; None where it was not tested."""
FEWEST_PARTS = 5
"""With fewer, the scatter of the parts has three degrees of freedom or less: Student's t has
hardly a variance then, and a mean that is off is not separable from parts that scatter."""
ROUNDING = 1e-9
"""Share of an expected MS_between that is rounding: a datum leaves no more of some features."""
NOTHING = 1e-6
"""The same of the variance by the last digit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One side of the comparison, each (items,), mm: the mean error (actual minus nominal), the
    standard uncertainty u of one part's error about it, U = k u, and the range width
    2 (|mean| + U) of Gilsinn & Ling 2004, Table 10.
    """

    mean: FloatArray
    u: FloatArray
    U: FloatArray
    width: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Pooled:
    """The test of the scatter of all `items` of an operation: `ratio` of the scatter from part to
    part to the predicted one, and two-sided `p`. Once it is judged, p is adjusted over the study,
    and `verdict` says what differs.
    """

    items: int
    ratio: float
    p: float
    operation: str = ""
    verdict: Verdict | None = None


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

    labels: tuple[tuple[str, str, str], ...]
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
    pooled: tuple[Pooled, ...]
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
        tested = zip(self.biased, self.under_predicted, strict=True)
        return tuple(
            None if answers == (None, None) else (*self.faults(i), "consistent")[0]
            for i, answers in enumerate(tested)
        )

    def stated(self, i: int) -> str:
        """Every fault of item `i`, or the verdict where it has none."""
        return ", ".join(self.faults(i)) or self.verdicts[i] or "not tested"

    def by_interest(self) -> list[int]:
        """Items with a fault, the clearest first, then those of the largest |E_n|: parts that
        scatter too much may lie where they should in the mean.
        """
        faulty = [verdict not in (None, "consistent") for verdict in self.verdicts]
        p = np.nan_to_num(np.fmin(self.p_bias, self.p_scatter), nan=1.0)
        size = np.abs(np.nan_to_num(self.E_n))
        order: list[int] = np.lexsort((-size, np.where(faulty, p, 2.0))).tolist()
        return order


def compared(
    tables: MeasuredTables,
    prediction: Prediction,
    A: FloatArray,
    k: float,
    holes: FloatArray | None = None,
) -> Compared:
    """The items A E of one operation, in the order of `tables`, against their prediction.

    `A` (items, rows of the prediction); `k` the coverage factor; `holes` (items,), of lengths, the
    variances that eq. (22) makes of hole variances, nan where it has none. The scatter of
    features, of which lengths are made, is pooled.
    """
    table, components = one_way(tables.cells, tables.rounding), reml(tables.cells)
    V = prediction.variance(A)
    D = np.maximum(V.passes + V.repeatability, 0.0)
    spread = (tables.cells.n**2).sum(axis=1) / table.N**2
    separable = np.isfinite(components.part)
    # Without repeats MS_between holds the CMM too, and stands for both.
    part = np.where(separable, components.part, table.ms_between)
    repeat = np.where(np.isfinite(components.repeat), components.repeat, 0.0)
    rounding = hidden(part + repeat, tables.rounding)
    of_mean = part * spread + repeat / table.N
    s_part = np.sqrt(np.where(separable, components.part, np.nan))
    # V_p(m) (1 + 1/N), eq. (33); of lengths V_p(m) is what eq. (22) makes of hole variances.
    V_p = table.ms_between if holes is None else np.where(np.isnan(holes), table.ms_between, holes)
    predicted = _side(A @ prediction.mean, np.maximum(V.total, 0.0), k)
    independent = _side(predicted.mean, A**2 @ prediction.independent_variance, k)
    measured = _side(table.mean, part + of_mean + rounding, k)
    paper = _side(table.mean, V_p * (1 + 1 / table.N), k)
    bias = measured.mean - predicted.mean
    u_difference, p_bias = _bias_test(bias, table, V, spread, of_mean, repeat, rounding)
    expected, p_scatter = _scatter_test(table, tables.rounding, D, V.squares)
    # Scatter where none at all is predicted is infinitely more.
    endless = (expected == 0) & (table.ms_between > 0)
    kept = np.isfinite(p_scatter) & (table.n0 * D > ROUNDING * expected) & (table.df_within > 0)
    return Compared(
        labels=tables.labels,
        predicted=predicted,
        independent=independent,
        measured=measured,
        measured_paper=paper,
        one_way=table,
        s_part=s_part,
        bias=bias,
        u_difference=u_difference,
        E_n=ratio(bias, k * u_difference),
        p_bias=p_bias,
        ratio_ms=np.where(endless, inf, ratio(table.ms_between, expected)),
        p_scatter=p_scatter,
        ratio_u=ratio(measured.u, predicted.u),
        ratio_range=ratio(measured.width, predicted.width),
        ratio_scatter=ratio(np.sqrt(part), np.sqrt(D)),
        paper_ratio_u=ratio(paper.u, independent.u),
        paper_ratio_range=ratio(paper.width, independent.width),
        ms_share=ratio(np.sqrt(table.ms_between), s_part),
        # Without repeats MS_between holds the CMM's scatter: too little to be seen at one item.
        pooled=_pooled(tables, table, expected, prediction, A, kept) if kept.sum() > 1 else (),
    )


def joined(found: Sequence[Any], order: IntArray) -> Any:
    """Items of several operations as one, its items in this `order`."""
    first = found[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(found)[order]
    if not isinstance(first, tuple):
        of = {x.name: [getattr(each, x.name) for each in found] for x in fields(first)}
        return type(first)(**{name: joined(each, order) for name, each in of.items()})
    every = tuple(item for each in found for item in each)
    return tuple(every[i] for i in order) if len(every) == len(order) else every


def _side(mean: FloatArray, variance: FloatArray, k: float) -> Side:
    u = np.sqrt(variance)
    return Side(mean=mean, u=u, U=k * u, width=2 * (np.abs(mean) + k * u))


def ratio(measured: FloatArray, predicted: FloatArray) -> FloatArray:
    """measured/predicted (items,), nan where nothing is predicted to compare with."""
    result = np.full(len(measured), np.nan)
    np.divide(measured, predicted, out=result, where=predicted > 0)
    return result


def _bias_test(
    bias: FloatArray,
    table: OneWay,
    V: Variance,
    spread: FloatArray,
    seen: FloatArray,
    repeat: FloatArray,
    rounding: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """u of the difference of the means, and p of it against C and the scatter of the mean, of
    which `seen` (items,) is the measured variance, and what the last digit hides (`rounding`).
    """
    cmm = repeat / table.N
    expected = np.maximum(V.passes + V.repeatability, 0.0) * spread + cmm
    by_parts = (table.parts >= FEWEST_PARTS) & (seen >= expected)
    variance = _variance(
        V.squares.of_mean + np.where(by_parts, 0.0, spread) * V.squares.of_part,
        V.squares.dof,
        (np.where(by_parts, seen, 0.0), table.df_between),
        (np.where(by_parts, 0.0, cmm), table.df_within),
        rounding=rounding,
    )
    u2 = np.maximum(V.coefficients, 0.0) + np.where(by_parts, seen, expected)
    nothing = (u2 <= NOTHING * rounding) & (bias**2 < 3 * rounding)
    return np.sqrt(u2 + rounding), np.where(nothing, np.nan, t_tail(bias, variance))


def _scatter_test(
    table: OneWay, r: FloatArray, D: FloatArray, squares: MeanSquares
) -> tuple[FloatArray, FloatArray]:
    """MS_within + n0 D, of which MS_between has the expectation, and p of their ratio; n0 r by the
    last digit, of variance `r` (items,), is neither more nor less scatter.
    """
    repeated, ms, df = table.df_within > 0, table.ms_between, table.df_between
    within = np.where(repeated, table.ms_within, 0.0)
    n0 = np.where(df > 0, table.n0, 0.0)
    rounding = n0 * hidden(np.where(repeated, within, D), r)
    cmm = within, table.df_within
    variance = _variance(n0 * squares.of_part, squares.dof, cmm, rounding=rounding)
    expected = within + n0 * D + rounding
    high, _ = f_tails(ms, df, variance)
    _, low = f_tails(ms + rounding * (ms < 3 * rounding), df, variance)
    nothing = (expected - rounding <= NOTHING * rounding) & (ms < 3 * rounding)
    return expected, np.where(nothing, np.nan, np.minimum(2 * np.fmin(high, low), 1.0))


def _variance(
    squares: FloatArray,
    dof: FloatArray,
    *more: tuple[FloatArray, FloatArray],
    rounding: FloatArray,
) -> UncertainVariance:
    """A sum of mean squares (K, items) of `dof` (K,); of `more`, each item with degrees of freedom
    of its own; and of `rounding` (items,), which is known.
    """
    rows, known = [squares, rounding[None]], [dof, np.array([inf])]
    for values, own in more:
        numbers = np.unique(own[(values > 0) & (own > 0)])
        rows.append(np.where(own == numbers[:, None], values, 0.0))
        known.append(numbers)
    return uncertain_variance(np.concatenate(rows), np.concatenate(known))


def _pooled(
    tables: MeasuredTables,
    table: OneWay,
    expected: FloatArray,
    prediction: Prediction,
    A: FloatArray,
    kept: BoolArray,
) -> tuple[Pooled, ...]:
    """The test of the scatter of the `kept` features; of lengths there is none."""
    operation, _, axis = tables.labels[0]
    if not axis:
        return ()
    A, df, weights = A[kept], table.df_between[kept], table.n0[kept] / expected[kept]
    # Of part means relative to their variance; the CMM is in the variances alone.
    correlation = (A @ prediction.scatter @ A.T) * np.sqrt(weights * weights[:, None])
    np.fill_diagonal(correlation, 1.0)
    squares = prediction.variance(A).squares
    passes = prediction.pass_squares(A)
    times = [1.0 if each is None else each.independent(weights) for each in passes]
    within = table.ms_within[kept] / expected[kept]
    of_cmm = within > 0
    unsure = float((within[of_cmm] ** 2 / table.df_within[kept][of_cmm]).sum())
    cmm = float(within.sum()) ** 2 / unsure if unsure else inf
    rows = np.append((squares.of_part * weights).mean(axis=1), within.mean())
    test = pooled_test(
        table.ms_between[kept] / expected[kept],
        correlation,
        2.0 * correlation**2 / np.maximum(df, df[:, None]),
        (rows[:, None], np.append(squares.dof * times, cmm)),
        float(within.mean()),
    )
    return (replace(test, operation=operation),)


def pooled_test(
    ratios: FloatArray,
    correlation: FloatArray,
    shared: FloatArray,
    squares: tuple[FloatArray, FloatArray],
    w: float,
) -> Pooled:
    """The mean T of m `ratios` MS_between/expectation.

    `correlation` (m, m) is that of the means of one part, `shared` (m, m) the covariance of any
    two ratios if the expectations are right, whose mean has the mean `squares` (K, 1) and degrees
    of freedom (K,); w is the share of the CMM in it. Of normal errors T is a sum of chi-squared
    variables whose sizes are the eigenvalues of the correlation; where items lack parts its degrees
    of freedom are those that give its variance, the mean of `shared`. Less the CMM's share T is of
    the parts alone: `ratio`^2 = (T - w)/(1 - w).
    """
    T = float(ratios.mean())
    sizes = np.maximum(np.linalg.eigvalsh(correlation), 0.0)
    dof = 2.0 * float((correlation**2).mean() / shared.mean())
    variance = uncertain_variance(*squares)
    high, low = mean_square_tails(T, sizes, dof, variance)
    return Pooled(
        items=len(ratios),
        ratio=float(np.sqrt(max(T - w, 0.0) / (1 - w))),
        p=min(2 * min(high, low), 1.0),
    )


def paper_length_variance(gradient: FloatArray, holes: FloatArray, N: float = inf) -> FloatArray:
    """Variance of lengths as Tables 8 and 9 have it: eq. (22), the `gradient` (..., rows), on the
    hole variances V_p(m) (rows,), times (1 + 1/N) for a future measurement, eq. (33). It is not
    the scatter of measured lengths: it takes V_p(m) for the part variance and the two ends for
    independent.
    """
    total: FloatArray = np.where(gradient == 0, 0.0, gradient**2 * holes).sum(axis=-1)
    return total * (1 + 1 / N)


def judged(features: Compared, lengths: Compared | None) -> tuple[Compared, Compared | None]:
    """Verdicts at a family-wise rate of 5 % over bias and scatter of features and lengths.

    The pooled tests of all features of an operation have JOINT_SHARE of the rate to themselves
    (weighted Bonferroni): among a hundred others they would see no more than these.
    """
    kinds = [features] if lengths is None else [features, lengths]
    p = np.concatenate([np.stack([kind.p_bias, kind.p_scatter]) for kind in kinds], axis=1)
    share = JOINT_SHARE if features.pooled else 0.0
    adjusted = np.minimum(holm(p.ravel()) / (1 - share), 1.0).reshape(2, -1)
    pooled = []
    p_pooled = holm(np.array([x.p for x in features.pooled])) / JOINT_SHARE
    for each, own in zip(features.pooled, np.minimum(p_pooled, 1.0).tolist(), strict=True):
        way: Verdict = "under-predicted" if each.ratio > 1 else "over-predicted"
        pooled.append(replace(each, p=own, verdict=way if own <= FAMILY_RATE else None))
    n = len(features.labels)
    features = _judged(replace(features, pooled=tuple(pooled)), adjusted[:, :n])
    return features, None if lengths is None else _judged(lengths, adjusted[:, n:])


def _judged(kind: Compared, p: FloatArray) -> Compared:
    """The verdicts by the adjusted p (2, items) of bias and scatter."""
    off, scatter = p <= FAMILY_RATE
    under, over = scatter & (kind.ratio_ms > 1), scatter & ~(kind.ratio_ms > 1)
    # Parts too few to measure their scatter, but known to scatter more, explain a mean that is off.
    off &= ~((kind.one_way.parts < FEWEST_PARTS) & under)

    def answers(met: BoolArray, q: FloatArray) -> Answers:
        pairs = zip(met.tolist(), np.isfinite(q).tolist(), strict=True)
        return tuple(yes if tested else None for yes, tested in pairs)

    return replace(
        kind,
        p_bias=p[0],
        p_scatter=p[1],
        biased=answers(off, p[0]),
        under_predicted=answers(under, p[1]),
        over_predicted=answers(over, p[1]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The items of one operation, features or lengths (`kind`).

    `verdicts` counts each item once, by its gravest fault; `biased`, `under_predicted` and
    `over_predicted` every fault. `ranges` are the least and the largest known of the ratios of u,
    range and scatter, of `ratio_scatter` of the items under- and over-predicted (`under_factor`,
    `over_factor`) and of |bias| of the biased (`bias_size`, mm).
    """

    kind: str
    operation: str
    items: int
    verdicts: dict[Verdict, int]
    biased: int
    under_predicted: int
    over_predicted: int
    ranges: Mapping[str, tuple[float, float]]
    pooled: Pooled | None

    @property
    def pooled_fault(self) -> Verdict | None:
        """What the pooled test shows and no item by itself."""
        alone = {"under-predicted": self.under_predicted, "over-predicted": self.over_predicted}
        verdict = None if self.pooled is None else self.pooled.verdict
        return None if verdict is None or alone[verdict] else verdict


def summarised(found: Compared, kind: str = "features") -> tuple[Summary, ...]:
    """One entry an operation, in the order in which they come."""
    result = []
    for operation in dict.fromkeys(label[0] for label in found.labels):
        rows = [i for i, label in enumerate(found.labels) if label[0] == operation]
        verdicts, scatter = [found.verdicts[i] for i in rows], found.ratio_scatter[rows]
        faults = (found.biased, found.under_predicted, found.over_predicted)
        biased, under, over = (np.array([each[i] is True for i in rows]) for each in faults)
        values = {
            "ratio_u": found.ratio_u[rows],
            "ratio_range": found.ratio_range[rows],
            "ratio_scatter": scatter,
            "under_factor": scatter[under],
            "over_factor": scatter[over],
            "bias_size": np.abs(found.bias[rows][biased]),
        }
        known = {name: each[np.isfinite(each)] for name, each in values.items()}
        summary = Summary(
            kind=kind,
            operation=operation,
            items=len(rows),
            verdicts={name: verdicts.count(name) for name in VERDICTS},
            biased=int(biased.sum()),
            under_predicted=int(under.sum()),
            over_predicted=int(over.sum()),
            ranges={name: (float(x.min()), float(x.max())) for name, x in known.items() if len(x)},
            pooled=next((item for item in found.pooled if item.operation == operation), None),
        )
        result.append(summary)
    return tuple(result)
