"""Components whose readings are smaller than any machine's: they may be in a larger unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.csv_table import Table
from mtu_cli.findings import Finding
from mtu_cli.units import ANGLE, LENGTH, UNITS

CODE = "readings-small"
SMALLEST: dict[float, float] = {LENGTH: 5e-5, ANGLE: 5e-8}
SLOPE: dict[float, float] = {LENGTH: 2e-7, ANGLE: 0.0}
"""The largest error of a component, mm or rad, below which no shop's axis is along LONG_MM; along
more it is SLOPE times that. Chosen by hand: 1 K of the air's temperature moves a laser's reading
by 1 um/m, and an axis that nobody compensated errs by up to 200 um/m, which in mm called um is
the SLOPE.
"""
LONG_MM, FEWEST = 100.0, 5
LIKELY: dict[float, tuple[float, float]] = {LENGTH: (5e-4, 1.0), ANGLE: (4e-7, 5e-3)}
"""What the largest error of a component usually is, mm or rad: units that make it so are named."""


@dataclass(slots=True)
class _Seen:
    """What is known of a component in a unit: its first row, and the extremes of the others."""

    place: str
    count: int = 0
    largest: float = 0.0
    low: float = inf
    high: float = -inf


class SmallReadings:
    """The sizes of each component's readings by unit, of tables or of blocks of them."""

    def __init__(self) -> None:
        self._found: dict[tuple[Path, str, str], _Seen] = {}

    def add(self, table: Table) -> None:
        """The rows of one more table, or block."""
        names, units = table.columns.texts["component"], table.columns.texts["unit"]
        error = np.abs(table.columns.numbers["error"])
        position = table.columns.numbers.get("position_mm")
        if position is None:
            return
        for code in np.unique(names.codes):
            for unit in np.unique(units.codes[names.codes == code]):
                rows = np.flatnonzero((names.codes == code) & (units.codes == unit))
                key = (table.source.path, names.labels[code], units.labels[unit])
                place = f"{table.source.shown}, row {table.rows[rows[0]]}"
                own = self._found.setdefault(key, _Seen(place))
                own.count += len(rows)
                own.largest = max(own.largest, float(error[rows].max()))
                known = position[rows][np.isfinite(position[rows])]
                own.low = min(own.low, float(known.min(initial=inf)))
                own.high = max(own.high, float(known.max(initial=-inf)))

    def notes(self) -> Iterator[Finding]:
        """One warning a file and unit, with its components, at the first row of the first."""
        told: dict[tuple[Path, str], list[tuple[str, _Seen]]] = {}
        for (file, name, unit), seen in self._found.items():
            size, span = UNITS[unit].to_internal * seen.largest, seen.high - seen.low
            few = seen.count < FEWEST or span < LONG_MM
            dimension = UNITS[unit].dimension
            if not few and 0 < size < max(SMALLEST[dimension], SLOPE[dimension] * span):
                told.setdefault((file, unit), []).append((name, seen))
        for (_, unit), own in told.items():
            likely = _likelier(max(seen.largest for _, seen in own), UNITS[unit].dimension)
            sizes = ", ".join(
                f"{name} (at most {seen.largest:.2g} {unit} along {seen.high - seen.low:g} mm)"
                for name, seen in own
            )
            text = (
                f"{own[0][1].place}, column 'unit': smaller than any machine's are the errors of "
                f"{sizes}: are they in {unit}{f', or in {likely}' if likely else ''}?"
            )
            yield Notice(code=CODE, message=text)


def _likelier(largest: float, dimension: float) -> str:
    """Units in which errors up to `largest` are those of a machine."""
    low, high = LIKELY[dimension]
    fit = [
        name
        for name, unit in UNITS.items()
        if unit.dimension == dimension and low <= largest * unit.to_internal <= high
    ]
    return " or ".join(fit)


def small_readings(tables: Iterable[Table]) -> tuple[Finding, ...]:
    """All of it of whole tables."""
    found = SmallReadings()
    for table in tables:
        found.add(table)
    return tuple(found.notes())
