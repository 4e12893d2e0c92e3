"""Features of one part that stand at the same nominal place: one of them is likely mistyped."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

    from mtu_cli.files.points import Points

AXES = ("x", "y", "z")
SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""
DEEPER_MM = 0.1
"""Measured z that differ by more are of two depths, where no nominal one tells."""
SHOWN = 3

Place = tuple[list[int], "Floats"]
"""Features, and their nominal coordinates (3,) in mm."""


def features_alike(points: Points) -> Iterator[Finding]:
    """One warning of all such places: coordinates of a common place cannot tell which is which.

    A hole at two depths differs in z: its nominal one, or else the measured one. Features of
    different parts, or of different operations, never meet.
    """
    if len(points.features) < 2:
        return
    shown = [source.shown for source in points.sources]
    rank = np.unique(shown, return_inverse=True)[1].reshape(-1)
    # From the last to the first: what is written last stays, whichever file comes first.
    order = np.lexsort((points.row, rank[points.file_index]))[::-1]
    rows = np.zeros(len(points.features), np.int64)
    rows[points.feature[order]] = order
    nominal, names = points.nominal[rows], points.features

    def first(feature: int) -> tuple[str, int]:
        row = int(rows[feature])
        return shown[points.file_index[row]], int(points.row[row])

    groups = [*_groups(nominal, points.measured[rows, 2])]
    met = [sorted(own, key=lambda f: names[f]) for own in _that_meet(points, groups)]
    if not met:
        return
    met.sort(key=lambda own: sorted(map(first, own))[1])
    name, row = sorted(map(first, met[0]))[1]
    yield _notice(f"{name}, row {row}", names, [(own, nominal[own[0]]) for own in met])


def part_features_alike(where: str, names: Sequence[str], nominal: Floats) -> Iterator[Finding]:
    """The same of the features of a part file, (n,), and their nominal places (n, 3) in mm, nan
    where not given.
    """
    groups = [*_groups(nominal, np.full(len(names), np.nan))]
    if groups:
        yield _notice(where, names, [(own, nominal[own[0]]) for own in map(sorted, groups)])


def _notice(where: str, names: Sequence[str], places: Sequence[Place]) -> Finding:
    shown = [_words([names[f] for f in own], at) for own, at in places[:SHOWN]]
    more = f", and {len(places) - SHOWN} places more" if len(places) > SHOWN else ""
    depth = np.isnan(places[0][1][2])
    text = (
        f"{where}: features at the same nominal place: {', '.join(shown)}{more}; look whether one "
        f"is mistyped, or there on purpose"
        f"{', or give them a nominal z of their own' if depth else ''}"
    )
    return Notice(code="features-alike", message=text)


def _groups(nominal: Floats, measured_z: Floats) -> Iterator[list[int]]:
    """Features (n,) of one place each; measured z (n,) tell where no nominal one (n, 3) does."""
    at: dict[tuple[float | None, ...], list[int]] = defaultdict(list)
    places = np.round(nominal / SAME_MM)
    for feature, place in enumerate(places.tolist()):
        at[tuple(None if value != value else value for value in place)].append(feature)
    for place, features in at.items():
        depths = measured_z[features]
        if place[2] is not None or np.isnan(depths).any():
            depths = np.zeros(len(features))
        order = np.argsort(depths, kind="stable")
        apart = np.flatnonzero(np.diff(depths[order]) > DEEPER_MM) + 1
        for group in np.split(order, apart):
            if len(group) > 1:
                yield [features[i] for i in group]


def _that_meet(points: Points, groups: Sequence[list[int]]) -> Iterator[list[int]]:
    """Of each group those that are measured beside another one in an operation of a part."""
    if not groups:
        return
    of = np.full(len(points.features), -1)
    for g, group in enumerate(groups):
        of[group] = g
    own = np.flatnonzero(of[points.feature] >= 0)
    visit = np.column_stack([of[points.feature[own]], points.part[own], points.operation[own]])
    _, code = np.unique(visit, axis=0, return_inverse=True)
    pairs = np.unique(np.column_stack([code.reshape(-1), points.feature[own]]), axis=0)
    together = np.bincount(pairs[:, 0])[pairs[:, 0]] > 1
    met = set(pairs[together, 1].tolist())
    for group in groups:
        found = [feature for feature in group if feature in met]
        if found:
            yield found


def _words(names: Sequence[str], place: Floats) -> str:
    *others, last = map(repr, names)
    told = zip(AXES, place.tolist(), strict=True)
    at = ", ".join(f"{axis}={value:.9g}" for axis, value in told if value == value)
    return f"{', '.join(others)} and {last} ({at} mm)"
