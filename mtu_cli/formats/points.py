"""Measured points: Q-DAS AQDEF ``.dfq`` (ISO/TR 11462-5: characteristics with K fields, values
compact or long), characteristics of Calypso (``_chr.txt``), text reports of PC-DMIS, QIF results
(2.x, 3.0), and tables of features x parts. Each is a list of coordinates, as texts, that `collect`
makes points of.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from mtu_cli.files.headers import Decimal
from mtu_cli.formats.base import Format, Import, RawFile, local
from mtu_cli.formats.grid import check_widths, decimals, grid_of, number, summary

FEATURE = ("feature", "feature id", "merkmal", "element", "hole", "bohrung", "characteristic")
AXIS = ("axis", "achse", "ax", "coordinate")
NOMINAL = ("nominal", "nom", "soll", "sollwert", "nominal mm", "nominal [mm]")
CALYPSO = {"id", "actual", "nominal", "deviation", "featureid"}
OF_AXIS = re.compile(r"(.*?)(?:^|[^A-Za-z])([XYZ])(?:[ _-]?(?:value|wert))?", re.I | re.S)
"""A name of a characteristic of position: the feature, and the axis at its end."""
_DIM = re.compile(r"^\s*DIM\s+(\S+)\s*=\s*\w+(?:\s+\w+)*?\s+OF\s+\w+\s+(\S+)", re.I)
INVALID = ("255", "256")
"""Attributes of a value that does not count."""
_FIELD = re.compile(r"(K\d{4})(?:/(\d+))?[ \t]+(.*)")


class Coordinate(NamedTuple):
    """A measured coordinate as it stands in the file, with its nominal value where there is one."""

    line: int
    part: str
    feature: str
    axis: str
    actual: str
    nominal: str = ""


def collect(
    result: Import, rows: Sequence[Coordinate], separator: str = "", scale: float = 1.0
) -> list[Decimal]:
    """Adds the points of features with X and Y, part by part; the others are counted.

    Raises InputError with all bad cells, and for two values of one coordinate.
    """
    columns = ([row.actual for row in rows], [row.nominal for row in rows])
    signs = decimals(result, columns, separator)
    points: dict[str, dict[str, tuple[int, dict[str, float]]]] = {}
    for row in rows:
        place = points.setdefault(row.part, {}).setdefault(row.feature, (row.line, {}))[1]
        texts = {f"{row.axis}_mm": (row.actual, signs[0])}
        if row.nominal:
            texts[f"nominal_{row.axis}_mm"] = (row.nominal, signs[1])
        for name, (text, sign) in texts.items():
            value = number(text, sign)
            if value is None:
                result.bad_cell(row.line, name, text)
            elif place.setdefault(name, value * scale) != value * scale:
                other = f"another {name} of {row.feature}, {row.part}"
                result.fault("copied-rows", row=row.line, other=other)
    result.faults.raise_if_any()
    for part, features in points.items():
        for feature, (line, place) in features.items():
            if {"x_mm", "y_mm"} <= place.keys():
                result.add(line, part=part, feature=feature, **place)
            else:
                result.drop("features without X or Y")
    if not result.rows and result.ask.kind != "inspect":
        expected = "features with X and Y in mm"
        raise result.file.error("empty-file", what=f"points of {result.format}", expected=expected)
    return signs


def _plain(cells: Sequence[str]) -> list[str]:
    return [cell.strip().casefold() for cell in cells]


def read_calypso(result: Import) -> None:
    """Actual and nominal of the characteristics X, Y, Z of each feature, by heading."""
    file, grid = result.file, grid_of(result.file.lines, separator="\t")
    header, (*rows, last) = _plain(grid.rows[0].cells), grid.rows
    if last.cells[0].upper() != "END":
        raise file.error("missing-input", what="the last line END", expected="a whole file")
    check_widths(result, rows, len(header), fewest=max(map(header.index, sorted(CALYPSO))) + 1)
    coordinates = []
    for row in rows[1:]:
        cells = dict(zip(header, row.cells, strict=False))
        texts = (cells.get(name, "") for name in ("idsymbol", "type", "id"))
        axis = next((m[2].lower() for text in texts if (m := OF_AXIS.fullmatch(text))), None)
        if axis is None or cells.get("unit", "mm") not in ("", "mm"):
            result.drop("other characteristics")
            continue
        part = cells.get("partnb") or file.source.path.stem
        coordinate = (cells["featureid"], axis, cells["actual"], cells["nominal"])
        coordinates.append(Coordinate(row.line, part, *coordinate))
    signs = collect(result, coordinates, "\t")
    result.says = [summary(grid, signs), "actual X, Y, Z in mm by the headings"]


def _header(file: RawFile) -> list[int] | None:
    """Indices of feature, axis and nominal in the header; None where it has not all of them."""
    grid = grid_of(file.lines[:20])
    header = _plain(grid.rows[0].cells) if grid.rows else []
    result = [next((i for i, name in enumerate(header) if name in synonyms), -1)
             for synonyms in (FEATURE, AXIS, NOMINAL)]  # fmt: skip
    return None if -1 in result or len(header) < 4 else result


def read_wide_points(result: Import) -> None:
    """Columns feature, axis, nominal, then measured coordinates in mm, one column a part."""
    place, grid = _header(result.file) or [0, 1, 2], grid_of(result.file.lines)
    header, rows = grid.rows[0].cells, grid.rows[1:]
    check_widths(result, rows, len(header))
    coordinates = list[Coordinate]()
    parts = {i: name for i, name in enumerate(header) if i not in place}
    for i, part in parts.items():
        for row in rows:
            feature, axis, nominal = (row.cells[at] for at in place)
            if axis.casefold() not in ("x", "y", "z"):
                result.bad_cell(row.line, header[place[1]], axis, "x, y or z")
            elif not nominal:
                result.bad_cell(row.line, header[place[2]], nominal)
            elif not row.cells[i]:
                result.drop("empty cells")
            else:
                coordinate = (feature, axis.casefold(), row.cells[i], nominal)
                coordinates.append(Coordinate(row.line, part, *coordinate))
    signs = collect(result, coordinates, grid.separator)
    pairs = [(a, b) for axis in "xyz" for a, b in zip(
        *(result.columns.get(f"{name}{axis}_mm", []) for name in ("", "nominal_")), strict=True)
        if None not in (a, b)]  # fmt: skip
    if sum(abs(a - b) for a, b in pairs) > 0.5 * sum(abs(b) for _, b in pairs) > 0:
        kind = "deviations, no coordinates (they do not follow the nominal places)"
        raise result.file.error("other-table", kind=kind, expected="measured coordinates in mm")
    result.says = [summary(grid, signs), f"{len(parts)} parts, coordinates in mm"]
    result.facts = {"parts": list(parts.values())}


def read_pcdmis(result: Import) -> None:
    """Measured X, Y, Z of each feature, by the heading line of its block."""
    file = result.file
    units = re.search(r"UNITS\s*=\s*(MM|IN)", file.text, re.I)
    if units and units[1].upper() == "IN":
        raise file.error("wrong-type", kind="millimetres", value="IN", expected="UNITS=MM")
    serial = re.search(r"SER(?:IAL)? ?(?:NUM\w*|NO)\s*[:=]\s*(\S+)", file.text, re.I)
    part = serial[1] if serial else file.source.path.stem
    coordinates, heading, feature = list[Coordinate](), list[str](), ""
    for line, text in enumerate(file.lines, 1):
        cells = text.split()
        if match := _DIM.match(text):
            feature, heading = match[2], []
        elif cells[:1] == ["AX"]:
            heading = cells
            if "MEAS" not in cells:
                result.fault("missing-column", row=line, column="MEAS", expected="AX ... MEAS")
                heading = []
        elif not (feature and heading and cells):
            continue
        elif cells[0] not in ("X", "Y", "Z"):
            result.drop("rows of other characteristics")
        elif len(cells) < len(heading):
            count, expected = f"{len(cells)} cells", " ".join(heading)
            result.fault("row-length", row=line, cells=count, expected=expected)
        else:
            fields = dict(zip(heading, cells, strict=False))
            values = (fields["AX"].lower(), fields["MEAS"], fields.get("NOMINAL", ""))
            coordinates.append(Coordinate(line, part, feature, *values))
    result.faults.raise_if_any()
    collect(result, coordinates)
    result.says = ["actual X, Y, Z in mm, by the heading of each block"]


def _under(element: Element, ending: str) -> Iterator[Element]:
    """Elements beneath whose name without namespace ends so."""
    return (item for item in element.iter() if local(item).endswith(ending))


def _text(element: Element, name: str) -> str:
    return next(((x.text or "").strip() for x in _under(element, name) if x is not element), "")


def read_qif(result: Import) -> None:
    """Locations of measured features in mm, joined by id to their items; others are counted."""
    root = result.file.xml
    assert root is not None
    factor = 1.0
    for unit in [*_under(root, "LinearUnit")][:1]:
        metre = _text(unit, "UnitName").lower() in ("m", "meter", "metre")
        stated = number(_text(unit, "Factor"), ".")
        factor = 1000.0 * stated if stated else 1000.0 if metre else 1.0
    names = {x.get("id", ""): _text(x, "FeatureName") for x in _under(root, "FeatureItem")}
    coordinates = list[Coordinate]()
    for i, results in enumerate(_under(root, "MeasurementResults"), 1):
        part = _text(results, "SerialNumber") or f"{result.file.source.path.stem}-{i}"
        for n, actual in enumerate(_under(results, "FeatureActual"), 1):
            cells, item = _text(actual, "Location").split(), _text(actual, "FeatureItemId")
            if len(cells) != 3:
                result.drop("features without a location")
                continue
            feature = names.get(item) or item or str(n)
            coordinates += [Coordinate(1, part, feature, *coordinate)
                            for coordinate in zip("xyz", cells, strict=True)]  # fmt: skip
    result.drop("characteristics", len([*_under(root, "CharacteristicActual")]))
    result.ask = replace(result.ask, decimal=".")
    collect(result, coordinates, scale=factor)
    result.says = [f"locations times {factor:g} in mm", "nominal places from the part file"]


def read_dfq(result: Import) -> None:
    """Values of characteristics named ``feature.X``: the n-th value of each is the n-th part."""
    # Of each characteristic; 0: of all, and of the part.
    fields: dict[int, dict[str, str]] = {0: {}}
    # Of each value: line, characteristic, text and attribute.
    values, last, width = list[list[Any]](), dict[int, int](), 0

    def count() -> int:
        return len(fields) - 1

    def of(index: int, key: str) -> str:
        return fields.get(index, {}).get(key) or fields[0].get(key, "")

    for line, text in enumerate(result.file.lines, 1):
        match = _FIELD.fullmatch(text.strip(" \t"))
        if match is None:
            # Compact: characteristics between 0x0F, fields between 0x14.
            cells = [cell.split("\x14") for cell in text.split("\x0f")] if text.strip() else []
            # Value, attribute and time: a record that was cut off has fewer than the first.
            width = width or min(3, max(map(len, cells), default=0))
            if cells and (min(map(len, cells)) < width or len(cells) != (count() or len(cells))):
                expected = f"{count()} characteristics of {width} fields or more"
                result.bad_cell(line, "values", text, expected)
                continue
            for i, cell in enumerate(cells, 1):
                values.append([line, i, cell[0].strip(), (*cell, "")[1].strip()])
            continue
        key, index, value = match[1], int(match[2] or 0), match[3].strip()
        if key == "K0001":
            last[index or 1] = len(values)
            values.append([line, index or 1, value, "0"])
        elif key in ("K0002", "K0004") and (index or 1) not in last:
            result.bad_cell(line, key, value, f"a K0001/{index or 1} before it")
        elif key == "K0002":
            values[last[index or 1]][3] = value
        elif key != "K0004":
            fields.setdefault(0 if key.startswith("K1") else index, {})[key] = value
    if (stated := of(0, "K0100")) != str(count()):
        number, expected = f"{count()} characteristics", f"{stated}, as K0100 says"
        result.fault("wrong-count", found=number, expected=expected)
    result.faults.raise_if_any()
    coordinates, counts = list[Coordinate](), dict[int, int]()
    for line, index, text, attribute in values:
        match = OF_AXIS.fullmatch(of(index, "K2002") or of(index, "K2001"))
        feature = match[1].rstrip(" ._-:") if match else ""
        counts[index] = counts.get(index, 0) + 1
        is_other = of(index, "K2004") == "1" or of(index, "K2142").lower() not in ("", "mm")
        if index not in fields:
            result.bad_cell(line, "characteristic", str(index), f"one of {count()}")
        elif attribute in INVALID:
            result.drop("values with attribute 255 or 256, that is invalid")
        elif is_other or match is None or not feature:
            result.drop("values of characteristics that are no X, Y or Z in mm")
        else:
            coordinate = (match[2].lower(), text, of(index, "K2101"))
            coordinates.append(Coordinate(line, str(counts[index]), feature, *coordinate))
    collect(result, coordinates)
    result.facts = {"characteristics": [of(i, "K2002") for i in sorted(fields) if i]}
    result.says = ["the n-th value of a characteristic is of the n-th part, in mm"]


FORMATS = (
    Format("dfq", "Q-DAS AQDEF", "points",
           lambda file: file.text.lstrip().startswith("K0100"), read_dfq),
    Format("qif", "QIF results", "points",
           lambda file: "QIFDocument" in file.text[:4000] and file.xml is not None, read_qif),
    Format("pcdmis-text", "PC-DMIS text report", "points",
           lambda file: bool(re.search(r"^[ \t]*AX\b.*MEAS", file.text, re.M)), read_pcdmis),
    Format("calypso", "Calypso table of characteristics", "points",
           lambda file: set(_plain(file.lines[0].split("\t"))) >= CALYPSO, read_calypso),
    Format("wide-points", "features x parts", "points",
           lambda file: bool(file.text) and _header(file) is not None, read_wide_points),
)  # fmt: skip
