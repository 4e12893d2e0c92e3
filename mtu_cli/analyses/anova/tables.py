"""The analysis of the tables of one kind: components, uncertainties, intervals, tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.anova import Cells, Components, OneWay, moments, one_way, paper, part_interval
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.resolution import hidden

Method = Literal["paper", "anova", "reml"]
METHODS: tuple[Method, ...] = ("paper", "anova", "reml")
Kind = Literal["feature", "length", "angle"]
Label = tuple[str, str, str]
"""Operation, name, axis."""


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `labels` are those of the tables, of which the axis of a length is "length" and that of a
    right angle "angle". `rounding` (tables,) is the variance of a mean that the last digit hides
    from the readings (`stats.resolution`). `components` by the chosen method, `reml` those that
    scale the part means; `interval` (tables, 2) for the part variance, nan by the paper's method,
    which has none. `both` is MS_between, and `both_interval` (tables, 2) its interval, where
    without repeats it holds the part's and the CMM's variance together, else nan. `u_mean` of the
    grand mean, in which every reading counts alike, and `u_future` of a future part, with
    `dof_mean` and `dof_future`; `interval_future` (tables, 2): see `_half_width`. `p_parts` of F
    and `p_mean` of a mean of zero (t test) are adjusted for all tables of the kind (Holm). `order`
    of the tables is that of |mean| + k u_future, the largest first; `unusual` are the outlying
    parts of each table by itself.
    """

    kind: Kind
    method: Method
    coverage_factor: float
    tables: MeasuredTables
    labels: tuple[Label, ...]
    rounding: FloatArray
    one_way: OneWay
    components: Components
    reml: Components
    interval: FloatArray
    both: FloatArray
    both_interval: FloatArray
    u_mean: FloatArray
    u_future: FloatArray
    dof_mean: FloatArray
    dof_future: FloatArray
    interval_future: FloatArray
    p_parts: FloatArray
    p_mean: FloatArray
    order: tuple[int, ...]
    unusual: tuple[tuple[str, ...], ...] = ()

    def part_means(self, i: int) -> tuple[FloatArray, FloatArray]:
        """The mean of each part (parts,) in table `i`, nan where it is missing, and what the CMM's
        scatter makes of it: s_repeat/sqrt(n_i).
        """
        cells = self.tables.cells
        s = np.sqrt(np.nan_to_num(self.one_way.ms_within[i]))
        values = cells.origin[i] + cells.mean[i], s / np.sqrt(np.maximum(cells.n[i], 1))
        mean, u = (np.where(cells.present[i], each, np.nan) for each in values)
        return mean, u


def analysed(kind: Kind, tables: MeasuredTables, method: Method, k: float) -> Analysed:
    """The analysis of one kind by one method, with the coverage factor k."""
    from scipy.special import chdtri, stdtr

    table, by_reml = one_way(tables.cells, tables.rounding), reml(tables.cells)
    methods = {"paper": paper, "anova": moments}
    components = methods[method](table) if method in methods else by_reml
    # Without repeats MS_between is the scatter of the readings.
    scatter = np.where(np.isfinite(by_reml.part), by_reml.part + by_reml.repeat, table.ms_between)
    rounding = hidden(scatter, tables.rounding)
    (u_mean, dof_mean), (u_future, dof_future) = _uncertainties(
        table, tables.cells, rounding, components, method
    )
    tail = (1 - PROBABILITY) / 2
    half = _half_width(table, tables.cells, rounding, u_future, dof_future, method)
    known = (u_mean > 0) & np.isfinite(dof_mean)
    t = np.divide(np.abs(table.mean), u_mean, out=np.zeros_like(u_mean), where=known)
    p_zero = np.where(known, 2 * stdtr(np.where(known, dof_mean, 1.0), -t), np.nan)
    both = np.where((table.df_within < 1) & (table.df_between > 0), table.ms_between, np.nan)
    df = np.maximum(table.df_between, 1.0)
    ends = [both * df / chdtri(df, tail), both * df / chdtri(df, 1 - tail)]
    interval = part_interval(tables.cells, table)
    size = np.abs(table.mean) + np.nan_to_num(k * u_future)
    return Analysed(
        kind=kind,
        method=method,
        coverage_factor=k,
        tables=tables,
        labels=tuple((operation, name, axis or kind) for operation, name, axis in tables.labels),
        rounding=rounding,
        one_way=table,
        components=components,
        reml=by_reml,
        interval=np.full_like(interval, np.nan) if method == "paper" else interval,
        both=both,
        both_interval=np.column_stack(ends),
        u_mean=u_mean,
        u_future=u_future,
        dof_mean=dof_mean,
        dof_future=dof_future,
        interval_future=np.column_stack([table.mean - half, table.mean + half]),
        p_parts=holm(table.p),
        p_mean=holm(p_zero),
        order=tuple(np.argsort(-size, kind="stable").tolist()),
    )


def _half_width(
    table: OneWay,
    cells: Cells,
    rounding: FloatArray,
    u_future: FloatArray,
    dof_future: FloatArray,
    method: Method,
) -> FloatArray:
    """Half (tables,) of the 95 % interval of a future part, t u_future.

    s_part^2 is a difference of mean squares, of which Satterthwaite leaves fewer degrees of freedom
    than the parts have. There sqrt((1 + sum n_i^2/N^2) MS_between/n0) with theirs bounds it: the
    CMM's scatter included it is too large, but its t is not (3 parts measured twice: half the
    width, and 95 % or more still covered).
    """
    from scipy.special import stdtrit

    def t(dof: FloatArray) -> FloatArray:
        known = np.isfinite(dof) & (dof > 0)
        quantile = stdtrit(np.where(known, dof, 1.0), (1 + PROBABILITY) / 2)
        return np.where(known, quantile, np.nan)

    share = (cells.n**2).sum(axis=1) / table.N**2
    between = (1 + share) * table.ms_between / table.n0
    bound = t(table.df_between) * np.sqrt(between + rounding)
    half = t(dof_future) * u_future
    # The paper's method has no variance of parts to bound.
    few = (dof_future < table.df_between) & (method != "paper")
    return np.where(few, np.fmin(half, bound), half)


WithDof = tuple[FloatArray, FloatArray]


def _uncertainties(
    table: OneWay,
    cells: Cells,
    rounding: FloatArray,
    components: Components,
    method: Method,
) -> tuple[WithDof, WithDof]:
    """(u, degrees of freedom) of the grand mean and of a future part, (tables,) each.

    u^2(mean) = s_part^2 sum n_i^2/N^2 + s_repeat^2/N: that of the mean of all readings, in which
    a part counts by its repeats. A future part adds s_part^2. Without repeats MS_between, the
    sum of both components, serves for both. By the paper's method eqs. (32)-(33), which have
    the repeat scatter alone. What the last digit hides (`rounding`) is added to both.
    """
    if method == "paper":
        s2, dof = table.ms_within, np.where(table.df_within > 0, table.df_within, np.nan)
        of_mean, of_one = (s2 * share + rounding for share in (1 / table.N, 1 + 1 / table.N))
        return (np.sqrt(of_mean), dof), (np.sqrt(of_one), dof)
    df_both = np.where(table.df_between > 0, table.df_between, np.nan)
    both = np.where(table.df_between > 0, table.ms_between, np.nan)
    separable = np.isfinite(components.part)
    share = (cells.n**2).sum(axis=1) / table.N**2
    result = []
    for weight, of_both in ((share, 1 / table.N), (1 + share, 1 + 1 / table.N)):
        u2 = components.part * weight + components.repeat / table.N
        u = np.sqrt(np.where(separable, u2, both * of_both) + rounding)
        result.append((u, np.where(separable, _satterthwaite(table, weight, u2), df_both)))
    return result[0], result[1]


def _satterthwaite(table: OneWay, weight: FloatArray, u2: FloatArray) -> FloatArray:
    """Degrees of freedom (tables,) of weight * s_part^2 + s_repeat^2/N (JCGM 100, G.4.1).

    In terms of the independent mean squares it is c1 MS_between + c2 MS_within with
    c1 = weight/n0 and c2 = 1/N - c1; between 1 and N - 1.
    """
    c1 = weight / table.n0
    c2 = 1 / table.N - c1
    between = (c1 * table.ms_between) ** 2 / np.maximum(table.df_between, 1)
    spread: FloatArray = between + (c2 * table.ms_within) ** 2 / np.maximum(table.df_within, 1)
    dof = np.divide(u2**2, spread, out=np.full_like(u2, np.nan), where=spread > 0)
    return np.clip(dof, 1.0, np.maximum(table.N - 1, 1.0))
