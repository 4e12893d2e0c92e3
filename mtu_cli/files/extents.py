"""Whether features lie as near to each other as a machine's travels allow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.csv_table import cell_text
from mtu_cli.files.points import AXES, Points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.part import LoadedPart
    from mtu_cli.files.reading_cells import Travels

TURNED = 2.0
"""A part that is turned around on the machine is at most so many times as long as the travel."""


def check_part_extent(part: LoadedPart, travels: Travels) -> None:
    """Raises InputError for features of a part file farther from the others than `travels` allow.

    What is said names the feature farthest from the middle one.
    """
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
    """The same for the nominal places of measured points."""
    problems = []
    for i, axis, what in _beyond(points.nominal, travels):
        name = points.features[int(points.feature[i])]
        problems.append(
            Problem(
                what=f"feature {name!r} {what}",
                file=points.sources[int(points.file_index[i])].shown,
                row=int(points.row[i]),
                column=f"nominal_{axis}_mm",
                value=cell_text(float(points.nominal[i, AXES.index(axis)])),
                expected=_expected(axis, travels),
            )
        )
    if problems:
        raise InputError(problems)


def _beyond(
    places: NDArray[np.float64], travels: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[int, str, str]]:
    """Number of a place, axis and what to say, of each axis along which `places` (n, 3) in mm
    are too far apart.
    """
    for a, axis in enumerate(AXES):
        column = places[:, a]
        if axis not in travels or not np.isfinite(column).any():
            continue
        low, high = travels[axis]
        extent = float(np.nanmax(column) - np.nanmin(column))
        if extent > TURNED * abs(high - low):
            far = np.abs(column - np.nanmedian(column))
            what = (
                f"is far from the others: all cover {extent:g} mm in {axis}, "
                f"the machine travels {abs(high - low):g} mm"
            )
            yield int(np.nanargmax(far)), axis, what


def _expected(axis: str, travels: Travels) -> str:
    low, high = travels[axis]
    return (
        f"features within {TURNED * abs(high - low):g} mm of each other in {axis}: twice the "
        "travel, as a part may be turned around; or another travel_mm of the machine"
    )
