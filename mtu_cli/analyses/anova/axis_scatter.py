"""Does Y scatter more from part to part than X? One test an operation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.anova.parts import FAMILY_RATE
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import BoolArray, OneWay
from mtu_cli.stats.scatter_ratio import (
    FEWEST_ROWS,
    ScatterRatio,
    Side,
    familywise,
    ratio_interval,
    scatter_ratio,
    untested,
)

FEWEST_PARTS = 2
"""One part has no scatter to compare."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisScatter:
    """y over x in one operation: of the parts alone where `apart`, else the CMM's scatter of
    their means included, because nothing was measured twice. `interval` of the ratio of
    variances, 95 %, for this operation alone; nan where none can be had.
    """

    operation: str
    test: ScatterRatio
    interval: tuple[float, float]
    apart: bool

    @property
    def significant(self) -> bool:
        """Whether one axis scatters more, at the family-wise rate."""
        return self.test.p_familywise <= FAMILY_RATE

    @property
    def wider(self) -> str:
        """The axis that scatters more."""
        return "x" if self.test.ratio < 1 else "y"

    @property
    def s_ratio(self) -> float:
        """Ratio of the standard deviations."""
        return float(np.sqrt(self.test.ratio))

    @property
    def s_interval(self) -> tuple[float, float]:
        """Its 95 % interval."""
        low, high = self.interval
        return float(np.sqrt(low)), float(np.sqrt(high))


def axis_scatter(tables: MeasuredTables, table: OneWay) -> tuple[AxisScatter, ...]:
    """The part component of y against that of x, over all features; p adjusted for all
    operations (Holm). Operations of too few parts are there, without a p.
    """
    rows: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        rows.setdefault((operation, axis), []).append(i)
    found = []
    for operation in dict.fromkeys(label[0] for label in tables.labels):
        x, y = (rows.get((operation, axis), []) for axis in ("x", "y"))
        kept = np.asarray(tables.cells.present[x].any(axis=0), np.bool_)
        if not x or len(x) != len(y) or int(kept.sum()) < FEWEST_PARTS:
            continue
        apart = all((table.df_within[side] > 0).any() for side in (x, y))
        test, interval = untested(int(kept.sum())), (float("nan"), float("nan"))
        if test.rows >= FEWEST_ROWS:
            sides = [_side(tables, table, side, kept, apart=apart) for side in (x, y)]
            test, interval = scatter_ratio(*sides), ratio_interval(*sides)
        found.append(AxisScatter(operation=operation, test=test, interval=interval, apart=apart))
    tests = familywise([item.test for item in found])
    return tuple(replace(item, test=test) for item, test in zip(found, tests, strict=True))


def _side(
    tables: MeasuredTables, table: OneWay, chosen: list[int], kept: BoolArray, *, apart: bool
) -> Side:
    """Part means (parts, tables) with what the CMM adds to their squared deviations.

    Of the mean of n_i repeats among a parts: s^2 ((1 - 2/a)/n_i + sum(1/n)/a^2).
    """
    cells = tables.cells
    there = cells.present[chosen][:, kept]
    values = np.where(there, cells.mean[chosen][:, kept], np.nan).T
    if not apart:
        return Side(values=values, noise=np.zeros(len(values)))
    known = table.df_within[chosen] > 0
    s2 = np.where(known, table.ms_within[chosen], table.ms_within[chosen][known].mean())
    inverse = np.divide(1.0, cells.n[chosen][:, kept], out=np.zeros(there.shape), where=there)
    a = np.maximum(there.sum(axis=1), 1)
    each = inverse * (1 - 2 / a)[:, None] + np.where(
        there, (inverse.sum(axis=1) / a**2)[:, None], 0
    )
    dof = np.where(known, table.df_within[chosen], table.df_within[chosen].sum())
    u2 = (each.sum(axis=1) * s2) ** 2 * 2 / dof
    return Side(values=values, noise=s2 @ each, u2=float(u2.sum()))
