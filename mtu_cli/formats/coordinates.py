"""Tables of coordinates: features x parts, and the characteristics of Calypso (``_chr.txt``)."""

from __future__ import annotations

import re

from mtu_cli.formats.base import POINTS, Ask, Format, Imported, RawFile
from mtu_cli.formats.grid import Faults, decimals, grid_of, number, said
from mtu_cli.formats.text_blocks import add_points

FEATURE = ("feature", "feature id", "merkmal", "element", "hole", "bohrung", "characteristic")
AXIS = ("axis", "achse", "ax", "coordinate")
NOMINAL = ("nominal", "nom", "soll", "sollwert", "nominal mm", "nominal [mm]")
CALYPSO = {"id", "actual", "nominal", "deviation", "featureid"}


def _plain(cells: list[str]) -> list[str]:
    return [cell.strip().casefold() for cell in cells]


def _is_calypso(file: RawFile) -> bool:
    return set(_plain(file.lines[0].split("\t"))) >= CALYPSO


def read_calypso(file: RawFile, ask: Ask) -> Imported:
    """Actual and nominal of the characteristics X, Y, Z of each feature, by heading."""
    grid = grid_of(file.lines, separator="\t")
    header, rows = _plain(grid.rows[0].cells), grid.rows[1:]
    found, faults = Imported(format="calypso", kind=POINTS), Faults(file)
    if not rows or rows[-1].cells[0].upper() != "END":
        raise file.error("missing-input", what="the last line END", expected="a whole file")
    place = {name: header.index(name) for name in header}
    rows = rows[:-1]
    for row in rows:
        if len(row.cells) < max(place[name] for name in CALYPSO) + 1:
            facts = {"cells": f"{len(row.cells)} cells", "expected": f"{len(header)} cells"}
            faults.found.append(file.finding("row-length", row=row.line, **facts))
    faults.raise_if_any()
    names = ("actual", "nominal")
    signs = decimals(file, ([r.cells[place[n]] for r in rows] for n in names), ask.decimal, "\t")
    parts: dict[str, dict[str, tuple[int, dict[str, float]]]] = {}
    for row in rows:
        axis = _axis(row.cells, place)
        if axis is None:
            found.drop("other characteristics")
            continue
        part = row.cells[place["partnb"]] if "partnb" in place else ""
        points = parts.setdefault(part or file.source.path.stem, {})
        at = points.setdefault(row.cells[place["featureid"]], (row.line, {}))[1]
        for name, sign, column in zip(names, signs, ("{}_mm", "nominal_{}_mm"), strict=True):
            value = number(row.cells[place[name]], sign)
            if value is None:
                faults.cell(row.line, name, row.cells[place[name]])
            else:
                at[column.format(axis)] = value
    faults.raise_if_any()
    for part, points in parts.items():
        add_points(file, found, part, points)
    if not parts:
        raise file.error("empty-file", what="characteristics X, Y, Z", expected="idsymbol or type")
    found.says = [said(grid, signs), "actual X, Y, Z in mm by the headings"]
    return found


def _axis(cells: list[str], place: dict[str, int]) -> str | None:
    """x, y or z of a characteristic of position: by its symbol, type or the end of its name."""
    unit = cells[place["unit"]] if place.get("unit", len(cells)) < len(cells) else "mm"
    if unit not in ("", "mm"):
        return None
    for name in ("idsymbol", "type", "id"):
        text = cells[place[name]] if name in place and place[name] < len(cells) else ""
        if match := re.search(r"(?:^|[^A-Za-z])([XYZ])(?:[ _-]?(?:value|wert))?$", text, re.I):
            return match[1].lower()
    return None


def _wide_header(file: RawFile) -> tuple[int, int, int] | None:
    """Indices of feature, axis and nominal in the header; None where it has not all of them."""
    grid = grid_of(file.lines[:20])
    header = _plain(grid.rows[0].cells) if grid.rows else []
    found = [next((i for i, name in enumerate(header) if name in known), -1)
             for known in (FEATURE, AXIS, NOMINAL)]  # fmt: skip
    return None if -1 in found or len(header) < 4 else (found[0], found[1], found[2])


def read_wide_points(file: RawFile, ask: Ask) -> Imported:
    """Columns feature, axis, nominal, then measured coordinates in mm, one column a part."""
    place = _wide_header(file)
    assert place is not None
    grid, faults = grid_of(file.lines), Faults(file)
    header, rows = grid.rows[0].cells, grid.rows[1:]
    for row in rows:
        if len(row.cells) != len(header):
            facts = {"cells": f"{len(row.cells)} cells", "expected": f"{len(header)} cells"}
            faults.found.append(file.finding("row-length", row=row.line, **facts))
    faults.raise_if_any()
    columns = ([row.cells[i] for row in rows] for i in range(len(header)))
    signs = decimals(file, columns, ask.decimal, grid.separator)
    found = Imported(format="wide-points", kind=POINTS)
    parts = {i: name for i, name in enumerate(header) if i not in place}
    points: dict[tuple[str, str], tuple[int, dict[str, float]]] = {}
    pairs: list[tuple[float, float]] = []
    for row in rows:
        axis = row.cells[place[1]].casefold()
        if axis not in ("x", "y", "z"):
            faults.cell(row.line, header[place[1]], row.cells[place[1]], "x, y or z")
            continue
        nominal = number(row.cells[place[2]], signs[place[2]])
        if nominal is None:
            faults.cell(row.line, header[place[2]], row.cells[place[2]])
        for i, part in parts.items():
            value = number(row.cells[i], signs[i])
            if not row.cells[i]:
                found.drop("empty cells")
            elif value is None:
                faults.cell(row.line, part, row.cells[i])
            elif nominal is not None:
                at = points.setdefault((part, row.cells[place[0]]), (row.line, {}))[1]
                if f"{axis}_mm" in at:
                    other = f"an earlier row of {row.cells[place[0]]}, {axis}"
                    faults.found.append(file.finding("copied-rows", row=row.line, other=other))
                at |= {f"{axis}_mm": value, f"nominal_{axis}_mm": nominal}
                pairs.append((nominal, value))
    faults.raise_if_any()
    apart = sum(abs(value - nominal) for nominal, value in pairs)
    if apart > 0.5 * sum(abs(nominal) for nominal, _ in pairs) > 0:
        kind = "deviations, no coordinates (they do not follow the nominal places)"
        raise file.error("other-table", kind=kind, expected="measured coordinates in mm")
    for part in parts.values():
        own = {feature: at for (name, feature), at in points.items() if name == part}
        if own:
            add_points(file, found, part, own)
    if not found.rows:
        raise file.error("empty-file", what="points", expected="rows of x and y of each feature")
    found.says = [said(grid, signs), f"{len(parts)} parts, coordinates in mm"]
    found.facts = {"parts": list(parts.values()), "features": len({f for _, f in points})}
    return found


FORMATS = (
    Format("calypso", "Calypso table of characteristics", (POINTS,), _is_calypso, read_calypso),
    Format("wide-points", "features x parts", (POINTS,),
           lambda file: bool(file.text) and _wide_header(file) is not None, read_wide_points),
)  # fmt: skip
