"""Listings for hand entry, no files to load: Mitsubishi increments, and a table for any control.

Mitsubishi, incremental: (interval - actual distance) times 2, in half output units, -128 to 127,
seen from the + side (moves in positive direction) and from the - side. Of Fanuc neither the sign
nor the file are documented publicly: `table` gives errors, corrections and increments.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.formats.control.errors import (
    Controller,
    ErrorTable,
    Parameters,
    decimals,
    number_parameter,
    numeric,
    refuse,
    rising,
    whole,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

HAND = "FOR HAND ENTRY, no file to load."
ROWS = "no,from_mm,to_mm,plus_side,minus_side"
COLUMNS = (
    "no,position_mm,error_forward,error_reverse,correction_forward,correction_reverse,"
    "step_forward,step_reverse"
)


def _unit(parameters: Parameters) -> float:
    """mm of half an output unit."""
    return number_parameter(parameters, "unit") * UM / 2


def _write_mitsubishi(table: ErrorTable, parameters: Parameters) -> str:
    half, lines = _unit(parameters), [f"# zero at {decimals(table.at[0])} mm", ROWS]
    # Rounded where it adds up, so that errors of rounding do not.
    sums = np.rint(-table.errors / half)
    plus, minus = np.diff(sums, axis=1)
    for k, (low, high) in enumerate(zip(table.at, table.at[1:], strict=False)):
        values = [whole(float(x[k]), "mitsubishi", -128, 127) for x in (plus, minus)]
        ends = f"{decimals(low)},{decimals(high)}"
        lines.append(f"{k + 1},{ends},{values[0]},{values[1]}")
    return "\n".join([*lines, ""])


def _rows(text: str, heading: str) -> FloatArray:
    """The numbers below a heading; lines that begin with # are comments."""
    found, rows = False, []
    for i, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.startswith("#"):
            continue
        if not found:
            found = line.strip() == heading
            if not found:
                refuse(f"the heading is {line[:60]!r}", i, heading)
            continue
        cells = line.split(",")
        if len(cells) != len(heading.split(",")):
            refuse(f"{len(cells)} values", i, f"{len(heading.split(','))}")
        rows.append([numeric(cell, i) for cell in cells])
    if not rows:
        refuse("it has no rows", expected=heading)
    return np.array(rows)


def _read_mitsubishi(text: str, parameters: Parameters) -> ErrorTable:
    rows, half = _rows(text, ROWS), _unit(parameters)
    at = rising([*rows[:, 1], rows[-1, 2]])
    if not np.array_equal(rows[1:, 1], rows[:-1, 2]):
        refuse("its intervals do not follow one another")
    sums = np.cumsum(np.vstack([np.zeros(2), rows[:, 3:5]]), axis=0)
    return ErrorTable.of(at, *(-half * sums.T))


def _write_table(table: ErrorTable, parameters: Parameters) -> str:
    unit, scale = ("urad", 1e-6) if table.angle else ("um", UM)
    lines = [f"# unit: {unit}", COLUMNS]
    steps = np.diff(table.errors, axis=1, prepend=table.errors[:, :1])
    columns = np.vstack([table.errors, -table.errors, steps]) / scale
    for k, at in enumerate(table.at):
        cells = ",".join(decimals(x, 3) for x in columns[:, k])
        lines.append(f"{k},{decimals(at)},{cells}")
    return "\n".join([*lines, ""])


def _read_table(text: str, parameters: Parameters) -> ErrorTable:
    rows, angle = _rows(text, COLUMNS), "# unit: urad" in text
    scale = 1e-6 if angle else UM
    forward, reverse = rows[:, 2] * scale, rows[:, 3] * scale
    if np.abs(rows[:, 2:4] + rows[:, 4:6]).max() > 0.002:
        refuse("its corrections are not the errors with the other sign")
    at = rising(rows[:, 1].tolist())
    both = not np.array_equal(forward, reverse)
    return ErrorTable(at=at, forward=forward, reverse=reverse, both=both, angle=angle)


MITSUBISHI = Controller(
    name="mitsubishi",
    sign="correction",
    says=f"{HAND} Increments (interval minus actual distance) times 2, in output units: plus_side "
    "of the move from from_mm to to_mm, minus_side of the move back. The backlash at the first "
    "point is not in it: enter it as the control's own.",
    write=_write_mitsubishi,
    read=_read_mitsubishi,
    parameters={"unit": "1"},
    quantum=_unit,
    two=lambda _: True,
    zeroed="each",
    comment="#",
    listing=True,
)
TABLE = Controller(
    name="table",
    sign="error",
    says=f"{HAND} error: actual minus nominal; correction: the other sign; step: the change of the "
    "error from the point before. Which of them the control wants its manual says (of Fanuc: "
    "increments, sign not stated in public sources): prove it with a verification move.",
    write=_write_table,
    read=_read_table,
    parameters={},
    two=lambda _: True,
    equidistant=lambda _: False,
    comment="#",
    angles=True,
    listing=True,
)
