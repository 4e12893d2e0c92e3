"""Tables of named and numbered values: Siemens, Beckhoff, Aerotech, ACS SPiiPlus, PMAC.

Siemens 840D sl, 828D, ONE: encoder error (ENC_COMP) and interpolatory compensation (CEC). "A
positive value makes the axis move in the negative direction": the values are errors. Point k lies
at MIN + k STEP; beyond the ends they are held. At the reference point the value has to be 0. The
sign of CEC, measured minus ideal, rests on one source: a verification move has to confirm it. Of a
rotary axis positions and values are in deg.
Beckhoff TwinCAT CNC `kw.ssfk`: delta s = actual minus nominal position, in 0.1 um or increments.
The tables of Aerotech, ACS and PMAC hold corrections (-e).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np

from mtu_cli.findings import error
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
)
from mtu_cli.stats.least_squares import FloatArray

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


def _siemens_file(title: str, table: ErrorTable, lines: list[str]) -> str:
    head = [f"%_N_{title}_INI", "CHANDATA(1)", *([IN_DEGREES] if table.rotary else [])]
    return "\n".join([*head, *lines, "M17", ""])


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


def _write_enc(table: ErrorTable, parameters: Parameters) -> str:
    index = f"{parameter(parameters, 'encoder')},{{}},{parameter(parameters, 'axis')}"
    lines = _siemens_points("AA_ENC_COMP", index, table, table.errors[0])
    return _siemens_file("AX_EEC", table, lines)


def _read_enc(text: str, parameters: Parameters) -> ErrorTable:
    tables = _siemens_tables(text, "AA_ENC_COMP")
    table_index = f"{parameters['encoder']},{parameters['axis']}"
    if len(tables) > 1 and table_index not in tables:
        refuse(f"it holds {', '.join(tables)}", expected="--set axis=... and --set encoder=...")
    return _siemens_table(text, *tables.get(table_index, next(iter(tables.values())))[:2])


def _write_cec(table: ErrorTable, parameters: Parameters) -> str:
    first, axis = int(numeric(parameter(parameters, "table"))), parameter(parameters, "axis")
    lines = []
    for t, (way, errors) in enumerate(
        zip((1, -1) if table.both else (0,), table.errors, strict=False)
    ):
        more = {"_INPUT_AXIS": f"({axis})", "_OUTPUT_AXIS": f"({axis})", "_DIRECTION": way,
                "_MULT_BY_TABLE": 0}  # fmt: skip
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


def _write_ssfk(table: ErrorTable, parameters: Parameters) -> str:
    unit, columns = _ssfk_unit(parameters), ("setpoint", "pos", *(["neg"] * table.both))
    rows = np.rint(np.vstack([table.at, table.errors]).T / unit).astype(int).tolist()
    head = {"unit": parameters["unit"], "kw_startpos": rows[0][0], "kw_nr_max": len(rows),
            "interval": 0, "bilateral": int(table.both)}  # fmt: skip
    lines = [f"kopf.log_achs_name      {parameter(parameters, 'axis')}"]
    lines += [f"{'kw.ssfk.' + name:<24}{value}" for name, value in head.items()]
    lines += [f"kw.ssfk.table[{k}].{name:<9}{x}" for k, row in enumerate(rows)
              for name, x in zip(columns, row, strict=False)]  # fmt: skip
    return "\n".join([*lines, ""])


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


def _write_cal(table: ErrorTable, parameters: Parameters) -> str:
    axis, home = parameter(parameters, "axis"), parameter(parameters, "home")
    lines = [
        f":START {axis} SAMPLEDIST={decimals(table.step or 0.0)} POSUNIT=PRIMARY CORUNIT=PRIMARY",
        f":START OFFSET={decimals(-table.at[0])}",
        f":START HOMEDIRECTION={home} HOMEOFFSET={parameters['home_offset']}",
        *(real(-e) for e in table.errors[0]),
    ]
    return "\n".join([*lines, ":END", ""])


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


def _write_acs(table: ErrorTable, parameters: Parameters) -> str:
    axis, zone = parameter(parameters, "axis"), parameter(parameters, "zone")
    name = f"MTU_MAP_{axis}_{zone}"
    base, step = decimals(table.at[0]), decimals(table.step or 0.0)
    lines = [f"GLOBAL REAL {name}({len(table.at)})"]
    lines += [f"{name}({k}) = {real(-e)}" for k, e in enumerate(table.errors[0])]
    lines.append(f"ERRORMAP1D {axis}, {zone}, {base}, {step}, {name}")
    return "\n".join([*lines, f"ERRORMAPON {axis}, {zone}", "STOP", ""])


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


def _write_pmac(table: ErrorTable, parameters: Parameters) -> str:
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
    return "\n".join([*lines, *map(str, values.tolist()), "I51=1", ""])


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
