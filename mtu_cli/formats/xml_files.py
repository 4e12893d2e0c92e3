"""XML of instruments: QIF results (2.x, 3.0), and the features of Renishaw's ballbar ``.b5r``; and
the dynamic capture ``.rtx``, text above binary samples.
"""

from __future__ import annotations

import re
import struct
from typing import Any
from xml.etree.ElementTree import Element

from mtu_cli.formats.base import OTHER, POINTS, Ask, Format, Imported, RawFile, local
from mtu_cli.formats.grid import number
from mtu_cli.formats.text_blocks import add_points

UNIT_OF = {"UT_LENGTH_UM": "um", "UT_LENGTH_MM": "mm", "UT_LENGTH_M": "m",
           "UT_FEEDRATE": "mm/min", "UT_ANGLE": "deg", "UT_SQUARENESS": "um/m",
           "UT_SERVO_MISMATCH": "ms", "UT_RANKING": "", "UT_PERCENT": "%",
           "UT_SCALE_ERROR": "ppm", "UT_SPEED": "mm/s"}  # fmt: skip
_SAMPLES = re.compile(rb"Data\s*:\s*\r?\n")


def _elements(element: Element) -> list[Element]:
    """An element and all beneath it, without comments."""
    return [each for each in element.iter() if isinstance(each.tag, str)]


def _under(element: Element, name: str) -> list[Element]:
    return [each for each in _elements(element) if local(each.tag) == name]


def _text(element: Element, name: str) -> str:
    return next(((each.text or "").strip() for each in element if local(each.tag) == name), "")


def _is_qif(file: RawFile) -> bool:
    return "QIFDocument" in file.head and file.xml is not None


def read_qif(file: RawFile, ask: Ask) -> Imported:
    """Locations of measured features in mm, joined by id to their items; statuses are counted."""
    root = file.xml
    assert root is not None
    factor = 1.0
    for unit in _under(root, "LinearUnit")[:1]:
        factors = [number((each.text or "").strip(), ".") for each in _under(unit, "Factor")]
        metre = _text(unit, "UnitName").lower() in ("m", "meter", "metre")
        known = [each for each in factors if each]
        factor = 1000.0 * known[0] if known else 1000.0 if metre else 1.0
    names = {each.get("id", ""): _text(each, "FeatureName") or each.get("id", "")
             for each in root.iter() if isinstance(each.tag, str)
             and local(each.tag).endswith("FeatureItem")}  # fmt: skip
    found, left = Imported(format="qif", kind=POINTS), 0
    for number_of, results in enumerate(_under(root, "MeasurementResults"), 1):
        points: dict[str, tuple[int, dict[str, float]]] = {}
        for actual in results.iter():
            if not isinstance(actual.tag, str) or not local(actual.tag).endswith("FeatureActual"):
                continue
            cells = [number(cell, ".") for cell in _text(actual, "Location").split()]
            item = _text(actual, "FeatureItemId")
            if len(cells) != 3 or None in cells:
                left += 1
                continue
            places = zip(("x_mm", "y_mm", "z_mm"), cells, strict=True)
            points[names.get(item) or item or str(len(points) + 1)] = (
                1,
                {name: (value or 0.0) * factor for name, value in places},
            )
        serial = [(each.text or "").strip() for each in _under(results, "SerialNumber")]
        if points:
            add_points(file, found, (serial or [f"{file.source.path.stem}-{number_of}"])[0], points)
    found.drop("features without a location", left)
    tags = [local(each.tag) for each in _elements(root)]
    found.drop("characteristics", sum(tag.endswith("CharacteristicActual") for tag in tags))
    if not found.rows:
        raise file.error("empty-file", what="locations of measured features", expected="results")
    found.says = [f"locations times {factor:g} in mm", "nominal places from the part file"]
    return found


def features_of(file: RawFile) -> dict[str, Any]:
    """Plane, machine and features of a ballbar file ``.b5r``: each `value` with its `unit`.

    Raises InputError where it has no feature.
    """
    root, found, features = file.xml, dict[str, Any](), dict[str, Any]()
    for element in root.iter() if root is not None else ():
        name = local(element.tag) if isinstance(element.tag, str) else ""
        own = {local(key).upper(): value for key, value in element.attrib.items()}
        inner = {local(each.tag).upper(): (each.text or "").strip() for each in element
                 if isinstance(each.tag, str)}  # fmt: skip
        known = own | {key: value for key, value in inner.items() if value}
        if name == "FEATURE" and known.get("NAME"):
            text = known.get("VALUE") or (element.text or "").strip()
            value, unit = number(text, "."), UNIT_OF.get(known.get("DT", ""))
            if value is None or unit is None:
                raise file.error("wrong-type", path=known["NAME"], kind="a value with a known DT",
                                 value=f"{text} {known.get('DT', '')}")  # fmt: skip
            features[known["NAME"]] = {"value": value, "unit": unit}
        for key in ("TEST_PLANE", "OPERATOR", "DATE_STARTED", "SERIAL_NUMBER", "LAST_CALIBRATED"):
            if key in known:
                found.setdefault(key.lower(), known[key])
        if name in ("MACHINE_TESTED", "TEST_SPEC") and known.get("NAME"):
            found.setdefault(name.lower(), known["NAME"])
    if not features:
        raise file.error("empty-file", what="FEATURE with NAME, DT and value", expected="a .b5r")
    return {**found, "features": features}


def read_b5r(file: RawFile, ask: Ask) -> Imported:
    """The features, to be shown: the elements of the raw samples are not documented."""
    found = Imported(format="b5r", kind=OTHER)
    known = features_of(file)
    found.facts = {name: text for name, text in known.items() if name != "features"}
    found.facts |= {name: f"{each['value']:g} {each['unit']}".strip()
                    for name, each in known["features"].items()}  # fmt: skip
    found.rows = [1] * len(known["features"])
    found.says = ["A and B are first and second axis of the plane; raw samples are not read"]
    return found


def samples_of(file: RawFile) -> tuple[dict[str, str], list[float]]:
    """Header and samples of a dynamic capture; raises InputError where bytes are missing."""
    match = _SAMPLES.search(file.content)
    head = file.content[: match.start() if match else 0].decode("cp1252", "replace")
    pairs = (line.partition(":") for line in head.splitlines() if ":" in line)
    header = {name.strip(): value.strip() for name, _, value in pairs}
    text = header.get("Sample no", header.get("Sample number", ""))
    if match is None or not text.isdecimal():
        raise file.error("missing-input", what="Sample no and Data:", expected="a whole .rtx")
    count, body = int(text), file.content[match.end() :]
    left = body[8 * count :].strip(b"\r\n")
    if len(body) < 8 * count or not left.startswith(b"EOF"):
        facts = {"found": f"{len(body)} bytes of samples", "expected": f"{8 * count} and EOF::"}
        raise file.error("wrong-count", **facts)
    return header, list(struct.unpack(f"<{count}d", body[: 8 * count]))


def read_rtx(file: RawFile, ask: Ask) -> Imported:
    """Header and extent of the samples, to be shown."""
    header, samples = samples_of(file)
    found = Imported(format="rtx", kind=OTHER, rows=[1] * len(samples))
    found.facts = {name: value for name, value in header.items() if value and len(value) < 80}
    if samples:
        found.facts |= {"least": min(samples), "largest": max(samples)}
    found.says = ["the order of day and month in Date is not known"]
    return found


def _is_rtx(file: RawFile) -> bool:
    head = file.content[:4000]
    return b"CARTO-Dynamic" in head or (b"Sample no" in head and bool(_SAMPLES.search(head)))


FORMATS = (
    Format("rtx", "Renishaw dynamic capture", (OTHER,), _is_rtx, read_rtx),
    Format("qif", "QIF results", (POINTS,), _is_qif, read_qif),
    Format("b5r", "Renishaw ballbar, features", (OTHER,),
           lambda file: file.xml is not None and bool(_under(file.xml, "FEATURE")), read_b5r),
)  # fmt: skip
