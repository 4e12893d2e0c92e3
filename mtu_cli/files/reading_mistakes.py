"""What would explain readings of no machine: another unit, or what is no error at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.units import ANGLE, LENGTH, UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

TYPICAL = {LENGTH: 0.1, ANGLE: 0.02}
"""Share of the largest error that a component typically has at most, in the unit it is meant in."""
SHORTEST_BAR_MM = 20.0


def explained(raw: Floats, places: Floats | None, most: Floats, unit: str) -> str:
    """What would explain a component's errors, `raw` (n,) in `unit`, in words; "" where nothing
    does. `places` (n,) in mm are where they were read, `most` (n,) the largest that are likely, in
    mm or rad.
    """
    own = UNITS[unit]
    errors, largest = raw * own.to_internal, float(np.median(most))
    middle, typical = float(np.median(errors)), float(np.median(np.abs(raw)))
    if own.dimension == LENGTH:
        if places is not None and float(np.median(np.abs(errors - places))) < largest:
            return "these look like the positions that were reached, not their errors"
        if middle > SHORTEST_BAR_MM and float(np.median(np.abs(errors - middle))) < largest:
            return f"these look like lengths of a bar of {middle:.6g} mm, not errors"
    plausible = TYPICAL[own.dimension] * largest
    fit = [
        other
        for other in UNITS.values()
        if (other.dimension, other.name == "um/m") == (own.dimension, False)
        and other.to_internal < own.to_internal
        and typical * other.to_internal <= plausible
    ]
    largest_fit = max((other.to_internal for other in fit), default=0.0)
    names = [other.name for other in fit if other.to_internal > 0.1 * largest_fit]
    if names:
        return f"these look like {' or '.join(names)} in a column of {unit}"
    thousand = typical * own.to_internal / 1000 <= plausible
    return "these look 1000 times too large" if thousand else ""
