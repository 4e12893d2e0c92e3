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
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mtu_cli.findings import error
from mtu_cli.formats.control.errors import (
    EQUAL_STEP,
    Controller,
    ErrorTable,
    Parameters,
    always,
    choice,
    decimals,
    in_order,
    never,
    number_parameter,
    numeric,
    parameter,
    real,
    refuse,
    rising,
    whole,
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
Values = dict[str, dict[str, tuple[str, int]]]
"""Values with their lines, by the ending of the name ("" of the points), then by index."""


def _siemens_file(title: str, table: ErrorTable, values: Iterable[tuple[str, str]]) -> str:
    lines = [f"%_N_{title}_INI", "CHANDATA(1)", *([IN_DEGREES] if table.rotary else [])]
    lines += [f"${name}={value}" for name, value in values]
    return "\n".join([*lines, "M17", ""])


def _siemens_values_of(table: ErrorTable, errors: FloatArray) -> list[str]:
    """Values in mm, of a rotary axis in deg."""
    if table.rotary:
        return [real(e, PLACES_DEG) for e in np.degrees(errors)]
    return [real(e) for e in errors]


def _siemens_table(
    text: str, at: FloatArray, forward: FloatArray, reverse: FloatArray | None = None
) -> ErrorTable:
    """The table of values read, in deg where the file says so."""
    if IN_DEGREES not in text:
        return ErrorTable.of(at, forward, reverse)
    table = ErrorTable.of(at, np.radians(forward), None if reverse is None else np.radians(reverse))
    return replace(table, angle=True, rotary=True)


def _siemens_ends(name: str, index: str, table: ErrorTable) -> list[tuple[str, str]]:
    values = (table.step or 0.0, table.at[0], table.at[-1])
    ends = [(f"{name}{end}[{index}]", real(x)) for end, x in zip(ENDS, values, strict=False)]
    return [*ends, (f"{name}_IS_MODULO[{index}]", "0")]


def _siemens_values(text: str, kind: str) -> Values:
    lines = [line.split(";")[0].strip() for line in text.split("\n")]
    for needed in SIEMENS_FRAME:
        if not any(re.fullmatch(needed, line) for line in lines):
            expected = "a file with %_N_..._INI, CHANDATA(1) and M17"
            refuse(f"a line like {needed} is missing", expected=expected)
    result: Values = {}
    for i, line in enumerate(lines, 1):
        match = SIEMENS.fullmatch(line)
        if line.startswith("$") and (match is None or match[1] != kind):
            refuse(f"{line!r} is no line of ${kind}", i)
        if match:
            value = (match[4].strip(), i)
            result.setdefault(match[2] or "", {})[match[3].replace(" ", "")] = value
    if not result.get(""):
        refuse(f"it has no ${kind}")
    return result


def _siemens_tables(found: Values, parts: int, point: int) -> dict[str, dict[int, float]]:
    """Values by point of each table; an index has so many parts, one of which is the point."""
    tables: dict[str, dict[int, float]] = {}
    for index, (text, line) in found[""].items():
        cells = index.split(",")
        if len(cells) != parts or not cells[point].isdigit():
            refuse(f"[{index}] names no table and point", line)
        k = int(cells.pop(point))
        tables.setdefault(",".join(cells), {})[k] = numeric(text, line)
    return tables


def _siemens_points(
    found: Values, index: str, values: dict[int, float]
) -> tuple[FloatArray, FloatArray]:
    """Positions and values of one table; raises InputError where its ends do not fit them."""
    for name in ENDS:
        if index not in found.get(name, {}):
            refuse(f"{name[1:]} of [{index}] is missing")
    step, low, high, modulo = (numeric(*found[name][index]) for name in ENDS)
    if modulo not in (0.0, 1.0):
        refuse(f"IS_MODULO is {modulo:g}", found["_IS_MODULO"][index][1], "0 or 1")
    errors = in_order(values, "its points")
    last = len(errors) - 1
    if step <= 0 or abs(low + last * step - high) > EQUAL_STEP * (last + 1):
        line, expected = found["_MAX"][index][1], f"{low + last * step:g}"
        refuse(f"MAX is {high:g}, but MIN + {last} STEP is not", line, expected)
    return np.asarray(low + step * np.arange(last + 1)), errors


def _write_enc(table: ErrorTable, parameters: Parameters) -> str:
    encoder, axis = parameter(parameters, "encoder"), parameter(parameters, "axis")
    name = "AA_ENC_COMP"
    errors = enumerate(_siemens_values_of(table, table.forward))
    values = [(f"{name}[{encoder},{k},{axis}]", e) for k, e in errors]
    ends = _siemens_ends(name, f"{encoder},{axis}", table)
    return _siemens_file("AX_EEC", table, [*values, *ends])


def _read_enc(text: str, parameters: Parameters) -> ErrorTable:
    result = _siemens_values(text, "AA_ENC_COMP")
    tables = _siemens_tables(result, 3, 1)
    own = f"{parameters['encoder']},{parameters['axis']}"
    if len(tables) > 1 and own not in tables:
        refuse(f"it holds {', '.join(tables)}", expected="--set axis=... and --set encoder=...")
    index = own if own in tables else next(iter(tables))
    return _siemens_table(text, *_siemens_points(result, index, tables[index]))


def _write_cec(table: ErrorTable, parameters: Parameters) -> str:
    first, axis = int(numeric(parameter(parameters, "table"))), parameter(parameters, "axis")
    columns = [(1, table.forward), (-1, table.reverse)] if table.both else [(0, table.forward)]
    values: list[tuple[str, str]] = []
    for t, (direction, errors) in enumerate(columns, first):
        written = enumerate(_siemens_values_of(table, errors))
        values += [(f"AN_CEC[{t},{k}]", e) for k, e in written]
        values += [(f"AN_CEC_{end}_AXIS[{t}]", f"({axis})") for end in ("INPUT", "OUTPUT")]
        values += [(f"AN_CEC_DIRECTION[{t}]", str(direction)), (f"AN_CEC_MULT_BY_TABLE[{t}]", "0")]
        values += _siemens_ends("AN_CEC", str(t), table)
    return _siemens_file("NC_CEC", table, values)


def _read_cec(text: str, parameters: Parameters) -> ErrorTable:
    found = _siemens_values(text, "AN_CEC")
    ways: dict[float, tuple[FloatArray, FloatArray]] = {}
    for t, values in _siemens_tables(found, 2, 1).items():
        if t not in found.get("_DIRECTION", {}):
            refuse(f"DIRECTION of [{t}] is missing")
        way = numeric(*found["_DIRECTION"][t])
        if way in ways or way not in (-1.0, 0.0, 1.0):
            refuse(f"DIRECTION of [{t}] is {way:g}", found["_DIRECTION"][t][1], "0, or 1 and -1")
        ways[way] = _siemens_points(found, t, values)
    if set(ways) == {0.0}:
        return _siemens_table(text, *ways[0.0])
    if set(ways) != {1.0, -1.0} or not np.array_equal(ways[1.0][0], ways[-1.0][0]):
        refuse("its tables are not of both directions at the same positions")
    return _siemens_table(text, *ways[1.0], ways[-1.0][1])


def _ssfk_unit(parameters: Parameters) -> float:
    """mm of one unit of the table."""
    if choice(parameters, "unit", ("1", "0")) == "1":
        return TENTH_UM
    return 1.0 / number_parameter(parameters, "counts_per_mm")


def _write_ssfk(table: ErrorTable, parameters: Parameters) -> str:
    unit, columns = _ssfk_unit(parameters), ["setpoint", "pos", *(["neg"] * table.both)]
    head = {"unit": parameters["unit"], "kw_startpos": whole(table.at[0] / unit, "beckhoff"),
            "kw_nr_max": len(table.at), "interval": 0, "bilateral": int(table.both)}  # fmt: skip
    lines = [f"kopf.log_achs_name      {parameter(parameters, 'axis')}"]
    lines += [f"{'kw.ssfk.' + name:<24}{value}" for name, value in head.items()]
    for k, row in enumerate(np.vstack([table.at, table.errors]).T / unit):
        lines += [f"kw.ssfk.table[{k}].{name:<9}{whole(float(x), 'beckhoff')}"
                  for name, x in zip(columns, row, strict=False)]  # fmt: skip
    return "\n".join([*lines, ""])


def _read_ssfk(text: str, parameters: Parameters) -> ErrorTable:
    head: dict[str, float] = {}
    points: dict[str, dict[int, float]] = {"setpoint": {}, "pos": {}, "neg": {}}
    for i, line in enumerate(text.split("\n"), 1):
        name, _, value = line.strip().partition(" ")
        if match := SSFK.fullmatch(name):
            points[match[2]][int(match[1])] = numeric(value, i)
        elif name.startswith("kw.ssfk."):
            head[name.removeprefix("kw.ssfk.")] = numeric(value, i)
    if missing := [name for name in ("unit", "kw_nr_max", "bilateral") if name not in head]:
        refuse(f"kw.ssfk.{missing[0]} is missing")
    count, columns = (
        len(points["setpoint"]),
        ["setpoint", "pos", *["neg"][: head["bilateral"] != 0]],
    )
    unit = _ssfk_unit({**parameters, "unit": f"{head['unit']:g}"})
    at, *errors = (in_order(points[name], name, count) * unit for name in columns)
    if head["kw_nr_max"] != count:
        refuse(f"kw_nr_max is {head['kw_nr_max']:g}", expected=f"{count}, the number of entries")
    return ErrorTable.of(rising(at), *errors)


def _write_cal(table: ErrorTable, parameters: Parameters) -> str:
    axis, home = parameter(parameters, "axis"), parameter(parameters, "home")
    lines = [
        f":START {axis} SAMPLEDIST={decimals(table.step or 0.0)} POSUNIT=PRIMARY CORUNIT=PRIMARY",
        f":START OFFSET={decimals(-table.at[0])}",
        f":START HOMEDIRECTION={home} HOMEOFFSET={parameters['home_offset']}",
        *(real(-e) for e in table.forward),
    ]
    return "\n".join([*lines, ":END", ""])


def _read_cal(text: str, parameters: Parameters) -> ErrorTable:
    body, end, _ = re.sub("[;'].*", "", text).partition(":END")
    keys: dict[str, str] = {}
    values: list[float] = []
    for i, line in enumerate(body.split("\n"), 1):
        words = line.split()
        if words[:1] == [":START2D"]:
            refuse("a table of two dimensions", i, "a 1D table: :START")
        if words[:1] == [":START"]:
            pairs = (word.partition("=") for word in words[1:])
            keys |= {name.upper(): value for name, _, value in pairs}
        else:
            values += [numeric(word, i) for word in words]
    if not end or "SAMPLEDIST" not in keys:
        refuse("no :START ... SAMPLEDIST=, values, :END")
    if {keys.get("POSUNIT", "PRIMARY"), keys.get("CORUNIT", "PRIMARY")} != {"PRIMARY"}:
        refuse("its units are not PRIMARY", expected="POSUNIT=PRIMARY CORUNIT=PRIMARY")
    at = numeric(keys["SAMPLEDIST"]) * np.arange(len(values)) - numeric(keys.get("OFFSET", "0"))
    return ErrorTable.of(rising(at), (1.0 if "NEGCOR" in keys else -1.0) * np.array(values))


def _write_acs(table: ErrorTable, parameters: Parameters) -> str:
    axis, zone = parameter(parameters, "axis"), parameter(parameters, "zone")
    name = f"MTU_MAP_{axis}_{zone}"
    base, step = decimals(table.at[0]), decimals(table.step or 0.0)
    lines = [f"GLOBAL REAL {name}({len(table.at)})"]
    lines += [f"{name}({k}) = {real(-e)}" for k, e in enumerate(table.forward)]
    lines.append(f"ERRORMAP1D {axis}, {zone}, {base}, {step}, {name}")
    return "\n".join([*lines, f"ERRORMAPON {axis}, {zone}", "STOP", ""])


def _read_acs(text: str, parameters: Parameters) -> ErrorTable:
    found = re.search(r"ERRORMAP1D\s+(\w+)\s*,\s*(\w+)\s*,([^,\n]+),([^,\n]+),\s*(\w+)", text)
    if found is None:
        refuse("no ERRORMAP1D axis, zone, base, step, array")
    base, step, name = numeric(found[3]), numeric(found[4]), found[5]
    entries = re.findall(rf"{name}\((\d+)\)\s*=\s*(\S+)", text)
    declared = re.search(rf"REAL\s+{name}\((\d+)\)", text)
    count = int(declared[1]) if declared else None
    values = in_order({int(k): numeric(value) for k, value in entries}, name, count)
    return ErrorTable.of(rising(base + step * np.arange(len(values))), -values)


def _write_pmac(table: ErrorTable, parameters: Parameters) -> str:
    counts, step = number_parameter(parameters, "counts_per_mm"), table.step or 0.0
    index = np.rint(table.at / step).astype(int)
    low, high = int(index[0]), int(index[-1])
    if np.abs(index * step - table.at).max() > EQUAL_STEP or not low <= 0 <= high:
        reason = f"a PMAC table begins at home, 0, which is no point of {low * step:g} to "
        reason += f"{high * step:g} mm by {step:g} mm"
        expected = "--from, --to and --step with a point at 0, or --machine-zero"
        raise error("not-applicable", reason=reason, expected=expected)
    if abs(table.forward[-low]) > 0.5 / (SIXTEENTHS * counts):
        raise error("not-applicable", reason="the value at home is not 0", expected="--reference 0")
    n = high - low + 1
    length = n * step * counts
    if abs(length - round(length)) > 1e-6:
        reason = f"the table's length is {length:g} counts, no whole number"
        raise error("not-applicable", reason=reason, expected="another --step")
    # Positions wrap: beyond the last point the table goes on with its lowest one, and ends at home.
    values = np.roll(np.rint(-table.forward * counts * SIXTEENTHS).astype(int), low - 1)
    lines = [f"; points from {decimals(low * step)} to {decimals(high * step)} mm"]
    lines += [f"#{parameter(parameters, 'axis')}", f"DEFINE COMP {n},{round(length)}"]
    return "\n".join([*lines, *map(str, values.tolist()), "I51=1", ""])


def _read_pmac(text: str, parameters: Parameters) -> ErrorTable:
    counts, covers = number_parameter(parameters, "counts_per_mm"), COVERS.search(text)
    plain = re.sub(r";.*", "", text)
    found = re.search(r"DEFINE COMP\s+(\d+)\s*,\s*(\d+)\s*\n([-+\d\s]*)", plain)
    if found is None:
        refuse("no DEFINE COMP n,counts")
    n, values = int(found[1]), np.array([int(numeric(word)) for word in found[3].split()])
    if len(values) != n or n < 2:
        refuse(f"{len(values)} values", expected=f"{n}, and two or more")
    if values[-1]:
        refuse(f"the last value is {values[-1]}", expected="0: the table wraps to home")
    step = int(found[2]) / n / counts
    if step <= 0:
        refuse("its length is 0 counts", expected="a length above 0")
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
    two=always, zeroed="forward", comment=";", rotary=True,
)  # fmt: skip
BECKHOFF = Controller(
    "beckhoff", "error", _write_ssfk, _read_ssfk, {"axis": "X", "unit": "1", "counts_per_mm": ""},
    says="kw.ssfk: values are errors (actual minus nominal), pos forward, neg reverse; unit 1 is "
    "0.1 um, 0 increments. Activate with lr_param.ssfk 1.",
    quantum=_ssfk_unit, two=always, equidistant=never, most=MOST_SSFK,
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
