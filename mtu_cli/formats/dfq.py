"""Q-DAS AQDEF ``.dfq`` (ISO/TR 11462-5): characteristics with K fields, values compact or long."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from mtu_cli.formats.base import POINTS, Ask, Format, Imported, RawFile
from mtu_cli.formats.grid import Faults, decimals, number

INVALID = ("255", "256")
"""Attributes of a value that does not count."""
_FIELD = re.compile(r"(K\d{4})(?:/(\d+))?[ \t]+(.*)")
_AXIS = re.compile(r"(.+?)[ ._\-:]+([XYZ])(?:[ _-]?(?:value|wert))?$", re.I)


@dataclass
class _Data:
    """Part fields, fields of each characteristic, and values: line, characteristic, text,
    attribute and time. /0 gives a field to all characteristics.
    """

    part: dict[str, str] = field(default_factory=dict)
    fields: dict[int, dict[str, str]] = field(default_factory=dict)
    values: list[tuple[int, int, str, str, str]] = field(default_factory=list)

    def of(self, index: int, key: str) -> str:
        """A field of a characteristic."""
        return self.fields.get(index, {}).get(key) or self.fields.get(0, {}).get(key, "")


def sniff(file: RawFile) -> bool:
    """Whether it begins with the number of characteristics."""
    return file.text.lstrip().startswith("K0100")


def _parsed(file: RawFile, faults: Faults) -> _Data:
    data, nth, whole = _Data(), dict[int, int](), 0
    for line, text in enumerate(file.lines, 1):
        match = _FIELD.fullmatch(text.strip(" \t"))
        count = len([index for index in data.fields if index])
        if match is None:
            # Compact: characteristics between 0x0F, fields between 0x14.
            cells = [cell.split("\x14") for cell in text.split("\x0f")] if text.strip() else []
            # Value, attribute and time: a record that was cut off has fewer than the first.
            whole = whole or min(3, max(map(len, cells), default=0))
            if cells and (min(map(len, cells)) < whole or (count and len(cells) != count)):
                expected = f"{count} characteristics of {whole} fields or more"
                faults.cell(line, "values", text, expected)
                continue
            for nth_cell, (value, *more) in enumerate(cells, 1):
                attribute, time, *_ = [*more, "", ""]
                data.values.append((line, nth_cell, value.strip(), attribute.strip(), time.strip()))
            continue
        key, index, value = match[1], int(match[2] or 0), match[3].strip()
        if key == "K0001":
            nth[index or 1] = len(data.values)
            data.values.append((line, index or 1, value, "0", ""))
        elif key in ("K0002", "K0004"):
            if (index or 1) not in nth:
                faults.cell(line, key, value, f"a K0001/{index or 1} before it")
                continue
            at = nth[index or 1]
            old = data.values[at]
            data.values[at] = (*old[:3], value, old[4]) if key == "K0002" else (*old[:4], value)
        elif key.startswith("K1"):
            data.part[key] = value
        else:
            data.fields.setdefault(index, {})[key] = value
    stated = next((value for key, value in data.fields.get(0, {}).items() if key == "K0100"), "")
    count = len([index for index in data.fields if index])
    if stated != str(count):
        facts = {"found": f"{count} characteristics", "expected": f"{stated}, as K0100 says"}
        faults.found.append(file.finding("wrong-count", **facts))
    return data


def read(file: RawFile, ask: Ask) -> Imported:
    """Values of characteristics named ``feature.X``: the n-th value of each is the n-th part."""
    found, faults = Imported(format="dfq", kind=POINTS), Faults(file)
    data = _parsed(file, faults)
    faults.raise_if_any()
    nominal = [fields.get("K2101", "") for fields in data.fields.values()]
    signs = decimals(file, [[*(value for _, _, value, _, _ in data.values), *nominal]], ask.decimal)
    parts: dict[tuple[int, str], tuple[int, dict[str, float]]] = {}
    seen = dict[int, int]()
    for line, index, text, attribute, _ in data.values:
        name = data.of(index, "K2002") or data.of(index, "K2001")
        match, unit = _AXIS.fullmatch(name), data.of(index, "K2142")
        nth = seen[index] = seen.get(index, 0) + 1
        value = number(text, signs[0])
        if index not in data.fields:
            faults.cell(line, "characteristic", str(index), f"one of {len(data.fields) - 1}")
        elif attribute in INVALID:
            found.drop("values with attribute 255 or 256, that is invalid")
        elif data.of(index, "K2004") == "1" or match is None or unit.lower() not in ("", "mm"):
            found.drop("values of characteristics that are no X, Y or Z in mm")
        elif value is None:
            faults.cell(line, name, text)
        else:
            at = parts.setdefault((nth, match[1]), (line, {}))[1]
            at[f"{match[2].lower()}_mm"] = value
            target = number(data.of(index, "K2101"), signs[0])
            if target is not None:
                at[f"nominal_{match[2].lower()}_mm"] = target
    faults.raise_if_any()
    for (nth, feature), (line, at) in parts.items():
        if {"x_mm", "y_mm"} <= at.keys():
            found.add(line, part=str(nth), feature=feature, **at)
        else:
            found.drop("features without X or Y")
    names = {"K1001": "part number", "K1002": "part name", "K1086": "operation"}
    found.facts = {names[key]: value for key, value in data.part.items() if key in names}
    found.facts["characteristics"] = [data.of(i, "K2002") for i in sorted(data.fields) if i]
    found.facts["values"] = len(data.values)
    if not found.rows and ask.kind == POINTS:
        expected = "characteristics named such as 'hole1.X' (K2002)"
        raise file.error("empty-file", what="values of X and Y", expected=expected)
    found.says = ["the n-th value of a characteristic is of the n-th part, in mm"]
    return found


FORMATS = (Format("dfq", "Q-DAS AQDEF", (POINTS,), sniff, read),)
