"""Features of one part that stand at the same nominal place: one of them is likely mistyped."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.contracts import Notice

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

    from mtu_cli.files.points import Points

AXES = ("x", "y", "z")
SAME_MM = 1e-6
DEEPER_MM = 0.1
"""Measured z that differ by more are of two depths, where no nominal one tells."""
SHOWN = 3

Pair = tuple[int, int]


def features_alike(points: Points) -> Iterator[Notice]:
    """One warning of all such pairs: coordinates of a common place cannot tell which is which.

    A hole at two depths differs in z: its nominal one, or else the measured one. Features of
    different parts, or of different operations, never meet.
    """
    if len(points.features) < 2:
        return
    # From the last to the first: what is written last stays.
    rows = np.zeros(len(points.features), np.int64)
    rows[points.feature[::-1]] = np.arange(len(points))[::-1]
    groups = _groups(points.nominal[rows], points.measured[rows, 2])
    listed = [sorted(group, key=lambda feature: int(rows[feature])) for group in groups]
    pairs = sorted(_pairs(points, listed), key=lambda pair: int(rows[pair[1]]))
    if not pairs:
        return
    row = int(rows[pairs[0][1]])
    where = f"{points.sources[points.file_index[row]].shown}, row {points.row[row]}"
    yield _notice(where, points.features, points.nominal[rows], pairs)


def part_features_alike(where: str, names: Sequence[str], nominal: Floats) -> Iterator[Notice]:
    """The same of the features of a part file, (n,), and their nominal places (n, 3) in mm, nan
    where not given.
    """
    groups = _groups(nominal, np.full(len(names), np.nan))
    pairs = sorted(
        (pair for group in groups for pair in pairwise(sorted(group))), key=itemgetter(1)
    )
    if pairs:
        yield _notice(where, names, nominal, pairs)


def _notice(where: str, names: Sequence[str], nominal: Floats, pairs: Sequence[Pair]) -> Notice:
    shown = [_words(names, nominal, pair) for pair in pairs[:SHOWN]]
    more = f", and {len(pairs) - SHOWN} more" if len(pairs) > SHOWN else ""
    depth = np.isnan(nominal[pairs[0][0], 2])
    text = (
        f"{where}: features at the same nominal place: {', '.join(shown)}{more}; look whether one "
        f"is mistyped{', or give them a nominal z where they differ in depth' if depth else ''}"
    )
    return Notice(code="features-alike", message=text)


def _groups(nominal: Floats, measured_z: Floats) -> Iterator[list[int]]:
    """Features (n,) of one place each; measured z (n,) tell where no nominal one (n, 3) does."""
    at: dict[tuple[float | None, ...], list[int]] = defaultdict(list)
    places = np.round(nominal / SAME_MM)
    for feature, place in enumerate(places.tolist()):
        at[tuple(None if value != value else value for value in place)].append(feature)
    for place, features in at.items():
        if len(features) > 1:
            depths = measured_z[features]
            if place[2] is not None or np.isnan(depths).any():
                depths = np.zeros(len(features))
            order = np.argsort(depths, kind="stable")
            apart = np.flatnonzero(np.diff(depths[order]) > DEEPER_MM) + 1
            yield from ([features[i] for i in group] for group in np.split(order, apart))


def _pairs(points: Points, groups: list[list[int]]) -> dict[Pair, None]:
    """Neighbours among those of a group that are measured in one operation of a part."""
    alike = np.zeros(len(points.features), bool)
    alike[[feature for group in groups for feature in group]] = True
    own = np.flatnonzero(alike[points.feature])
    visit = points.part[own] * (len(points.operations) + 1) + points.operation[own]
    visits: dict[int, set[int]] = defaultdict(set)
    for feature, one in zip(points.feature[own].tolist(), visit.tolist(), strict=True):
        visits[feature].add(one)
    found: dict[Pair, None] = {}
    for group in groups:
        last: dict[int, int] = {}
        for feature in group:
            found |= {(last[one], feature): None for one in visits[feature] if one in last}
            last |= dict.fromkeys(visits[feature], feature)
    return found


def _words(names: Sequence[str], nominal: Floats, pair: Pair) -> str:
    first, second = (repr(names[feature]) for feature in pair)
    place = zip(AXES, nominal[pair[0]].tolist(), strict=True)
    told = ", ".join(f"{axis}={value:.9g}" for axis, value in place if value == value)
    return f"{first} and {second} ({told} mm)"
