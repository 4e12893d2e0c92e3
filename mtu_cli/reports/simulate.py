"""Simulated readings, points and drift readings as CSV files of the contract, or of a laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.model.simulate import SimulatedDrift, SimulatedPoints, SimulatedReadings
from mtu_cli.reports.fields import csv_text
from mtu_cli.stats.least_squares import FloatArray

SENSORS = (
    "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
    "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
    "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
)
FINE = ("um", "nm", "arcsec", "urad", "um/m")
"""Units of which a thousandth is fine enough; larger ones have seven digits."""


@dataclass(frozen=True, slots=True)
class Synthetic:
    """A file: the cells of its columns, comment lines on what they hold, and its `body` where it
    is no CSV.
    """

    columns: dict[str, list[str]]
    comment: str = ""
    body: str | None = None

    @property
    def count(self) -> int:
        """Its rows."""
        return len(next(iter(self.columns.values())))

    def text(self, heading: str) -> str:
        """The whole file below a `heading`."""
        rows = zip(*self.columns.values(), strict=True)
        body = csv_text(list(self.columns), rows) if self.body is None else self.body
        return heading + self.comment + body

    def values(self) -> dict[str, list[str | float | None]]:
        """Its columns as read from the file: numbers, where all cells are such."""
        return {name: _values(cells) for name, cells in self.columns.items()}


def _values(cells: list[str]) -> list[str | float | None]:
    for kind in (int, float):
        try:
            return [kind(cell) if cell else None for cell in cells]
        except ValueError:
            pass
    return [*cells]


def readings_file(readings: SimulatedReadings) -> Synthetic:
    """A readings file; errors to seven digits."""
    columns = {
        "component": [*readings.component],
        "position_mm": _texts(readings.position, "{:.6g}"),
        "pass": _texts(readings.pass_number, "{:d}"),
        "direction": ["reverse" if sign < 0 else "forward" for sign in readings.direction],
        "error": _texts(readings.error, "{:.7g}"),
        "unit": [*readings.unit],
    }
    if not (readings.direction != 0).any():
        del columns["direction"]
    return Synthetic(columns)


def points_file(points: SimulatedPoints) -> Synthetic:
    """A points file; coordinates to 1 nm, covariates to nine digits."""
    columns = {"part": [*points.part], "feature": [*points.feature]}
    columns["repeat"] = _texts(points.repeat, "{:d}")
    if points.operation:
        columns["operation"] = [points.operation] * len(points.part)
    for axis, values in zip(points.axes, points.measured.T, strict=True):
        columns[f"{axis}_mm"] = _texts(values, "{:.6f}")
    columns |= {name: _texts(values, "{:.9g}") for name, values in points.covariates.items()}
    return Synthetic(columns)


def drift_file(drift: SimulatedDrift) -> Synthetic:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    errors = zip(drift.error, drift.unit, strict=True)
    columns = {
        "component": [*drift.component],
        "position_mm": _texts(drift.position, "{:.6g}"),
        "cycle": _texts(drift.cycle, "{:d}"),
        "time_min": _texts(drift.time, "{:.9g}"),
        "error": [f"{x:.3f}" if unit in FINE else f"{x:.7g}" for x, unit in errors],
        "unit": [*drift.unit],
        **{name: _texts(values, "{:.3f}") for name, values in drift.temperatures.items()},
    }
    sensors = zip(drift.sensors.names, drift.sensors.shares, drift.sensors.lags, strict=True)
    each = [f"{name} {share:.3f} {lag:.1f}" for name, share, lag in sensors]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return Synthetic(columns, SENSORS + "".join(f"#   {line}\n" for line in lines))


def _texts(values: FloatArray, form: str) -> list[str]:
    """An empty cell where there is no value."""
    return ["" if np.isnan(value) else form.format(value) for value in values.tolist()]
