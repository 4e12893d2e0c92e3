"""Single points that are far off while the others are not: told by row and column."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

SHOWN = 3
ALIKE = 0.05
"""Share of their offset by which points that are off alike differ at most."""
NEAR = 0.99
"""Share of the other points that the distance given for them covers."""


def slips(
    points: Points, freed: Points, axes: tuple[int, ...], far: np.ndarray, limit: float
) -> str:
    """What is the matter with the points `far` (n,) that are not all points of their parts: the
    columns and rows that do not fit, and what would. "" where whole parts are off.

    `freed` are the points less the freedoms of a datum, `limit` is that of `far`, mm.
    """
    own = np.unique(points.part[far])
    if far[np.isin(points.part, own)].all():
        return ""
    errors = freed.measured[:, axes] - freed.nominal[:, axes]
    off = np.abs(errors) > limit
    columns = [f"'{AXES[axis]}_mm'" for i, axis in enumerate(axes) if off[far, i].any()]
    rest = errors[~far]
    near = float(np.quantile(np.abs(rest).max(axis=1), NEAR))
    others = f"the other points are within {near:.2g} mm of their nominal"
    rows = np.flatnonzero(far)
    if len(rows) <= SHOWN:
        return f"{'; '.join(_cells(points, int(i), axes, off[i]) for i in rows)} ({others})"
    where = f"column {columns[0]}" if len(columns) == 1 else f"columns {' and '.join(columns)}"
    text = f"in {where}{_offset(errors[far], off[far])}"
    names = [points.features[code] for code in np.unique(points.feature[far])]
    elsewhere = np.isin(points.features, names)[points.feature[~far]]
    if not elsewhere.any():
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        text += f", of feature {', '.join(map(repr, names[:SHOWN]))}{more} in every part"
    return f"{text}: first {_cells(points, int(rows[0]), axes, off[rows[0]])} ({others})"


def _cells(points: Points, i: int, axes: tuple[int, ...], off: np.ndarray) -> str:
    """A row's cells that do not fit, with what would."""
    cells = [
        f"column '{AXES[axis]}_mm': {points.measured[i, axis]:.9g} where about "
        f"{points.nominal[i, axis]:.9g} is expected"
        for axis, wrong in zip(axes, off, strict=True)
        if wrong
    ]
    return f"{points.sources[points.file_index[i]].shown}, row {points.row[i]}, {', '.join(cells)}"


def _offset(errors: FloatArray, off: np.ndarray) -> str:
    """By how much all are off alike in one column, in words."""
    if off.any(axis=0).sum() != 1:
        return ""
    one = errors[:, off.any(axis=0)][:, 0]
    middle = float(np.median(one))
    alike = np.abs(one - middle).max() < ALIKE * abs(middle)
    return f", all by {middle:+.4g} mm" if alike else ""
