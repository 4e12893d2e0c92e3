"""Positions of components that are no function of any axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.csv_table import Table
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from mtu_cli.files.readings import ComponentLike


def unused_positions(
    tables: Sequence[Table], components: Mapping[str, ComponentLike]
) -> tuple[Finding, ...]:
    """Positions that are given for components without an axis: they mean nothing, and 0 is what
    some programs write there.
    """
    found = []
    for table in tables:
        positions = table.columns.numbers.get("position_mm")
        column = table.columns.texts["component"]
        names = [n for n in column.labels if n in components and components[n].of is None]
        if positions is None or not names:
            continue
        codes = [column.labels.index(name) for name in names]
        given = np.nan_to_num(positions) != 0
        rows = np.flatnonzero(given & np.isin(column.codes, codes))
        if len(rows):
            first = column.labels[column.codes[rows[0]]]
            text = (
                f"{table.source.shown}, row {table.rows[rows[0]]}, column 'position_mm': "
                f"{positions[rows[0]]:g} mm of {first}, to which the machine file gives no axis: "
                f"positions of such components are not used ({len(rows)} rows); where they matter, "
                "'of' in the machine file names their axis"
            )
            found.append(Notice(code="position-not-used", message=text))
    return tuple(found)
