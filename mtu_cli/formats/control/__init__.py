"""The formats of controls: tables of rows (LinuxCNC, Heidenhain, ISG_CSV, Etalon), listings for
hand entry (Mitsubishi increments, any control), tables of named and numbered values (Siemens,
Beckhoff, Aerotech, ACS SPiiPlus, PMAC), and their registry.

LinuxCNC (usrmotLoadComp): reading stops, without a message, at the first line that is not three
numbers: no comment and no heading may stand in the file. Heidenhain: `variant=new` (TNC 640, 620,
320, MANUALplus) has a column BACKLASH, the values measured in negative direction; `variant=old`
(iTNC 530, TNC 4xx) the datum and a distance of 2^n times 0.0001 mm in the first line. ISG_CSV and
the Vendor variant of ETALON_EXCHANGE: values of the error model, mm and rad. Mitsubishi: (interval
- actual distance) times 2, in half output units, seen from the + side and from the - side. Of Fanuc
neither the sign nor the file are documented publicly: `table` gives errors, corrections and
increments.
Siemens 840D sl, 828D, ONE: encoder error (ENC_COMP) and interpolatory compensation (CEC). "A
positive value makes the axis move in the negative direction": the values are errors. Point k lies
at MIN + k STEP; beyond the ends they are held. At the reference point the value has to be 0. The
sign of CEC, measured minus ideal, rests on one source: a verification move has to confirm it. Of a
rotary axis positions and values are in deg.
Beckhoff TwinCAT CNC `kw.ssfk`: delta s = actual minus nominal position, in 0.1 um or increments.
The tables of Aerotech, ACS and PMAC hold corrections (-e).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.findings import InputError, error
from mtu_cli.formats.control.errors import (
    EQUAL_STEP,
    Controller,
    ErrorTable,
    Parameters,
    choice,
    decimals,
    in_order,
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


def _write_linuxcnc(table: ErrorTable, parameters: Parameters) -> list[str]:
    trims = choice(parameters, "type", ("0", "1")) == "1"
    unit, values = _inch(parameters), -table.errors if trims else table.at + table.errors
    rows = np.vstack([table.at, values]).T / unit
    places = 6 if unit == 1 else 7
    return [" ".join(decimals(x, places) for x in row) for row in rows.tolist()]


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


def _write_heidenhain(table: ErrorTable, parameters: Parameters) -> list[str]:
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
    return [*lines, "[END]"]


def _read_heidenhain(text: str, parameters: Parameters) -> ErrorTable:
    (_, first), *lines = [*lines_of(text), (1, "")]
    head, names = HEAD.fullmatch(first), [x for _, line in lines[:1] for x in line.split()]
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


def _model_rows(table: ErrorTable) -> list[str]:
    pairs, places = zip(table.at, table.errors[0], strict=True), 9 if table.angle else 6
    return [f"{real(at)} {real(e, places)}" for at, e in pairs]


def _model_table(lines: list[tuple[int, str]], name: str) -> ErrorTable:
    """Of the error model: an angle by its name."""
    return ErrorTable.of(*rows_of(lines, 2).T, angle=name[1] in ANGLES)


def _write_csv(table: ErrorTable, parameters: Parameters) -> list[str]:
    return [f"{parameters['axis']} {_error_name(parameters, table)}", *_model_rows(table)]


def _read_csv(text: str, parameters: Parameters) -> ErrorTable:
    (at, heading), *lines = lines_of(text, "//") or [(1, "")]
    names = heading.split()
    if len(names) != 2 or not ISO_NAME.fullmatch(names[1]):
        refuse(f"{heading!r} is no heading of one axis", at, "such as X EXX")
    return _model_table(lines, names[1])


def _write_etalon(table: ErrorTable, parameters: Parameters) -> list[str]:
    name = _error_name(parameters, table)
    return [f"[{name}]", "Gridpoints = {", *_model_rows(table), "}"]


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


def _write_mitsubishi(table: ErrorTable, parameters: Parameters) -> list[str]:
    # Rounded where it adds up, so that errors of rounding do not.
    steps = np.diff(np.rint(-table.errors / _output_unit(parameters)), axis=1)
    if steps.min() < -128 or steps.max() > 127:
        reason = f"increments of {steps.min():.0f} to {steps.max():.0f}; mitsubishi holds -128 to "
        raise error("not-applicable", reason=f"{reason}127")
    lines = [f"# zero at {decimals(table.at[0])} mm", INCREMENTS]
    for k, (plus, minus) in enumerate(steps.T):
        ends = f"{decimals(table.at[k])},{decimals(table.at[k + 1])}"
        lines.append(f"{k + 1},{ends},{plus:.0f},{minus:.0f}")
    return lines


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


def _write_table(table: ErrorTable, parameters: Parameters) -> list[str]:
    unit, scale = ("urad", 1e-6) if table.angle else ("um", UM)
    lines = [f"# unit: {unit}", LISTED.format("deg" if table.rotary else "mm")]
    steps = np.diff(table.errors, axis=1, prepend=table.errors[:, :1])
    values = np.vstack([table.errors, -table.errors, steps]).T / scale
    for k, (at, row) in enumerate(zip(table.at, values, strict=True)):
        lines.append(",".join([str(k), decimals(at), *(decimals(x, 3) for x in row)]))
    return lines


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

SIEMENS = re.compile(r"\$(AA_ENC_COMP|AN_CEC)(_[A-Z_]+)?\[([^\]]*)\]\s*=\s*(.+)")
SIEMENS_FRAME = (r"%_N_\w+_INI", r"CHANDATA\(\d+\)", "M17")
ENDS = ("_STEP", "_MIN", "_MAX", "_IS_MODULO")
SSFK = re.compile(r"kw\.ssfk\.table\[(\d+)\]\.(setpoint|pos|neg)")
TENTH_UM, MOST_SSFK = 1e-4, 1500
PLACES_DEG = 8
"""Decimal places of degrees: finer than a nanoradian."""
SIXTEENTHS = 16
"""PMAC: a value of the table is a sixteenth of a count."""
IN_DEGREES = "; rotary: positions and values in deg"
"""Siemens: a comment, without which a table is read as one in mm."""
COVERS = re.compile(r";\s*points from (\S+) to (\S+) mm")


def _siemens_points(
    name: str, index: str, table: ErrorTable, errors: FloatArray, **more: Any
) -> list[str]:
    """Lines of one table, of an ``index`` with {} for the point: values in mm, of a rotary axis in
    deg; `more` names that only this table has.
    """
    values = [real(e) for e in errors]
    if table.rotary:
        values = [real(e, PLACES_DEG) for e in np.degrees(errors)]
    table_index = index.replace("{},", "").replace(",{}", "")
    ends = map(real, (table.step or 0.0, table.at[0], table.at[-1]))
    more |= dict(zip(ENDS, [*ends, "0"], strict=True))
    lines = [f"${name}[{index.format(k)}]={value}" for k, value in enumerate(values)]
    return lines + [f"${name}{key}[{table_index}]={value}" for key, value in more.items()]


def _siemens_file(title: str, table: ErrorTable, lines: list[str]) -> list[str]:
    head = [f"%_N_{title}_INI", "CHANDATA(1)", *([IN_DEGREES] if table.rotary else [])]
    return [*head, *lines, "M17"]


def _siemens_tables(text: str, kind: str) -> dict[str, tuple[FloatArray, FloatArray, float]]:
    """Positions, values and direction (0: both) of each table, by its index without the point.

    Raises InputError for other lines, and where MIN, MAX and STEP are not those of the points.
    """
    lines = lines_of(text, ";")
    for pattern in SIEMENS_FRAME:
        if not any(re.fullmatch(pattern, line) for _, line in lines):
            expected = "a file with %_N_..._INI, CHANDATA(1) and M17"
            refuse(f"a line like {pattern} is missing", expected=expected)
    points, ends = dict[str, dict[int, float]](), dict[tuple[str, str], tuple[str, int]]()
    for i, line in lines:
        match = SIEMENS.fullmatch(line)
        if line.startswith("$") and (match is None or match[1] != kind):
            refuse(f"{line!r} is no line of ${kind}", i)
        if match is None:
            continue
        index = match[3].replace(" ", "")
        if match[2]:
            ends[match[2], index] = (match[4], i)
            continue
        first, _, rest = index.partition(",")
        point, _, axis = rest.partition(",")
        if not point.isdecimal():
            refuse(f"[{index}] names no table and point", i)
        table_index = f"{first},{axis}" if axis else first
        points.setdefault(table_index, {})[int(point)] = numeric(match[4], i)
    result = {}
    for index, values in points.items():
        for end in ENDS:
            if (end, index) not in ends:
                refuse(f"{end[1:]} of [{index}] is missing")
        step, low, high, modulo = (numeric(*ends[end, index]) for end in ENDS)
        last = len(values) - 1
        if modulo not in (0.0, 1.0):
            refuse(f"IS_MODULO is {modulo:g}", ends["_IS_MODULO", index][1], "0 or 1")
        if step <= 0 or abs(low + last * step - high) > EQUAL_STEP * (last + 1):
            reason, at = f"MAX is {high:g}, but MIN + {last} STEP is not", ends["_MAX", index][1]
            refuse(reason, at, f"{low + last * step:g}")
        way = numeric(*ends.get(("_DIRECTION", index), ("0", 0)))
        errors = in_order(values, "its points", last + 1)
        result[index] = np.asarray(low + step * np.arange(last + 1)), errors, way
    if not result:
        refuse(f"it has no ${kind}")
    return result


def _siemens_table(text: str, at: FloatArray, *errors: FloatArray) -> ErrorTable:
    """The table of values read, in deg where the file says so."""
    if IN_DEGREES not in text:
        return ErrorTable.of(at, *errors)
    return replace(ErrorTable.of(at, *map(np.radians, errors), angle=True), rotary=True)


def _write_enc(table: ErrorTable, parameters: Parameters) -> list[str]:
    index = f"{parameter(parameters, 'encoder')},{{}},{parameter(parameters, 'axis')}"
    lines = _siemens_points("AA_ENC_COMP", index, table, table.errors[0])
    return _siemens_file("AX_EEC", table, lines)


def _read_enc(text: str, parameters: Parameters) -> ErrorTable:
    tables = _siemens_tables(text, "AA_ENC_COMP")
    table_index = f"{parameters['encoder']},{parameters['axis']}"
    if len(tables) > 1 and table_index not in tables:
        refuse(f"it holds {', '.join(tables)}", expected="--set axis=... and --set encoder=...")
    return _siemens_table(text, *tables.get(table_index, next(iter(tables.values())))[:2])


def _write_cec(table: ErrorTable, parameters: Parameters) -> list[str]:
    first, axis = int(numeric(parameter(parameters, "table"))), parameter(parameters, "axis")
    lines, of_axis = [], dict.fromkeys(("_INPUT_AXIS", "_OUTPUT_AXIS"), f"({axis})")
    for t, way in enumerate((1, -1) if table.both else (0,)):
        errors, more = table.errors[t], {**of_axis, "_DIRECTION": way, "_MULT_BY_TABLE": 0}
        lines += _siemens_points("AN_CEC", f"{first + t},{{}}", table, errors, **more)
    return _siemens_file("NC_CEC", table, lines)


def _read_cec(text: str, parameters: Parameters) -> ErrorTable:
    tables = sorted(_siemens_tables(text, "AN_CEC").values(), key=lambda table: -table[2])
    ways = [way for *_, way in tables]
    at = tables[0][0]
    if ways not in ([0.0], [1.0, -1.0]) or not np.array_equal(at, tables[-1][0]):
        reason = f"DIRECTION of its tables is {', '.join(f'{way:g}' for way in ways)}"
        refuse(reason, expected="0, or 1 and -1 at the same positions")
    return _siemens_table(text, at, *(errors for _, errors, _ in tables))


def _ssfk_unit(parameters: Parameters) -> float:
    """mm of one unit of the table."""
    if choice(parameters, "unit", ("1", "0")) == "1":
        return TENTH_UM
    return 1.0 / number_parameter(parameters, "counts_per_mm")


def _write_ssfk(table: ErrorTable, parameters: Parameters) -> list[str]:
    unit, columns = _ssfk_unit(parameters), ("setpoint", "pos", *(["neg"] * table.both))
    rows = np.rint(np.vstack([table.at, table.errors]).T / unit).astype(int).tolist()
    head = {"unit": parameters["unit"], "kw_startpos": rows[0][0], "kw_nr_max": len(rows),
            "interval": 0, "bilateral": int(table.both)}  # fmt: skip
    lines = [f"kopf.log_achs_name      {parameter(parameters, 'axis')}"]
    lines += [f"{'kw.ssfk.' + name:<24}{value}" for name, value in head.items()]
    lines += [f"kw.ssfk.table[{k}].{name:<9}{x}" for k, row in enumerate(rows)
              for name, x in zip(columns, row, strict=False)]  # fmt: skip
    return lines


def _read_ssfk(text: str, parameters: Parameters) -> ErrorTable:
    head: dict[str, float] = {}
    points: dict[str, dict[int, float]] = {"setpoint": {}, "pos": {}, "neg": {}}
    for i, line in lines_of(text):
        name, _, value = line.partition(" ")
        if match := SSFK.fullmatch(name):
            points[match[2]][int(match[1])] = numeric(value, i)
        elif name.startswith("kw.ssfk."):
            head[name.removeprefix("kw.ssfk.")] = numeric(value, i)
    if missing := [name for name in ("unit", "kw_nr_max", "bilateral") if name not in head]:
        refuse(f"kw.ssfk.{missing[0]} is missing")
    count, unit = len(points["setpoint"]), _ssfk_unit({**parameters, "unit": f"{head['unit']:g}"})
    if head["kw_nr_max"] != count:
        refuse(f"kw_nr_max is {head['kw_nr_max']:g}", expected=f"{count}, the number of entries")
    columns = ("setpoint", "pos", "neg") if head["bilateral"] else ("setpoint", "pos")
    return ErrorTable.of(*(in_order(points[name], name, count) * unit for name in columns))


def _write_cal(table: ErrorTable, parameters: Parameters) -> list[str]:
    axis, home = parameter(parameters, "axis"), parameter(parameters, "home")
    return [
        f":START {axis} SAMPLEDIST={decimals(table.step or 0.0)} POSUNIT=PRIMARY CORUNIT=PRIMARY",
        f":START OFFSET={decimals(-table.at[0])}",
        f":START HOMEDIRECTION={home} HOMEOFFSET={parameters['home_offset']}",
        *(real(-e) for e in table.errors[0]),
        ":END",
    ]


def _read_cal(text: str, parameters: Parameters) -> ErrorTable:
    body, end, _ = re.sub("[;'].*", "", text).partition(":END")
    keys, values = {"OFFSET": "0"}, list[float]()
    for i, line in lines_of(body):
        first, *words = line.split()
        if first == ":START":
            pairs = (word.partition("=") for word in words)
            keys |= {name.upper(): value for name, _, value in pairs}
        elif first == ":START2D":
            refuse("a table of two dimensions", i, "a 1D table: :START")
        else:
            values += [numeric(word, i) for word in (first, *words)]
    if not end or "SAMPLEDIST" not in keys:
        refuse("no :START ... SAMPLEDIST=, values, :END")
    if {keys.get("POSUNIT", "PRIMARY"), keys.get("CORUNIT", "PRIMARY")} != {"PRIMARY"}:
        refuse("its units are not PRIMARY", expected="POSUNIT=PRIMARY CORUNIT=PRIMARY")
    at = numeric(keys["SAMPLEDIST"]) * np.arange(len(values)) - numeric(keys["OFFSET"])
    return ErrorTable.of(at, (1.0 if "NEGCOR" in keys else -1.0) * np.array(values))


def _write_acs(table: ErrorTable, parameters: Parameters) -> list[str]:
    axis, zone = parameter(parameters, "axis"), parameter(parameters, "zone")
    name = f"MTU_MAP_{axis}_{zone}"
    base, step = decimals(table.at[0]), decimals(table.step or 0.0)
    lines = [f"GLOBAL REAL {name}({len(table.at)})"]
    lines += [f"{name}({k}) = {real(-e)}" for k, e in enumerate(table.errors[0])]
    lines.append(f"ERRORMAP1D {axis}, {zone}, {base}, {step}, {name}")
    return [*lines, f"ERRORMAPON {axis}, {zone}", "STOP"]


def _read_acs(text: str, parameters: Parameters) -> ErrorTable:
    match = re.search(r"ERRORMAP1D\s+\w+\s*,\s*\w+\s*,([^,\n]+),([^,\n]+),\s*(\w+)", text)
    if match is None:
        refuse("no ERRORMAP1D axis, zone, base, step, array")
    base, step, name = numeric(match[1]), numeric(match[2]), match[3]
    entries = re.findall(rf"{name}\((\d+)\)\s*=\s*(\S+)", text)
    declaration = re.search(rf"REAL\s+{name}\((\d+)\)", text)
    count = int(declaration[1]) if declaration else len(entries)
    values = in_order({int(k): numeric(value) for k, value in entries}, name, count)
    return ErrorTable.of(base + step * np.arange(count), -values)


def _write_pmac(table: ErrorTable, parameters: Parameters) -> list[str]:
    counts, step = number_parameter(parameters, "counts_per_mm"), table.step or 0.0
    index = np.rint(table.at / step).astype(int)
    low, high, expected = int(index[0]), int(index[-1]), "--reference 0"
    length, reason = (high - low + 1) * step * counts, ""
    if np.abs(index * step - table.at).max() > EQUAL_STEP or not low <= 0 <= high:
        reason = f"a PMAC table begins at home, 0, which is no point of {low * step:g} to "
        reason += f"{high * step:g} mm by {step:g} mm"
        expected = "--from, --to and --step with a point at 0, or --machine-zero"
    elif abs(table.errors[0][-low]) > 0.5 / (SIXTEENTHS * counts):
        reason = "the value at home is not 0"
    elif abs(length - round(length)) > 1e-6:
        reason = f"the table's length is {length:g} counts, no whole number"
        expected = "another --step"
    if reason:
        raise error("not-applicable", reason=reason, expected=expected)
    # Positions wrap: beyond the last point the table goes on with its lowest one, and ends at home.
    values = np.roll(np.rint(-table.errors[0] * counts * SIXTEENTHS).astype(int), low - 1)
    lines = [f"; points from {decimals(low * step)} to {decimals(high * step)} mm"]
    lines += [f"#{parameter(parameters, 'axis')}", f"DEFINE COMP {len(values)},{round(length)}"]
    return [*lines, *map(str, values.tolist()), "I51=1"]


def _read_pmac(text: str, parameters: Parameters) -> ErrorTable:
    counts, covers = number_parameter(parameters, "counts_per_mm"), COVERS.search(text)
    plain = "\n".join(line for _, line in lines_of(text, ";"))
    match = re.search(r"DEFINE COMP\s+(\d+)\s*,\s*(\d+)\s*\n([-+\d\s]*)", plain)
    if match is None or int(match[2]) == 0:
        refuse("no DEFINE COMP n,counts")
    n, values = int(match[1]), np.array([int(numeric(word)) for word in match[3].split()])
    if len(values) != n or n < 2:
        refuse(f"{len(values)} values", expected=f"{n}, and two or more")
    if values[-1]:
        refuse(f"the last value is {values[-1]}", expected="0: the table wraps to home")
    step = int(match[2]) / n / counts
    low = round(numeric(covers[1]) / step) if covers else 0
    if not -n < low <= 0:
        refuse("the points named in its comment are not those of the table")
    errors = -np.roll(values, 1 - low) / (SIXTEENTHS * counts)
    return ErrorTable.of(np.round(np.arange(low, low + n) * step, 6), errors)


ENC = Controller(
    "siemens-enc", "error", _write_enc, _read_enc, {"axis": "X1", "encoder": "0"},
    says="Values are errors (actual minus nominal): a positive value makes the axis move in the "
    "negative direction. 0 at the reference point. Load with MD32700 = 0, then set it to 1.",
    zeroed="forward", comment=";", rotary=True,
)  # fmt: skip
CEC = Controller(
    "siemens-cec", "error", _write_cec, _read_cec, {"axis": "AX1", "table": "0"},
    says="Values are errors (measured minus ideal); DIRECTION 1 forward, -1 reverse. Confirm the "
    "sign by a verification move. Enable with MD32710 and SD41300.",
    two=lambda _: True, zeroed="forward", comment=";", rotary=True,
)  # fmt: skip
BECKHOFF = Controller(
    "beckhoff", "error", _write_ssfk, _read_ssfk, {"axis": "X", "unit": "1", "counts_per_mm": ""},
    says="kw.ssfk: values are errors (actual minus nominal), pos forward, neg reverse; unit 1 is "
    "0.1 um, 0 increments. Activate with lr_param.ssfk 1.",
    quantum=_ssfk_unit, two=lambda _: True, equidistant=lambda _: False, most=MOST_SSFK,
)  # fmt: skip
AEROTECH = Controller(
    "aerotech", "correction", _write_cal, _read_cal,
    {"axis": "1", "home": "CCW", "home_offset": "0"},
    says="Values are corrections (nominal minus actual), the same in both directions; NEGCOR turns "
    "the sign. Set HOMEDIRECTION and HOMEOFFSET as the axis is homed.",
    comment=";",
)  # fmt: skip
ACS = Controller(
    "acs", "correction", _write_acs, _read_acs, {"axis": "0", "zone": "0"},
    says="Values are corrections (target minus mean), the same in both directions.",
    comment="!",
)  # fmt: skip
PMAC = Controller(
    "pmac", "correction", _write_pmac, _read_pmac, {"axis": "1", "counts_per_mm": ""},
    says="Values are corrections in 1/16 count, added to the commanded position; the first is one "
    "spacing from home, the last 0 at home: the table wraps.",
    quantum=lambda parameters: 1.0 / (SIXTEENTHS * number_parameter(parameters, "counts_per_mm")),
    zeroed="forward", comment=";",
)  # fmt: skip
CONTROLLERS: dict[str, Controller] = {
    each.name: each
    for each in (
        *(LINUXCNC, ENC, CEC, HEIDENHAIN, BECKHOFF, ISG_CSV, ETALON, AEROTECH, ACS, PMAC),
        *(MITSUBISHI, TABLE),
    )
}
"""By the name of --for; `KLIPPER` holds a skew, no table of an axis."""
KLIPPER = "klipper"
NAMES = (*CONTROLLERS, KLIPPER)
