"""Values that agree by more than chance: copies of parts and repeats, and those of the drawing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mtu_cli.checks import Odd, PointsData, check
from mtu_cli.checks.plausible import LEAST_REPEAT_MM, SAME_MM
from mtu_cli.model.resolution import last_digit
from mtu_cli.model.visits import axes_of, visits_of

Rows = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
FEWEST = 4
"""Equal values from which on there is something to judge."""
CHANCE = 1e-3
"""Expected number of pairs that agree in all values by chance, below which they are copies."""
MEAN_RANGE = 1.128
"""Mean difference of two normal readings in standard deviations (Tippett, 1925)."""


@check("copied-points", of="points")
def copied_points(data: PointsData) -> Iterator[Odd]:
    """Measurements of parts with the values of another one, of the same part or of another.

    m values agree by chance in pairs * q^m cases, q the share that agrees in the pair of
    neighbours that is most alike and no copy; where all are, what the last digit hides of the
    best CMM, q = 1 - 1.128 s/digit.
    """
    table, axes = data.table, axes_of(data.table)
    if not axes:
        return
    visits = visits_of(table)
    values = (visits.errors + visits.nominal)[:, :, axes].reshape(len(visits.part), -1)
    count = np.isfinite(values).sum(axis=1)
    _, first, same = np.unique(
        np.nan_to_num(values, nan=np.inf), axis=0, return_index=True, return_inverse=True
    )
    twin = first[same.reshape(-1)]
    drawn = np.nan_to_num(np.abs(visits.errors[:, :, axes])).max(axis=(1, 2)) <= SAME_MM
    copies = np.flatnonzero((twin != np.arange(len(twin))) & (count >= FEWEST) & ~drawn)
    if not len(copies):
        return
    digit = max(last_digit(table.measured[:, axis]) for axis in axes)
    own = visits.part[copies] == visits.part[twin[copies]]
    for kind, of_kind in ((True, copies[own]), (False, copies[~own])):
        if not len(of_kind):
            continue
        share = _agreeing(values, visits.part, twin, kind, digit)
        sure = of_kind[_pairs(visits.part, kind) * share ** count[of_kind] < CHANCE]
        if len(sure):
            rows = np.flatnonzero(np.isin(visits.of_point, sure))
            names = list(dict.fromkeys(_named(data, visits.part, i, int(twin[i])) for i in sure))
            yield Odd(rows, {"names": names})


def _named(data: PointsData, part: Rows, copy: int, twin: int) -> str:
    name, other = (repr(data.table.parts[part[i]]) for i in (copy, twin))
    return f"part {name} as part {other}" if name != other else f"a repeat of part {name}"


def _pairs(part: Rows, same_part: bool) -> float:
    """How many pairs of measurements there are of one part, or of two."""
    count = np.bincount(part).astype(np.float64)
    own, every = (float((n * (n - 1) / 2).sum()) for n in (count, count.sum()))
    return own if same_part else every - own


def _agreeing(values: Floats, part: Rows, twin: Rows, same_part: bool, digit: float) -> float:
    """The share of values (visits, cells) in which neighbours that are no copies agree."""
    honest = np.flatnonzero(twin == np.arange(len(twin)))
    order = honest[np.argsort(part[honest], kind="stable")]
    one, other = order[:-1], order[1:]
    kind = (part[one] == part[other]) == same_part
    both = np.isfinite(values[one[kind]]) & np.isfinite(values[other[kind]])
    n = both.sum(axis=1)
    if not n.any():
        return max(1.0 - MEAN_RANGE * LEAST_REPEAT_MM / digit, 0.0)
    alike = (both & (values[one[kind]] == values[other[kind]])).sum(axis=1)
    pooled = (alike.sum() + 1) / (n.sum() + 1)
    return float(max(pooled, (alike[n >= FEWEST] / n[n >= FEWEST]).max(initial=0.0)))


@check("on-nominal", of="points")
def on_nominal(data: PointsData) -> Iterator[Odd]:
    """Parts, or axes, whose values are those of the drawing to the last digit."""
    table, axes = data.table, axes_of(data.table)
    exact = np.abs(table.measured - table.nominal)[:, axes] <= SAME_MM
    drawn = exact.all(axis=0)
    if len(table) >= FEWEST:
        for k in np.flatnonzero(drawn):
            letter = "xyz"[axes[k]]
            yield Odd(np.arange(len(table)), {"what": f"{letter} of all points"}, f"{letter}_mm")
    exact, sizes = exact[:, ~drawn], np.bincount(table.part, minlength=len(table.parts))
    if not exact.size:
        return
    off = np.bincount(table.part, ~exact.all(axis=1), minlength=len(sizes))
    others = (off > 0)[table.part]
    share = (exact[others].sum() + 1) / (exact[others].size + 1)
    for part in np.flatnonzero((off == 0) & (sizes > 0)):
        rows = np.flatnonzero(table.part == part)
        values = len(np.unique(table.feature[rows])) * exact.shape[1]
        if others.any() and values >= FEWEST and len(sizes) * share**values < CHANCE:
            yield Odd(rows, {"what": f"part {table.parts[part]!r}"}, "part")
