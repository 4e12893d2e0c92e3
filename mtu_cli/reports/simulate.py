"""Simulated readings, points and drift readings as CSV files of the contract."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.model.simulate_drift import SimulatedDrift
from mtu_cli.model.simulate_readings import SimulatedReadings
from mtu_cli.reports.csv_text import csv_text

DIRECTIONS = {1: "forward", -1: "reverse", 0: ""}


def readings_csv(found: SimulatedReadings, heading: str) -> str:
    """A readings file; errors to seven digits."""
    two_way = bool((found.direction != 0).any())
    header = ["component", "position_mm", "pass", *(["direction"] if two_way else []), "error"]
    rows: list[Sequence[object]] = []
    for i, name in enumerate(found.component):
        sign = int(found.direction[i])
        direction = [DIRECTIONS[sign] or "forward"] if two_way else []
        position = f"{found.position[i]:.6g}"
        error = f"{found.error[i]:.7g}"
        rows.append([name, position, int(found.pass_number[i]), *direction, error, found.unit[i]])
    return heading + csv_text([*header, "unit"], rows)


def points_csv(found: SimulatedPoints, heading: str) -> str:
    """A points file; coordinates to 1 nm."""
    header = [
        "part",
        "feature",
        "repeat",
        *([] if found.operation is None else ["operation"]),
        *(f"{axis}_mm" for axis in found.axes),
        *found.covariates,
    ]
    rows = [
        [
            found.part[i],
            found.feature[i],
            int(found.repeat[i]),
            *([] if found.operation is None else [found.operation]),
            *(f"{value:.6f}" for value in found.measured[i]),
            *(_plain(values[i]) for values in found.covariates.values()),
        ]
        for i in range(len(found.part))
    ]
    return heading + csv_text(header, rows)


def drift_csv(found: SimulatedDrift, heading: str) -> str:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    header = ["component", "position_mm", "cycle", "time_min", "error", "unit", *found.temperatures]
    columns = [[f"{value:.3f}" for value in values] for values in found.temperatures.values()]
    rows = [
        [
            name,
            "" if np.isnan(found.position[i]) else f"{found.position[i]:.6g}",
            int(found.cycle[i]),
            f"{found.time[i]:.9g}",
            _error(found.error[i], found.unit[i]),
            found.unit[i],
            *(column[i] for column in columns),
        ]
        for i, name in enumerate(found.component)
    ]
    return heading + csv_text(header, rows)


def _error(value: float, unit: str) -> str:
    """Large units need more places than a thousandth."""
    return f"{value:.3f}" if unit in ("um", "nm", "arcsec", "urad", "um/m") else f"{value:.7g}"


def _plain(value: float) -> str:
    """Covariates to nine digits; whole numbers (sequence, directions) without a point."""
    return f"{value:.9g}"
