"""Q-DAS AQDEF ``.dfq`` (ISO/TR 11462-5): characteristics with K fields, values compact or long."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from mtu_cli.formats.base import POINTS, Ask, Format, Imported, RawFile
from mtu_cli.formats.grid import Faults
from mtu_cli.formats.points import OF_AXIS, Coordinate, collect

INVALID = ("255", "256")
"""Attributes of a value that does not count."""
_FIELD = re.compile(r"(K\d{4})(?:/(\d+))?[ \t]+(.*)")


@dataclass
class _Data:
    """Fields of each characteristic (0: of all, and of the part), and values: line, characteristic,
    text, attribute.
    """

    fields: dict[int, dict[str, str]] = field(default_factory=dict)
    values: list[tuple[int, int, str, str]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Of characteristics."""
        return sum(1 for index in self.fields if index)

    def of(self, index: int, key: str) -> str:
        """A field of a characteristic."""
        return self.fields.get(index, {}).get(key) or self.fields.get(0, {}).get(key, "")


def _parsed(file: RawFile, faults: Faults) -> _Data:
    data, last, whole = _Data(), dict[int, int](), 0
    for line, text in enumerate(file.lines, 1):
        match = _FIELD.fullmatch(text.strip(" \t"))
        if match is None:
            # Compact: characteristics between 0x0F, fields between 0x14.
            cells = [cell.split("\x14") for cell in text.split("\x0f")] if text.strip() else []
            # Value, attribute and time: a record that was cut off has fewer than the first.
            whole = whole or min(3, max(map(len, cells), default=0))
            if cells and (min(map(len, cells)) < whole or len(cells) != (data.count or len(cells))):
                expected = f"{data.count} characteristics of {whole} fields or more"
                faults.cell(line, "values", text, expected)
                continue
            for i, (value, *more) in enumerate(cells, 1):
                data.values.append((line, i, value.strip(), more[0].strip() if more else ""))
            continue
        key, index, value = match[1], int(match[2] or 0), match[3].strip()
        if key == "K0001":
            last[index or 1] = len(data.values)
            data.values.append((line, index or 1, value, "0"))
        elif key in ("K0002", "K0004") and (index or 1) not in last:
            faults.cell(line, key, value, f"a K0001/{index or 1} before it")
        elif key == "K0002":
            at = last[index or 1]
            data.values[at] = (*data.values[at][:3], value)
        elif key != "K0004":
            data.fields.setdefault(0 if key.startswith("K1") else index, {})[key] = value
    stated = data.of(0, "K0100")
    if stated != str(data.count):
        facts = {"found": f"{data.count} characteristics", "expected": f"{stated}, as K0100 says"}
        faults.add(file.finding("wrong-count", **facts))
    return data


def read(file: RawFile, ask: Ask) -> Imported:
    """Values of characteristics named ``feature.X``: the n-th value of each is the n-th part."""
    result, faults = Imported(format="dfq", kind=POINTS), Faults(file)
    data = _parsed(file, faults)
    faults.raise_if_any()
    coordinates, seen = list[Coordinate](), dict[int, int]()
    for line, index, text, attribute in data.values:
        match = OF_AXIS.fullmatch(data.of(index, "K2002") or data.of(index, "K2001"))
        feature = match[1].rstrip(" ._-:") if match else ""
        seen[index] = seen.get(index, 0) + 1
        other = data.of(index, "K2004") == "1" or data.of(index, "K2142").lower() not in ("", "mm")
        if index not in data.fields:
            faults.cell(line, "characteristic", str(index), f"one of {data.count}")
        elif attribute in INVALID:
            result.drop("values with attribute 255 or 256, that is invalid")
        elif other or match is None or not feature:
            result.drop("values of characteristics that are no X, Y or Z in mm")
        else:
            own = (match[2].lower(), text, data.of(index, "K2101"))
            coordinates.append(Coordinate(line, str(seen[index]), feature, *own))
    collect(file, ask, result, coordinates, faults)
    result.facts = {"characteristics": [data.of(i, "K2002") for i in sorted(data.fields) if i]}
    result.says = ["the n-th value of a characteristic is of the n-th part, in mm"]
    return result


FORMATS = (
    Format("dfq", "Q-DAS AQDEF", (POINTS,), lambda file: file.text.lstrip().startswith("K0100"),
           read),
)  # fmt: skip
