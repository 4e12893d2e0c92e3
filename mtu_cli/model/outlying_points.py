"""Single readings that pull all figures: far off what the other parts have at the feature."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mtu_cli.errors import Warned
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.outlying_repeats import (
    SHOWN,
    SLIP_RATE,
    of_operation,
    repeats_apart,
    rows_at,
    swollen,
)
from mtu_cli.model.visits import IntArray, axes_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import display_step, outlying_p

FEWEST_PARTS = 5
STEPS = 3.0
"""Of what the readings were rounded to: parts that are alike otherwise differ by less."""
ROUNDING_MM = 1e-6


class Outlying(NamedTuple):
    """Parts with a reading that stands out, the farthest first, and the warnings of them.

    `texts` say which reading it is, by how much and what the part's others are, one a part, of the
    first few; `told` counts all. `rows` (k,) are the points of every part at every feature that
    stands out, whole: which of several readings is wrong need not be known.
    """

    parts: tuple[str, ...]
    warnings: list[Finding]
    texts: tuple[str, ...]
    told: int
    rows: IntArray


def outlying(tables: MeasuredTables, points: Points) -> Outlying:
    """One warning with the farthest reading of every part that has any, and those of repeats
    that are apart (`repeats_apart`) where no mean stands out.

    The parts' means of a feature and axis are compared with one another (`outlying_p`), with
    the bound of Bonferroni over all of them. `tables` are what is compared, `points` as they were
    measured.
    """
    found, off, scatter = _found(tables, points)
    apart = repeats_apart(tables, points, {table for table, _ in found})
    doubted = [tables.parts[part] for _, part in apart.cells]
    worst: dict[int, list[int]] = {}
    for table, part in sorted(found, key=lambda at: -abs(off[at])):
        worst.setdefault(part, []).append(table)
    texts = [
        _text(tables, points, (own[0], part), off[own[0], part], scatter[own[0], part])
        + (f" (and {len(own) - 1} more of part {tables.parts[part]!r})" if len(own) > 1 else "")
        for part, own in list(worst.items())[:SHOWN]
    ]
    rows = [_own(tables, points, at) for at in (*found, *apart.cells)]
    return Outlying(
        parts=tuple(dict.fromkeys((*(tables.parts[part] for part in worst), *doubted))),
        warnings=[*_warned(texts, len(worst), len(found)), *apart.warnings],
        texts=(*texts, *apart.texts),
        told=len(worst) + len(apart.cells),
        rows=np.unique(np.concatenate(rows)) if rows else np.zeros(0, np.int64),
    )


def _warned(texts: list[str], parts: int, cells: int) -> list[Finding]:
    if not texts:
        return []
    more = f"; and {parts - SHOWN} more parts" if parts > SHOWN else ""
    one = cells == 1
    text = (
        f"{'; '.join(texts)}{more}: {'it pulls' if one else 'they pull'} the figures, look "
        f"whether {'it is' if one else 'they are'} mistyped, or the part is off"
    )
    return [Warned(code="reading-stands-out", message=text)]


def farthest_off(tables: MeasuredTables, points: Points) -> FloatArray:
    """How far the farthest part's mean that stands out is off the others in each table (tables,),
    or what repeats that a slip has put apart scatter by, mm; 0 where nothing does. Tables of
    features or of lengths of the `points`.
    """
    found, off, _ = _found(tables, points)
    farthest = swollen(tables).by_slips
    for at in found:
        farthest[at[0]] = max(farthest[at[0]], abs(off[at]))
    return farthest


def _found(
    tables: MeasuredTables, points: Points
) -> tuple[list[tuple[int, int]], FloatArray, FloatArray]:
    """(table, part) of what stands out by more than rounding, and the figures of `_judged`."""
    p, off, scatter = _judged(tables)
    doubted = np.argwhere(p <= SLIP_RATE).tolist()
    step = {axis: _step(points, axis) for axis in {tables.labels[table][2] for table, _ in doubted}}
    found = [
        (table, part)
        for table, part in doubted
        if abs(off[table, part]) > STEPS * step[tables.labels[table][2]]
    ]
    return found, off, scatter


def _judged(tables: MeasuredTables) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Family-wise p of every part's mean, how far it is off the mean of the parts that do not
    stand out, and these parts' standard deviation, mm; each (tables, parts).

    Means of fewer repeats scatter more where the repeats do, and no more where the parts do:
    the larger p of both counts.
    """
    n, mean = tables.cells.n, np.where(tables.cells.present, tables.cells.mean, np.nan)
    p = outlying_p(mean, FEWEST_PARTS)
    if (np.where(n > 0, n, n.max()) < n.max()).any():
        middle = np.nanmedian(mean, axis=1, keepdims=True)
        weighted = (mean - middle) * np.sqrt(n / n.max(axis=1, keepdims=True))
        p = np.maximum(p, outlying_p(weighted, FEWEST_PARTS))
    parts = np.isfinite(mean).sum(axis=1)
    family = p * max(int(parts[parts >= FEWEST_PARTS].sum()), 1)
    others = np.where(family > SLIP_RATE, mean, np.nan)
    known = np.isfinite(others)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    centre = np.where(known, others, 0.0).sum(axis=1, keepdims=True) / count
    squares = np.where(known, others - centre, 0.0) ** 2
    s = np.sqrt(squares.sum(axis=1, keepdims=True) / np.maximum(count - 1, 1))
    return family, mean - centre, np.broadcast_to(s, mean.shape)


def _step(points: Points, axis: str) -> float:
    """What errors along an axis were rounded to, as far as they tell, mm; of lengths, which have
    no axis, along the coarsest.

    Deviations are rounded as they are printed, or coordinates: of nominal places between two
    digits errors are then no multiples of any step, and coordinates are.
    """
    own = (AXES.index(axis),) if axis else axes_of(points)
    given = [points.measured[:, k] - points.nominal[:, k] for k in own]
    given += [points.measured[:, k] for k in own]
    return max(*(display_step(values, ROUNDING_MM) for values in given), ROUNDING_MM)


def _text(
    tables: MeasuredTables, points: Points, at: tuple[int, int], off: float, scatter: float
) -> str:
    """The reading behind a part's mean: of its repeats the one that is farthest off, and how far
    the others are: one that is mistyped is alone, of a part that is off all are.
    """
    operation, feature, axis = tables.labels[at[0]]
    k = AXES.index(axis)
    own = _own(tables, points, at)
    errors = points.measured[own, k] - points.nominal[own, k]
    away = errors - (errors.mean() - off)
    row = int(own[np.argmax(np.abs(away))])
    return (
        f"{points.sources[points.file_index[row]].shown}, row {points.row[row]}: part "
        f"{tables.parts[at[1]]!r}, feature {feature!r}{of_operation(operation)}, {axis}_mm is "
        f"{points.measured[row, k]:.7g}, {_um(away[own == row][0])} off the other parts, which "
        f"scatter by {float(f'{1e3 * scatter:.2g}'):g} um"
        + _rest(points, own[own != row], away[own != row], off)
    )


def _rest(points: Points, rows: IntArray, away: FloatArray, off: float) -> str:
    """Of the part's other readings at the feature: how far they are `away` (n,) off, mm."""
    if not len(rows):
        return ""
    one = len(rows) == 1
    named = f"other reading (row {points.row[rows[0]]})" if one else f"other {len(rows)} readings"
    # About as far as their mean: nobody mistypes a number twice.
    if (np.abs(away) > abs(off) / 2).all():
        far = _um(away[0]) if one else f"{_um(away.min())} to {_um(away.max())}"
        return f"; the part's {named} {'is' if one else 'are'} as far off ({far}): no single slip"
    least = away[np.argmax(np.abs(away))]
    return f"; the part's {named} {'is' if one else 'are at most'} {_um(least)} off"


def _um(value: float) -> str:
    return f"{float(f'{1e3 * value:.3g}'):g} um"


def _own(tables: MeasuredTables, points: Points, at: tuple[int, int]) -> IntArray:
    """The points of a part at the feature and in the operation of a table."""
    operation, feature, _ = tables.labels[at[0]]
    rows = rows_at(points, operation, feature)
    own: IntArray = rows[points.part[rows] == at[1]]
    return own
