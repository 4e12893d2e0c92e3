"""Q-DAS AQDEF ``.dfq`` (ISO/TR 11462-5): characteristics with K fields, values compact or long."""

from __future__ import annotations

import re
from typing import Any

from mtu_cli.formats.base import Format, Import
from mtu_cli.formats.points import OF_AXIS, Coordinate, collect

INVALID = ("255", "256")
"""Attributes of a value that does not count."""
_FIELD = re.compile(r"(K\d{4})(?:/(\d+))?[ \t]+(.*)")


def read(result: Import) -> None:
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
    Format("dfq", "Q-DAS AQDEF", "points", lambda file: file.text.lstrip().startswith("K0100"),
           read),
)  # fmt: skip
