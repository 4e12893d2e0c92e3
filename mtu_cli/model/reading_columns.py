"""Columns of one component's readings by their names in equations."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.model.basis import TIME
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.reading_layout import ReadingLayout
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.stats.least_squares import FloatArray


def reading_columns(
    readings: Readings, rows: IntArray, layout: ReadingLayout, of: str | None
) -> dict[str, np.ndarray]:
    """Columns (n,) of the readings `rows` of a component that is a function of the axis `of`;
    `sequence` counts passes.
    """
    found: dict[str, np.ndarray] = {"sequence": layout.cells.part + 1.0}
    sign = readings.direction[rows].astype(np.float64)
    if of is not None and sign.any():
        found[f"dir_{of}"] = np.where(sign == 0, np.nan, sign)
    times = readings.time_min[rows]
    if not np.isnan(times).all():
        found[TIME] = times
    for name, column in readings.covariates.items():
        own = column[rows]
        if own.dtype == object or not np.isnan(own).all():
            found.setdefault(name, own)
    return found


def reading_places(readings: Readings, rows: IntArray, of: str | None) -> FloatArray:
    """Places (n, 3) mm: the positions along the axis, nan beside it."""
    places = np.full((len(rows), 3), np.nan)
    if of is not None:
        places[:, AXES.index(of)] = readings.position_mm[rows]
    return places
