"""Renishaw: laser runs ``.rtl`` (targets mm, deviations um) and ``.rta`` (targets degrees or mm,
deviations mrad), whose sections end in ``::``, keys and blanks varying; the dynamic capture
``.rtx``, text above binary samples; the features of the ballbar's XML ``.b5r``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from mtu_cli.formats.base import Format, Import, RawFile, local
from mtu_cli.formats.grid import number

HEAD = 4000
"""Characters by which a file is recognised."""
UNITS = {"rtl": "um", "rta": "mrad"}
NO_SENSOR = -10.0
SHOWN = ("HEADER", "USER-TEXT", "ENVIRONMENT")
"""Sections whose entries `mtu inspect` shows as they stand."""
STATED = ("TEST_PLANE", "OPERATOR", "DATE_STARTED", "SERIAL_NUMBER", "LAST_CALIBRATED")
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
    head = file.text[:HEAD]
    match = re.search(r"File type\s*:\s*(rt[la])\b", head, re.IGNORECASE)
    if not re.search(r"^\s*HEADER\s*::", head, re.M) or not (match or "TARGET DATA" in head):
        return None
    name = match[1] if match else file.source.path.suffix[1:]
    return "rta" if name.lower() == "rta" else "rtl"


def _entries(lines: Lines) -> dict[str, tuple[int, str]]:
    """Line and text of each key, whose blanks and hyphens are one blank."""
    matches = ((row, _KEY.match(line)) for row, line in lines)
    return {
        re.sub(r"[\s-]+", " ", match[1]): (row, match[2].strip()) for row, match in matches if match
    }


def _deviations(result: Import, lines: Lines, targets: int) -> dict[tuple[int, int], Any]:
    """Line and deviation by run and index of the target, in the order of the file."""
    values: dict[tuple[int, int], tuple[int, float]] = {}
    for row, line in lines:
        cells = line.split()
        value = number(cells[-1], ".") if len(cells) == 3 else None
        if value is None or not (cells[0].isdecimal() and cells[1].isdecimal()):
            # "Run Target Data:" is the heading.
            if not line.strip().rstrip(":").strip().replace(" ", "").isalpha():
                result.bad_cell(row, "Run Target Data", line.strip(), "run, target and deviation")
            continue
        place = int(cells[0]), int(cells[1])
        if not 1 <= place[1] <= targets or place[0] < 1:
            result.bad_cell(row, "Target", cells[1], f"an index from 1 to {targets}")
        elif place in values:
            other = f"row {values[place][0]}: run {place[0]}, target {place[1]}"
            result.fault("copied-rows", row=row, other=other)
        else:
            values[place] = (row, value)
    return values


def read(result: Import) -> None:
    """Deviations as readings. Run numbers count each way: of a bidirectional file the odd ones go
    forward. The index of the target counts, never the order of the rows.
    """
    unit, sections, current = UNITS[result.format], dict[str, Lines](), Lines()
    for row, line in enumerate(result.file.lines, 1):
        if match := _SECTION.match(line):
            current = sections.setdefault(match[1], [])
        elif line.strip():
            current.append((row, line))
    for name in ("TARGET DATA", "DEVIATIONS", "EOF"):
        if name not in sections:
            expected = "a whole file: it may be cut off"
            result.fault("missing-input", what=f"the section {name}::", expected=expected)
    result.faults.raise_if_any()
    head = _entries(sections["TARGET DATA"] + sections.get("RUNS", []))
    # All numbers from ``Targets :`` to the next key, however they are wrapped and signed.
    targets, inside = list[float](), False
    for row, line in sections["TARGET DATA"]:
        heading = _KEY.match(line)
        inside = heading[1].lower().startswith("targets") if heading else inside
        for cell in (heading[2] if heading else line).split() if inside else ():
            if (value := number(cell, ".")) is None:
                result.bad_cell(row, "Targets", cell)
            else:
                targets.append(value)
    values = _deviations(result, sections["DEVIATIONS"], len(targets))
    runs = len({run for run, _ in values})
    for key, count, what in (("Target count", len(targets), "targets"),
                             ("Run count", runs, "runs with deviations")):  # fmt: skip
        row, stated = head.get(key, (0, str(count)))
        if stated != str(count):
            expected = f"{stated}, as {key} says"
            result.fault("wrong-count", row=row, found=f"{count} {what}", expected=expected)
    result.faults.raise_if_any()
    result.drop("deviations missing in the file", len(targets) * runs - len(values))
    one_way = head.get("Flags", (0, ""))[1].split()[1:2] == ["1"]
    even = [value for (run, _), (_, value) in values.items() if run % 2 == 0]
    padded = one_way and bool(even) and not any(even) and any(v for _, v in values.values())
    if padded:
        result.drop("zeros that fill reverse runs of a file flagged as one-way", len(even))
        result.doubts.append("reverse runs of zeros in a file that is flagged as one-way")
    result.add_readings(unit, (
        (row, targets[index - 1], (run + 1) // 2 if padded or not one_way else run,
         "forward" if one_way or run % 2 else "reverse", value)
        for (run, index), (row, value) in values.items() if run % 2 or not padded
    ))  # fmt: skip
    place = "mm" if result.format == "rtl" else "degrees or mm"
    result.says = [f"targets in {place}, deviations in {unit}",
                  "one-way runs" if one_way else "odd runs forward, even runs reverse"]  # fmt: skip
    entries = _entries([line for name in SHOWN for line in sections.get(name, [])])
    for name, (_, text) in entries.items():
        if name.startswith("Mat temp") and number(text.split(" ")[0], ".") == NO_SENSOR:
            result.drop("material sensors at -10 degC, that is not connected")
        elif text:
            result.facts[name] = text
    if "Exp coeff" in result.facts:
        result.says.append(
            f"the instrument's expansion coefficient is {result.facts['Exp coeff'].split()[0]} "
            "um/(m K): deviations are normally at 20 degC already (confirm; not corrected here)"
        )
    result.facts |= {"targets": targets, "runs": runs, "one_way": one_way}


def read_rtx(result: Import) -> None:
    """Header and extent of the samples, to be shown; raises InputError where bytes are missing."""
    import numpy as np

    file = result.file
    match = _SAMPLES.search(file.content)
    head = file.content[: match.start() if match else 0].decode("cp1252", "replace")
    header = _entries([*enumerate(head.splitlines(), 1)])
    text = header.get("Sample no", header.get("Sample number", (0, "")))[1]
    if match is None or not text.isdecimal():
        raise file.error("missing-input", what="Sample no and Data:", expected="a whole .rtx")
    count, body = int(text), file.content[match.end() :]
    if len(body) < 8 * count or not body[8 * count :].strip(b"\r\n").startswith(b"EOF"):
        facts = {"found": f"{len(body)} bytes of samples", "expected": f"{8 * count} and EOF::"}
        raise file.error("wrong-count", **facts)
    result.rows = [1] * count
    result.facts = {name: value for name, (_, value) in header.items() if 0 < len(value) < 80}
    if count:
        samples = np.frombuffer(body, "<f8", count)
        result.facts |= {"least": float(samples.min()), "largest": float(samples.max())}
    result.says = ["the order of day and month in Date is not known"]


def features_of(file: RawFile, planes: Sequence[str] = ()) -> dict[str, Any]:
    """Plane, machine and features of a ballbar file ``.b5r``: each `value` with its `unit`.

    Raises InputError where it has no feature, and for a plane that is none of the `planes` asked.
    """
    result, features = dict[str, Any](), dict[str, Any]()
    for element in file.xml.iter() if file.xml is not None else ():
        fields = {name.rpartition("}")[2].upper(): text for name, text in element.attrib.items()}
        children = ((local(child).upper(), (child.text or "").strip()) for child in element)
        fields |= {name: text for name, text in children if text}
        if local(element) == "FEATURE" and fields.get("NAME"):
            text = fields.get("VALUE") or (element.text or "").strip()
            value, unit = number(text, "."), FEATURE_UNITS.get(fields.get("DT", ""))
            if value is None or unit is None:
                raise file.error("wrong-type", path=fields["NAME"], kind="a value with a known DT",
                                 value=f"{text} {fields.get('DT', '')}")  # fmt: skip
            features[fields["NAME"]] = {"value": value, "unit": unit}
        elif local(element) in ("MACHINE_TESTED", "TEST_SPEC") and fields.get("NAME"):
            result.setdefault(local(element).lower(), fields["NAME"])
        result = {key.lower(): fields[key] for key in STATED if key in fields} | result
    if not features:
        raise file.error("empty-file", what="FEATURE with NAME, DT and value", expected="a .b5r")
    plane = result.get("test_plane")
    if plane and (others := {*planes} - {plane.upper()}):
        other = f"--plane {', '.join(sorted(others))}"
        raise file.error("contradicts", path="TEST_PLANE", value=plane, other=other)
    return {**result, "features": features}


def read_b5r(result: Import) -> None:
    """The features, to be shown: the elements of the raw samples are not documented."""
    result.facts = features_of(result.file)
    features = result.facts.pop("features")
    for name, item in features.items():
        result.facts[name] = f"{item['value']:g} {item['unit']}".strip()
    result.rows = [1] * len(features)
    result.says = ["A and B are first and second axis of the plane; raw samples are not read"]


def run_file(kind: str, columns: Mapping[str, Sequence[Any]]) -> bytes:
    """Readings of one component as a run file, six decimals: the grammar of `read`."""
    targets = sorted(set(columns["position_mm"]))
    one_way = set(columns["direction"]) == {"forward"}
    cells = (columns[name] for name in ("pass", "direction", "position_mm", "error"))
    rows = [
        (p if one_way else 2 * p - (way == "forward"), targets.index(x) + 1, value)
        for p, way, x, value in zip(*cells, strict=True)
    ]
    owner = "Linear" if kind == "rtl" else "Angular"
    lines = [
        *("HEADER::", f"File type  : {kind}", f"Owner      : {owner}", "Version no : 1"),
        *("TARGET DATA::", "Filetype  : ISO", f"Target-count: {len(targets)}", "Targets :"),
        *(" ".join(f"{x:.6f}" for x in targets[i : i + 5]) for i in range(0, len(targets), 5)),
        *(f"Flags: 0 {int(one_way)} 2 0", "USER-TEXT::", "RUNS::"),
        *(f"Run-count:{len({run for run, _, _ in rows})}", "DEVIATIONS::", "Run Target Data:"),
        *(f"  {run}   {index}    {value:.6f}" for run, index, value in rows),
        *("ENVIRONMENT::", "EOF::", ""),
    ]
    return "\r\n".join(lines).encode("cp1252")


FORMATS = (
    Format("rtl", "Renishaw linear run", "readings", lambda x: _kind(x) == "rtl", read),
    Format("rta", "Renishaw angular or rotary run", "readings", lambda x: _kind(x) == "rta", read),
    Format(
        "rtx", "Renishaw dynamic capture", "features",
        lambda x: b"CARTO-Dynamic" in x.content[:HEAD] or bool(
            b"Sample no" in x.content[:HEAD] and _SAMPLES.search(x.content[:HEAD])),
        read_rtx,
    ),
    Format(
        "b5r", "Renishaw ballbar, features", "features",
        lambda x: x.xml is not None and any(local(each) == "FEATURE" for each in x.xml.iter()),
        read_b5r,
    ),
)  # fmt: skip
