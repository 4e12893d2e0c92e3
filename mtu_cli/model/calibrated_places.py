"""Where features of a calibrated circle really stand at the temperature of the part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.files.part import Circle
from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.stats.least_squares import FloatArray, least_squares


def growth(
    found: SimulatedPoints, ids: Sequence[str], points: FloatArray, circles: Sequence[Circle]
) -> FloatArray:
    """What the circles' features stand off their nominal places, (n, axes) in mm.

    They stand on the diameter D(T) of the calibration: p - c grows by D(T)/D0 - 1, with c the
    centre and D0 the mean diameter of the nominal features `ids` at `points` (features, 3);
    D between calibrated temperatures is linear, beyond them constant. A circle whose temperature
    no covariate gives stays nominal.
    """
    columns = ["xyz".index(axis) for axis in found.axes]
    code = np.array([ids.index(name) for name in found.feature])
    moved = np.zeros_like(found.measured)
    for circle in circles:
        if circle.calibrated_mm is None or circle.temperature not in found.covariates:
            continue
        own = [ids.index(name) for name in circle.features]
        centre = _centre(points[own])
        nominal = 2.0 * np.linalg.norm(points[own] - centre, axis=1).mean()
        known = np.array(sorted(circle.calibrated_mm.items()))
        diameter = np.interp(found.covariates[circle.temperature], known[:, 0], known[:, 1])
        rows = np.isin(code, own)
        away = (points[code] - centre)[:, columns]
        moved[rows] = (away * (diameter / nominal - 1.0)[:, None])[rows]
    return moved


def _centre(places: FloatArray) -> FloatArray:
    """The centre (3,) of the circle through `places` (n, 3): |p|^2 = 2 c.p + k in their plane."""
    middle = places.mean(axis=0)
    plane = np.linalg.svd(places - middle, full_matrices=False)[2][:2]
    p = (places - middle) @ plane.T
    X = np.column_stack([2.0 * p, np.ones(len(p))])
    c = least_squares(X, np.sum(p**2, axis=1)).coefficients[:2]
    centre: FloatArray = middle + c @ plane
    return centre
