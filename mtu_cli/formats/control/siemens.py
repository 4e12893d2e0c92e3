"""Siemens 840D sl, 828D, ONE: encoder error (ENC_COMP) and interpolatory compensation (CEC).

"A positive value makes the axis move in the negative direction": the values are errors. Point k
lies at MIN + k STEP; beyond the ends they are held. At the reference point the value has to be 0.
The sign of CEC, measured minus ideal, rests on one source: a verification move has to confirm it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from mtu_cli.formats.control.errors import (
    EQUAL_STEP,
    Controller,
    ErrorTable,
    Parameters,
    numeric,
    parameter,
    real,
    refuse,
)
from mtu_cli.stats.least_squares import FloatArray

LINE = re.compile(r"\$(AA_ENC_COMP|AN_CEC)(_[A-Z_]+)?\[([^\]]*)\]\s*=\s*(.+)")
NEEDED = ("_STEP", "_MIN", "_MAX", "_IS_MODULO")


def _ends(name: str, index: str, table: ErrorTable) -> Iterable[tuple[str, str]]:
    yield f"{name}_STEP[{index}]", real(table.step or 0.0)
    yield f"{name}_MIN[{index}]", real(table.at[0])
    yield f"{name}_MAX[{index}]", real(table.at[-1])


def _file(title: str, values: Iterable[tuple[str, str]]) -> str:
    lines = [f"%_N_{title}_INI", "CHANDATA(1)", *(f"${name}={value}" for name, value in values)]
    return "\n".join([*lines, "M17", ""])


def _parsed(text: str, kind: str) -> dict[str, dict[str, tuple[str, int]]]:
    """Values with their lines, by the ending of the name ("" of the points), then by index."""
    lines = [line.split(";")[0].strip() for line in text.split("\n")]
    stated = [line for line in lines if line]
    for needed in (r"%_N_\w+_INI", r"CHANDATA\(\d+\)", "M17"):
        if not any(re.fullmatch(needed, line) for line in stated):
            expected = "a file with %_N_..._INI, CHANDATA(1) and M17"
            refuse(f"a line like {needed} is missing", expected=expected)
    found: dict[str, dict[str, tuple[str, int]]] = {}
    for i, line in enumerate(lines, 1):
        if not line.startswith("$"):
            continue
        match = LINE.fullmatch(line)
        if match is None or match[1] != kind:
            refuse(f"{line!r} is no line of ${kind}", i)
        value = (match[4].strip(), i)
        found.setdefault(match[2] or "", {})[match[3].replace(" ", "")] = value
    if not found.get(""):
        refuse(f"it has no ${kind}")
    return found


def _points(
    found: dict[str, dict[str, tuple[str, int]]], index: str, values: dict[int, tuple[str, int]]
) -> tuple[FloatArray, FloatArray]:
    """Positions and values of one table; raises InputError where its ends do not fit them."""
    ends: list[float] = []
    for name in NEEDED:
        if index not in found.get(name, {}):
            refuse(f"{name[1:]} of [{index}] is missing")
        ends.append(numeric(*found[name][index]))
    step, low, high, modulo = ends
    if modulo not in (0.0, 1.0):
        refuse(f"IS_MODULO is {modulo:g}", found["_IS_MODULO"][index][1], "0 or 1")
    count = len(values)
    if count < 2 or sorted(values) != list(range(count)):
        refuse(f"{count} points whose numbers do not run from 0", expected="points 0, 1, 2, ...")
    if step <= 0 or abs(low + (count - 1) * step - high) > EQUAL_STEP * count:
        line, expected = found["_MAX"][index][1], f"{low + (count - 1) * step:g}"
        refuse(f"MAX is {high:g}, but MIN + {count - 1} STEP is not", line, expected)
    errors = [numeric(*values[k]) for k in range(count)]
    return np.asarray(low + step * np.arange(count)), np.array(errors)


def _write_enc(table: ErrorTable, parameters: Parameters) -> str:
    encoder, axis = parameter(parameters, "encoder"), parameter(parameters, "axis")
    own, name = f"{encoder},{axis}", "AA_ENC_COMP"
    values = [(f"{name}[{encoder},{k},{axis}]", real(e)) for k, e in enumerate(table.forward)]
    return _file("AX_EEC", [*values, *_ends(name, own, table), (f"{name}_IS_MODULO[{own}]", "0")])


def _read_enc(text: str, parameters: Parameters) -> ErrorTable:
    found = _parsed(text, "AA_ENC_COMP")
    tables: dict[str, dict[int, tuple[str, int]]] = {}
    for index, value in found[""].items():
        encoder, point, axis = (*index.split(","), "", "")[:3]
        if not point.isdigit():
            refuse(f"[{index}] names no encoder, point and axis", value[1])
        tables.setdefault(f"{encoder},{axis}", {})[int(point)] = value
    own = f"{parameters['encoder']},{parameters['axis']}"
    if len(tables) > 1 and own not in tables:
        refuse(f"it holds {', '.join(tables)}", expected="--set axis=... and --set encoder=...")
    index = own if own in tables else next(iter(tables))
    return ErrorTable.of(*_points(found, index, tables[index]))


def _write_cec(table: ErrorTable, parameters: Parameters) -> str:
    first, axis = int(numeric(parameter(parameters, "table"))), parameter(parameters, "axis")
    columns = [(1, table.forward), (-1, table.reverse)] if table.both else [(0, table.forward)]
    values: list[tuple[str, str]] = []
    for t, (direction, errors) in enumerate(columns, first):
        values += [(f"AN_CEC[{t},{k}]", real(e)) for k, e in enumerate(errors)]
        values += [(f"AN_CEC_{end}_AXIS[{t}]", f"({axis})") for end in ("INPUT", "OUTPUT")]
        values += _ends("AN_CEC", str(t), table)
        values.append((f"AN_CEC_DIRECTION[{t}]", str(direction)))
        values += [(f"AN_CEC_{end}[{t}]", "0") for end in ("MULT_BY_TABLE", "IS_MODULO")]
    return _file("NC_CEC", values)


def _read_cec(text: str, parameters: Parameters) -> ErrorTable:
    found = _parsed(text, "AN_CEC")
    tables: dict[str, dict[int, tuple[str, int]]] = {}
    for index, value in found[""].items():
        t, _, point = index.partition(",")
        if not (t.isdigit() and point.isdigit()):
            refuse(f"[{index}] names no table and point", value[1])
        tables.setdefault(t, {})[int(point)] = value
    ways: dict[float, tuple[FloatArray, FloatArray]] = {}
    for t, values in tables.items():
        if t not in found.get("_DIRECTION", {}):
            refuse(f"DIRECTION of [{t}] is missing")
        way = numeric(*found["_DIRECTION"][t])
        if way in ways or way not in (-1.0, 0.0, 1.0):
            refuse(f"DIRECTION of [{t}] is {way:g}", found["_DIRECTION"][t][1], "0, or 1 and -1")
        ways[way] = _points(found, t, values)
    if set(ways) == {0.0}:
        return ErrorTable.of(*ways[0.0])
    if set(ways) != {1.0, -1.0} or not np.array_equal(ways[1.0][0], ways[-1.0][0]):
        refuse("its tables are not of both directions at the same positions")
    return ErrorTable.of(*ways[1.0], ways[-1.0][1])


ENC = Controller(
    name="siemens-enc",
    sign="error",
    says="Values are errors (actual minus nominal): a positive value makes the axis move in the "
    "negative direction. 0 at the reference point. Load with MD32700 = 0, then set it to 1.",
    write=_write_enc,
    read=_read_enc,
    parameters={"axis": "X1", "encoder": "0"},
    zeroed="forward",
    comment=";",
)
CEC = Controller(
    name="siemens-cec",
    sign="error",
    says="Values are errors (measured minus ideal); DIRECTION 1 forward, -1 reverse. Confirm the "
    "sign by a verification move. Enable with MD32710 and SD41300.",
    write=_write_cec,
    read=_read_cec,
    parameters={"axis": "AX1", "table": "0"},
    two=lambda _: True,
    zeroed="forward",
    comment=";",
)
