"""Simulated readings, points and drift readings as CSV files of the contract.

One entry a column: its name, and its cells as texts of the digits that an instrument would show.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.model.simulate_drift import Sensors, SimulatedDrift
from mtu_cli.model.simulate_readings import SimulatedReadings
from mtu_cli.reports.fields import csv_text
from mtu_cli.stats.least_squares import FloatArray

DIRECTIONS = {1: "forward", -1: "reverse", 0: "forward"}
FINE = ("um", "nm", "arcsec", "urad", "um/m")
"""Units of which a thousandth is fine enough; larger ones have seven digits."""


@dataclass(frozen=True, slots=True)
class Synthetic:
    """A file: the cells of its columns, and comment lines on what they hold."""

    columns: dict[str, list[str]]
    comment: str = ""

    @property
    def count(self) -> int:
        """Its rows."""
        return len(next(iter(self.columns.values())))

    def text(self, heading: str) -> str:
        """The whole file below a `heading`."""
        rows = zip(*self.columns.values(), strict=True)
        return heading + self.comment + csv_text(list(self.columns), rows)

    def typed(self) -> dict[str, list[str | float | None]]:
        """Its columns as whoever reads the file has them: numbers, where all cells are such."""
        return {name: _typed(cells) for name, cells in self.columns.items()}


def _typed(cells: list[str]) -> list[str | float | None]:
    for kind in (int, float):
        try:
            return [kind(cell) if cell else None for cell in cells]
        except ValueError:
            pass
    return [*cells]


def readings_file(found: SimulatedReadings) -> Synthetic:
    """A readings file; errors to seven digits."""
    columns = {
        "component": [*found.component],
        "position_mm": _texts(found.position, "{:.6g}"),
        "pass": _texts(found.pass_number, "{:d}"),
        "direction": [DIRECTIONS[int(sign)] for sign in found.direction],
        "error": _texts(found.error, "{:.7g}"),
        "unit": [*found.unit],
    }
    if not (found.direction != 0).any():
        del columns["direction"]
    return Synthetic(columns)


def points_file(found: SimulatedPoints) -> Synthetic:
    """A points file; coordinates to 1 nm, covariates to nine digits."""
    measured = zip(found.axes, found.measured.T, strict=True)
    return Synthetic(
        {
            "part": [*found.part],
            "feature": [*found.feature],
            "repeat": _texts(found.repeat, "{:d}"),
            **({"operation": [found.operation] * len(found.part)} if found.operation else {}),
            **{f"{axis}_mm": _texts(values, "{:.6f}") for axis, values in measured},
            **{name: _texts(values, "{:.9g}") for name, values in found.covariates.items()},
        }
    )


def drift_file(found: SimulatedDrift) -> Synthetic:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    errors = zip(found.error, found.unit, strict=True)
    columns = {
        "component": [*found.component],
        "position_mm": _texts(found.position, "{:.6g}"),
        "cycle": _texts(found.cycle, "{:d}"),
        "time_min": _texts(found.time, "{:.9g}"),
        "error": [f"{x:.3f}" if unit in FINE else f"{x:.7g}" for x, unit in errors],
        "unit": [*found.unit],
        **{name: _texts(values, "{:.3f}") for name, values in found.temperatures.items()},
    }
    return Synthetic(columns, _sensors_comment(found.sensors))


def _sensors_comment(sensors: Sensors) -> str:
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


def _texts(values: FloatArray, form: str) -> list[str]:
    """An empty cell where there is no value."""
    known: Iterable[float] = values.tolist()
    return ["" if np.isnan(value) else form.format(value) for value in known]
