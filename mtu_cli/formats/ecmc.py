"""Positioning tests of ecmc (ESS, PSI): the ``.dat`` with TGT_DATA and REF_DATA, and the Markdown
report with its tables of reference positions.
"""

from __future__ import annotations

import re

from mtu_cli.formats.base import FORWARD, READINGS, REVERSE, Ask, Format, Imported, RawFile
from mtu_cli.formats.base import need_component as component_of
from mtu_cli.formats.grid import Faults, number, split

_ENTRY = re.compile(r"(TGT_DATA|REF_DATA_FWD|REF_DATA_BWD)\[(\d+)(?:,(\d+))?\]\s*=\s*(.*)")
_HEADING = re.compile(r"#+\s*Data (forward|backward) direction", re.I)
UNITS = ("mm", "deg")


def sniff(file: RawFile) -> bool:
    """Whether it has the entries of the data file, or the headings of the report."""
    return "REF_DATA_FWD[" in file.text or bool(
        re.search(r"ref_pos\(i,1\)", file.text) and _HEADING.search(file.text)
    )


def read(file: RawFile, ask: Ask) -> Imported:
    """Reference position minus target, as errors in the file's unit, each cycle a pass."""
    faults = Faults(file)
    as_data = "REF_DATA_FWD[" in file.text
    unit, targets, rows = (_data if as_data else _report)(file, faults)
    if unit not in UNITS:
        facts = {"what": "unit", "value": unit, "expected": "mm or deg"}
        faults.found.append(file.finding("unknown-name", **facts))
    component = component_of(file, ask)
    found = Imported(format="ecmc-iso230")
    for line, way, index, cycle, value in rows:
        if index not in targets:
            faults.cell(line, "TGT_DATA", str(index), "the index of a target")
            continue
        found.add(line, component=component, position_mm=targets[index], **{"pass": cycle},
                  direction=way, error=value - targets[index], unit=unit)  # fmt: skip
    stated = re.search(
        r"^CYCLES=(\d+)" if as_data else r"Cycle count\s*\|\s*(\d+)", file.text, re.M
    )
    cycles = {row[3] for row in rows}
    if stated and int(stated[1]) != len(cycles):
        facts = {"found": f"{len(cycles)} cycles", "expected": f"{stated[1]}, as the file says"}
        faults.found.append(file.finding("wrong-count", **facts))
    faults.raise_if_any()
    if not rows:
        raise file.error("empty-file", what="reference positions", expected="a whole file")
    found.says = [f"errors in {unit}: reference minus target", "directions as labelled"]
    if not as_data:
        found.doubts.append(
            "reports of this evaluator exchange the directions against their data file: read the "
            ".dat where there is one"
        )
    found.facts = {"targets": sorted(targets.values()), "runs": len(cycles), "unit": unit}
    return found


Rows = list[tuple[int, str, int, int, float]]
"""Line, direction, index of the target, cycle, position."""


def _data(file: RawFile, faults: Faults) -> tuple[str, dict[int, float], Rows]:
    unit, targets, rows = "mm", dict[int, float](), Rows()
    for line, text in enumerate(file.lines, 1):
        if text.startswith("UNIT="):
            unit = text[5:].strip()
        match = _ENTRY.match(text.strip())
        if match is None:
            if re.match(r"\s*(TGT|REF)_DATA", text):
                faults.cell(line, "data", text.strip(), "NAME[index]=number")
            continue
        value = number(match[4].strip(), ".")
        if value is None or (match[3] is None) != (match[1] == "TGT_DATA"):
            faults.cell(line, match[1], match[4].strip())
        elif match[3] is None:
            targets[int(match[2])] = value
        else:
            way = FORWARD if match[1].endswith("FWD") else REVERSE
            rows.append((line, way, int(match[2]), int(match[3]), value))
    return unit, targets, rows


def _report(file: RawFile, faults: Faults) -> tuple[str, dict[int, float], Rows]:
    stated = re.search(r"tgt_pos\(i\) \[([^\]]*)\]", file.text)
    targets, rows = dict[int, float](), Rows()
    way, header = "", 0
    for line, text in enumerate(file.lines, 1):
        if heading := _HEADING.match(text):
            way, header = (FORWARD if heading[1].lower() == "forward" else REVERSE), 0
        elif text.startswith("#"):
            way = ""
        elif way and "tgt_pos" in text and "|" in text:
            header = len(split(text, "|"))
        elif header and way and re.match(r"\s*\|?\s*\d+\s*\|", text):
            cells = split(text, "|")
            values = [number(cell, ".") for cell in cells]
            if len(cells) != header or None in values:
                faults.cell(line, "i | tgt_pos(i) | ref_pos(i,j)", text, f"{header} numbers")
                continue
            index, target, *positions = (value or 0.0 for value in values)
            targets[int(index)] = target
            rows += [(line, way, int(index), j, x) for j, x in enumerate(positions, 1)]
    return stated[1] if stated else "mm", targets, rows


FORMATS = (
    Format("ecmc-iso230", "ecmc positioning test (.dat or report)", (READINGS,), sniff, read),
)
