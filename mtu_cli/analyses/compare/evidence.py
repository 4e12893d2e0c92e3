"""The tests of bias and scatter, item by item, before any verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from mtu_cli.analyses.compare.pooled import Joint, PooledItems, pooled_items
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import OneWay, one_way
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.uncertain_variance import f_tails, t_tail, uncertain_variance

FEWEST_PARTS = 5
"""With fewer, the scatter of the parts has three degrees of freedom or less: Student's t has
hardly a variance then, and a mean that is off is not separable from parts that scatter."""
HOPELESS = 10.0
"""A scatter test that would not see scatter of so many times the predicted is withheld."""
ROUNDING = 1e-9
"""Share of an expected MS_between."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedItems:
    """The predicted items, each (items,); mm and mm^2.

    `mean`; variance of one future part, `total` = `coefficients` (shared by all parts) +
    `scatter` (from part to part: passes and visits), and under the papers' independence,
    `independent`. `of_mean` and `of_part` (K, items) are the mean squares of `dof` (K,) behind
    coefficients and scatter (see `variance.MeanSquares`). `holes` is g'V g of the measured
    hole variances V, for lengths; nan where there are none. `joint` has the
    common scatter of the items of each operation, in their order.
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
    sqrt(MS_between)/s_part says how much of the paper's scatter is not the parts'. `pooled_items`
    are those whose scatter is tested as one, an operation each.
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
    pooled_items: tuple[PooledItems, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bias:
    """The difference of the means and its test; (items,)."""

    bias: FloatArray
    u: FloatArray
    p: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scatter:
    """MS_between against its expectation; (items,)."""

    expected: FloatArray
    ratio: FloatArray
    p: FloatArray
    p_hopeless: FloatArray


def evidence(tables: MeasuredTables, items: PredictedItems, k: float) -> Evidence:
    """The items of `tables` against their prediction; k the coverage factor."""
    table, components = one_way(tables.cells), reml(tables.cells)
    spread = (tables.cells.n**2).sum(axis=1) / table.N**2
    apart = np.isfinite(components.part)
    # Without repeats MS_between holds the CMM too, and stands for both.
    part = np.where(apart, components.part, table.ms_between)
    repeat = np.where(np.isfinite(components.repeat), components.repeat, 0.0)
    of_mean = part * spread + repeat / table.N
    means = _bias(table, repeat, spread, of_mean, items)
    scatter = _scatter(table, items)
    predicted = _side(items.mean, items.total, k)
    independent = _side(items.mean, items.independent, k)
    measured = _side(table.mean, part + of_mean, k)
    paper = _paper_side(table, items.holes, k)
    s_part = np.sqrt(np.where(apart, components.part, np.nan))
    return Evidence(
        labels=tables.labels,
        predicted=predicted,
        independent=independent,
        measured=measured,
        measured_paper=paper,
        one_way=table,
        s_part=s_part,
        bias=means.bias,
        u_difference=means.u,
        E_n=ratio(means.bias, k * means.u),
        p_bias=means.p,
        ms_expected=scatter.expected,
        ratio_ms=scatter.ratio,
        p_scatter=scatter.p,
        p_hopeless=scatter.p_hopeless,
        ratio_u=ratio(measured.u, predicted.u),
        ratio_range=ratio(measured.width, predicted.width),
        ratio_scatter=ratio(np.sqrt(part), np.sqrt(items.scatter)),
        paper_ratio_u=ratio(paper.u, independent.u),
        paper_ratio_range=ratio(paper.width, independent.width),
        ms_share=ratio(np.sqrt(table.ms_between), s_part),
        pooled_items=tuple(_pooled(tables.labels, table, items, scatter)),
    )


def _side(mean: FloatArray, variance: FloatArray, k: float) -> Side:
    u = np.sqrt(variance)
    return Side(mean=mean, u=u, U=k * u, width=2 * (np.abs(mean) + k * u))


def _paper_side(table: OneWay, holes: FloatArray, k: float) -> Side:
    """V_p(m) (1 + 1/N), eq. (33); of lengths V_p(m) is what eq. (22) makes of hole variances."""
    V = np.where(np.isfinite(holes), holes, table.ms_between)
    return _side(table.mean, V * (1 + 1 / table.N), k)


def ratio(measured: FloatArray, predicted: FloatArray) -> FloatArray:
    """measured/predicted (items,), nan where nothing is predicted to compare with."""
    found = np.full(len(measured), np.nan)
    np.divide(measured, predicted, out=found, where=predicted > 0)
    return found


def _bias(
    table: OneWay,
    repeat: FloatArray,
    spread: FloatArray,
    seen: FloatArray,
    items: PredictedItems,
) -> _Bias:
    """Measured minus predicted mean against C and the scatter of the mean; `seen` (items,) is
    the measured variance of the mean.
    """
    predicted = items.scatter * spread + repeat / table.N
    by_parts = (table.parts >= FEWEST_PARTS) & (seen >= predicted)
    own, own_dof = _by_dof(np.where(by_parts, seen, 0.0), table.df_between)
    cmm, cmm_dof = _by_dof(np.where(by_parts, 0.0, repeat / table.N), table.df_within)
    squares = items.of_mean + np.where(by_parts, 0.0, spread) * items.of_part
    variance = uncertain_variance(
        np.concatenate([squares, own, cmm]), np.concatenate([items.dof, own_dof, cmm_dof])
    )
    bias = table.mean - items.mean
    of_mean = np.where(by_parts, seen, predicted)
    return _Bias(bias=bias, u=np.sqrt(items.coefficients + of_mean), p=t_tail(bias, variance))


def _scatter(table: OneWay, items: PredictedItems) -> _Scatter:
    """MS_between against MS_within + n0 (D + visit), of which it is the expectation."""
    within = np.where(table.df_within > 0, table.ms_within, 0.0)
    n0 = np.where(table.df_between > 0, table.n0, 0.0)
    cmm, cmm_dof = _by_dof(within, table.df_within)
    variance = uncertain_variance(
        np.concatenate([n0 * items.of_part, cmm]), np.concatenate([items.dof, cmm_dof])
    )
    expected = within + n0 * items.scatter
    high, low = f_tails(table.ms_between, table.df_between, variance)
    hopeless, _ = f_tails(HOPELESS**2 * expected, table.df_between, variance)
    found = ratio(table.ms_between, expected)
    # Scatter where none at all is predicted is infinitely more.
    found = np.where((expected == 0) & (table.ms_between > 0), inf, found)
    return _Scatter(
        expected=np.where(table.df_between > 0, expected, np.nan),
        ratio=found,
        p=np.minimum(2 * np.fmin(high, low), 1.0),
        p_hopeless=np.where(expected > 0, 2 * hopeless, 0.0),
    )


def _pooled(
    labels: Sequence[tuple[str, str, str]], table: OneWay, items: PredictedItems, scatter: _Scatter
) -> Iterator[PooledItems]:
    """The items of every operation, those with a predicted scatter and a measured one."""
    for operation, joint in items.joint.items():
        place = np.array([i for i, label in enumerate(labels) if label[0] == operation])
        # A datum leaves no more of some features than rounding.
        of_parts = table.n0[place] * items.scatter[place]
        kept = np.isfinite(scatter.p[place]) & (of_parts > ROUNDING * scatter.expected[place])
        # Without repeats MS_between holds the CMM's scatter: too little to be seen at one item.
        kept &= table.df_within[place] > 0
        own = place[kept]
        yield pooled_items(operation, own, scatter.expected[own], table, joint.only(kept), HOPELESS)


def _by_dof(values: FloatArray, dof: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean squares (items,) with degrees of freedom of their own as rows (K, items), (K,)."""
    known = np.unique(dof[(values > 0) & (dof > 0)])
    return np.where(dof == known[:, None], values, 0.0), known


def paper_length_variance(gradient: FloatArray, holes: FloatArray, N: float = inf) -> float:
    """Variance of a length as Tables 8 and 9 have it: eq. (22) on the hole variances V_p(m)
    (rows,), times (1 + 1/N) for a future measurement, eq. (33). It is not the scatter of
    measured lengths: it takes V_p(m) for the part variance and the two ends for independent.
    """
    used = gradient != 0
    return float(gradient[used] ** 2 @ holes[used]) * (1 + 1 / N)
