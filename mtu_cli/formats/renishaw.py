"""Renishaw laser runs: linear ``.rtl`` (targets mm, deviations um) and angular ``.rta``
(targets degrees or mm, deviations mrad). Sections end in ``::``; keys and blanks vary.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from mtu_cli.formats.base import FORWARD, READINGS, REVERSE, Ask, Format, Imported, RawFile
from mtu_cli.formats.base import need_component as component_of
from mtu_cli.formats.grid import Faults, number

UNITS = {"rtl": "um", "rta": "mrad"}
TARGET_UNITS = {"rtl": "mm", "rta": "degrees or mm"}
NO_SENSOR = -10.0
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
"""The instrument writes them in English whatever the computer's language."""
_SECTION = re.compile(r"\s*([A-Z][A-Z -]*[A-Z])\s*::\s*$")
_KEY = re.compile(r"\s*([A-Za-z][\w \-.]*?)\s*:(?!:)\s*(.*)$")
_SHOWN = ("Machine", "Serial No", "Date", "By", "Axis", "Location", "TITLE", "Owner", "Version no")


def sniff(file: RawFile) -> bool:
    """Whether it has the sections of a run."""
    head = file.head
    kinds = re.search(r"File type\s*:\s*rt[la]\b", head, re.IGNORECASE)
    return bool(re.search(r"^\s*HEADER\s*::", head, re.M) and (kinds or "TARGET DATA" in head))


def _kind(file: RawFile) -> str:
    found = re.search(r"File type\s*:\s*(rt[la])\b", file.head, re.IGNORECASE)
    named = found[1] if found else file.source.path.suffix[1:]
    return "rta" if named.lower() == "rta" else "rtl"


def _sections(file: RawFile) -> dict[str, list[tuple[int, str]]]:
    """The numbered lines of each section."""
    found: dict[str, list[tuple[int, str]]] = {}
    current: list[tuple[int, str]] = []
    for row, line in enumerate(file.lines, 1):
        if match := _SECTION.match(line):
            current = found.setdefault(match[1], [])
        elif line.strip():
            current.append((row, line))
    return found


def _entry(lines: Iterable[tuple[int, str]], *names: str) -> tuple[int, str] | None:
    """Line and text of a key, whatever its blanks and hyphens."""
    wanted = {re.sub(r"[\s-]", "", name).lower() for name in names}
    for row, line in lines:
        if (match := _KEY.match(line)) and re.sub(r"[\s-]", "", match[1]).lower() in wanted:
            return row, match[2].strip()
    return None


def _targets(file: RawFile, lines: list[tuple[int, str]], faults: Faults) -> list[float]:
    """All numbers from ``Targets :`` to the next key, however they are wrapped and signed."""
    found: list[float] = []
    inside = False
    for row, line in lines:
        key = _KEY.match(line)
        if key and not key[1].lower().startswith("targets"):
            inside = False
        elif key:
            inside, line = True, key[2]
        for cell in line.split() if inside else ():
            value = number(cell, ".")
            if value is None:
                faults.cell(row, "Targets", cell)
            else:
                found.append(value)
    if (count := _entry(lines, "Target-count")) and count[1] != str(len(found)):
        facts = {"found": f"{len(found)} targets", "expected": f"{count[1]}, as Target-count says"}
        faults.found.append(file.finding("wrong-count", row=count[0], **facts))
    return found


def read(file: RawFile, ask: Ask) -> Imported:
    """Deviations as readings. Run numbers count each way: of a bidirectional file the odd ones go
    forward. The index of the target counts, never the order of the rows.
    """
    kind, sections, faults = _kind(file), _sections(file), Faults(file)
    for name in ("TARGET DATA", "DEVIATIONS", "EOF"):
        if name not in sections:
            facts = {"what": f"the section {name}::", "expected": "a whole file: it may be cut off"}
            faults.found.append(file.finding("missing-input", **facts))
    faults.raise_if_any()
    targets = _targets(file, sections["TARGET DATA"], faults)
    rows = _deviations(sections["DEVIATIONS"], len(targets), faults)
    runs = sorted({run for _, run, _, _ in rows})
    if (count := _entry(sections.get("RUNS", []), "Run-count")) and count[1] != str(len(runs)):
        facts = {"found": f"deviations of {len(runs)} runs", "expected": f"{count[1]} (Run-count)"}
        faults.found.append(file.finding("wrong-count", row=count[0], **facts))
    faults.raise_if_any()
    if not rows:
        raise file.error("empty-file", what="deviations", expected="rows below DEVIATIONS::")
    found = Imported(format=kind)
    flags = _entry(sections["TARGET DATA"], "Flags")
    values = flags[1].split() if flags else []
    one_way = len(values) > 1 and values[1] == "1"
    padded = one_way and _padded(rows)
    if padded:
        zeros = sum(run % 2 == 0 for _, run, _, _ in rows)
        found.drop("zeros that fill reverse runs of a file flagged as one-way", zeros)
        found.doubts.append("reverse runs of zeros in a file that is flagged as one-way")
    component = component_of(file, ask)
    for row, run, index, value in rows:
        if padded and run % 2 == 0:
            continue
        pairs = padded or not one_way
        found.add(
            row,
            component=component,
            position_mm=targets[index - 1],
            **{"pass": (run + 1) // 2 if pairs else run},
            direction=FORWARD if one_way or run % 2 else REVERSE,
            error=value,
            unit=UNITS[kind],
        )
    _describe(found, sections, targets, len(runs), one_way)
    found.says[:0] = [
        f"targets in {TARGET_UNITS[kind]}, deviations in {UNITS[kind]}",
        "one-way runs" if one_way else "odd runs forward, even runs reverse",
    ]
    return found


def _deviations(
    lines: list[tuple[int, str]], targets: int, faults: Faults
) -> list[tuple[int, int, int, float]]:
    """Line, run, index of the target, and deviation of each row."""
    found, seen = [], dict[tuple[int, int], int]()
    for row, line in lines:
        if not re.match(r"\s*[+-]?[\d.]", line):
            if not line.strip().rstrip(":").strip().replace(" ", "").isalpha():
                faults.cell(row, "Run Target Data", line.strip(), "run, target and deviation")
            continue
        cells = line.split()
        value = number(cells[-1], ".") if len(cells) == 3 else None
        if value is None or not (cells[0].isdecimal() and cells[1].isdecimal()):
            faults.cell(row, "Run Target Data", line.strip(), "run, target and deviation")
            continue
        run, index = int(cells[0]), int(cells[1])
        if not 1 <= index <= targets or run < 1:
            faults.cell(row, "Target", cells[1], f"an index from 1 to {targets}")
        elif (run, index) in seen:
            other = f"row {seen[run, index]}: run {run}, target {index}"
            faults.found.append(faults.file.finding("copied-rows", row=row, other=other))
        else:
            seen[run, index] = row
            found.append((row, run, index, value))
    return found


def _padded(rows: list[tuple[int, int, int, float]]) -> bool:
    even = [value for _, run, _, value in rows if run % 2 == 0]
    odd = [value for _, run, _, value in rows if run % 2]
    return bool(even) and not any(even) and any(odd)


def _describe(
    found: Imported, sections: dict[str, list[tuple[int, str]]], targets: list[float], runs: int,
    one_way: bool,
) -> None:  # fmt: skip
    """Facts of the header and the environment; a sensor at -10 is not connected."""
    header = [item for name in ("HEADER", "USER-TEXT") for item in sections.get(name, [])]
    facts: dict[str, Any] = {
        name.lower().replace(" ", "_"): entry[1]
        for name in _SHOWN
        if (entry := _entry(header, name)) and entry[1]
    }
    facts |= {"targets": targets, "runs": runs, "one_way": one_way}
    names = {"Air temp": "air_degC", "Air press": "pressure_kPa", "Air humid": "humidity_percent",
             "Exp coeff": "expansion_um_per_m_K", "Env factor": "environment_factor"}  # fmt: skip
    names |= {f"Mat temp {n}": f"material_{n}_degC" for n in (1, 2, 3)}
    for name, key in names.items():
        entry = _entry(sections.get("ENVIRONMENT", []), name)
        values = [number(cell, ".") for cell in entry[1].split()[:2]] if entry else []
        if name.startswith("Mat") and values and values[0] == NO_SENSOR:
            found.drop("material sensors at -10 degC, that is not connected")
        elif values and None not in values:
            facts[key] = values
    if entry := _entry(sections.get("ENVIRONMENT", []), "Date Time"):
        facts["measured"] = [time for text in re.findall(r'"([^"]*)"', entry[1])
                             if (time := _time(text))]  # fmt: skip
    if "expansion_um_per_m_K" in facts:
        found.says.append(
            f"the instrument's expansion coefficient is {facts['expansion_um_per_m_K'][0]:g} "
            "um/(m K): deviations are normally at 20 degC already (confirm; not corrected here)"
        )
    found.facts = facts


def _time(text: str) -> str | None:
    """An instrument's time as ISO 8601: ``10:46 Dec 12 2016``."""
    match = re.fullmatch(r"\s*(\d\d?):(\d\d)\s+([A-Za-z]{3})\w*\s+(\d\d?)\s+(\d{4})\s*", text)
    if not match or match[3].title() not in MONTHS:
        return None
    month = MONTHS.index(match[3].title()) + 1
    return f"{match[5]}-{month:02}-{int(match[4]):02}T{int(match[1]):02}:{match[2]}"


def write(data: Imported) -> bytes:
    """Readings of one component as a run file, six decimals: the grammar of `read`."""
    columns = data.columns
    targets = sorted(set(columns["position_mm"]))
    ways, passes = columns["direction"], columns["pass"]
    one_way = set(ways) == {FORWARD}
    rows = [
        (p if one_way else 2 * p - (way == FORWARD), targets.index(x) + 1, value)
        for p, way, x, value in zip(
            passes, ways, columns["position_mm"], columns["error"], strict=True
        )
    ]
    kind = data.format
    owner = {"rtl": "Linear", "rta": "Angular"}[kind]
    lines = ["HEADER::", f"File type  : {kind}", f"Owner      : {owner}", "Version no : 1",
             "TARGET DATA::", "Filetype  : ISO", f"Target-count: {len(targets)}",
             "Targets :"]  # fmt: skip
    lines += [" ".join(f"{x:.6f}" for x in targets[i : i + 5]) for i in range(0, len(targets), 5)]
    lines += [f"Flags: 0 {int(one_way)} 2 0", "USER-TEXT::", "RUNS::",
              f"Run-count:{len({run for run, _, _ in rows})}", "DEVIATIONS::",
              "Run Target Data:"]  # fmt: skip
    lines += [f"  {run}   {index}    {value:.6f}" for run, index, value in rows]
    return "\r\n".join([*lines, "ENVIRONMENT::", "EOF::", ""]).encode("cp1252")


FORMATS = (
    Format("rtl", "Renishaw linear run", (READINGS,), lambda f: sniff(f) and _kind(f) == "rtl",
           read, write),
    Format("rta", "Renishaw angular or rotary run", (READINGS,),
           lambda f: sniff(f) and _kind(f) == "rta", read, write),
)  # fmt: skip
