"""Outlying parts, by a rotation test over all tables of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.anova.tables import Analysed, Label
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.rotation import outstanding_rows

FAMILY_RATE = 0.05
"""Of clean studies so many have an alarm of any kind at most: an outlying part, or a trend over the
sequence."""
PARTS, TRENDS = 0.6, 0.2
"""Shares of the rate (weighted Bonferroni): p of each kind are over its share. Not all of it is
spent."""
PARTS_RATE = PARTS * FAMILY_RATE
FEWEST_PARTS = 4
"""Among fewer parts none can be called an outlier."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusualPart:
    """An outlying part at the family-wise rate: its `deviation` in the table `where` it lies
    farthest from the mean of the others, and the `typical` one of these (root mean square), in the
    unit of the table: neither is pulled by the part. `singles` are all tables in which it is an
    outlier by itself.
    """

    part: str
    p: float
    where: Label
    deviation: float
    typical: float
    singles: tuple[Label, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsTable:
    """All tables of a study side by side: deviations of the part means (parts, tables).

    `raw` in the tables' unit, `scaled` = raw/`scale` to equal variance for unequal repeats; nan
    where a part is missing. `rounding` (tables,) is the variance of a value that the last
    digit hides, in the tables' unit, squared. Tables of equal operation and axis are looked at
    together.
    """

    labels: tuple[Label, ...]
    parts: tuple[str, ...]
    raw: FloatArray
    scale: FloatArray
    scaled: FloatArray
    rounding: FloatArray

    @property
    def rounding_scaled(self) -> FloatArray:
        """`rounding` (tables,) of scaled values."""
        return np.asarray(self.rounding / np.median(self.scale, axis=0) ** 2)


def parts_table(kinds: Sequence[Analysed]) -> PartsTable:
    """Deviations of part means; the variance of one is s_part^2 + s_repeat^2/n_i, relative where
    it is not known.
    """
    raws, scales = [], []
    for result in kinds:
        cells = result.tables.cells
        raw = cells.mean - (result.one_way.mean - cells.origin)[:, None]
        part, repeat = (np.nan_to_num(of)[:, None] for of in (result.reml.part, result.reml.repeat))
        variance = part + repeat / np.where(cells.present, cells.n, 1.0)
        raws.append(np.where(cells.present, raw, np.nan))
        scales.append(np.sqrt(np.where(variance > 0, variance, 1.0)))
    raw, scale = np.concatenate(raws).T, np.concatenate(scales).T
    labels = tuple(label for result in kinds for label in result.labels)
    parts = kinds[0].tables.parts
    return PartsTable(
        labels=labels,
        parts=parts,
        raw=raw,
        scale=scale,
        scaled=raw / scale,
        rounding=np.concatenate([result.rounding for result in kinds]),
    )


def unusual_parts(table: PartsTable, seed: int) -> tuple[UnusualPart, ...] | None:
    """Outlying parts at their share of the family-wise rate over all parts and tables; None of too
    few parts.
    """
    if len(table.parts) < FEWEST_PARTS:
        return None
    names = [(operation, axis) for operation, _, axis in table.labels]
    groups = np.unique(names, axis=0, return_inverse=True)[1].ravel()
    result = outstanding_rows(table.scaled, groups, seed, table.rounding_scaled)
    p = np.minimum(result.by_row, result.by_cell.min(axis=1))
    outside = np.flatnonzero(p <= PARTS_RATE).tolist()
    unusual = [_unusual(table, result.by_cell[i], i, float(p[i])) for i in outside]
    return tuple(sorted(unusual, key=lambda item: item.p))


def _unusual(table: PartsTable, singles: FloatArray, i: int, p: float) -> UnusualPart:
    """Part `i`, and where it lies farthest from the others in terms of how far these do; `singles`
    (tables,) are its p in each table by itself.
    """
    others = np.arange(len(table.parts)) != i
    off = table.raw - _mean(table.raw[others])
    square = _mean(off[others] ** 2)
    scale2 = square + table.rounding
    each = np.nan_to_num(off[i]) / np.sqrt(np.where(scale2 > 0, scale2, 1.0))
    j = int(np.argmax(np.abs(each)))
    return UnusualPart(
        part=table.parts[i],
        p=min(p / PARTS, 1.0),
        where=table.labels[j],
        deviation=float(off[i, j]),
        typical=float(np.sqrt(square[j])),
        singles=tuple(table.labels[j] for j in np.flatnonzero(singles <= PARTS_RATE)),
    )


def _mean(values: FloatArray) -> FloatArray:
    """Of each column, of what is known; 0 where nothing is."""
    count = np.maximum(np.isfinite(values).sum(axis=0), 1)
    return np.asarray(np.nan_to_num(values).sum(axis=0) / count)
