"""LinuxCNC: COMP_FILE of a joint (usrmotLoadComp, EMCMOT_SET_JOINT_COMP).

Rows `nominal forward reverse`. Type 0: the positions reached, type 1: corrections, nominal minus
actual. Reading stops, without a message, at the first line that is not three numbers: no comment
and no heading may stand in the file.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.files.csv_table import number
from mtu_cli.formats.control.errors import (
    Controller,
    ErrorTable,
    Parameters,
    choice,
    decimals,
    refuse,
    rising,
)

MOST_ROWS = 256
"""EMCMOT_COMP_SIZE."""
LONGEST_LINE = 255
INCH = 25.4


def _unit(parameters: Parameters) -> float:
    return {"mm": 1.0, "inch": INCH}[choice(parameters, "unit", ("mm", "inch"))]


def _write(table: ErrorTable, parameters: Parameters) -> str:
    trims = choice(parameters, "type", ("0", "1")) == "1"
    unit, rows = _unit(parameters), []
    for at, *errors in zip(table.at, table.forward, table.reverse, strict=True):
        values = [-e if trims else at + e for e in errors]
        rows.append(" ".join(decimals(x / unit, 6 if unit == 1 else 7) for x in (at, *values)))
    return "\n".join(rows) + "\n"


def _read(text: str, parameters: Parameters) -> ErrorTable:
    trims, unit = choice(parameters, "type", ("0", "1")) == "1", _unit(parameters)
    rows: list[list[float]] = []
    for i, line in enumerate(text.removesuffix("\n").split("\n"), 1):
        cells = [float("nan") if (x := number(cell)) is None else x for cell in line.split()]
        if len(cells) != 3 or not np.isfinite(cells).all():
            reason = (
                f"LinuxCNC stops reading here, without a message: {line[:40]!r} is not three "
                f"numbers, and {len(rows)} rows above it are all that it would use"
            )
            refuse(reason, i, "three numbers, no comment, no heading, no blank line")
        if len(line) > LONGEST_LINE:
            refuse(f"a line of {len(line)} characters", i, f"at most {LONGEST_LINE}")
        rows.append([x * unit for x in cells])
    if len(rows) > MOST_ROWS:
        refuse(f"{len(rows)} rows", expected=f"at most {MOST_ROWS}")
    at, forward, reverse = np.array(rows).T
    at = rising(at.tolist())
    if trims:
        return ErrorTable.of(at, -forward, -reverse)
    return ErrorTable.of(at, forward - at, reverse - at)


LINUXCNC = Controller(
    name="linuxcnc",
    sign="position",
    says="LinuxCNC COMP_FILE: nominal, forward, reverse; type 0 holds the positions that the axis "
    "reaches, type 1 corrections (nominal minus actual). No comment may stand in the file itself. "
    "BACKLASH is ignored where it is loaded; STEPGEN_MAXACCEL needs 1.5 to 2 times headroom.",
    write=_write,
    read=_read,
    parameters={"type": "", "unit": "mm"},
    quantum=lambda parameters: 1e-6 if _unit(parameters) == 1 else 1e-7 * INCH,
    two=lambda _: True,
    equidistant=lambda _: False,
    most=MOST_ROWS,
    newline="\n",
)
