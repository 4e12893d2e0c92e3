"""The analysis of the tables of one kind: components, uncertainties, intervals, tests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, assert_never

import numpy as np

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.anova import (
    BoolArray,
    Components,
    OneWay,
    moments,
    one_way,
    paper,
    part_interval,
)
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.reml import reml

Method = Literal["paper", "anova", "reml"]
METHODS: tuple[Method, ...] = ("paper", "anova", "reml")
Kind = Literal["feature", "length", "angle"]


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `components` by the chosen method, `reml` those that scale the part means; `interval`
    (tables, 2) for the part variance, nan by the paper's method, which has none. `both` is
    MS_between, and `both_interval` (tables, 2) its interval, where without repeats it holds the
    part's and the CMM's variance together, else nan. `u_mean` of the grand mean, in which every
    reading counts alike, and `u_future` of a future part, with `dof_mean` and `dof_future`;
    `interval_future` (tables, 2) is mean -+ t u_future. `p_parts` of F and `p_mean` of a mean of
    zero (t test) are adjusted for all tables of the kind (Holm). `unusual` are the
    outlying parts of each table by itself.
    """

    kind: Kind
    method: Method
    coverage_factor: float
    tables: MeasuredTables
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
    unusual: tuple[tuple[str, ...], ...]

    @cached_property
    def below_zero(self) -> BoolArray:
        """Tables (tables,) of which both limits for the part variance were below 0 (see
        `part_interval`): [0, 0] is no bound on it.
        """
        known: BoolArray = (self.one_way.ms_within > 0) & (self.interval == 0).all(axis=1)
        return known

    @property
    def unit(self) -> str:
        """Of its figures in a report."""
        return "arcsec" if self.kind == "angle" else "um"

    @cached_property
    def s_pooled(self) -> FloatArray:
        """Standard deviation (tables,) of repeats, pooled over the parts."""
        return np.sqrt(self.one_way.ms_within)

    @cached_property
    def rounding(self) -> FloatArray:
        """What a mean is rounded to (tables,): its u, of one part the scatter of its repeats."""
        return np.where(self.u_mean > 0, self.u_mean, self.s_pooled)

    @cached_property
    def s_part(self) -> FloatArray:
        """Standard deviation (tables,) from part to part."""
        return np.sqrt(self.components.part)

    @cached_property
    def s_both(self) -> FloatArray:
        """Standard deviation (tables,) of parts measured once, the CMM's included."""
        return np.sqrt(self.both)

    @cached_property
    def U_future(self) -> FloatArray:
        """k u_future (tables,)."""
        return self.coverage_factor * self.u_future

    def largest(self) -> list[int]:
        """Tables in the order of |mean| + k u_future, the largest first."""
        size = np.abs(self.one_way.mean) + np.nan_to_num(self.U_future)
        order: list[int] = np.argsort(-size, kind="stable").tolist()
        return order

    def part_means(self, i: int) -> FloatArray:
        """Mean of each part (parts,) in table `i`, nan where it is missing."""
        cells = self.tables.cells
        return np.where(cells.present[i], cells.origin[i] + cells.mean[i], np.nan)

    def u_repeat(self, i: int) -> FloatArray:
        """What the CMM's scatter makes of the mean of each part (parts,): s_repeat/sqrt(n_i)."""
        cells = self.tables.cells
        s = np.sqrt(np.nan_to_num(self.one_way.ms_within[i]))
        return np.where(cells.present[i], s / np.sqrt(np.maximum(cells.n[i], 1)), np.nan)


class Base:
    """What every method needs of the tables of one kind."""

    def __init__(self, kind: Kind, tables: MeasuredTables) -> None:
        self.kind = kind
        self.tables = tables
        self.one_way = one_way(tables.cells)
        self.reml = reml(tables.cells)


def analysed(
    base: Base, method: Method, coverage_factor: float, unusual: tuple[tuple[str, ...], ...]
) -> Analysed:
    """The analysis of one kind by one method."""
    table, components = base.one_way, _components(base, method)
    (u_mean, dof_mean), (u_future, dof_future) = _uncertainties(base, components, method)
    half = _t_quantile(dof_future) * u_future
    mixed = (table.df_within < 1) & (table.df_between > 0)
    both = np.where(mixed, table.ms_between, np.nan)
    interval = part_interval(base.tables.cells, table)
    return Analysed(
        kind=base.kind,
        method=method,
        coverage_factor=coverage_factor,
        tables=base.tables,
        one_way=table,
        components=components,
        reml=base.reml,
        interval=np.full_like(interval, np.nan) if method == "paper" else interval,
        both=both,
        both_interval=_variance_interval(both, table.df_between),
        u_mean=u_mean,
        u_future=u_future,
        dof_mean=dof_mean,
        dof_future=dof_future,
        interval_future=np.column_stack([table.mean - half, table.mean + half]),
        p_parts=holm(table.p),
        p_mean=holm(_p_of_zero(table.mean, u_mean, dof_mean)),
        unusual=unusual,
    )


def _components(base: Base, method: Method) -> Components:
    match method:
        case "paper":
            return paper(base.one_way)
        case "anova":
            return moments(base.one_way)
        case "reml":
            return base.reml
        case _:
            assert_never(method)


WithDof = tuple[FloatArray, FloatArray]


def _uncertainties(base: Base, components: Components, method: Method) -> tuple[WithDof, WithDof]:
    """(u, degrees of freedom) of the grand mean and of a future part, (tables,) each.

    u^2(mean) = s_part^2 sum n_i^2/N^2 + s_repeat^2/N: that of the mean of all readings, in which
    a part counts by its repeats. A future part adds s_part^2. Without repeats MS_between, the
    sum of both components, serves for both. By the paper's method eqs. (32)-(33), which have
    the repeat scatter alone.
    """
    table, n = base.one_way, base.tables.cells.n
    if method == "paper":
        s2, dof = table.ms_within, np.where(table.df_within > 0, table.df_within, np.nan)
        return (np.sqrt(s2 / table.N), dof), (np.sqrt(s2 * (1 + 1 / table.N)), dof)
    together = np.where(table.df_between > 0, table.ms_between, np.nan)
    apart = np.isfinite(components.part)
    share = (n**2).sum(axis=1) / table.N**2
    found = []
    for weight, of_both in ((share, 1 / table.N), (1 + share, 1 + 1 / table.N)):
        u2 = components.part * weight + components.repeat / table.N
        dof = _satterthwaite(table, weight, u2)
        found.append(
            (
                np.sqrt(np.where(apart, u2, together * of_both)),
                np.where(apart, dof, np.where(table.df_between > 0, table.df_between, np.nan)),
            )
        )
    return found[0], found[1]


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


def _t_quantile(dof: FloatArray) -> FloatArray:
    from scipy.special import stdtrit

    known = np.isfinite(dof)
    found = np.asarray(stdtrit(np.where(known, dof, 1.0), (1 + PROBABILITY) / 2), np.float64)
    return np.where(known, found, np.nan)


def _p_of_zero(mean: FloatArray, u: FloatArray, dof: FloatArray) -> FloatArray:
    """Two-sided p of a mean of zero; nan where u is not known or zero."""
    from scipy.special import stdtr

    known = (u > 0) & np.isfinite(dof)
    t = np.divide(np.abs(mean), u, out=np.zeros_like(mean), where=known)
    return np.where(known, 2 * stdtr(np.where(known, dof, 1.0), -t), np.nan)


def _variance_interval(variance: FloatArray, dof: FloatArray) -> FloatArray:
    """95 % interval (tables, 2) of a variance estimated with `dof`, by chi-squared."""
    from scipy.special import chdtri

    safe, tail = np.maximum(dof, 1.0), (1 - PROBABILITY) / 2
    return np.column_stack(
        [variance * safe / chdtri(safe, tail), variance * safe / chdtri(safe, 1 - tail)]
    )
