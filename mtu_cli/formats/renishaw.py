"""Renishaw: laser runs ``.rtl`` (targets mm, deviations um) and ``.rta`` (targets degrees or mm,
deviations mrad), whose sections end in ``::``, keys and blanks varying; the dynamic capture
``.rtx``, text above binary samples; the features of the ballbar's XML ``.b5r``.
"""

from __future__ import annotations

import re
import struct
from typing import Any

from mtu_cli.formats.base import (
    FORWARD,
    OTHER,
    READINGS,
    REVERSE,
    Ask,
    Format,
    Imported,
    RawFile,
    local,
    need_component,
)
from mtu_cli.formats.grid import Faults, number

UNITS = {"rtl": "um", "rta": "mrad"}
OWNERS = {"rtl": "Linear", "rta": "Angular"}
TARGET_UNITS = {"rtl": "mm", "rta": "degrees or mm"}
NO_SENSOR = -10.0
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
"""The instrument writes them in English whatever the computer's language."""
SHOWN = ("Machine", "Serial No", "Date", "By", "Axis", "Location", "TITLE", "Owner", "Version no")
ENVIRONMENT = {
    "Air temp": "air_degC", "Air press": "pressure_kPa", "Air humid": "humidity_percent",
    "Exp coeff": "expansion_um_per_m_K", "Env factor": "environment_factor",
    **{f"Mat temp {n}": f"material_{n}_degC" for n in (1, 2, 3)},
}  # fmt: skip
FEATURE_UNITS = {
    "UT_LENGTH_UM": "um", "UT_LENGTH_MM": "mm", "UT_LENGTH_M": "m", "UT_FEEDRATE": "mm/min",
    "UT_ANGLE": "deg", "UT_SQUARENESS": "um/m", "UT_SERVO_MISMATCH": "ms", "UT_RANKING": "",
    "UT_PERCENT": "%", "UT_SCALE_ERROR": "ppm", "UT_SPEED": "mm/s",
}  # fmt: skip
_SECTION = re.compile(r"\s*([A-Z][A-Z -]*[A-Z])\s*::\s*$")
_KEY = re.compile(r"\s*([A-Za-z][\w \-.]*?)\s*:(?!:)\s*(.*)$")
_SAMPLES = re.compile(rb"Data\s*:\s*\r?\n")
Lines = list[tuple[int, str]]
"""Numbered lines."""


def _kind(file: RawFile) -> str | None:
    """Rtl or rta; None of a file without the sections of a run."""
    found = re.search(r"File type\s*:\s*(rt[la])\b", file.head, re.IGNORECASE)
    if not re.search(r"^\s*HEADER\s*::", file.head, re.M) or not (
        found or "TARGET DATA" in file.head
    ):
        return None
    named = found[1] if found else file.source.path.suffix[1:]
    return "rta" if named.lower() == "rta" else "rtl"


def _entry(lines: Lines, *names: str) -> tuple[int, str] | None:
    """Line and text of a key, whatever its blanks and hyphens."""
    wanted = {re.sub(r"[\s-]", "", name).lower() for name in names}
    for row, line in lines:
        if (match := _KEY.match(line)) and re.sub(r"[\s-]", "", match[1]).lower() in wanted:
            return row, match[2].strip()
    return None


def _targets(lines: Lines, faults: Faults) -> list[float]:
    """All numbers from ``Targets :`` to the next key, however they are wrapped and signed."""
    result: list[float] = []
    inside = False
    for row, line in lines:
        if key := _KEY.match(line):
            inside, line = key[1].lower().startswith("targets"), key[2]
        for cell in line.split() if inside else ():
            value = number(cell, ".")
            if value is None:
                faults.cell(row, "Targets", cell)
            else:
                result.append(value)
    _check_count(lines, "Target-count", len(result), "targets", faults)
    return result


def _check_count(lines: Lines, key: str, count: int, what: str, faults: Faults) -> None:
    if (stated := _entry(lines, key)) and stated[1] != str(count):
        facts = {"found": f"{count} {what}", "expected": f"{stated[1]}, as {key} says"}
        faults.add(faults.file.finding("wrong-count", row=stated[0], **facts))


def _deviations(
    lines: Lines, targets: int, faults: Faults
) -> dict[tuple[int, int], tuple[int, float]]:
    """Line and deviation by run and index of the target, in the order of the file."""
    result: dict[tuple[int, int], tuple[int, float]] = {}
    for row, line in lines:
        cells = line.split()
        value = number(cells[-1], ".") if len(cells) == 3 else None
        if value is None or not (cells[0].isdecimal() and cells[1].isdecimal()):
            # "Run Target Data:" is the heading.
            if not line.strip().rstrip(":").strip().replace(" ", "").isalpha():
                faults.cell(row, "Run Target Data", line.strip(), "run, target and deviation")
            continue
        place = int(cells[0]), int(cells[1])
        if not 1 <= place[1] <= targets or place[0] < 1:
            faults.cell(row, "Target", cells[1], f"an index from 1 to {targets}")
        elif place in result:
            other = f"row {result[place][0]}: run {place[0]}, target {place[1]}"
            faults.add(faults.file.finding("copied-rows", row=row, other=other))
        else:
            result[place] = (row, value)
    return result


def read(file: RawFile, ask: Ask) -> Imported:
    """Deviations as readings. Run numbers count each way: of a bidirectional file the odd ones go
    forward. The index of the target counts, never the order of the rows.
    """
    kind, sections, faults = _kind(file) or "rtl", dict[str, Lines](), Faults(file)
    current = Lines()
    for row, line in enumerate(file.lines, 1):
        if match := _SECTION.match(line):
            current = sections.setdefault(match[1], [])
        elif line.strip():
            current.append((row, line))
    for name in ("TARGET DATA", "DEVIATIONS", "EOF"):
        if name not in sections:
            facts = {"what": f"the section {name}::", "expected": "a whole file: it may be cut off"}
            faults.add(file.finding("missing-input", **facts))
    faults.raise_if_any()
    targets = _targets(sections["TARGET DATA"], faults)
    values = _deviations(sections["DEVIATIONS"], len(targets), faults)
    runs = len({run for run, _ in values})
    _check_count(sections.get("RUNS", []), "Run-count", runs, "runs with deviations", faults)
    faults.raise_if_any()
    if not values:
        raise file.error("empty-file", what="deviations", expected="rows below DEVIATIONS::")
    result = Imported(format=kind)
    flags = (_entry(sections["TARGET DATA"], "Flags") or (0, ""))[1].split()
    one_way = flags[1:2] == ["1"]
    even = [value for (run, _), (_, value) in values.items() if run % 2 == 0]
    padded = one_way and bool(even) and not any(even) and any(v for _, v in values.values())
    if padded:
        result.drop("zeros that fill reverse runs of a file flagged as one-way", len(even))
        result.doubts.append("reverse runs of zeros in a file that is flagged as one-way")
    component, pairs = need_component(file, ask), padded or not one_way
    for (run, index), (row, value) in values.items():
        if padded and run % 2 == 0:
            continue
        result.add(
            row,
            component=component,
            position_mm=targets[index - 1],
            **{"pass": (run + 1) // 2 if pairs else run},
            direction=FORWARD if one_way or run % 2 else REVERSE,
            error=value,
            unit=UNITS[kind],
        )
    result.says = [f"targets in {TARGET_UNITS[kind]}, deviations in {UNITS[kind]}",
                  "one-way runs" if one_way else "odd runs forward, even runs reverse"]  # fmt: skip
    result.facts = _facts(result, sections)
    result.facts |= {"targets": targets, "runs": runs, "one_way": one_way}
    return result


def _facts(found: Imported, sections: dict[str, Lines]) -> dict[str, Any]:
    """The header and the environment; a sensor at -10 is not connected."""
    header = sections.get("HEADER", []) + sections.get("USER-TEXT", [])
    around = sections.get("ENVIRONMENT", [])
    facts: dict[str, Any] = {
        name.lower().replace(" ", "_"): entry[1]
        for name in SHOWN
        if (entry := _entry(header, name)) and entry[1]
    }
    for name, key in ENVIRONMENT.items():
        entry = _entry(around, name)
        values = [number(cell, ".") for cell in entry[1].split()[:2]] if entry else []
        if name.startswith("Mat") and values and values[0] == NO_SENSOR:
            found.drop("material sensors at -10 degC, that is not connected")
        elif values and None not in values:
            facts[key] = values
    if entry := _entry(around, "Date Time"):
        times = map(_time, re.findall(r'"([^"]*)"', entry[1]))
        facts["measured"] = [time for time in times if time]
    if "expansion_um_per_m_K" in facts:
        found.says.append(
            f"the instrument's expansion coefficient is {facts['expansion_um_per_m_K'][0]:g} "
            "um/(m K): deviations are normally at 20 degC already (confirm; not corrected here)"
        )
    return facts


def _time(text: str) -> str | None:
    """An instrument's time as ISO 8601: ``10:46 Dec 12 2016``."""
    match = re.fullmatch(r"\s*(\d\d?):(\d\d)\s+([A-Za-z]{3})\w*\s+(\d\d?)\s+(\d{4})\s*", text)
    if not match or match[3].title() not in MONTHS:
        return None
    month = MONTHS.index(match[3].title()) + 1
    return f"{match[5]}-{month:02}-{int(match[4]):02}T{int(match[1]):02}:{match[2]}"


def read_rtx(file: RawFile, ask: Ask) -> Imported:
    """Header and extent of the samples, to be shown; raises InputError where bytes are missing."""
    match = _SAMPLES.search(file.content)
    head = file.content[: match.start() if match else 0].decode("cp1252", "replace")
    pairs = (line.partition(":") for line in head.splitlines() if ":" in line)
    header = {name.strip(): value.strip() for name, _, value in pairs}
    text = header.get("Sample no", header.get("Sample number", ""))
    if match is None or not text.isdecimal():
        raise file.error("missing-input", what="Sample no and Data:", expected="a whole .rtx")
    count, body = int(text), file.content[match.end() :]
    if len(body) < 8 * count or not body[8 * count :].strip(b"\r\n").startswith(b"EOF"):
        facts = {"found": f"{len(body)} bytes of samples", "expected": f"{8 * count} and EOF::"}
        raise file.error("wrong-count", **facts)
    samples = struct.unpack(f"<{count}d", body[: 8 * count])
    result = Imported(format="rtx", kind=OTHER, rows=[1] * count)
    result.facts = {name: value for name, value in header.items() if value and len(value) < 80}
    if samples:
        result.facts |= {"least": min(samples), "largest": max(samples)}
    result.says = ["the order of day and month in Date is not known"]
    return result


def _is_rtx(file: RawFile) -> bool:
    head = file.content[:4000]
    return b"CARTO-Dynamic" in head or (b"Sample no" in head and bool(_SAMPLES.search(head)))


def features_of(file: RawFile) -> dict[str, Any]:
    """Plane, machine and features of a ballbar file ``.b5r``: each `value` with its `unit`.

    Raises InputError where it has no feature.
    """
    result, features = dict[str, Any](), dict[str, Any]()
    for element in file.xml.iter() if file.xml is not None else ():
        name = local(element.tag) if isinstance(element.tag, str) else ""
        known = {local(key).upper(): value for key, value in element.attrib.items()}
        texts = {each.tag: (each.text or "").strip() for each in element}
        known |= {
            local(tag).upper(): text for tag, text in texts.items() if text and tag == str(tag)
        }
        if name == "FEATURE" and known.get("NAME"):
            text = known.get("VALUE") or (element.text or "").strip()
            value, unit = number(text, "."), FEATURE_UNITS.get(known.get("DT", ""))
            if value is None or unit is None:
                raise file.error("wrong-type", path=known["NAME"], kind="a value with a known DT",
                                 value=f"{text} {known.get('DT', '')}")  # fmt: skip
            features[known["NAME"]] = {"value": value, "unit": unit}
        for key in ("TEST_PLANE", "OPERATOR", "DATE_STARTED", "SERIAL_NUMBER", "LAST_CALIBRATED"):
            if key in known:
                result.setdefault(key.lower(), known[key])
        if name in ("MACHINE_TESTED", "TEST_SPEC") and known.get("NAME"):
            result.setdefault(name.lower(), known["NAME"])
    if not features:
        raise file.error("empty-file", what="FEATURE with NAME, DT and value", expected="a .b5r")
    return {**result, "features": features}


def read_b5r(file: RawFile, ask: Ask) -> Imported:
    """The features, to be shown: the elements of the raw samples are not documented."""
    known = features_of(file)
    features = known.pop("features")
    result = Imported(format="b5r", kind=OTHER, rows=[1] * len(features))
    shown = {name: f"{each['value']:g} {each['unit']}".strip() for name, each in features.items()}
    result.facts = known | shown
    result.says = ["A and B are first and second axis of the plane; raw samples are not read"]
    return result


def _is_b5r(file: RawFile) -> bool:
    return file.xml is not None and any(
        isinstance(each.tag, str) and local(each.tag) == "FEATURE" for each in file.xml.iter()
    )


def run_file(data: Imported) -> bytes:
    """Readings of one component as a run file, six decimals: the grammar of `read`."""
    columns = data.columns
    targets = sorted(set(columns["position_mm"]))
    one_way = set(columns["direction"]) == {FORWARD}
    cells = (columns[name] for name in ("pass", "direction", "position_mm", "error"))
    rows = [
        (p if one_way else 2 * p - (way == FORWARD), targets.index(x) + 1, value)
        for p, way, x, value in zip(*cells, strict=True)
    ]
    kind = data.format
    lines = ["HEADER::", f"File type  : {kind}", f"Owner      : {OWNERS[kind]}",
             "Version no : 1", "TARGET DATA::", "Filetype  : ISO", f"Target-count: {len(targets)}",
             "Targets :"]  # fmt: skip
    lines += [" ".join(f"{x:.6f}" for x in targets[i : i + 5]) for i in range(0, len(targets), 5)]
    lines += [f"Flags: 0 {int(one_way)} 2 0", "USER-TEXT::", "RUNS::",
              f"Run-count:{len({run for run, _, _ in rows})}", "DEVIATIONS::",
              "Run Target Data:"]  # fmt: skip
    lines += [f"  {run}   {index}    {value:.6f}" for run, index, value in rows]
    return "\r\n".join([*lines, "ENVIRONMENT::", "EOF::", ""]).encode("cp1252")


FORMATS = (
    Format("rtl", "Renishaw linear run", (READINGS,), lambda f: _kind(f) == "rtl", read),
    Format("rta", "Renishaw angular or rotary run", (READINGS,), lambda f: _kind(f) == "rta", read),
    Format("rtx", "Renishaw dynamic capture", (OTHER,), _is_rtx, read_rtx),
    Format("b5r", "Renishaw ballbar, features", (OTHER,), _is_b5r, read_b5r),
)
