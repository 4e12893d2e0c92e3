"""Kernel of ISG: axis tables of Beckhoff TwinCAT CNC, volumetric tables ISG_CSV and Etalon.

`kw.ssfk`: delta s = actual minus nominal position, forward (pos) and reverse (neg), in 0.1 um or
increments. ISG_CSV and the Vendor variant of ETALON_EXCHANGE: values of the error model, mm and
rad, the same in both directions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from mtu_cli.formats.control.errors import (
    Controller,
    ErrorTable,
    Parameters,
    choice,
    number_parameter,
    numeric,
    parameter,
    places_of,
    real,
    refuse,
    rising,
    whole,
)

TENTH_UM = 1e-4
ENTRY = re.compile(r"kw\.ssfk\.table\[(\d+)\]\.(setpoint|pos|neg)")
MOST_ENTRIES = 1500
ANGLES = ("A", "B", "C")


def _unit(parameters: Parameters) -> float:
    """mm of one unit of the table."""
    if choice(parameters, "unit", ("1", "0")) == "1":
        return TENTH_UM
    return 1.0 / number_parameter(parameters, "counts_per_mm")


def _write_ssfk(table: ErrorTable, parameters: Parameters) -> str:
    unit = _unit(parameters)
    head = {"unit": parameters["unit"], "kw_startpos": whole(table.at[0] / unit, "beckhoff")}
    head |= {"kw_nr_max": len(table.at), "interval": 0, "bilateral": int(table.both)}
    lines = [f"kopf.log_achs_name      {parameter(parameters, 'axis')}"]
    lines += [f"{'kw.ssfk.' + name:<24}{value}" for name, value in head.items()]
    for k, (at, pos, neg) in enumerate(zip(table.at, *table.errors, strict=True)):
        values = {"setpoint": at, "pos": pos} | ({"neg": neg} if table.both else {})
        for name, value in values.items():
            lines.append(f"kw.ssfk.table[{k}].{name:<9}{whole(value / unit, 'beckhoff')}")
    return "\n".join([*lines, ""])


def _read_ssfk(text: str, parameters: Parameters) -> ErrorTable:
    head: dict[str, float] = {}
    points: dict[str, dict[int, float]] = {"setpoint": {}, "pos": {}, "neg": {}}
    for i, line in enumerate(text.split("\n"), 1):
        name, _, value = line.strip().partition(" ")
        if match := ENTRY.fullmatch(name):
            points[match[2]][int(match[1])] = numeric(value, i)
        elif name.startswith("kw.ssfk."):
            head[name.removeprefix("kw.ssfk.")] = numeric(value, i)
    if missing := [name for name in ("unit", "kw_nr_max", "bilateral") if name not in head]:
        refuse(f"kw.ssfk.{missing[0]} is missing")
    count, columns = len(points["setpoint"]), ["setpoint", "pos"]
    columns += ["neg"] if head["bilateral"] else []
    for name in columns:
        if sorted(points[name]) != list(range(count)):
            refuse(f"the entries of {name} do not run from 0 to {count - 1}")
    if head["kw_nr_max"] != count:
        refuse(f"kw_nr_max is {head['kw_nr_max']:g}", expected=f"{count}, the number of entries")
    unit = _unit({**parameters, "unit": f"{head['unit']:g}"})
    at, *errors = (np.array([points[name][k] for k in range(count)]) * unit for name in columns)
    return ErrorTable.of(rising(at.tolist()), *errors)


def _error_name(parameters: Parameters, table: ErrorTable) -> tuple[str, str]:
    """The axis and the ISO 230-1 name of the error: EXX of the axis X unless it is said."""
    axis = parameter(parameters, "axis")
    name = parameters["error"] or ("" if table.angle else f"E{axis}{axis}")
    known = [f"E{a}{axis}" for a in (ANGLES if table.angle else ("X", "Y", "Z"))]
    return axis, choice({"error": name}, "error", tuple(known))


def _write_csv(table: ErrorTable, parameters: Parameters) -> str:
    axis, name = _error_name(parameters, table)
    places = places_of(table)
    rows = [f"{real(at)} {real(e, places)}" for at, e in zip(table.at, table.forward, strict=True)]
    return "\n".join([f"{axis} {name}", *rows, ""])


def _table(rows: list[list[float]], name: str) -> ErrorTable:
    at, errors = np.array(rows).reshape(-1, 2).T
    found = ErrorTable.of(rising(at.tolist()), errors)
    if name[1] not in ANGLES:
        return found
    return ErrorTable(at=found.at, forward=errors, reverse=errors, angle=True)


def _read_csv(text: str, parameters: Parameters) -> ErrorTable:
    heading: list[str] = []
    rows: list[list[float]] = []
    for i, line in enumerate(text.split("\n"), 1):
        cells = line.split("//")[0].split()
        if not cells:
            continue
        if not heading:
            heading = cells
            if len(cells) != 2 or not re.fullmatch(r"E[XYZABC][XYZ]", cells[1]):
                refuse(f"{' '.join(cells)!r} is no heading of one axis", i, "such as X EXX")
        elif len(cells) != 2:
            refuse(f"{len(cells)} values", i, "two")
        else:
            rows.append([numeric(cell, i) for cell in cells])
    if not heading:
        refuse("it has no heading")
    return _table(rows, heading[1])


def _write_etalon(table: ErrorTable, parameters: Parameters) -> str:
    places, (_, name) = places_of(table), _error_name(parameters, table)
    rows = [f"{real(at)} {real(e, places)}" for at, e in zip(table.at, table.forward, strict=True)]
    return "\n".join([f"[{name}]", "Gridpoints = {", *rows, "}", ""])


def _read_etalon(text: str, parameters: Parameters) -> ErrorTable:
    sections: dict[str, list[list[float]]] = {}
    name, inside = "", False
    for i, line in enumerate(map(str.strip, text.split("\n")), 1):
        if match := re.fullmatch(r"\[(\w+)\]", line):
            name = match[1]
        elif re.fullmatch(r"Gridpoints *= *\{", line):
            inside = True
        elif line == "}":
            inside = False
        elif inside:
            cells = line.split()
            if len(cells) != 2:
                refuse(f"{len(cells)} values", i, "a position and a value")
            sections.setdefault(name, []).append([numeric(cell, i) for cell in cells])
    if inside:
        refuse("the brace of Gridpoints is not closed")
    wanted = parameters["error"] or f"E{parameters['axis']}{parameters['axis']}"
    own = wanted if wanted in sections else next(iter(sections), "")
    if not re.fullmatch(r"E[XYZABC][XYZ]", own) or (wanted not in sections and len(sections) > 1):
        refuse(f"no Gridpoints of {wanted}", expected="--set error=EXX")
    return _table(sections[own], own)


VOLUMETRIC: Mapping[str, str] = {"axis": "X", "error": ""}
BECKHOFF = Controller(
    name="beckhoff",
    sign="error",
    says="kw.ssfk: values are errors (actual minus nominal), pos forward, neg reverse; unit 1 is "
    "0.1 um, 0 increments. Activate with lr_param.ssfk 1.",
    write=_write_ssfk,
    read=_read_ssfk,
    parameters={"axis": "X", "unit": "1", "counts_per_mm": ""},
    quantum=_unit,
    two=lambda _: True,
    equidistant=lambda _: False,
    most=MOST_ENTRIES,
)
ISG_CSV = Controller(
    name="isg-csv",
    sign="error",
    says="Values of the error model (actual minus nominal), mm and rad; `negate` in the list file "
    "turns the sign.",
    write=_write_csv,
    read=_read_csv,
    parameters=VOLUMETRIC,
    equidistant=lambda _: False,
    comment="//",
    angles=True,
)
ETALON = Controller(
    name="etalon",
    sign="error",
    says="ETALON_EXCHANGE, Vendor variant: values of the error model (actual minus nominal), mm "
    "and rad; `negate` in the list file turns the sign.",
    write=_write_etalon,
    read=_read_etalon,
    parameters=VOLUMETRIC,
    equidistant=lambda _: False,
    angles=True,
)
