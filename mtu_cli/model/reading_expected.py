"""What the others of a component make one expect of each of its readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.model.residual_cells import IntArray
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import BoolArray, display_u, spread
from mtu_cli.stats.trimmed import Trimmed, trimmed_fit

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

SWEEPS, ROUNDS = 5, 5
REPLICATES = 3
FEWEST_NEAR = {"run": 2, "place": 1}
NEAR_SHARE = 1 / 3
"""Readings of a group, and share of it, that stand for it where the rest is gross: passes move,
places have the line to be held against."""
TORN = 1 / 3
"""Share of a group far from the rest of it, from which on its majority may be the gross ones."""


def expected(readings: Readings, rows: IntArray, component: Any) -> Trimmed:
    """What the others make one expect of each of `rows` (n,), the readings of one component by
    one instrument: pass and place where places are visited again, else the polynomial alone.
    """
    error = readings.error[rows]
    if component.of is None:
        return trimmed_fit(np.ones((len(rows), 1)), error)
    direction = readings.direction[rows].astype(np.int64)
    position = readings.position_mm[rows]
    line = _curve(position, error, component.degree)
    place = _groups(position, direction)
    run = _groups(readings.file_index[rows], readings.pass_number[rows], direction)
    if np.bincount(place).min() < REPLICATES or np.bincount(run).min() < REPLICATES:
        return line
    return _of_passes(place, run, error, line)


def _of_passes(place: IntArray, run: IntArray, error: FloatArray, line: Trimmed) -> Trimmed:
    """Medians of pass and place (Tukey 1977, ch. 11), of the readings that are not gross.

    Half of a pass or a place may be gross, where few are in all: what is far off the polynomial,
    and then off the medians of the places, takes no part in the medians to begin with.
    """
    near = line.distance <= line.limit
    by_place, sure = _judged({"place": place}, error, near)
    away = np.abs(by_place.expected - error)
    near = np.where(sure, near & (by_place.distance <= by_place.limit), near)
    for _ in range(ROUNDS):
        found, sure = _judged({"run": run, "place": place}, error, near)
        now = np.where(sure, found.distance <= found.limit, near)
        if (now == near).all():
            break
        near = now
    sure &= ~_torn(run, near, away) & ~_torn(place, near, away)
    return replace(found, distance=np.where(sure, found.distance, 0.0))


def _judged(
    groups: Mapping[str, IntArray], error: FloatArray, near: BoolArray
) -> tuple[Trimmed, BoolArray]:
    """What the medians of `groups` make one expect, and of which rows (n,) they are known by
    enough of those that are `near`; the others have no part in what is expected of these.
    """
    sure, moved = np.ones(len(error), bool), np.zeros(len(error), bool)
    new = np.ones(len(error))
    for kind, group in groups.items():
        count, own = np.bincount(group), np.bincount(group, weights=near)
        known = (own >= FEWEST_NEAR[kind]) & (own >= NEAR_SHARE * count)
        # A pass of which all readings are elsewhere has moved: it is known by itself.
        sure &= (known | (own == 0))[group]
        moved |= (own == 0)[group]
        # What took no part in a mean is off it by the mean's own deviation, too.
        new += np.where(near, 0.0, 1 / np.maximum(own, 1.0)[group])
    used = sure & (near | moved)
    left = error.copy()
    for _ in range(SWEEPS if len(groups) > 1 else 1):
        for group in groups.values():
            left = left - _medians(group, left, used)
    taken = sum(int(group.max()) + 1 for group in groups.values()) - len(groups) + 1
    s = spread(left[sure], min(taken, int(sure.sum()) - 1)) if sure.any() else 0.0
    s = max(s, display_u(error))
    distance = np.abs(left) / (s * np.sqrt(new)) if s > 0 else np.zeros(len(error))
    # Medians are not moved by what is left out: nothing was chosen to suit them.
    dof = max(len(error) - taken, 1)
    return Trimmed(expected=error - left, spread=s, dof=dof, distance=distance, out=1), sure


def _torn(group: IntArray, near: BoolArray, away: FloatArray) -> BoolArray:
    """Rows (n,) of groups of which many are far off the others without being the ones that lie
    farther `away` (n,) from what other groups have: nobody knows which are the gross ones.
    """
    count, far = np.bincount(group), np.bincount(group, weights=~near)
    worst = np.full(len(count), np.inf)
    np.minimum.at(worst, group[~near], away[~near])
    best = np.zeros(len(count))
    np.maximum.at(best, group[near], away[near])
    found: BoolArray = ((far >= TORN * count) & (worst <= best))[group]
    return found


def _curve(position: FloatArray, error: FloatArray, degree: int) -> Trimmed:
    """The polynomial through the readings that are not gross."""
    span = max(float(np.ptp(position)), 1e-9)
    X = np.vander(2 * (position - position.min()) / span - 1, degree + 1)
    return trimmed_fit(X, error, [np.argsort(position, kind="stable")])


def _groups(*keys: FloatArray | IntArray) -> IntArray:
    """Numbers (n,) from 0, without a gap, of the rows whose `keys` (n,) are alike. One key after
    the other: numpy sorts rows of several keys ten times as slowly.
    """
    found = np.zeros(len(keys[0]), np.int64)
    for key in keys:
        own = np.unique(key, return_inverse=True)[1].reshape(-1)
        joint = found * (int(own.max()) + 1) + own
        found = np.unique(joint, return_inverse=True)[1].reshape(-1)
    return found


def _medians(group: IntArray, values: FloatArray, used: BoolArray | None = None) -> FloatArray:
    """The median of each value's group, (n,), of those that are `used` (n,); 0 without any."""
    own, kept = (group, values) if used is None else (group[used], values[used])
    count = np.bincount(own, minlength=int(group.max()) + 1)
    # Short integers are sorted by their digits, in a tenth of the time.
    key = own.astype(np.uint16) if len(count) <= np.iinfo(np.uint16).max else own
    ascending = np.argsort(kept)
    order = ascending[np.argsort(key[ascending], kind="stable")]
    start = np.cumsum(count) - count
    ordered = np.append(kept[order], 0.0)
    low = np.where(count > 0, start + (count - 1) // 2, len(kept))
    high = np.where(count > 0, start + count // 2, len(kept))
    middle = (ordered[low] + ordered[high]) / 2
    found: FloatArray = middle[group]
    return found
