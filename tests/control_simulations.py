"""Simulated controls, each written from its manual's sentence and apart from the writers.

``CONTROLS[name](text)`` gives where an axis is sent to at a commanded position and travel (+1, -1):
the commanded position less or plus what the table holds there. The axis then errs by its own error.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise

Command = Callable[[float, int], float]
NUMBER = r"[-+]?\d+(?:\.\d+)?"


def between(points: dict[float, float], x: float) -> float:
    """Linear between the points, held beyond them."""
    places = sorted(points)
    if x <= places[0]:
        return points[places[0]]
    for low, high in pairwise(places):
        if x <= high:
            share = (x - low) / (high - low)
            return points[low] + share * (points[high] - points[low])
    return points[places[-1]]


def assignments(text: str) -> dict[str, float]:
    found = re.findall(rf"(?m)^\$(\S+)=({NUMBER})\s*$", text)
    return {name: float(value) for name, value in found}


def linuxcnc(text: str) -> Command:
    """Source: trim = nominal - value (type 0), added to the commanded motor position."""
    rows = [[float(x) for x in line.split()] for line in text.splitlines()]
    ways = {1: {n: n - f for n, f, _ in rows}, -1: {n: n - r for n, _, r in rows}}
    return lambda x, way: x + between(ways[way], x)


def siemens_enc(text: str) -> Command:
    """ "A positive value makes the axis move in the negative direction"."""
    own = assignments(text)
    low, step = own["AA_ENC_COMP_MIN[0,X1]"], own["AA_ENC_COMP_STEP[0,X1]"]
    points = {
        low + step * int(name.split(",")[1]): value
        for name, value in own.items()
        if name.startswith("AA_ENC_COMP[")
    }
    return lambda x, way: x - between(points, x)


def siemens_cec(text: str) -> Command:
    """Measured minus ideal; DIRECTION 1 and -1 name the travel in which a table acts."""
    own = assignments(text)
    ways: dict[int, dict[float, float]] = {}
    for t in range(2):
        way = int(own.get(f"AN_CEC_DIRECTION[{t}]", 9))
        low, step = own.get(f"AN_CEC_MIN[{t}]", 0.0), own.get(f"AN_CEC_STEP[{t}]", 0.0)
        ways[way] = {
            low + step * int(name[:-1].split(",")[1]): value
            for name, value in own.items()
            if name.startswith(f"AN_CEC[{t},")
        }
    return lambda x, way: x - between(ways[way], x)


def heidenhain(text: str) -> Command:
    """The figure is labelled "Error [mm]"; BACKLASH: what was measured in negative direction."""
    rows = [line.split() for line in text.splitlines()[2:-1]]
    forward = {float(row[1]): float(row[3]) for row in rows}
    reverse = {float(row[1]): float(row[2]) for row in rows}
    return lambda x, way: x - between(forward if way > 0 else reverse, x)


def heidenhain_old(text: str) -> Command:
    """One value for both directions."""
    rows = [line.split() for line in text.splitlines()[2:-1]]
    points = {float(row[1]): float(row[2]) for row in rows}
    return lambda x, way: x - between(points, x)


def beckhoff(text: str) -> Command:
    """Commanded 19866.7, reached 19856.5 going positive: pos is -102 in units of 0.1 um."""
    found = re.findall(r"table\[(\d+)\]\.(\w+)\s+(\S+)", text)
    rows: dict[str, dict[str, float]] = {}
    for k, name, value in found:
        rows.setdefault(k, {})[name] = float(value) * 1e-4
    ways = {
        1: {row["setpoint"]: row["pos"] for row in rows.values()},
        -1: {row["setpoint"]: row["neg"] for row in rows.values()},
    }
    return lambda x, way: x - between(ways[way], x)


def two_columns(text: str) -> Command:
    """Values of the error model, which the control takes out."""
    found = re.findall(rf"(?m)^({NUMBER}) ({NUMBER})\s*$", text)
    points = {float(x): float(e) for x, e in found}
    return lambda x, way: x - between(points, x)


def aerotech(text: str) -> Command:
    """Corrections, added; OFFSET is minus the start."""
    step = float(re.findall(rf"SAMPLEDIST=({NUMBER})", text)[0])
    start = -float(re.findall(rf":START OFFSET=({NUMBER})", text)[0])
    values = [float(x) for x in re.findall(rf"(?m)^({NUMBER})\s*$", text)]
    points = {start + step * k: value for k, value in enumerate(values)}
    return lambda x, way: x + between(points, x)


def acs(text: str) -> Command:
    """Target minus mean, added."""
    base, step = (
        float(x) for x in re.findall(rf"ERRORMAP1D \d+, \d+, ({NUMBER}), ({NUMBER})", text)[0]
    )
    values = [float(x) for x in re.findall(rf"\(\d+\) = ({NUMBER})", text)]
    points = {base + step * k: value for k, value in enumerate(values)}
    return lambda x, way: x + between(points, x)


def pmac(text: str) -> Command:
    """Sixteenths of a count (of 1 um), added to the commanded position; home is 0 and it wraps."""
    lines = [line.split(";")[0].strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    count, length = (int(x) for x in lines[1].removeprefix("DEFINE COMP ").split(","))
    values = [0, *(int(x) for x in lines[2 : 2 + count])]
    span = length / 1000.0
    points = {span / count * k: value / 16_000.0 for k, value in enumerate(values)}
    return lambda x, way: x + between(points, x % span)


def mitsubishi(text: str) -> Command:
    """(Interval - actual) times 2 in um: what a move is to be longer by, twice."""
    rows = [[float(x) for x in line.split(",")] for line in text.splitlines() if line[0].isdigit()]
    ways: dict[int, dict[float, float]] = {1: {rows[0][1]: 0.0}, -1: {rows[0][1]: 0.0}}
    for _, low, high, plus, minus in rows:
        ways[1][high] = ways[1][low] + plus / 2000.0
        ways[-1][high] = ways[-1][low] + minus / 2000.0
    return lambda x, way: x + between(ways[way], x)


def table(text: str) -> Command:
    """Columns of corrections, um, entered by hand."""
    rows = [[float(x) for x in line.split(",")] for line in text.splitlines() if line[0].isdigit()]
    ways = {1: {r[1]: r[4] / 1000 for r in rows}, -1: {r[1]: r[5] / 1000 for r in rows}}
    return lambda x, way: x + between(ways[way], x)


CONTROLS: dict[str, Callable[[str], Command]] = {
    "linuxcnc": linuxcnc,
    "siemens-enc": siemens_enc,
    "siemens-cec": siemens_cec,
    "heidenhain": heidenhain,
    "heidenhain-old": heidenhain_old,
    "beckhoff": beckhoff,
    "isg-csv": two_columns,
    "etalon": two_columns,
    "aerotech": aerotech,
    "acs": acs,
    "pmac": pmac,
    "mitsubishi": mitsubishi,
    "table": table,
}
