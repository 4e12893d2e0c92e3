"""The plane that features are drawn in, and their levels along its normal."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residual_layout import IntArray
from mtu_cli.stats.least_squares import FloatArray

FEW = 4
"""Levels that are always drawn apart; more only where features stand on top of each other."""
MOST = 9
"""Levels on one sheet."""
APART = 1e-3
"""Coordinates that differ by more of the part's extent are at two levels."""
ATOP = 0.02
"""Features nearer in the plane than this share of the extent stand on top of each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """The features, `rows` (m,), at one height, in words `at`; empty where it is not known."""

    at: str
    rows: IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """`plane` and `normal` by index of axis, the levels drawn of `total` that there are."""

    plane: tuple[int, int]
    normal: int
    levels: tuple[Level, ...]
    total: int


def cut(places: FloatArray, axes: Collection[str]) -> Cut:
    """How features at `places` (n, 3) mm with errors along `axes` are drawn best.

    From above, level by level, unless there are too many levels in z for one sheet: then along
    the axis with the fewest; a face of holes is seen from the side. A feature without a height
    cannot be seen from the side: then all are seen from above.
    """
    above = _cut(places, 2)
    if not set(AXES) <= set(axes) or np.isnan(places[:, 2]).any():
        return above
    found = [above, _cut(places, 1), _cut(places, 0)]
    face = above.total > 1 and any(item.total == 1 for item in found)
    if above.total <= MOST and not face:
        return above
    if face:
        return next(item for item in found if item.total == 1)
    return min(found, key=lambda item: len(item.levels))


def flat(places: FloatArray, axes: Collection[str]) -> bool:
    """Whether a map of errors in x and y at one height says everything."""
    return "z" not in axes and _cut(places, 2).total == 1


def _cut(places: FloatArray, normal: int) -> Cut:
    plane = (0, 1) if normal == 2 else (0, 2) if normal == 1 else (1, 2)
    heights = places[:, normal]
    extent = _extent(places)
    group = _grouped(heights, APART * extent)
    total = int(group.max()) + 1
    if total > FEW and not _atop(places[:, plane], group, ATOP * extent):
        group = np.zeros(len(places), dtype=np.int64)
    count = int(group.max()) + 1
    drawn = np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(int))
    rows = [np.flatnonzero(group == i) for i in drawn]
    levels = tuple(Level(at=_words(heights[own], normal), rows=own) for own in rows)
    return Cut(plane=plane, normal=normal, levels=levels, total=total)


def _extent(places: FloatArray) -> float:
    sizes = [float(np.ptp(c[np.isfinite(c)])) for c in places.T if np.isfinite(c).any()]
    return max(sizes, default=0.0)


def _grouped(heights: FloatArray, apart: float) -> IntArray:
    """The level (n,) of each height, from the lowest; unknown heights are a level, the last."""
    order = np.argsort(heights, kind="stable")
    values = heights[order]
    steps = ~(np.diff(values) <= apart) & ~np.isnan(values[:-1])
    level = np.zeros(len(heights), dtype=np.int64)
    level[order] = np.concatenate([[0], np.cumsum(steps)])
    return level


def _atop(plane: FloatArray, group: IntArray, near: float) -> bool:
    """Whether features of different levels stand at one known place of the plane."""
    from scipy.spatial import KDTree

    known = np.isfinite(plane).all(axis=1)
    level = group[known]
    pairs = KDTree(plane[known]).query_pairs(near, output_type="ndarray")
    return bool((level[pairs[:, 0]] != level[pairs[:, 1]]).any())


def _words(heights: FloatArray, normal: int) -> str:
    known = heights[np.isfinite(heights)]
    if not len(known):
        return ""
    low, high = f"{known.min() + 0.0:.6g}", f"{known.max() + 0.0:.6g}"
    middle = f"{float(np.median(known)) + 0.0:.6g}"
    one = np.ptp(known) <= 1e-3 * max(1.0, abs(float(known.max())))
    return f"{AXES[normal]} = {middle} mm" if one else f"{AXES[normal]} {low} to {high} mm"
