"""Positions that one pass alone has, in place of one that it lacks: mistyped ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.pass_units import alike
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import ComponentLike, Readings

    Rows = NDArray[np.int64]

CODE = "position-alone"
FEWEST_WAYS = 3
"""Passes (there or back) of a component from which on it is known where it is read."""
NEARLY_ALL = 0.75
"""Share of these in which all other positions occur, or all of them but one; places that differ
from pass to pass are no slips."""
MOST = 3
"""Slips of a component."""


def lone_positions(
    readings: Readings, components: Mapping[str, ComponentLike]
) -> Iterator[Finding]:
    """A warning of each reading at a position where its component is read but once, in a pass that
    lacks one where nearly all others read.
    """
    for code, name in enumerate(readings.components):
        inside = np.flatnonzero(readings.code == code)
        if components[name].of is None:
            continue
        for role in dict.fromkeys(readings.roles):
            files = [i for i, own in enumerate(readings.roles) if own == role != DRIFT]
            rows = inside[np.isin(readings.file_index[inside], files)]
            for row, missing in _slips(readings, rows):
                lacks = " or ".join(f"{place:g}" for place in missing)
                text = (
                    f"{readings.sources[readings.file_index[row]].shown}, row {readings.row[row]}, "
                    f"column 'position_mm': {name} at {readings.position_mm[row]:g} mm, where no "
                    f"other pass reads it, but none of this pass at {lacks} mm, where the others "
                    "do: look whether the position is mistyped"
                )
                yield Notice(code=CODE, message=text, about=(name,))


def _slips(readings: Readings, rows: Rows) -> Iterator[tuple[int, list[float]]]:
    """The readings of a component, by one instrument, at positions of their own, each with the
    positions that its pass lacks.
    """
    if not len(rows):
        return
    places, place = np.unique(readings.position_mm[rows], return_inverse=True)
    place = place.reshape(-1)
    alone = np.bincount(place) == 1
    if not 0 < alone.sum() <= MOST:
        return
    way = alike(readings.file_index[rows], readings.pass_number[rows], readings.direction[rows])
    visited = np.zeros((int(way.max()) + 1, len(places)), bool)
    visited[way, place] = True
    usual = visited.sum(axis=0) >= min(NEARLY_ALL * len(visited), len(visited) - 1)
    if len(visited) < FEWEST_WAYS or not (alone | usual).all():
        return
    for column in np.flatnonzero(alone).tolist():
        i = int(np.flatnonzero(place == column)[0])
        missing = places[usual & ~visited[way[i]]].tolist()
        if missing:
            yield int(rows[i]), missing
