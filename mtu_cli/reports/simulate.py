"""Simulated readings, points and drift readings as CSV files of the contract, or of a laser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.model.simulate import Columns, Sensors, SimulatedPoints
from mtu_cli.reports.fields import csv_text
from mtu_cli.stats.least_squares import FloatArray

SENSORS = (
    "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
    "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
    "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
)
FINE = ("um", "nm", "arcsec", "urad", "um/m")
"""Units of which a thousandth is fine enough; larger ones have seven digits."""
MK = "{:.3f}"
FORMS = {
    "position_mm": "{:.6g}", "pass": "{:d}", "direction": "{:d}", "cycle": "{:d}",
    "time_min": "{:.9g}", "error": "{:.7g}",
}  # fmt: skip


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


def readings_file(readings: Columns) -> Synthetic:
    """A readings file; errors to seven digits."""
    cells = _cells(readings)
    cells["direction"] = ["reverse" if sign < 0 else "forward" for sign in readings["direction"]]
    if not readings["direction"].any():
        del cells["direction"]
    return Synthetic(cells)


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


def drift_file(drift: Columns, sensors: Sensors) -> Synthetic:
    """A drift file; temperatures to 1 mK, errors to 1 nm or a thousandth of the unit."""
    cells, errors = _cells(drift), zip(drift["error"], drift["unit"], strict=True)
    cells["error"] = [f"{x:.3f}" if unit in FINE else f"{x:.7g}" for x, unit in errors]
    rows = zip(sensors.names, sensors.shares, sensors.lags, strict=True)
    each = [f"{name} {share:.3f} {lag:.1f}" for name, share, lag in rows]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return Synthetic(cells, SENSORS + "".join(f"#   {line}\n" for line in lines))


def _cells(columns: Columns) -> dict[str, list[str]]:
    """Texts as they are, numbers as `FORMS` has them, temperatures to 1 mK."""
    return {
        name: values.tolist() if values.dtype.kind == "U" else _texts(values, FORMS.get(name, MK))
        for name, values in columns.items()
    }


def _texts(values: FloatArray, form: str) -> list[str]:
    """An empty cell where there is no value."""
    return ["" if np.isnan(value) else form.format(value) for value in values.tolist()]
