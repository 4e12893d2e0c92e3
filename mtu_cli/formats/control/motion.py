"""Motion controllers whose tables hold corrections (-e): Aerotech, ACS SPiiPlus, PMAC."""

from __future__ import annotations

import re

import numpy as np

from mtu_cli.findings import error
from mtu_cli.formats.control.errors import (
    EQUAL_STEP,
    Controller,
    ErrorTable,
    Parameters,
    decimals,
    number_parameter,
    numeric,
    parameter,
    real,
    refuse,
    rising,
)

SIXTEENTHS = 16
"""PMAC: a value of the table is a sixteenth of a count."""
COVERS = re.compile(r";\s*points from (\S+) to (\S+) mm")


def _write_cal(table: ErrorTable, parameters: Parameters) -> str:
    axis = parameter(parameters, "axis")
    home = f"HOMEDIRECTION={parameter(parameters, 'home')} HOMEOFFSET={parameters['home_offset']}"
    lines = [
        f":START {axis} SAMPLEDIST={decimals(table.step or 0.0)} POSUNIT=PRIMARY CORUNIT=PRIMARY",
        f":START OFFSET={decimals(-table.at[0])}",
        f":START {home}",
        *(real(-e) for e in table.forward),
        ":END",
    ]
    return "\n".join([*lines, ""])


def _read_cal(text: str, parameters: Parameters) -> ErrorTable:
    keys: dict[str, str] = {}
    values: list[float] = []
    ended = False
    for i, line in enumerate(text.split("\n"), 1):
        words = re.split("[;']", line)[0].split()
        if not words or ended:
            continue
        if words[0] == ":START2D":
            refuse("a table of two dimensions", i, "a 1D table: :START")
        if words[0] == ":START":
            pairs = (word.partition("=") for word in words[1:])
            keys |= {name.upper(): value for name, _, value in pairs}
        elif words[0] == ":END":
            ended = True
        else:
            values += [numeric(word, i) for word in words]
    if not ended or "SAMPLEDIST" not in keys or len(values) < 2:
        refuse("no :START ... SAMPLEDIST=, two values or more, :END")
    if {keys.get("POSUNIT", "PRIMARY"), keys.get("CORUNIT", "PRIMARY")} != {"PRIMARY"}:
        refuse("its units are not PRIMARY", expected="POSUNIT=PRIMARY CORUNIT=PRIMARY")
    at = numeric(keys["SAMPLEDIST"]) * np.arange(len(values)) - numeric(keys.get("OFFSET", "0"))
    sign = 1.0 if "NEGCOR" in keys else -1.0
    return ErrorTable.of(rising(at.tolist()), sign * np.array(values))


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
    values = {int(k): numeric(value) for k, value in entries}
    declared = re.search(rf"REAL\s+{name}\((\d+)\)", text)
    if len(values) < 2 or sorted(values) != list(range(len(values))):
        refuse(f"the values of {name} do not run from 0")
    if declared and int(declared[1]) != len(values):
        refuse(f"{len(values)} values of {name}", expected=declared[1])
    at = base + step * np.arange(len(values))
    return ErrorTable.of(rising(at.tolist()), [-values[k] for k in range(len(values))])


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
    values = np.rint(-table.forward * counts * SIXTEENTHS).astype(int)
    # Positions wrap: beyond the last point the table goes on with its lowest one, and ends at home.
    around = [i if i <= high else i - n for i in range(1, n + 1)]
    lines = [f"; points from {decimals(low * step)} to {decimals(high * step)} mm"]
    lines += [f"#{parameter(parameters, 'axis')}", f"DEFINE COMP {n},{round(length)}"]
    return "\n".join([*lines, *(str(values[k - low]) for k in around), "I51=1", ""])


def _read_pmac(text: str, parameters: Parameters) -> ErrorTable:
    counts, covers = number_parameter(parameters, "counts_per_mm"), COVERS.search(text)
    plain = re.sub(r";.*", "", text)
    found = re.search(r"DEFINE COMP\s+(\d+)\s*,\s*(\d+)\s*\n([-+\d\s]*)", plain)
    if found is None:
        refuse("no DEFINE COMP n,counts")
    n, values = int(found[1]), [int(numeric(word)) for word in found[3].split()]
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
    index = np.arange(low, low + n)
    errors = [-values[(k - 1) % n] / (SIXTEENTHS * counts) for k in index.tolist()]
    return ErrorTable.of(np.round(index * step, 6), errors)


AEROTECH = Controller(
    name="aerotech",
    sign="correction",
    says="Values are corrections (nominal minus actual), the same in both directions; NEGCOR turns "
    "the sign. Set HOMEDIRECTION and HOMEOFFSET as the axis is homed.",
    write=_write_cal,
    read=_read_cal,
    parameters={"axis": "1", "home": "CCW", "home_offset": "0"},
    comment=";",
)
ACS = Controller(
    name="acs",
    sign="correction",
    says="Values are corrections (target minus mean), the same in both directions.",
    write=_write_acs,
    read=_read_acs,
    parameters={"axis": "0", "zone": "0"},
    comment="!",
)
PMAC = Controller(
    name="pmac",
    sign="correction",
    says="Values are corrections in 1/16 count, added to the commanded position; the first is one "
    "spacing from home, the last 0 at home: the table wraps.",
    write=_write_pmac,
    read=_read_pmac,
    parameters={"axis": "1", "counts_per_mm": ""},
    quantum=lambda parameters: 1.0 / (SIXTEENTHS * number_parameter(parameters, "counts_per_mm")),
    zeroed="forward",
    comment=";",
)
