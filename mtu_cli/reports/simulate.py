"""Simulated readings, points and drift readings as CSV files of the contract, or of a laser."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from mtu_cli.analyses.simulate import SimulateResult
from mtu_cli.formats.renishaw import UNITS, run_file
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.simulate import Columns, Sensors
from mtu_cli.reports.fields import csv_text

SENSORS = (
    "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
    "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
    "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
)
Cells = dict[str, list[str]]


def file_of(kind: str, result: SimulateResult) -> tuple[str, dict[str, list[Any]]]:
    """The text of a file below its heading, and the values that are read from it by column."""
    cells = _cells(kind, result.columns[kind])
    text = csv_text(list(cells), zip(*cells.values(), strict=True))
    if kind == "laser":
        text = _run(result.columns[kind])
    elif kind == "drift" and result.climate is not None:
        text = _comment(result.climate[1]) + text
    return text, {name: _values(column) for name, column in cells.items()}


def _cells(kind: str, columns: Columns) -> Cells:
    """Readings: errors to seven digits. Points: coordinates to 1 nm, covariates to nine digits.
    Drift: temperatures to 1 mK, errors to 1 nm or a thousandth of the unit.
    """
    if kind == "cmm":
        return _formatted(columns, ".9g", **{f"{axis}_mm": ".6f" for axis in AXES})
    if kind == "drift":
        cells = _formatted(columns, ".3f", position_mm=".6g", time_min=".9g", error=".7g")
        # Of larger units a thousandth is not fine enough.
        fine = np.isin(columns["unit"], ("um", "nm", "arcsec", "urad", "um/m"))
        errors = np.where(fine, _formatted(columns, ".3f")["error"], cells["error"])
        return cells | {"error": errors.tolist()}
    cells = _formatted(columns, ".7g", position_mm=".6g")
    if columns["direction"].any():
        ways = np.where(columns["direction"] < 0, "reverse", "forward")
        return cells | {"direction": ways.tolist()}
    del cells["direction"]
    return cells


def _formatted(columns: Columns, default: str, **forms: str) -> Cells:
    """Numbers by the form of their column, an empty cell where there is none."""
    result = {}
    for name, values in columns.items():
        form = forms.get(name, default) if values.dtype.kind == "f" else ""
        result[name] = ["" if x != x else format(x, form) for x in values.tolist()]
    return result


def _values(cells: list[str]) -> list[Any]:
    """A column as read from a file: numbers, where all cells are such."""
    for kind in (int, float):
        with suppress(ValueError):
            return [kind(cell) if cell else None for cell in cells]
    return [*cells]


def _run(readings: Columns) -> str:
    """Readings of one component as a run of the format that has their unit."""
    file_format = next(name for name, unit in UNITS.items() if unit == readings["unit"][0])
    ways = np.where(readings["direction"] > 0, "forward", "reverse")
    columns = {name: values.tolist() for name, values in (readings | {"direction": ways}).items()}
    return run_file(file_format, columns).decode("cp1252")


def _comment(sensors: Sensors) -> str:
    of_sensors = zip(sensors.names, sensors.shares, sensors.lags, strict=True)
    each = [f"{name} {share:.3f} {lag:.1f}" for name, share, lag in of_sensors]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return SENSORS + "".join(f"#   {line}\n" for line in lines)
