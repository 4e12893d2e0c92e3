"""Coefficients of a machine file that give errors as no machine has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mtu_cli.files.machine_contract import Component
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from mtu_cli.files.reading_cells import Travels

PLACES = 101
"""Places along a travel at which a component is looked at."""


def large_coefficients(component: Component, travels: Travels) -> str | None:
    """What to ask about a component whose polynomial is larger along its axis' travel than
    readings may be without a question; None for a sound one, and where no travel is stated.
    """
    import numpy as np

    from mtu_cli.files.reading_cells import largest_errors, look_large

    travel = None if component.of is None else travels.get(component.of)
    if component.coefficients is None or travel is None:
        return None
    unit = UNITS[component.unit]
    low, high = travel
    positions = np.linspace(low, high, PLACES)
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.polynomial.polynomial.polyval(positions, np.array(component.coefficients))
        errors = np.abs(np.nan_to_num(found * unit.to_internal, nan=np.inf))
    most = largest_errors(unit.dimension, positions, travels)
    if not look_large(errors, most, unit.dimension):
        return None
    per_metre = ""
    if component.degree:
        slope = component.coefficients[1] * 1000
        per_metre = (
            f"; slopes are per mm of position, so that {component.coefficients[1]:g} is "
            f"{slope:g} {unit.name} per metre"
        )
    return (
        f"large errors for a machine: up to {errors.max() / unit.to_internal:.3g} {unit.name} over "
        f"the travel of {low:g} to {high:g} mm; are the coefficients in the unit they state"
        f"{per_metre}?"
    )
