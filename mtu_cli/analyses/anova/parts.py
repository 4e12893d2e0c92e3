"""Outlying parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.analyses.anova.tables import Kind
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import Components, OneWay
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.rotation import RATE, Outstanding, outstanding_rows

FAMILY_RATE = RATE
FEWEST_PARTS = 4
"""Among fewer parts none can be called an outlier."""

Label = tuple[str, str, str]
Why = Literal["distance", "mean", "single"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusualPart:
    """An outlying part at the family-wise rate, and by what most of all.

    `why`: its mean over a group of tables (an axis of an operation, the lengths), its distance
    there (root mean square), or a `single` table. `where` is that table (operation, id, axis)
    or the group (id ""), "length" and "angle" standing for an axis; `deviation` how far the
    part lies from the mean of the others there and `typical` how far these do (root mean
    square), in the unit of the tables: neither is pulled by the part. `singles` all tables
    in which it is an outlier by itself.
    """

    part: str
    p: float
    why: Why
    where: Label
    deviation: float
    typical: float
    singles: tuple[Label, ...]

    @property
    def unit(self) -> str:
        """Of its figures in a report."""
        return "arcsec" if self.where[2] == "angle" else "um"


@dataclass(frozen=True, slots=True, kw_only=True)
class PartsTable:
    """Tables of any kind side by side: deviations of the part means (parts, tables).

    `raw` in the tables' unit, `scaled` = raw/`scale` to equal variance for unequal repeats; nan
    where a part is missing. Tables of equal `group` are looked at together.
    """

    labels: tuple[Label, ...]
    parts: tuple[str, ...]
    raw: FloatArray
    scale: FloatArray
    scaled: FloatArray
    group: tuple[Label, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """All tables of a study as one family, and what its test `found`: None of too few parts."""

    table: PartsTable
    found: Outstanding | None


def full_labels(tables: MeasuredTables, kind: Kind) -> tuple[Label, ...]:
    """Labels of which the axis of a length is "length", that of a right angle "angle"."""
    return tuple((operation, name, axis or kind) for operation, name, axis in tables.labels)


def parts_table(
    tables: MeasuredTables, kind: Kind, table: OneWay, components: Components
) -> PartsTable:
    """Deviations of part means; the variance of one is s_part^2 + s_repeat^2/n_i."""
    cells = tables.cells
    raw = cells.mean - (table.mean - cells.origin)[:, None]
    scale = mean_scale(tables, components)
    scaled = raw / scale
    for values in (raw, scaled):
        values[~cells.present] = np.nan
    labels = full_labels(tables, kind)
    return PartsTable(
        labels=labels,
        parts=tables.parts,
        raw=raw.T,
        scale=scale.T,
        scaled=scaled.T,
        group=tuple((operation, "", axis) for operation, _, axis in labels),
    )


def mean_scale(tables: MeasuredTables, components: Components) -> FloatArray:
    """Standard deviation (tables, parts) of a part's mean, relative where it is not known."""
    cells = tables.cells
    part = np.nan_to_num(components.part)[:, None]
    repeat = np.nan_to_num(components.repeat)[:, None]
    variance = part + repeat / np.where(cells.present, cells.n, 1.0)
    scale: FloatArray = np.sqrt(np.where(variance > 0, variance, 1.0))
    return scale


def side_by_side(first: PartsTable, *others: PartsTable) -> PartsTable:
    """All tables of the same parts as one family."""
    found = (first, *others)
    return PartsTable(
        labels=tuple(label for item in found for label in item.labels),
        parts=first.parts,
        raw=np.hstack([item.raw for item in found]) if others else first.raw,
        scale=np.hstack([item.scale for item in found]) if others else first.scale,
        scaled=np.hstack([item.scaled for item in found]) if others else first.scaled,
        group=tuple(label for item in found for label in item.group),
    )


def unusual_parts(table: PartsTable, seed: int) -> tuple[Family, list[UnusualPart]]:
    """Outlying parts with a family-wise error rate of 5 % over all parts and tables."""
    if len(table.parts) < FEWEST_PARTS:
        return Family(table=table, found=None), []
    kinds = {label: code for code, label in enumerate(dict.fromkeys(table.group))}
    groups = np.array([kinds[label] for label in table.group])
    found = outstanding_rows(table.scaled, groups, seed)
    p = np.minimum(found.by_row, found.by_cell.min(axis=1))
    unusual = [
        _unusual(table, groups, list(kinds), found, int(i))
        for i in np.flatnonzero(p <= FAMILY_RATE)
    ]
    family = Family(table=table, found=found)
    return family, sorted(unusual, key=lambda item: item.p)


def _unusual(
    table: PartsTable, groups: np.ndarray, kinds: list[Label], found: Outstanding, i: int
) -> UnusualPart:
    """Part `i` with the table or group of its largest deviation."""
    p_row, p_single = float(found.by_row[i]), float(found.by_cell[i].min())
    singles = np.flatnonzero(found.by_cell[i] <= FAMILY_RATE)
    if p_row <= p_single:
        why: Why = "mean" if found.row_kind[i] else "distance"
        where, deviation, typical = _of_groups(table, groups, kinds, i, why)
    else:
        why, j = "single", int(np.argmin(found.by_cell[i]))
        own = _off_the_others(table.raw[:, [j]], i)[:, 0]
        where, deviation, typical = table.labels[j], float(own[i]), _rms(np.delete(own, i))
    return UnusualPart(
        part=table.parts[i],
        p=min(p_row, p_single),
        why=why,
        where=where,
        deviation=deviation,
        typical=typical,
        singles=tuple(table.labels[j] for j in singles),
    )


def _of_groups(
    table: PartsTable, groups: np.ndarray, kinds: list[Label], i: int, why: Why
) -> tuple[Label, float, float]:
    """The group in which part `i` deviates most: its deviation and the others'."""
    best: tuple[float, Label, float, float] | None = None
    raw = _off_the_others(table.raw, i)
    for code, label in enumerate(kinds):
        known = np.where(np.isfinite(raw), raw, 0.0)[:, groups == code]
        count = np.maximum(np.isfinite(raw)[:, groups == code].sum(axis=1), 1)
        each = known.sum(axis=1) if why == "mean" else np.einsum("ij,ij->i", known, known)
        value = each / count if why == "mean" else np.sqrt(each / count)
        typical = _rms(np.delete(value, i))
        off = abs(float(value[i]))
        # Where nothing differs at all, nor does this part.
        share = off / typical if typical > 0 else np.inf if off > 0 else 0.0
        if best is None or share > best[0]:
            best = (share, label, float(value[i]), typical)
    if best is None:
        raise ValueError("a table without columns")
    return best[1:]


def _off_the_others(raw: FloatArray, i: int) -> FloatArray:
    """Deviations (parts, tables) from the mean of all parts but `i`."""
    others = np.delete(raw, i, axis=0)
    known = np.isfinite(others)
    mean = np.where(known, others, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    off: FloatArray = raw - mean
    return off


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")


def part_limits(family: Family, column: int) -> FloatArray:
    """The values (2, parts) of part means beyond which a part is an outlier of one table by itself,
    about the table's mean; nan where none can.

    They are those of the test that names the parts, over all tables of the study.
    """
    table = family.table
    if family.found is None:
        return np.full((2, len(table.parts)), np.nan)
    scaled = table.scaled[:, column]
    known = scaled[np.isfinite(scaled)]
    s = float(known.std(ddof=1)) if len(known) > 1 else float("nan")
    half = family.found.limit[column] * s
    with np.errstate(invalid="ignore"):
        scale = np.abs(table.scale[:, column])
    return np.stack([scale * (known.mean() - half), scale * (known.mean() + half)])
