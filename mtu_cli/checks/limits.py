"""Sizes that machines, parts and sensors have, and how far chance goes: all limits of checks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.units import ANGLE, LENGTH

# Errors of machines, mm and rad.
ERRORS = {LENGTH: (5e-5, 0.5), ANGLE: (5e-8, 5e-3)}
"""By dimension: least and most that the largest error of any component of a machine is."""
STEEPEST = 0.01
"""... but for what grows along an axis: a scale, or the slope to which a laser was aligned."""
POINT_ERROR_MM = 0.5
"""No machine tool in order errs by more."""
LEAST_REPEAT_MM = 5e-5
"""Standard deviation of the repeats of the best CMM."""
TOLERANCE_UM = 0.2
"""Least tolerance of a length."""
TRAVEL_MM = 5.0
"""Least travel of an axis."""
CONSTANT_TRAVELS = 20.0
"""Largest constant of a machine, in travels of its longest axis."""
NEARLY = 0.83
"""Likeness of names of which one is a slip of the other; of operator and operation it is 0.82."""
SPAN = 0.02
"""Positions beyond a travel are in another unit where that takes them to this share of it."""
NARROW = 0.05
"""The positions of passes cover more than this share of a travel in their right unit."""
BEYOND = 3.0
"""Positions are within so many travels of the origin, nominal places of their median."""

# Units that are taken for one another, in mm and rad.
UNITS = {
    LENGTH: {"nm": 1e-6, "um": 1e-3, "mm": 1.0, "inch": 25.4},
    ANGLE: {"urad": 1e-6, "arcsec": np.pi / 648000, "mrad": 1e-3, "deg": np.pi / 180},
}
"""Units that errors are given in."""
POSITIONS = {"metres": 1e3, "inches": 25.4, "um": 1e-3}
"""What positions in the column `position_mm` may be in."""
COORDINATES = {"inches": 25.4, "mm for inches": 1 / 25.4, "um": 1e-3, "metres": 1e3}
"""What points may be in, the likeliest first; or their nominal places."""

# Chance.
CHANCE = 1e-3
"""Expected number of pairs that agree in all values by chance, below which they are copies."""
FEWEST_EQUAL = 4
"""Equal values, and different ones, from which on there is something to judge."""
FEWEST_POINTS = 3
"""Points from which on an origin or an order can be distinguished from single slips."""
NEARLY_ALL = 0.9
"""Share of the points that a mistake, undone, brings to their places ..."""
EXPLAINED = 0.1
"""... and of the distance that this leaves."""
RELATED = 0.99
"""Correlation of coordinates with their nominal values."""
ALIKE = 0.01
"""Slope of distances on positions within this of 1 or -1."""
LOUD = 20.0
"""A pass whose bends are so many times those of the other passes is in another unit."""
MIRRORED = 0.7
"""Least correlation of all passes where one is mirrored back."""
MOST = 5000
"""Points of a part up to which another order, and single slips, are looked for."""

# Sensors of temperature.
SHOP_DEGC = (5.0, 60.0)
"""What a sensor of a machine in a shop typically reads."""
SENSOR_STEP_K = 2.0
"""No sensor's single reading is this far off those before and after it by chance."""
SENSORS_NEAR_K = 8.0
"""Readings in another unit, converted, lie so near to those of the other sensors."""
STUCK_SHARE = 0.5
"""A stuck sensor keeps one value in this share of a file ..."""
OTHERS_MOVE_K = 0.5
"""... while others move by so much."""


def largest(dimension: int, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """The largest error (n,) of a machine at positions (n,), mm: that of a length grows with it."""
    grown = STEEPEST * (dimension == LENGTH) * np.nan_to_num(np.abs(position))
    return np.maximum(ERRORS[dimension][1], grown)
