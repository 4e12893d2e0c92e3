"""Files of readings that were given twice, perhaps under another name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Problem
from mtu_cli.files import doubled
from mtu_cli.files.row_marks import row_marks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList
    from mtu_cli.files.readings import Readings

FEWEST_COPIED = 4
"""Fewer equal readings than this may be chance."""


def reading_marks(readings: Readings) -> NDArray[np.uint64]:
    """Marks (n,) by which equal readings of different files are found."""
    columns = (
        readings.code, readings.position_mm, readings.error, readings.pass_number,
        readings.direction, readings.time_min,
    )  # fmt: skip
    return row_marks([np.nan_to_num(item.astype(np.float64), nan=-1e300) for item in columns])


def check_copied_files(readings: Readings, problems: ProblemList) -> None:
    """A file all of whose rows stand in an earlier one as well would count them twice.

    Single rows may agree by chance where the digits are few; a whole file does not.
    """
    marks = reading_marks(readings)
    ordered = [np.sort(marks[readings.file_index == i]) for i in range(len(readings.sources))]
    for file, earlier in doubled.copied_files(ordered, FEWEST_COPIED):
        names = ", ".join(readings.sources[i].shown for i in earlier)
        problems.add(
            Problem(
                what=f"all its readings stand in {names} as well: they would count twice",
                file=readings.sources[file].shown,
                expected="each reading once",
            )
        )
