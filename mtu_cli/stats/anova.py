"""One-way analysis of variance and restricted maximum likelihood (REML) with unequal repeats, for
many tables at once.

Every table has a parts in rows and n_i repeats of part i: y_ij = mu + p_i + e_ij, the parts
random. Arrays are (tables, parts) where the tables share their parts, with n_i = 0 where a
part is missing from a table.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from scipy.special import chdtri, fdtrc, fdtri

from mtu_cli.stats.coverage import TAIL
from mtu_cli.stats.groups import group_means
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray, quotient
from mtu_cli.stats.resolution import hidden

OfTables = TypeVar("OfTables", bound=Any)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """What an analysis needs of the data: per table and part the count n (tables, parts) and
    the mean above `origin` (tables,), one of the table's values; the sum of squares within all
    parts, `within` (tables,).
    """

    origin: FloatArray
    n: FloatArray
    mean: FloatArray
    within: FloatArray

    @property
    def present(self) -> BoolArray:
        """Parts that a table has."""
        return self.n > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OneWay:
    """The paper's table, each (tables,): Gilsinn & Ling 2004, eqs. (29)-(34).

    `mean` the grand mean sum n_i m_i / N; `ms_between` = V_p(m) = sum n_i (m_i - mean)^2 /
    (a - 1) and `ms_within` = V_p(s) (nan without repeats); `F`, its critical value at 95 %
    and p; `n0` = (N - sum n_i^2/N)/(a - 1), so that E ms_between = s_repeat^2 + n0 s_part^2;
    `share` = sum n_i^2/N^2, that of s_part^2 in the variance of the grand mean.
    """

    parts: FloatArray
    N: FloatArray
    mean: FloatArray
    ms_between: FloatArray
    ms_within: FloatArray
    df_between: FloatArray
    df_within: FloatArray
    F: FloatArray
    F_critical_95: FloatArray
    p: FloatArray
    n0: FloatArray
    share: FloatArray


def only(of: OfTables, rows: Any) -> OfTables:
    """The tables at `rows`, indices or a mask, of a dataclass of arrays (tables, ...)."""
    arrays = {field.name: getattr(of, field.name)[rows] for field in fields(of)}
    return replace(of, **arrays)


def cells_of(values: FloatArray, cell: IntArray, tables: int, parts: int) -> Cells:
    """Counts, means and sums of squares of `values` (n,) in `cell` = table * parts + part.

    Values are taken about one of their table before anything is summed: large common leading
    digits would otherwise be lost (NIST StRD, SmLs07-09).
    """
    size, table = tables * parts, cell // parts
    origin = np.zeros(tables)
    origin[table] = values
    rest = values - origin[table]
    n = np.bincount(cell, minlength=size).astype(np.float64)
    mean = np.nan_to_num(group_means(rest, cell, size))
    squares = np.bincount(cell, (rest - mean[cell]) ** 2, minlength=size)
    within: FloatArray = squares.reshape(tables, parts).sum(axis=1).astype(np.float64)
    # What equal repeats leave of a sum of squares, their mean being rounded.
    share = 4 * np.finfo(np.float64).eps * mean
    within[within <= (n * share**2).reshape(tables, -1).sum(axis=1)] = 0.0
    n, mean = n.reshape(tables, parts), mean.reshape(tables, parts)
    return Cells(origin=origin, n=n, mean=mean, within=within)


def one_way(cells: Cells, rounding: FloatArray | float = 0.0) -> OneWay:
    """The analysis of every table; nan where there is too little data for a figure.

    In F the variance `rounding` (tables,) that the last digit hides from the repeats of a part
    (`resolution.hidden`) adds to that of its mean; `ms_within` is as it was measured.
    """
    n, m = cells.n, cells.mean
    parts = cells.present.sum(axis=1).astype(np.float64)
    N = n.sum(axis=1)
    grand = (n * m).sum(axis=1) / N
    deviation = np.where(cells.present, m - grand[:, None], 0.0)
    ss_between = (n * deviation**2).sum(axis=1)
    df_between, df_within = parts - 1, N - parts
    ms_between = quotient(ss_between, df_between)
    ms_within = quotient(cells.within, df_within)
    squares = (n**2).sum(axis=1)
    n0 = quotient(N - squares / N, df_between)
    noise = ms_within + np.nan_to_num(n0) * hidden(ms_within, rounding)
    F = np.where(ms_within > 0, quotient(ms_between, noise), np.nan)
    # Without F all that follows of it is nan.
    df_F = np.where(np.isfinite(F), df_between, np.nan)
    return OneWay(
        parts=parts,
        N=N,
        mean=cells.origin + grand,
        ms_between=ms_between,
        ms_within=ms_within,
        df_between=df_between,
        df_within=df_within,
        F=F,
        F_critical_95=fdtri(df_F, df_within, 0.95),
        p=np.asarray(fdtrc(df_F, df_within, F), np.float64),
        n0=n0,
        share=squares / N**2,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Components:
    """Components of variance, each (tables,): of the parts and of the repeats.

    `part_estimate` is the moment estimate before a negative one is set to 0 (equal to `part`
    for REML). nan where the data cannot tell them apart.
    """

    part: FloatArray
    repeat: FloatArray
    part_estimate: FloatArray


def moments(table: OneWay) -> Components:
    """s_part^2 = (MS_between - MS_within)/n0, the analysis-of-variance estimate."""
    estimate = (table.ms_between - table.ms_within) / table.n0
    return Components(
        part=np.maximum(estimate, 0.0), repeat=table.ms_within, part_estimate=estimate
    )


def paper(table: OneWay) -> Components:
    """The paper's: MS_between itself stands for the manufacturing variance."""
    return Components(part=table.ms_between, repeat=table.ms_within, part_estimate=table.ms_between)


def part_interval(cells: Cells, table: OneWay) -> FloatArray:
    """95 % interval (tables, 2) for s_part^2: modified large-sample limits, unequal repeats.

    Burdick & Graybill, Confidence Intervals on Variance Components (1992), 3.2 and 4.2: with the
    unweighted mean square S1 = h sum (m_i - mean m)^2/(a - 1), h the harmonic mean of n_i, and
    S2 = MS_within the limits are (S1 - S2 -+ sqrt(...))/h (Ting, Burdick, Graybill, Jeyaratnam &
    Lu, J. Stat. Comput. Simul. 35 (1990) 135). Limits below 0 are 0.

    The upper one is where S1/S2 is below the lower quantile of F, in 2.5 % of
    studies of parts that are alike, and in fewer of others: [0, 0] then counts among the intervals
    that miss, and says nothing of the size of s_part.
    """
    present = cells.present
    known = (table.df_between > 0) & (table.df_within > 0)
    n1, n2 = (np.where(known, df, np.nan) for df in (table.df_between, table.df_within))
    inverse = np.divide(1.0, cells.n, out=np.zeros_like(cells.n), where=present)
    h = table.parts / inverse.sum(axis=1)
    centre = np.where(present, cells.mean, 0.0).sum(axis=1) / table.parts
    deviation = np.where(present, cells.mean - centre[:, None], 0.0)
    S1, S2 = h * (deviation**2).sum(axis=1) / n1, table.ms_within
    G1, G2 = 1 - n1 / chdtri(n1, TAIL), 1 - n2 / chdtri(n2, TAIL)
    H1, H2 = n1 / chdtri(n1, 1 - TAIL) - 1, n2 / chdtri(n2, 1 - TAIL) - 1
    upper, lower = fdtri(n1, n2, 1 - TAIL), fdtri(n1, n2, TAIL)
    G12 = ((upper - 1) ** 2 - (G1 * upper) ** 2 - H2**2) / upper
    H12 = ((1 - lower) ** 2 - (H1 * lower) ** 2 - G2**2) / lower
    down = (G1 * S1) ** 2 + (H2 * S2) ** 2 + G12 * S1 * S2
    up = (H1 * S1) ** 2 + (G2 * S2) ** 2 + H12 * S1 * S2
    low = (S1 - S2 - np.sqrt(np.maximum(down, 0.0))) / h
    high = (S1 - S2 + np.sqrt(np.maximum(up, 0.0))) / h
    return np.maximum(np.column_stack([low, high]), 0.0)


GRID = np.concatenate([[0.0], 10.0 ** np.arange(-5.0, 9.01, 0.25)])
"""Ratios r = s_part^2/s_repeat^2 between which the likelihood's maximum is bracketed. Beyond the
last one the limit of large r holds to a relative 1e-9.
"""
HALVINGS = 52
"""Of a bracket: to the last bit."""


def reml(cells: Cells) -> Components:
    """Components of variance by REML: s_part^2 >= 0, s_repeat^2.

    With r = s_part^2/s_repeat^2, w_i = n_i/(1 + n_i r), mu = sum w_i m_i / sum w_i and
    Q = SS_within + sum w_i (m_i - mu)^2 the profiled criterion is

        -2 l(r) = (N - 1) log Q + sum log(1 + n_i r) + log sum w_i,

    and s_repeat^2 = Q/(N - 1) (Searle, Casella & McCulloch, Variance Components, 1992, 6.6).
    The root of its derivative is bracketed on a grid and bisected; r is 0 where -2 l rises from
    there on. For large r the estimates tend to SS_within/(N - a) and the sample variance of the
    part means, less their share of s_repeat^2. A table without repeats has nan, one with a single
    part has nan for s_part^2; one whose repeats are all equal has s_repeat^2 = 0.
    """
    within, N, n = cells.within, cells.n.sum(axis=1), np.unique(cells.n)
    n = n[n > 0]
    # Parts of equal repeats n (levels,) count as one: their number, mean and sum of squares about
    # it, (tables, levels).
    count, means, about = np.empty((3, len(N), len(n)))
    for k, repeats in enumerate(n):
        mask = cells.n == repeats
        count[:, k] = mask.sum(axis=1)
        means[:, k] = np.where(mask, cells.mean, 0.0).sum(axis=1) / np.maximum(count[:, k], 1)
        deviation = np.where(mask, cells.mean - means[:, k, None], 0.0)
        about[:, k] = np.einsum("ij,ij->i", deviation, deviation)
    a = count.sum(axis=1)

    def fitted(r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights w, sums of (m - mu)^2 (tables, levels), and Q (tables,), at r (tables,)."""
        w = n / (1 + n * r[:, None])
        weights = count * w
        mu = (weights * means).sum(axis=1) / weights.sum(axis=1)
        squares = about + count * (means - mu[:, None]) ** 2
        return w, squares, within + (w * squares).sum(axis=1)

    def slope(r: FloatArray) -> FloatArray:
        """d(-2 l)/dr = (N - 1) Q'/Q + sum w - sum w^2 / sum w, Q' = -sum w^2 (m - mu)^2."""
        w, squares, Q = fitted(r)
        total = (count * w).sum(axis=1)
        # Equal values in all of a table have Q = 0; it is not the likelihood's to decide.
        change = (w**2 * squares).sum(axis=1) / np.where(Q > 0, Q, 1.0)
        return total - (count * w**2).sum(axis=1) / total - (N - 1) * change

    falling = np.array([slope(np.full(len(a), r)) < 0 for r in GRID])
    last = len(GRID) - 1 - np.argmax(falling[::-1], axis=0)
    low, high = GRID[last], GRID[np.minimum(last + 1, len(GRID) - 1)]
    for _ in range(HALVINGS):
        middle = np.where(low > 0, np.sqrt(low * high), high / 2)
        above = slope(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    r = np.where(falling.any(axis=0), high, 0.0)
    repeat = fitted(r)[2] / np.maximum(N - 1, 1)
    part = r * repeat
    far = falling[-1] | (within == 0)
    repeat = np.where(far, within / np.maximum(N - a, 1), repeat)
    mean = (count * means).sum(axis=1) / a
    squares = about + count * (means - mean[:, None]) ** 2
    lost = repeat * (count / n).sum(axis=1) / a
    part = np.where(far, squares.sum(axis=1) / np.maximum(a - 1, 1) - lost, part)
    part = np.where((a > 1) & (a < N), part, np.nan)
    repeat = np.where(a < N, repeat, np.nan)
    return Components(part=part, repeat=repeat, part_estimate=part)
