"""Where features of a calibrated circle really stand at the temperature of the part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.files.part import Circle
from mtu_cli.findings import InputError, finding
from mtu_cli.model.geometry import GeometryError, fit_circle
from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.stats.least_squares import FloatArray


def growth(
    found: SimulatedPoints, ids: Sequence[str], points: FloatArray, circles: Sequence[Circle]
) -> FloatArray:
    """What the circles' features stand off their nominal places, (n, axes) in mm.

    They stand on the diameter D(T) of the calibration: p - c grows by D(T)/D0 - 1, with c the
    centre and D0 the diameter of the circle through the nominal features `ids` at `points`
    (features, 3); D between calibrated temperatures is linear, beyond them constant. A circle
    whose temperature no covariate gives stays nominal.

    Raises InputError for features that do not determine their circle.
    """
    columns = ["xyz".index(axis) for axis in found.axes]
    code = np.array([ids.index(name) for name in found.feature])
    moved = np.zeros_like(found.measured)
    for circle in circles:
        if circle.calibrated_mm is None or circle.temperature not in found.covariates:
            continue
        own = [ids.index(name) for name in circle.features]
        try:
            ring = fit_circle(points[own])
        except GeometryError as error:
            raise InputError(
                finding(
                    "too-little-data",
                    what=f"no circle goes through the nominal points of {circle.id!r}: {error}",
                )
            ) from None
        known = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(found.covariates[circle.temperature], known[:, 0], known[:, 1])
        rows = np.isin(code, own)
        away = (points[code] - ring.centre)[:, columns]
        moved[rows] = (away * (diameter / (2.0 * ring.radius) - 1.0)[:, None])[rows]
    return moved
