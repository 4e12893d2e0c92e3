"""Simulated controls, each written from its manual's sentence and apart from the writers.

``CONTROLS[name](text)`` gives where an axis is sent to at a commanded position and travel (+1, -1):
the commanded position plus what the table adds there. The axis then errs by its own error.
"""

import re
from collections.abc import Callable, Iterable

import numpy as np

Command = Callable[[float, int], float]
NUMBER = r"[-+]?\d+(?:\.\d+)?"


def command(
    forward: Iterable[tuple[float, float]], reverse: Iterable[tuple[float, float]] | None = None
) -> Command:
    """Adds the corrections of points (position, correction), linear between, held beyond them."""
    ways = {1: np.array(sorted(forward)).T}
    ways[-1] = ways[1] if reverse is None else np.array(sorted(reverse)).T
    return lambda x, way: x + float(np.interp(x, ways[way][0], ways[way][1]))


def rows_of(text: str, separator: str | None = None) -> list[list[float]]:
    """The lines that are numbers alone."""
    cells = [line.split(separator) for line in text.splitlines()]
    number = re.compile(NUMBER)
    return [[float(x) for x in row] for row in cells if row and all(map(number.fullmatch, row))]


def assignments(text: str, name: str) -> dict[str, float]:
    """Values by index."""
    found = re.findall(rf"(?m)^\${name}\[(\S+)\]=({NUMBER})\s*$", text)
    return {index: float(value) for index, value in found}


def linuxcnc(text: str) -> Command:
    """Source: trim = nominal - value (type 0), added to the commanded motor position."""
    rows = rows_of(text)
    return command(((n, n - f) for n, f, _ in rows), ((n, n - r) for n, _, r in rows))


def siemens_enc(text: str) -> Command:
    """ "A positive value makes the axis move in the negative direction"."""
    low, step = (assignments(text, f"AA_ENC_COMP_{x}")["0,X1"] for x in ("MIN", "STEP"))
    values = assignments(text, "AA_ENC_COMP")
    return command((low + step * int(index.split(",")[1]), -x) for index, x in values.items())


def siemens_cec(text: str) -> Command:
    """Measured minus ideal; DIRECTION 1 and -1 name the travel in which a table acts."""
    ways = {}
    for t, way in assignments(text, "AN_CEC_DIRECTION").items():
        low, step = (assignments(text, f"AN_CEC_{x}")[t] for x in ("MIN", "STEP"))
        points = (index.split(",") for index in assignments(text, "AN_CEC"))
        own = {int(k): assignments(text, "AN_CEC")[f"{t},{k}"] for table, k in points if table == t}
        ways[way] = [(low + step * k, -x) for k, x in own.items()]
    return command(ways[1.0], ways[-1.0])


def heidenhain(text: str) -> Command:
    """The figure is labelled "Error [mm]"; BACKLASH: what was measured in negative direction."""
    rows = rows_of(text)
    return command(((row[1], -row[-1]) for row in rows), ((row[1], -row[2]) for row in rows))


def beckhoff(text: str) -> Command:
    """Commanded 19866.7, reached 19856.5 going positive: pos is -102 in units of 0.1 um."""
    found = re.findall(r"table\[\d+\]\.(\w+)\s+(\S+)", text)
    at, pos, neg = (
        [float(x) * 1e-4 for own, x in found if own == name] for name in ("setpoint", "pos", "neg")
    )
    ways = ([-x for x in own] for own in (pos, neg))
    return command(*(zip(at, own, strict=True) for own in ways))


def two_columns(text: str) -> Command:
    """Values of the error model, which the control takes out."""
    return command((x, -e) for x, e in rows_of(text))


def aerotech(text: str) -> Command:
    """Corrections, added; OFFSET is minus the start."""
    step, offset = (
        float(re.findall(rf"{x}=({NUMBER})", text)[0]) for x in ("SAMPLEDIST", "START OFFSET")
    )
    return command((step * k - offset, value) for k, (value,) in enumerate(rows_of(text)))


def acs(text: str) -> Command:
    """Target minus mean, added."""
    base, step = map(float, re.findall(rf"MAP1D \d+, \d+, ({NUMBER}), ({NUMBER})", text)[0])
    values = re.findall(rf"\(\d+\) = ({NUMBER})", text)
    return command((base + step * k, float(value)) for k, value in enumerate(values))


def pmac(text: str) -> Command:
    """Sixteenths of a count (of 1 um), added to the commanded position; home is 0 and it wraps."""
    count, length = map(int, re.findall(r"DEFINE COMP (\d+),(\d+)", text)[0])
    values, span = [0.0, *(value for (value,) in rows_of(text))], length / 1000.0
    added = command((span / count * k, value / 16_000.0) for k, value in enumerate(values))
    return lambda x, way: x - x % span + added(x % span, way)


def mitsubishi(text: str) -> Command:
    """(Interval - actual) times 2 in um: what a move is to be longer by, twice."""
    _, low, high, *steps = np.array(rows_of(text, ",")).T
    at = [low[0], *high]
    return command(*(zip(at, [0.0, *np.cumsum(own) / 2000.0], strict=True) for own in steps))


def table(text: str) -> Command:
    """Columns of corrections, um, entered by hand."""
    rows = rows_of(text, ",")
    return command(((r[1], r[4] / 1000) for r in rows), ((r[1], r[5] / 1000) for r in rows))


CONTROLS: dict[str, Callable[[str], Command]] = {
    "linuxcnc": linuxcnc,
    "siemens-enc": siemens_enc,
    "siemens-cec": siemens_cec,
    "heidenhain": heidenhain,
    "heidenhain-old": heidenhain,
    "beckhoff": beckhoff,
    "isg-csv": two_columns,
    "etalon": two_columns,
    "aerotech": aerotech,
    "acs": acs,
    "pmac": pmac,
    "mitsubishi": mitsubishi,
    "table": table,
}
