"""A thermal model in three states of the machine: the drift along the axis, cold to warm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

STEPS = (0.0, 3.0, 6.0)
"""Uniform temperatures in K above the reference where the sensors' range is not known."""
PLACES = 101
"""Places of a profile along the axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftProfile:
    """Drift in mm or rad at places (g,) mm, (3, g), and where it was observed, (3, p).

    `temperatures` (3, s) degC: the lowest, middle and highest that each sensor read, which in a
    warm-up come close to a state of the machine; where they are not known `ranged` is False and
    all sensors are STEPS above the reference. A drift that is the same everywhere has one place.
    """

    temperatures: FloatArray
    ranged: bool
    places: FloatArray
    drift: FloatArray
    at_observed: FloatArray


def drift_profile(estimate: ThermalEstimate, observed: Sequence[float]) -> DriftProfile:
    """The model's drift in its three states; `observed` are the positions of the readings, mm."""
    ranged = estimate.temperature_range is not None and len(estimate.sensors) > 0
    states = _states(estimate)
    positions = np.array(observed, float)
    places = np.zeros(1)
    if estimate.degree > 0 and len(positions) > 1:
        low, high = estimate.position_range or (positions.min(), positions.max())
        places = np.linspace(low, high, PLACES)
    return DriftProfile(
        temperatures=states,
        ranged=ranged,
        places=places,
        drift=_drifts(estimate, places, states),
        at_observed=_drifts(estimate, positions, states),
    )


def _states(estimate: ThermalEstimate) -> FloatArray:
    if estimate.temperature_range is None or not estimate.sensors:
        uniform = estimate.reference + np.array(STEPS)
        return np.repeat(uniform[:, None], len(estimate.sensors), axis=1)
    low, high = estimate.temperature_range.T
    return np.array([low, (low + high) / 2, high])


def _drifts(estimate: ThermalEstimate, places: FloatArray, states: FloatArray) -> FloatArray:
    return np.array(
        [
            estimate.drift(places, dict(zip(estimate.sensors, state[:, None], strict=True)))
            for state in states
        ]
    )
