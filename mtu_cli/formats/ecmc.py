"""Positioning tests of ecmc (ESS, PSI): the ``.dat`` with TGT_DATA and REF_DATA, and the Markdown
report with its tables of reference positions.
"""

from __future__ import annotations

import re

from mtu_cli.formats.base import Format, Import, RawFile
from mtu_cli.formats.grid import number, split

_ENTRY = re.compile(r"(TGT_DATA|REF_DATA_FWD|REF_DATA_BWD)\[(\d+)(?:,(\d+))?\]\s*=\s*(.*)")
_HEADING = re.compile(r"#+\s*Data (forward|backward) direction", re.I)
_UNIT = re.compile(r"^UNIT=(.*)$|tgt_pos\(i\) \[([^\]]*)\]", re.M)
_CYCLES = re.compile(r"^CYCLES=(\d+)|Cycle count\s*\|\s*(\d+)", re.M)
_POSITIONS = re.compile(r"^POSITIONS=(\d+)|Position count\s*\|\s*(\d+)", re.M)
Rows = list[tuple[int, str, int, int, float]]
"""Line, direction, index of the target, cycle, position."""


def sniff(file: RawFile) -> bool:
    """Whether it has the entries of the data file, or the headings of the report."""
    return "REF_DATA_FWD[" in file.text or bool(
        re.search(r"ref_pos\(i,1\)", file.text) and _HEADING.search(file.text)
    )


def read(result: Import) -> None:
    """Reference position minus target, as errors in the file's unit, each cycle a pass."""
    file, as_data = result.file, "REF_DATA_FWD[" in result.file.text
    targets, rows = (_data if as_data else _report)(result)
    unit, cycles, places = (
        next((text.strip() for text in match.groups() if text), "") if match else default
        for match, default in (
            (_UNIT.search(file.text), "mm"),
            (_CYCLES.search(file.text), ""),
            (_POSITIONS.search(file.text), str(len(targets))),
        )
    )
    if unit not in ("mm", "deg"):
        result.fault("unknown-name", what="unit", value=unit, expected="mm or deg")
    for line, _, index, *_ in rows:
        if index not in targets:
            result.bad_cell(line, "TGT_DATA", str(index), "the index of a target")
    runs = len({row[3] for row in rows})
    if cycles and len(rows) != (size := 2 * int(places) * int(cycles)):
        # A file that is cut off lacks its last readings: reverse ones.
        counts = f"{len(rows)} readings of {len(targets)} positions in {runs} cycles"
        expected = f"{size}: {places} positions, {cycles} cycles, both directions, as the file says"
        result.fault("wrong-count", found=counts, expected=expected)
    result.faults.raise_if_any()
    errors = [(line, targets[index], cycle, way, value - targets[index])
              for line, way, index, cycle, value in rows]  # fmt: skip
    result.add_readings(unit, errors)
    result.says = [f"errors in {unit}: reference minus target", "directions as labelled"]
    if not as_data:
        result.doubts.append(
            "reports of this evaluator exchange the directions against their data file: read the "
            ".dat where there is one"
        )
    result.facts = {"targets": sorted(targets.values()), "runs": runs, "unit": unit}


def _data(result: Import) -> tuple[dict[int, float], Rows]:
    targets, rows = dict[int, float](), Rows()
    for line, text in enumerate(map(str.strip, result.file.lines), 1):
        match = _ENTRY.match(text)
        if match is None:
            if text.startswith(("TGT_DATA", "REF_DATA")):
                result.bad_cell(line, "data", text, "NAME[index]=number")
            continue
        name, index, cycle, cell = match.groups()
        value = number(cell, ".")
        if value is None or (cycle is None) != (name == "TGT_DATA"):
            result.bad_cell(line, name, cell)
        elif cycle is None:
            targets[int(index)] = value
        else:
            way = "forward" if name.endswith("FWD") else "reverse"
            rows.append((line, way, int(index), int(cycle), value))
    return targets, rows


def _report(result: Import) -> tuple[dict[int, float], Rows]:
    targets, rows = dict[int, float](), Rows()
    way, header = "", 0
    for line, text in enumerate(result.file.lines, 1):
        if text.startswith("#"):
            heading, header = _HEADING.match(text), 0
            way = {"f": "forward", "b": "reverse"}[heading[1][0].lower()] if heading else ""
        elif way and "tgt_pos" in text and "|" in text:
            header = len(split(text, "|"))
        elif header and re.match(r"\s*\|?\s*\d+\s*\|", text):
            values = [number(cell, ".") for cell in split(text, "|")]
            if len(values) != header or None in values:
                result.bad_cell(line, "i | tgt_pos(i) | ref_pos(i,j)", text, f"{header} numbers")
                continue
            index, target, *positions = (value or 0.0 for value in values)
            targets[int(index)] = target
            rows += [(line, way, int(index), j, x) for j, x in enumerate(positions, 1)]
    return targets, rows


FORMATS = (
    Format("ecmc-iso230", "ecmc positioning test (.dat or report)", "readings", sniff, read),
)
