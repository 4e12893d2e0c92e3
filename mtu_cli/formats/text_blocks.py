"""Text with blocks: Aerotech laser text (``Raw Data:``) and the text reports of PC-DMIS."""

from __future__ import annotations

import re

from mtu_cli.formats.base import POINTS, READINGS, Ask, Format, Imported, RawFile
from mtu_cli.formats.grid import Faults, decimals, number
from mtu_cli.formats.wide import read as read_wide

AXES = ("X", "Y", "Z")
_LASER = re.compile(r"^Raw Data:", re.M)
_DIM = re.compile(r"^\s*DIM\s+(\S+)\s*=\s*\w+(?:\s+\w+)*?\s+OF\s+\w+\s+(\S+)", re.I)
_UNITS = re.compile(r"UNITS\s*=\s*(MM|IN)", re.I)


def _is_laser(file: RawFile) -> bool:
    return bool(_LASER.search(file.text)) and "Target Position" in file.text


def read_laser(file: RawFile, ask: Ask) -> Imported:
    """The table below ``Raw Data:``, one column a run; the other blocks are counted."""
    start = next(i for i, line in enumerate(file.lines) if line.startswith("Raw Data:"))
    end = next((i for i in range(start + 1, len(file.lines))
                if re.match(r"[A-Z][\w ]+:\s*$", file.lines[i])), len(file.lines))  # fmt: skip
    # Blank lines keep the lines of the file.
    lines = [""] * (start + 1) + file.lines[start + 1 : end]
    table = RawFile(source=file.source, content=b"", text="\n".join(lines), encoding=file.encoding)
    found = read_wide(table, ask)
    found.format = "laser-text"
    others = [line for line in file.lines[:start] + file.lines[end:] if line.strip()]
    found.drop("lines of the other blocks (comments, environment, statistics)", len(others))
    return found


def _is_pcdmis(file: RawFile) -> bool:
    return any("MEAS" in line and re.match(r"\s*AX\b", line) for line in file.lines[:400])


def read_pcdmis(file: RawFile, ask: Ask) -> Imported:
    """Measured X, Y, Z of each feature, by the heading line of its block."""
    found, faults = Imported(format="pcdmis-text", kind=POINTS), Faults(file)
    rows: list[tuple[int, str, dict[str, str]]] = []
    heading, feature = list[str](), ""
    for line, text in enumerate(file.lines, 1):
        if match := _DIM.match(text):
            feature, heading = match[2], []
        elif re.match(r"\s*AX\b.*\bMEAS\b", text):
            heading = text.split()
        elif feature and heading and text.split():
            cells = text.split()
            if cells[0] not in AXES:
                found.drop("rows of other characteristics")
            elif len(cells) < len(heading):
                facts = {"cells": f"{len(cells)} cells", "expected": " ".join(heading)}
                faults.found.append(file.finding("row-length", row=line, **facts))
            else:
                rows.append((line, feature, dict(zip(heading, cells, strict=False))))
    faults.raise_if_any()
    units = _UNITS.search(file.text)
    if units and units[1].upper() == "IN":
        raise file.error("wrong-type", kind="millimetres", value="IN", expected="UNITS=MM")
    (sign,) = decimals(file, [[x for _, _, cells in rows for x in cells.values()]], ask.decimal)
    part = re.search(r"SER(?:IAL)? ?(?:NUM\w*|NO)\s*[:=]\s*(\S+)", file.text, re.I)
    points: dict[str, tuple[int, dict[str, float]]] = {}
    for line, name, by_heading in rows:
        axis = by_heading["AX"].lower()
        at = points.setdefault(name, (line, {}))[1]
        for key, column in (("MEAS", f"{axis}_mm"), ("NOMINAL", f"nominal_{axis}_mm")):
            if key in by_heading:
                value = number(by_heading[key], sign)
                if value is None:
                    faults.cell(line, key, by_heading[key])
                else:
                    at[column] = value
    faults.raise_if_any()
    add_points(file, found, part[1] if part else file.source.path.stem, points)
    found.says = ["actual X, Y, Z in mm, by the heading of each block"]
    return found


def add_points(
    file: RawFile, found: Imported, part: str, points: dict[str, tuple[int, dict[str, float]]]
) -> None:
    """Points with x and y; the others are counted."""
    for name, (line, at) in points.items():
        if {"x_mm", "y_mm"} <= at.keys():
            found.add(line, part=part, feature=name, **at)
        else:
            found.drop("features without X or Y")
    if not found.rows:
        raise file.error("empty-file", what="points with X and Y", expected=found.format)


FORMATS = (
    Format("laser-text", "Aerotech laser text", (READINGS,), _is_laser, read_laser),
    Format("pcdmis-text", "PC-DMIS text report", (POINTS,), _is_pcdmis, read_pcdmis),
)
