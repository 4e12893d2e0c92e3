"""Heidenhain: compensation value tables (.COM).

`variant=new` (TNC 640, 620, 320, MANUALplus): `BEGIN AXIS_X.COM MM` with columns NR, AXISPOS,
BACKLASH (the values measured in negative direction) and the axis. `variant=old` (iTNC 530, TNC
4xx): the datum and an equal distance in the first line, values of one direction, at most 256
entries; a distance is a power of two times 0.0001 mm. Values are errors, by the figure labelled
"Error [mm]".
"""

from __future__ import annotations

import math
import re

import numpy as np

from mtu_cli.findings import error
from mtu_cli.formats.control.errors import (
    Controller,
    ErrorTable,
    Parameters,
    choice,
    numeric,
    parameter,
    refuse,
    rising,
)

PLACES, QUANTUM = 4, 1e-4
MOST_OLD = 256
VARIANTS = ("new", "old")
NEW_HEAD = re.compile(r"BEGIN +AXIS_(\w+)\.COM +MM")
OLD_HEAD = re.compile(r"BEGIN +AXIS-(\w+)\.COM +DATUM: *(\S+) +DISTANCE: *(\S+)")


def _is_old(parameters: Parameters) -> bool:
    return choice(parameters, "variant", VARIANTS) == "old"


def _write(table: ErrorTable, parameters: Parameters) -> str:
    axis = parameter(parameters, "axis")
    if _is_old(parameters):
        step = table.step or 0.0
        power = math.log2(step / QUANTUM)
        if abs(power - round(power)) > 1e-6 or len(table.at) > MOST_OLD:
            near = QUANTUM * 2.0 ** round(power)
            reason = f"a distance of {step:g} mm in {len(table.at)} points"
            expected = (
                f"2^n times 0.0001 mm, such as --step {near:g}, and at most {MOST_OLD} points"
            )
            raise error("not-applicable", reason=reason, expected=expected)
        lines = [f"BEGIN AXIS-{axis}.COM  DATUM:{table.at[0]:+.4f} DISTANCE:{step:+.4f}"]
        lines.append(f"{'NR':<6}{'':>14}{axis:>12}")
        columns = [table.forward]
    else:
        lines = [f"BEGIN AXIS_{axis}.COM MM"]
        lines.append(f"{'NR':<6}{'AXISPOS':>14}{'BACKLASH':>12}{axis:>12}")
        columns = [table.reverse, table.forward]
    for k, (at, *values) in enumerate(zip(table.at, *columns, strict=True)):
        cells = "".join(f"{round(e, PLACES) + 0.0:>+12.4f}" for e in values)
        lines.append(f"{k:<6}{at:>+14.4f}{cells}")
    return "\n".join([*lines, "[END]", ""])


def _read(text: str, parameters: Parameters) -> ErrorTable:
    lines = text.rstrip().split("\n")
    new, old = NEW_HEAD.fullmatch(lines[0].strip()), OLD_HEAD.fullmatch(lines[0].strip())
    if not (new or old):
        refuse(f"{lines[0][:60]!r} begins no table", 1, "BEGIN AXIS_X.COM MM")
    if lines[-1].strip() != "[END]":
        refuse("it does not end with [END]", len(lines))
    count = 4 if new else 3
    names = lines[1].split() if len(lines) > 1 else []
    if names[:1] != ["NR"] or (new and names[1:3] != ["AXISPOS", "BACKLASH"]):
        refuse("the line of the columns is missing", 2, "NR AXISPOS BACKLASH X")
    rows = []
    for i, line in enumerate(lines[2:-1], 3):
        cells = line.split()
        if len(cells) != count:
            refuse(f"{len(cells)} values", i, f"{count}: a table of one axis")
        rows.append([numeric(cell, i) for cell in cells])
    values = np.array(rows).reshape(-1, count)
    if values[:, 0].tolist() != list(range(len(rows))):
        refuse("the numbers do not run from 0", 3)
    at = rising(values[:, 1].tolist())
    if old:
        due = numeric(old[2], 1) + numeric(old[3], 1) * np.arange(len(at))
        if np.abs(at - due).max() > QUANTUM:
            refuse("the positions are not those of DATUM and DISTANCE", 1)
        return ErrorTable.of(at, values[:, 2])
    return ErrorTable.of(at, values[:, 3], values[:, 2])


HEIDENHAIN = Controller(
    name="heidenhain",
    sign="error",
    says="Heidenhain .COM: values are errors in mm (actual minus nominal), positions from the "
    "machine datum; BACKLASH: the values in negative direction. One line of config.CMA has to be "
    "active. Confirm the sign by a verification move.",
    write=_write,
    read=_read,
    parameters={"variant": "new", "axis": "X"},
    quantum=lambda _: QUANTUM,
    two=lambda parameters: not _is_old(parameters),
    equidistant=_is_old,
)
