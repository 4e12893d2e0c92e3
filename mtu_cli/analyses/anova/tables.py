"""The analysis of the tables of one kind: components, uncertainties, intervals, tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.model.measured import Label, MeasuredTables
from mtu_cli.stats.anova import Components, OneWay, moments, one_way, paper, part_interval
from mtu_cli.stats.coverage import PROBABILITY
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml
from mtu_cli.stats.resolution import hidden

Method = Literal["paper", "anova", "reml"]
METHODS: tuple[Method, ...] = ("paper", "anova", "reml")
Kind = Literal["feature", "length", "angle"]
TAIL = (1 - PROBABILITY) / 2


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `labels` are those of the tables, of which the axis of a length is "length" and that of a
    right angle "angle". `rounding` (tables,) is the variance of a mean that the last digit hides
    from the readings (`stats.resolution`). `components` by the chosen method, `reml` those that
    scale the part means; `interval` (tables, 2) for the part variance, nan by the paper's method,
    which has none. `both` is MS_between, and `both_interval` (tables, 2) its interval, where
    without repeats it holds the part's and the CMM's variance together, else nan.

    With w = sum n_i^2/N^2, in which a part counts by its repeats, u^2 = w s_part^2 + s_repeat^2/N
    of the grand mean (`u_mean`) and s_part^2 more of a future part (`u_future`). Without repeats
    MS_between stands for both components. By the paper's method eqs. (32)-(33), of the repeat
    scatter alone. `rounding` is added to all. `dof_mean` and `dof_future` are effective degrees of
    freedom (JCGM 100, G.4.1), `interval_future` (tables, 2) the mean -+ t u_future.

    `p_parts` of F and `p_mean` of a mean of zero (t test) are adjusted for all tables of the kind
    (Holm). `order` of the tables is that of |mean| + k u_future, the largest first; `unusual` are
    the outlying parts of each table by itself.
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
    separable = np.isfinite(by_reml.part)
    # Without repeats MS_between is the scatter of the readings.
    scatter = np.where(separable, by_reml.part + by_reml.repeat, table.ms_between)
    rounding = hidden(scatter, tables.rounding)
    interval = part_interval(tables.cells, table)
    share, part, repeat = table.share, components.part, components.repeat
    if method == "paper":
        share, part, repeat = 1 / table.N, table.ms_within, 0.0 * table.N
        interval, separable = np.full_like(interval, np.nan), np.zeros_like(separable)
    else:
        part = np.where(separable, part, table.ms_between)
        repeat = np.where(separable, repeat, 0.0)
    df = table.df_within if method == "paper" else table.df_between
    (u_mean, dof_mean), (u_future, dof_future) = (
        (np.sqrt(u2 + rounding), np.where(separable, _satterthwaite(table, weight, u2), df))
        for weight, u2 in ((w, w * part + repeat / table.N) for w in (share, 1 + share))
    )
    dof_mean, dof_future = (np.where(dof > 0, dof, np.nan) for dof in (dof_mean, dof_future))
    half = _t(dof_future) * u_future
    if method != "paper":
        # s_part^2 is a difference of mean squares, of which Satterthwaite leaves fewer degrees of
        # freedom than the parts have. There MS_between/n0 with theirs bounds it: the CMM's scatter
        # included it is too large, but its t is not (3 parts measured twice: half the width, and
        # 95 % or more still covered).
        between = (1 + share) * table.ms_between / table.n0
        bound = _t(table.df_between) * np.sqrt(between + rounding)
        half = np.where(dof_future < table.df_between, np.fmin(half, bound), half)
    known = (u_mean > 0) & np.isfinite(dof_mean)
    t = np.divide(np.abs(table.mean), u_mean, out=np.zeros_like(u_mean), where=known)
    p_zero = np.where(known, 2 * stdtr(np.where(known, dof_mean, 1.0), -t), np.nan)
    both = np.where((table.df_within < 1) & (table.df_between > 0), table.ms_between, np.nan)
    df = np.maximum(table.df_between, 1.0)
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
        interval=interval,
        both=both,
        both_interval=np.column_stack([both * df / chdtri(df, p) for p in (TAIL, 1 - TAIL)]),
        u_mean=u_mean,
        u_future=u_future,
        dof_mean=dof_mean,
        dof_future=dof_future,
        interval_future=np.column_stack([table.mean - half, table.mean + half]),
        p_parts=holm(table.p),
        p_mean=holm(p_zero),
        order=tuple(np.argsort(-size, kind="stable").tolist()),
    )


def _t(dof: FloatArray) -> FloatArray:
    """Quantiles of Student's t for the interval; nan without degrees of freedom."""
    from scipy.special import stdtrit

    known = np.isfinite(dof) & (dof > 0)
    return np.where(known, stdtrit(np.where(known, dof, 1.0), 1 - TAIL), np.nan)


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
