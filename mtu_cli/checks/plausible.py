"""Sizes that machines, parts and sensors have: the one place where they stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mtu_cli.units import LENGTH

Floats = NDArray[np.float64]

ERRORS = {"length": (5e-5, 0.5), "angle": (5e-8, 5e-3)}
"""Least and most (mm, rad) that the largest error of any component of a machine is."""
STEEPEST = 0.01
"""... but for what grows along an axis: a scale, or the slope to which a laser was aligned."""
UNITS = {
    "length": {"nm": 1e-6, "um": 1e-3, "mm": 1.0, "inch": 25.4},
    "angle": {"urad": 1e-6, "arcsec": np.pi / 648000, "mrad": 1e-3, "deg": np.pi / 180},
}
POSITIONS = {"metres": 1e3, "inches": 25.4, "um": 1e-3}
"""Units that a column of mm may hold, in mm."""
NARROW, BEYOND = 0.02, 3.0
"""Positions span more than this share of a travel, and lie within so many travels of 0."""
POINT_ERROR_MM = 0.5
"""No machine tool in order errs by more."""
SAME_MM = 1e-6
"""Coordinates that differ by less are one: a nanometre, which nobody measures."""
LEAST_REPEAT_MM = 5e-5
"""Standard deviation of the repeats of the best CMM."""
COORDINATES = {"inches": 25.4, "mm for inches": 1 / 25.4, "um": 1e-3, "metres": 1e3}
"""What brings coordinates in another unit to mm."""
TOLERANCE_UM, TRAVEL_MM, CONSTANT_TRAVELS = 0.2, 5.0, 20.0
"""Least tolerance of a length, least travel of an axis, largest constant in longest travels."""
SENSOR_DEGC = (-60.0, 150.0)
SHOP_DEGC = (5.0, 60.0)
"""What a sensor of a machine in a shop typically reads."""
SENSOR_CODES = (-273.15, -127.0, -60.0, 0.0, 85.0, 150.0)
"""What sensors and loggers write where they have no reading, within SENSOR_DEGC or at its ends."""
SENSOR_STEP_K = 2.0
"""No sensor's single reading is this far off those before and after it by chance."""


def kind_of(dimension: int) -> str:
    """``length`` or ``angle``: the row of the tables."""
    return "length" if dimension == LENGTH else "angle"


def meant_units(size: float, kind: str, stated: str) -> Iterator[str]:
    """The other units in which a typical largest error of `size` (mm, rad) is that of a machine."""
    low, high = ERRORS[kind]
    own = UNITS[kind].get(stated, 1.0)
    for unit, other in UNITS[kind].items():
        if unit != stated and low <= size / own * other <= high:
            yield unit
