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

AXES = ("x", "y", "z")
SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""
SHOWN = 3

Place = tuple[list[int], "Floats"]
"""Features, and their nominal coordinates (3,) in mm."""


def part_features_alike(where: str, names: Sequence[str], nominal: Floats) -> Iterator[Finding]:
    """One warning of all features (n,) of a part file that stand at one nominal place (n, 3), mm,
    nan where not given.
    """
    groups = [*_groups(nominal)]
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


def _groups(nominal: Floats) -> Iterator[list[int]]:
    """Features of one place each."""
    at: dict[tuple[float | None, ...], list[int]] = defaultdict(list)
    for feature, place in enumerate(np.round(nominal / SAME_MM).tolist()):
        at[tuple(None if value != value else value for value in place)].append(feature)
    return (features for features in at.values() if len(features) > 1)


def _words(names: Sequence[str], place: Floats) -> str:
    *others, last = map(repr, names)
    told = zip(AXES, place.tolist(), strict=True)
    at = ", ".join(f"{axis}={value:.9g}" for axis, value in told if value == value)
    return f"{', '.join(others)} and {last} ({at} mm)"
