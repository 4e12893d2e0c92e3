"""Tables of rows, one point a row: LinuxCNC, Heidenhain, ISG_CSV, Etalon, and listings for hand
entry (Mitsubishi increments, any control).

LinuxCNC (usrmotLoadComp): reading stops, without a message, at the first line that is not three
numbers: no comment and no heading may stand in the file. Heidenhain: `variant=new` (TNC 640, 620,
320, MANUALplus) has a column BACKLASH, the values measured in negative direction; `variant=old`
(iTNC 530, TNC 4xx) the datum and a distance of 2^n times 0.0001 mm in the first line. ISG_CSV and
the Vendor variant of ETALON_EXCHANGE: values of the error model, mm and rad. Mitsubishi: (interval
- actual distance) times 2, in half output units, seen from the + side and from the - side. Of Fanuc
neither the sign nor the file are documented publicly: `table` gives errors, corrections and
increments.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mtu_cli.findings import InputError, error
from mtu_cli.formats.control.errors import (
    Controller,
    ErrorTable,
    Parameters,
    choice,
    decimals,
    lines_of,
    number_parameter,
    numeric,
    parameter,
    real,
    refuse,
    rows_of,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

MOST_ROWS, LONGEST_LINE, INCH = 256, 255, 25.4
"""LinuxCNC: EMCMOT_COMP_SIZE, the characters of a line, and mm of an inch."""
QUANTUM, MOST_OLD = 1e-4, 256
"""Heidenhain: mm; entries of an old table."""
HEAD = re.compile(r"BEGIN +AXIS[_-]\w+\.COM +(?:MM|DATUM: *(\S+) +DISTANCE: *(\S+))")
ANGLES = ("A", "B", "C")
ISO_NAME = re.compile(r"E[XYZABC][XYZABC]")
HAND = "FOR HAND ENTRY, no file to load."
INCREMENTS = "no,from_mm,to_mm,plus_side,minus_side"
LISTED = (
    "no,position_{},error_forward,error_reverse,correction_forward,correction_reverse,"
    "step_forward,step_reverse"
)


def _inch(parameters: Parameters) -> float:
    return {"mm": 1.0, "inch": INCH}[choice(parameters, "unit", ("mm", "inch"))]


def _write_linuxcnc(table: ErrorTable, parameters: Parameters) -> str:
    trims = choice(parameters, "type", ("0", "1")) == "1"
    unit, values = _inch(parameters), -table.errors if trims else table.at + table.errors
    rows = np.vstack([table.at, values]).T / unit
    places = 6 if unit == 1 else 7
    return "".join(" ".join(decimals(x, places) for x in row) + "\n" for row in rows.tolist())


def _read_linuxcnc(text: str, parameters: Parameters) -> ErrorTable:
    trims, unit = choice(parameters, "type", ("0", "1")) == "1", _inch(parameters)
    lines = [*enumerate(text.removesuffix("\n").split("\n"), 1)]
    for i, line in lines:
        try:
            rows_of([(i, line)], 3)
        except InputError:
            reason = (
                f"LinuxCNC stops reading here, without a message: {line[:40]!r} is not three "
                f"numbers, and {i - 1} rows above it are all that it would use"
            )
            refuse(reason, i, "three numbers, no comment, no heading, no blank line")
    if len(lines) > MOST_ROWS or max(len(line) for _, line in lines) > LONGEST_LINE:
        refuse(f"{len(lines)} rows", expected=f"at most {MOST_ROWS}, of {LONGEST_LINE} characters")
    at, *both = rows_of(lines, 3).T * unit
    return ErrorTable.of(at, *(-x if trims else x - at for x in both))


def _is_old(parameters: Parameters) -> bool:
    return choice(parameters, "variant", ("new", "old")) == "old"


def _write_heidenhain(table: ErrorTable, parameters: Parameters) -> str:
    axis, step = parameter(parameters, "axis"), table.step or 0.0
    if _is_old(parameters):
        power = math.log2(step / QUANTUM)
        if abs(power - round(power)) > 1e-6 or len(table.at) > MOST_OLD:
            near = f"--step {QUANTUM * 2.0 ** round(power):g}, and at most {MOST_OLD} points"
            reason = f"a distance of {step:g} mm in {len(table.at)} points"
            expected = f"2^n times 0.0001 mm, such as {near}"
            raise error("not-applicable", reason=reason, expected=expected)
        lines = [f"BEGIN AXIS-{axis}.COM  DATUM:{table.at[0]:+.4f} DISTANCE:{step:+.4f}",
                 f"{'NR':<6}{'':>14}{axis:>12}"]  # fmt: skip
        columns = table.errors[:1]
    else:
        lines = [f"BEGIN AXIS_{axis}.COM MM", f"{'NR':<6}{'AXISPOS':>14}{'BACKLASH':>12}{axis:>12}"]
        columns = table.errors[::-1]
    for k, (at, values) in enumerate(zip(table.at, columns.T, strict=True)):
        cells = "".join(f"{e:>+12.4f}" for e in np.round(values, 4) + 0.0)
        lines.append(f"{k:<6}{at:>+14.4f}{cells}")
    return "\n".join([*lines, "[END]", ""])


def _read_heidenhain(text: str, parameters: Parameters) -> ErrorTable:
    (_, first), *lines = [*lines_of(text), (1, "")]
    head, names = HEAD.fullmatch(first), lines[0][1].split()
    if not head or names[:1] != ["NR"]:
        refuse(f"{first[:60]!r} and {' '.join(names)[:60]!r} begin no table", 1,
               "BEGIN AXIS_X.COM MM, and below it NR AXISPOS BACKLASH X")  # fmt: skip
    if lines[-2][1] != "[END]":
        refuse("it does not end with [END]")
    if not head[1] and names[1:3] != ["AXISPOS", "BACKLASH"]:
        refuse("the line of the columns is missing", 2, "NR AXISPOS BACKLASH X")
    number, at, *errors = rows_of(lines[1:-2], 3 if head[1] else 4).T
    if number.tolist() != [*range(len(at))]:
        refuse("the numbers do not run from 0", 3)
    if head[1]:
        position = numeric(head[1], 1) + numeric(head[2], 1) * number
        if np.abs(at - position).max() > QUANTUM:
            refuse("the positions are not those of DATUM and DISTANCE", 1)
    return ErrorTable.of(at, *errors[::-1])


def _error_name(parameters: Parameters, table: ErrorTable) -> str:
    """The ISO 230-1 name of the error: EXX of the axis X unless stated."""
    axis = parameter(parameters, "axis")
    name = parameters["error"] or ("" if table.angle else f"E{axis}{axis}")
    names = tuple(f"E{a}{axis}" for a in (ANGLES if table.angle else ("X", "Y", "Z")))
    return choice({"error": name}, "error", names)


def _model_file(table: ErrorTable, head: list[str], tail: list[str]) -> str:
    places = 9 if table.angle else 6
    pairs = zip(table.at, table.errors[0], strict=True)
    return "\n".join([*head, *(f"{real(at)} {real(e, places)}" for at, e in pairs), *tail, ""])


def _model_table(lines: list[tuple[int, str]], name: str) -> ErrorTable:
    """Of the error model: an angle by its name."""
    return ErrorTable.of(*rows_of(lines, 2).T, angle=name[1] in ANGLES)


def _write_csv(table: ErrorTable, parameters: Parameters) -> str:
    return _model_file(table, [f"{parameters['axis']} {_error_name(parameters, table)}"], [])


def _read_csv(text: str, parameters: Parameters) -> ErrorTable:
    (at, heading), *lines = lines_of(text, "//") or [(1, "")]
    names = heading.split()
    if len(names) != 2 or not ISO_NAME.fullmatch(names[1]):
        refuse(f"{heading!r} is no heading of one axis", at, "such as X EXX")
    return _model_table(lines, names[1])


def _write_etalon(table: ErrorTable, parameters: Parameters) -> str:
    return _model_file(table, [f"[{_error_name(parameters, table)}]", "Gridpoints = {"], ["}"])


def _read_etalon(text: str, parameters: Parameters) -> ErrorTable:
    sections: dict[str, list[tuple[int, str]]] = {}
    name, inside = "", False
    for i, line in lines_of(text):
        if match := re.fullmatch(r"\[(\w+)\]", line):
            name = match[1]
        elif re.fullmatch(r"Gridpoints *= *\{", line) or line == "}":
            inside = line != "}"
        elif inside:
            sections.setdefault(name, []).append((i, line))
    if inside:
        refuse("the brace of Gridpoints is not closed")
    error_name = parameters["error"] or f"E{parameters['axis']}{parameters['axis']}"
    section = next(iter(sections), "") if len(sections) == 1 else error_name
    if section not in sections or not ISO_NAME.fullmatch(section):
        refuse(f"no Gridpoints of {error_name}", expected="--set error=EXX")
    return _model_table(sections[section], section)


def _output_unit(parameters: Parameters) -> float:
    """mm of half an output unit."""
    return number_parameter(parameters, "unit") * UM / 2


def _write_mitsubishi(table: ErrorTable, parameters: Parameters) -> str:
    # Rounded where it adds up, so that errors of rounding do not.
    steps = np.diff(np.rint(-table.errors / _output_unit(parameters)), axis=1)
    if steps.min() < -128 or steps.max() > 127:
        reason = f"increments of {steps.min():.0f} to {steps.max():.0f}; mitsubishi holds -128 to "
        raise error("not-applicable", reason=f"{reason}127")
    lines = [f"# zero at {decimals(table.at[0])} mm", INCREMENTS]
    for k, (plus, minus) in enumerate(steps.T):
        ends = f"{decimals(table.at[k])},{decimals(table.at[k + 1])}"
        lines.append(f"{k + 1},{ends},{plus:.0f},{minus:.0f}")
    return "\n".join([*lines, ""])


def _listed(text: str, heading: str) -> FloatArray:
    """The numbers below a heading; lines that begin with # are comments."""
    (at, line), *lines = lines_of(text, "#") or [(1, "")]
    if line != heading:
        refuse(f"the heading is {line[:60]!r}", at, heading)
    return rows_of(lines, heading.count(",") + 1, separator=",")


def _read_mitsubishi(text: str, parameters: Parameters) -> ErrorTable:
    rows, half = _listed(text, INCREMENTS), _output_unit(parameters)
    if not np.array_equal(rows[1:, 1], rows[:-1, 2]):
        refuse("its intervals do not follow one another")
    sums = np.cumsum(np.vstack([np.zeros(2), rows[:, 3:5]]), axis=0)
    return ErrorTable.of([*rows[:, 1], rows[-1, 2]], *(-half * sums.T))


def _write_table(table: ErrorTable, parameters: Parameters) -> str:
    unit, scale = ("urad", 1e-6) if table.angle else ("um", UM)
    lines = [f"# unit: {unit}", LISTED.format("deg" if table.rotary else "mm")]
    steps = np.diff(table.errors, axis=1, prepend=table.errors[:, :1])
    columns = np.vstack([table.errors, -table.errors, steps]) / scale
    for k, at in enumerate(table.at):
        lines.append(",".join([str(k), decimals(at), *(decimals(x, 3) for x in columns[:, k])]))
    return "\n".join([*lines, ""])


def _read_table(text: str, parameters: Parameters) -> ErrorTable:
    angle, rotary = "# unit: urad" in text, "no,position_deg," in text
    rows = _listed(text, LISTED.format("deg" if rotary else "mm"))
    if np.abs(rows[:, 2:4] + rows[:, 4:6]).max() > 0.002:
        refuse("its corrections are not the errors with the other sign")
    errors = rows[:, 2:4].T * (1e-6 if angle else UM)
    table = ErrorTable.of(rows[:, 1], *errors, angle=angle)
    return replace(table, rotary=rotary, both=not np.array_equal(*errors))


MODEL: Mapping[str, str] = {"axis": "X", "error": ""}
LINUXCNC = Controller(
    "linuxcnc", "position", _write_linuxcnc, _read_linuxcnc, {"type": "", "unit": "mm"},
    says="LinuxCNC COMP_FILE: nominal, forward, reverse; type 0 holds the positions that the axis "
    "reaches, type 1 corrections (nominal minus actual). No comment may stand in the file itself. "
    "BACKLASH is ignored where it is loaded; STEPGEN_MAXACCEL needs 1.5 to 2 times headroom.",
    quantum=lambda parameters: 1e-6 if _inch(parameters) == 1 else 1e-7 * INCH, two=lambda _: True,
    equidistant=lambda _: False, most=MOST_ROWS, newline="\n",
)  # fmt: skip
HEIDENHAIN = Controller(
    "heidenhain", "error", _write_heidenhain, _read_heidenhain, {"variant": "new", "axis": "X"},
    says="Heidenhain .COM: values are errors in mm (actual minus nominal), positions from the "
    "machine datum; BACKLASH: the values in negative direction. One line of config.CMA has to be "
    "active. Confirm the sign by a verification move.",
    quantum=lambda _: QUANTUM, two=lambda parameters: not _is_old(parameters),
    equidistant=_is_old,
)  # fmt: skip
ISG_CSV = Controller(
    "isg-csv", "error", _write_csv, _read_csv, MODEL,
    says="Values of the error model (actual minus nominal), mm and rad; `negate` in the list file "
    "turns the sign.",
    equidistant=lambda _: False, comment="//", angles=True,
)  # fmt: skip
ETALON = Controller(
    "etalon", "error", _write_etalon, _read_etalon, MODEL,
    says="ETALON_EXCHANGE, Vendor variant: values of the error model (actual minus nominal), mm "
    "and rad; `negate` in the list file turns the sign.",
    equidistant=lambda _: False, angles=True,
)  # fmt: skip
MITSUBISHI = Controller(
    "mitsubishi", "correction", _write_mitsubishi, _read_mitsubishi, {"unit": "1"},
    says=f"{HAND} Increments (interval minus actual distance) times 2, in output units: plus_side "
    "of the move from from_mm to to_mm, minus_side of the move back. The backlash at the first "
    "point is not in it: enter it as the control's own.",
    quantum=_output_unit, two=lambda _: True, zeroed="each", comment="#", listing=True,
)  # fmt: skip
TABLE = Controller(
    "table", "error", _write_table, _read_table, {"axis": "X"},
    says=f"{HAND} error: actual minus nominal; correction: the other sign; step: the change of the "
    "error from the point before. Which of them the control wants its manual says (of Fanuc: "
    "increments, sign not stated in public sources): prove it with a verification move.",
    two=lambda _: True, equidistant=lambda _: False, comment="#", angles=True, listing=True,
)  # fmt: skip
