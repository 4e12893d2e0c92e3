"""Whether features lie as near to each other as a machine's travels allow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.csv_table import cell_text
from mtu_cli.files.points import AXES, Points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.part import LoadedPart
    from mtu_cli.files.readings import Travels

MOST_APART = 2.0
"""Travels that features of one part are apart at most: it may be turned around on the machine.
Where its frame lies cancels between them: not so of single positions (`reading_cells.reach`).
"""


def check_part_extent(part: LoadedPart, travels: Travels) -> None:
    """Raises InputError for features of a part file that are farther apart than `travels` allow."""
    places = part.part.places()
    own = np.array([[np.nan if v is None else v for v in place] for place in places.values()])
    names = list(places)
    problems = []
    for i, axis, what in _beyond(own, travels):
        path = ("features", names[i], f"{axis}_mm")
        problems.append(
            Problem(
                what=f"feature {names[i]!r} {what}",
                file=part.source.shown,
                line=part.line_of(*path),
                path=".".join(path),
                value=cell_text(float(own[i, AXES.index(axis)])),
                expected=_expected(axis, travels),
            )
        )
    if problems:
        raise InputError(problems)


def check_points_extent(points: Points, travels: Travels) -> None:
    """Raises InputError for measured points whose nominal places are farther apart than `travels`
    allow, once for each place of a feature.
    """
    if next(_beyond(points.nominal, travels), None) is None:
        return
    # Rows carry nominal places of their own: that of one row may be another than its feature's.
    known = np.where(np.isnan(points.nominal), np.inf, points.nominal)
    first = np.unique(np.column_stack([points.feature, known]), axis=0, return_index=True)[1]
    problems = []
    for i, axis, what in _beyond(points.nominal[first], travels):
        at = int(first[i])
        problems.append(
            Problem(
                what=f"feature {points.features[int(points.feature[at])]!r} {what}",
                file=points.sources[int(points.file_index[at])].shown,
                row=int(points.row[at]),
                column=f"nominal_{axis}_mm",
                value=cell_text(float(points.nominal[at, AXES.index(axis)])),
                expected=_expected(axis, travels),
            )
        )
    if problems:
        raise InputError(problems)


def _beyond(places: NDArray[np.float64], travels: Travels) -> Iterator[tuple[int, str, str]]:
    """Number of a place, axis and what to say, of `places` (n, 3) in mm too far from the middle
    one along an axis; where none is, but their ends are too far apart, of both.
    """
    for a, axis in enumerate(AXES):
        column = places[:, a]
        if axis not in travels or not np.isfinite(column).any():
            continue
        low, high = travels[axis]
        most, extent = MOST_APART * abs(high - low), float(np.nanmax(column) - np.nanmin(column))
        if extent <= most:
            continue
        far = np.flatnonzero(np.abs(column - np.nanmedian(column)) > most)
        ends = [int(np.nanargmin(column)), int(np.nanargmax(column))]
        # Of two groups neither is the one that is wrong.
        known = 0 < 2 * len(far) < np.isfinite(column).sum()
        for i in far.tolist() if known else sorted(ends):
            place = "far from the others" if known else "at one end"
            yield (
                i,
                axis,
                f"is {place}: all cover {extent:g} mm in {axis}, the machine travels "
                f"{abs(high - low):g} mm",
            )


def _expected(axis: str, travels: Travels) -> str:
    low, high = travels[axis]
    return (
        f"features within {MOST_APART * abs(high - low):g} mm of each other in {axis}: twice the "
        "travel, as a part may be turned around; or another travel_mm of the machine"
    )
