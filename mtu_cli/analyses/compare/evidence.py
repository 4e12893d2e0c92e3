"""The tests of bias and of scatter, by item and pooled by operation, before any verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.variance import MeanSquares, PassSquare
from mtu_cli.stats.anova import OneWay, one_way
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.resolution import hidden
from mtu_cli.stats.uncertain_variance import f_tails, mean_square_tails, t_tail, uncertain_variance

FEWEST_PARTS = 5
"""With fewer, the scatter of the parts has three degrees of freedom or less: Student's t has
hardly a variance then, and a mean that is off is not separable from parts that scatter."""
HOPELESS = 10.0
"""A scatter test that would not see scatter of so many times the predicted is withheld."""
ROUNDING = 1e-9
"""Share of an expected MS_between."""
NOTHING = 1e-6
"""Of the variance by the last digit: what is less than that is the rounding of the arithmetic, such
as a datum leaves of some features."""

Label = tuple[str, str, str]
"""Operation, feature or length, axis."""


class Joint(NamedTuple):
    """How m items are predicted to scatter together: their `covariance` (m, m), mm^2, the mean
    `squares` behind it and those of them that are of `passes`.
    """

    covariance: FloatArray
    squares: MeanSquares
    passes: Sequence[PassSquare | None]

    def only(self, kept: NDArray[np.bool_]) -> Joint:
        """The same of the items `kept` (m,)."""
        of_mean, of_part = self.squares.of_mean[:, kept], self.squares.of_part[:, kept]
        passes = [each and PassSquare(each.g[kept], each.S) for each in self.passes]
        squares = MeanSquares(of_mean=of_mean, of_part=of_part, dof=self.squares.dof)
        return Joint(self.covariance[np.ix_(kept, kept)], squares, passes)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedItems:
    """The predicted items, each (items,); mm and mm^2.

    `mean`; variance of one future part, `total` = `coefficients` (shared by all parts) +
    `scatter` (from part to part: passes and visits), and under the papers' independence,
    `independent`. `of_mean` and `of_part` (K, items) are the mean squares of `dof` (K,) behind
    coefficients and scatter (see `variance.MeanSquares`). `holes` is g'V g of the measured
    hole variances V, for lengths; nan where there are none. `joint` has the common scatter of
    the features of each operation, in their order; lengths, which are made of features, have none.
    """

    mean: FloatArray
    total: FloatArray
    coefficients: FloatArray
    scatter: FloatArray
    independent: FloatArray
    holes: FloatArray
    of_mean: FloatArray
    of_part: FloatArray
    dof: FloatArray
    joint: Mapping[str, Joint]


@dataclass(frozen=True, slots=True, kw_only=True)
class PooledTest:
    """One test of the scatter of `items`: `ratio`, the scatter from part to part over the predicted
    one, two-sided `p`, and `p_hopeless`, that of the scatter that any test should see.
    """

    items: int
    ratio: float
    p: float
    p_hopeless: float


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
class Evidence:
    """Items (features by axis, or lengths) with both sides; arrays (items,), mm and mm^2.

    `labels` (operation, id, axis). `measured` is of a future part by components of variance,
    `measured_paper` takes MS_between for the part variance (Gilsinn & Ling 2004, eq. (33), and
    for lengths eq. (22) on hole variances).

    `bias` = measured minus predicted mean; `u_difference` its standard uncertainty u,

        u^2 = C + (s_part^2 sum n_i^2/N^2 + s_repeat^2/N),

    C the coefficients' variance and s_part^2 the variance from part to part, measured or
    predicted (D + visit), whichever gives more; predicted alone with fewer than FEWEST_PARTS
    parts. `E_n` = bias/(k u) (ISO/IEC 17043:2023, B.3.1.3 e, with the measured mean as the
    reference). `p_bias`: two-sided, by the mean squares behind C and the scatter; nan where
    nothing is predicted to scatter and nothing differs.

    `ms_expected` = MS_within + n0 (D + visit); `ratio_ms` = MS_between/ms_expected. `p_scatter`
    is twice the smaller tail of it, MS_between having df_between degrees of freedom (parts - 1)
    and ms_expected those of the mean squares that it consists of: Fisher's F where it is one.
    `p_hopeless`: what a ratio of HOPELESS^2 would have. nan without MS_between.

    Ratios are measured over predicted, nan where nothing is predicted: `ratio_u` and
    `ratio_range` of `u` and `width`, `paper_ratio_u` and `paper_ratio_range` of the paper's
    own two sides, `ratio_scatter` of s_part and the root of (D + visit). `ms_share` =
    sqrt(MS_between)/s_part says how much of the paper's scatter is not the parts'. `pooled_tests`
    are of the pooled scatter of all items of an operation.
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
    ms_expected: FloatArray
    ratio_ms: FloatArray
    p_scatter: FloatArray
    p_hopeless: FloatArray
    ratio_u: FloatArray
    ratio_range: FloatArray
    ratio_scatter: FloatArray
    paper_ratio_u: FloatArray
    paper_ratio_range: FloatArray
    ms_share: FloatArray
    pooled_tests: Mapping[str, PooledTest]


def evidence(tables: MeasuredTables, items: PredictedItems, k: float) -> Evidence:
    """The items of `tables` against their prediction; k the coverage factor."""
    table, components = one_way(tables.cells, tables.rounding), reml(tables.cells)
    spread = (tables.cells.n**2).sum(axis=1) / table.N**2
    separable = np.isfinite(components.part)
    # Without repeats MS_between holds the CMM too, and stands for both.
    part = np.where(separable, components.part, table.ms_between)
    repeat = np.where(np.isfinite(components.repeat), components.repeat, 0.0)
    rounding = hidden(part + repeat, tables.rounding)
    of_mean = part * spread + repeat / table.N
    bias = table.mean - items.mean
    u_difference, p_bias = _bias_test(bias, table, repeat, spread, of_mean, rounding, items)
    expected, ratio_ms, p_scatter, p_hopeless = _scatter_test(table, tables.rounding, items)
    predicted = _side(items.mean, items.total, k)
    independent = _side(items.mean, items.independent, k)
    measured = _side(table.mean, part + of_mean + rounding, k)
    # V_p(m) (1 + 1/N), eq. (33); of lengths V_p(m) is what eq. (22) makes of hole variances.
    V = np.where(np.isfinite(items.holes), items.holes, table.ms_between)
    paper = _side(table.mean, V * (1 + 1 / table.N), k)
    s_part = np.sqrt(np.where(separable, components.part, np.nan))
    return Evidence(
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
        ms_expected=expected,
        ratio_ms=ratio_ms,
        p_scatter=p_scatter,
        p_hopeless=p_hopeless,
        ratio_u=ratio(measured.u, predicted.u),
        ratio_range=ratio(measured.width, predicted.width),
        ratio_scatter=ratio(np.sqrt(part), np.sqrt(items.scatter)),
        paper_ratio_u=ratio(paper.u, independent.u),
        paper_ratio_range=ratio(paper.width, independent.width),
        ms_share=ratio(np.sqrt(table.ms_between), s_part),
        pooled_tests=_pooled_tests(tables.labels, table, items, expected, p_scatter),
    )


def _side(mean: FloatArray, variance: FloatArray, k: float) -> Side:
    u = np.sqrt(variance)
    return Side(mean=mean, u=u, U=k * u, width=2 * (np.abs(mean) + k * u))


def ratio(measured: FloatArray, predicted: FloatArray) -> FloatArray:
    """measured/predicted (items,), nan where nothing is predicted to compare with."""
    found = np.full(len(measured), np.nan)
    np.divide(measured, predicted, out=found, where=predicted > 0)
    return found


def _bias_test(
    bias: FloatArray,
    table: OneWay,
    repeat: FloatArray,
    spread: FloatArray,
    seen: FloatArray,
    rounding: FloatArray,
    items: PredictedItems,
) -> tuple[FloatArray, FloatArray]:
    """u of the difference of the means, and p of it against C and the scatter of the mean, of
    which `seen` (items,) is the measured variance, and what the last digit hides (`rounding`).
    """
    predicted = items.scatter * spread + repeat / table.N
    by_parts = (table.parts >= FEWEST_PARTS) & (seen >= predicted)
    of_parts, parts_dof = _by_dof(np.where(by_parts, seen, 0.0), table.df_between)
    cmm, cmm_dof = _by_dof(np.where(by_parts, 0.0, repeat / table.N), table.df_within)
    squares = items.of_mean + np.where(by_parts, 0.0, spread) * items.of_part
    variance = uncertain_variance(
        np.concatenate([squares, of_parts, cmm, rounding[None]]),
        np.concatenate([items.dof, parts_dof, cmm_dof, [inf]]),
    )
    u2 = items.coefficients + np.where(by_parts, seen, predicted)
    nothing = (u2 <= NOTHING * rounding) & (bias**2 < 3 * rounding)
    return np.sqrt(u2 + rounding), np.where(nothing, np.nan, t_tail(bias, variance))


def _scatter_test(
    table: OneWay, r: FloatArray, items: PredictedItems
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """MS_within + n0 (D + visit), of which MS_between has the expectation; their ratio, its p and
    that of a ratio of HOPELESS^2. The last digit, of variance `r` (items,), may make of the
    expectation, or hide from MS_between, n0 r: neither is more or less scatter.
    """
    repeated = table.df_within > 0
    within = np.where(repeated, table.ms_within, 0.0)
    n0 = np.where(table.df_between > 0, table.n0, 0.0)
    cmm, cmm_dof = _by_dof(within, table.df_within)
    rounding = n0 * hidden(np.where(repeated, within, items.scatter), r)
    variance = uncertain_variance(
        np.concatenate([n0 * items.of_part, cmm, rounding[None]]),
        np.concatenate([items.dof, cmm_dof, [inf]]),
    )
    expected = within + n0 * items.scatter + rounding
    high, _ = f_tails(table.ms_between, table.df_between, variance)
    least = table.ms_between + rounding * (table.ms_between < 3 * rounding)
    _, low = f_tails(least, table.df_between, variance)
    hopeless, _ = f_tails(HOPELESS**2 * expected, table.df_between, variance)
    found = ratio(table.ms_between, expected)
    # Scatter where none at all is predicted is infinitely more.
    found = np.where((expected == 0) & (table.ms_between > 0), inf, found)
    nothing = (expected - rounding <= NOTHING * rounding) & (table.ms_between < 3 * rounding)
    p = np.where(nothing, np.nan, np.minimum(2 * np.fmin(high, low), 1.0))
    p_hopeless = np.where(expected > 0, 2 * hopeless, 0.0)
    return np.where(table.df_between > 0, expected, np.nan), found, p, p_hopeless


def _by_dof(values: FloatArray, dof: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean squares (items,) with degrees of freedom of their own as rows (K, items), (K,)."""
    known = np.unique(dof[(values > 0) & (dof > 0)])
    return np.where(dof == known[:, None], values, 0.0), known


def _pooled_tests(
    labels: Sequence[Label],
    table: OneWay,
    items: PredictedItems,
    expected: FloatArray,
    p_scatter: FloatArray,
) -> dict[str, PooledTest]:
    """Of every operation the scatter of all items that have a predicted and a measured one."""
    found = {}
    for operation, joint in items.joint.items():
        place = np.array([i for i, label in enumerate(labels) if label[0] == operation])
        # A datum leaves no more of some features than rounding.
        of_parts = table.n0[place] * items.scatter[place]
        kept = np.isfinite(p_scatter[place]) & (of_parts > ROUNDING * expected[place])
        # Without repeats MS_between holds the CMM's scatter: too little to be seen at one item.
        kept &= table.df_within[place] > 0
        chosen = place[kept]
        if len(chosen) < 2:
            continue
        df, weights = table.df_between[chosen], table.n0[chosen] / expected[chosen]
        joint = joint.only(kept)
        # Of part means relative to their variance; the CMM is in the variances alone.
        correlation = joint.covariance * np.sqrt(weights * weights[:, None])
        np.fill_diagonal(correlation, 1.0)
        within = table.ms_within[chosen] / expected[chosen]
        found[operation] = pooled_test(
            table.ms_between[chosen] / expected[chosen],
            correlation,
            2.0 * correlation**2 / np.maximum(df, df[:, None]),
            _pooled_squares(joint, weights, within, table.df_within[chosen]),
            float(within.mean()),
        )
    return found


def pooled_test(
    ratios: FloatArray,
    correlation: FloatArray,
    shared: FloatArray,
    squares: tuple[FloatArray, FloatArray],
    w: float,
) -> PooledTest:
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
    far, _ = mean_square_tails(HOPELESS**2, sizes, dof, variance)
    return PooledTest(
        items=len(ratios),
        ratio=float(np.sqrt(max(T - w, 0.0) / (1 - w))),
        p=min(2 * min(high, low), 1.0),
        p_hopeless=2 * far,
    )


def _pooled_squares(
    joint: Joint, weights: FloatArray, within: FloatArray, within_dof: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The mean squares (K, 1) that the expectation of T consists of, and their degrees of freedom.

    A mean square of passes is one matrix at all items, one of repeatability is as far off at all
    of them, the CMM's is estimated at each by itself.
    """
    more = [1.0 if each is None else each.independent(weights) for each in joint.passes]
    of_cmm = within > 0
    spread = float((within[of_cmm] ** 2 / within_dof[of_cmm]).sum())
    cmm = float(within.sum()) ** 2 / spread if spread > 0 else np.inf
    squares = np.append((joint.squares.of_part * weights).mean(axis=1), within.mean())
    return squares[:, None], np.append(joint.squares.dof * np.array(more), cmm)


def paper_length_variance(gradient: FloatArray, holes: FloatArray, N: float = inf) -> float:
    """Variance of a length as Tables 8 and 9 have it: eq. (22) on the hole variances V_p(m)
    (rows,), times (1 + 1/N) for a future measurement, eq. (33). It is not the scatter of
    measured lengths: it takes V_p(m) for the part variance and the two ends for independent.
    """
    used = gradient != 0
    return float(gradient[used] ** 2 @ holes[used]) * (1 + 1 / N)
