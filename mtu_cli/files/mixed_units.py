"""Components whose rows carry several units: of some of them it may be a slip."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.csv_table import Table
from mtu_cli.findings import Finding
from mtu_cli.units import UNITS


@dataclass(slots=True)
class _Rows:
    """How many rows of a component have a unit, and where the first of them stands."""

    place: str
    count: int = 0


class UnitRows:
    """The units of each component, of tables or of blocks of them in the order of their rows."""

    def __init__(self) -> None:
        # Of two instruments each may have its own unit.
        self._found: dict[tuple[str, str], dict[str, _Rows]] = {}

    def add(self, table: Table) -> None:
        """The rows of one more table, or block."""
        names, units = table.columns.texts["component"], table.columns.texts["unit"]
        pairs = names.codes.astype(np.int64) * len(units.labels) + units.codes
        counts = np.bincount(pairs)
        for pair in np.flatnonzero(counts).tolist():
            name, unit = divmod(pair, len(units.labels))
            own = self._found.setdefault((table.source.role, names.labels[name]), {})
            if units.labels[unit] not in own:
                row = table.rows[int(np.argmax(pairs == pair))]
                own[units.labels[unit]] = _Rows(f"{table.source.shown}, row {row}")
            own[units.labels[unit]].count += int(counts[pair])

    def notes(self) -> Iterator[Finding]:
        """One warning a component, at the first row of its rarest unit."""
        for (_, name), own in self._found.items():
            # urad and um/m are two names of one unit.
            if len({UNITS[unit].to_internal for unit in own}) == 1:
                continue
            # Of as many rows the unit that comes later is the odd one.
            often = sorted(own, key=lambda unit: -own[unit].count)
            told = [f"{u} ({own[u].count} row{'s' * (own[u].count != 1)})" for u in often]
            text = (
                f"{own[often[-1]].place}, column 'unit': {name} is given in "
                f"{', '.join(told[:-1])} and in {told[-1]}; each row is read in its own unit: look "
                f"whether {often[-1]} is meant there"
            )
            yield Notice(code="units-mixed", message=text)


def mixed_units(tables: Iterable[Table]) -> tuple[Finding, ...]:
    """All of it of whole tables."""
    found = UnitRows()
    for table in tables:
        found.add(table)
    return tuple(found.notes())
