"""Simulated readings, points and drift readings as CSV files of the contract.

One entry a column: its name, and its cells as texts of the digits that an instrument would show.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.model.simulate_drift import Sensors, SimulatedDrift
from mtu_cli.model.simulate_readings import SimulatedReadings
from mtu_cli.reports.fields import csv_text
from mtu_cli.stats.least_squares import FloatArray

DIRECTIONS = {1: "forward", -1: "reverse", 0: "forward"}
FINE = ("um", "nm", "arcsec", "urad", "um/m")
"""Units of which a thousandth is fine enough; larger ones have seven digits."""


def readings_csv(found: SimulatedReadings, heading: str) -> str:
    """A readings file; errors to seven digits."""
    two_way = bool((found.direction != 0).any())
    columns: dict[str, Iterable[object]] = {
        "component": found.component,
        "position_mm": _texts(found.position, "{:.6g}"),
        "pass": map(int, found.pass_number),
        "direction": (DIRECTIONS[int(sign)] for sign in found.direction),
        "error": _texts(found.error, "{:.7g}"),
        "unit": found.unit,
    }
    return heading + _csv({k: v for k, v in columns.items() if two_way or k != "direction"})


def points_csv(found: SimulatedPoints, heading: str) -> str:
    """A points file; coordinates to 1 nm, covariates to nine digits."""
    measured = zip(found.axes, found.measured.T, strict=True)
    columns: dict[str, Iterable[object]] = {
        "part": found.part,
        "feature": found.feature,
        "repeat": map(int, found.repeat),
        **({} if found.operation is None else {"operation": [found.operation] * len(found.part)}),
        **{f"{axis}_mm": _texts(values, "{:.6f}") for axis, values in measured},
        **{name: _texts(values, "{:.9g}") for name, values in found.covariates.items()},
    }
    return heading + _csv(columns)


def drift_csv(found: SimulatedDrift, heading: str) -> str:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    errors = zip(found.error, found.unit, strict=True)
    columns: dict[str, Iterable[object]] = {
        "component": found.component,
        "position_mm": _texts(found.position, "{:.6g}"),
        "cycle": map(int, found.cycle),
        "time_min": _texts(found.time, "{:.9g}"),
        "error": (f"{x:.3f}" if unit in FINE else f"{x:.7g}" for x, unit in errors),
        "unit": found.unit,
        **{name: _texts(values, "{:.3f}") for name, values in found.temperatures.items()},
    }
    return heading + _sensors_heading(found.sensors) + _csv(columns)


def _sensors_heading(sensors: Sensors) -> str:
    """Comment lines that say how the sensors follow the room."""
    each = [
        f"{name} {share:.3f} {lag:.1f}"
        for name, share, lag in zip(sensors.names, sensors.shares, sensors.lags, strict=True)
    ]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return (
        "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
        "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
        "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
        + "".join(f"#   {line}\n" for line in lines)
    )


def _texts(values: FloatArray, form: str) -> Iterable[str]:
    """An empty cell where there is no value."""
    return ("" if np.isnan(value) else form.format(value) for value in values)


def _csv(columns: Mapping[str, Iterable[object]]) -> str:
    return csv_text(list(columns), zip(*columns.values(), strict=True))
