"""Simulated readings, points and drift readings as CSV files of the contract, or of a laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.model.simulate import Columns, Sensors
from mtu_cli.reports.fields import csv_text

SENSORS = (
    "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
    "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
    "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
)


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


def _cells(columns: Columns, default: str, **forms: str) -> dict[str, list[str]]:
    """Numbers by the form of their column, an empty cell where there is none."""
    result = {}
    for name, values in columns.items():
        form = forms.get(name, default) if values.dtype.kind == "f" else ""
        result[name] = ["" if x != x else format(x, form) for x in values.tolist()]
    return result


def readings_file(readings: Columns) -> Synthetic:
    """A readings file; errors to seven digits."""
    cells = _cells(readings, ".7g", position_mm=".6g")
    if readings["direction"].any():
        ways = np.where(readings["direction"] < 0, "reverse", "forward")
        return Synthetic(cells | {"direction": ways.tolist()})
    del cells["direction"]
    return Synthetic(cells)


def points_file(points: Columns) -> Synthetic:
    """A points file; coordinates to 1 nm, covariates to nine digits."""
    return Synthetic(_cells(points, ".9g", **{f"{axis}_mm": ".6f" for axis in AXES}))


def drift_file(drift: Columns, sensors: Sensors) -> Synthetic:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    cells = _cells(drift, ".3f", position_mm=".6g", time_min=".9g", error=".7g")
    # Of larger units a thousandth is not fine enough.
    fine = np.isin(drift["unit"], ("um", "nm", "arcsec", "urad", "um/m"))
    cells["error"] = np.where(fine, _cells(drift, ".3f")["error"], cells["error"]).tolist()
    of_sensors = zip(sensors.names, sensors.shares, sensors.lags, strict=True)
    each = [f"{name} {share:.3f} {lag:.1f}" for name, share, lag in of_sensors]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return Synthetic(cells, SENSORS + "".join(f"#   {line}\n" for line in lines))
