"""Time and channels: loggers of temperatures and a probe as text, and TDMS (an extra)."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from mtu_cli.findings import listed
from mtu_cli.formats.base import Format, Import, RawFile, unit_in
from mtu_cli.formats.grid import Columns, Grid, grid_of, summary
from mtu_cli.units import UNITS, plain_unit

TIME = re.compile(r"\s*(time|zeit|date|datum|timestamp|date.?time|elapsed)\b", re.I)
PER_MINUTE = {"s": 1 / 60, "sec": 1 / 60, "min": 1.0, "h": 60.0}
_DATE = re.compile(
    r"(\d{1,4})([-./])(\d{1,2})\2(\d{1,4})[ T]"
    r"(\d\d?)(:\d\d(?::\d\d(?:[.,]\d+)?)?)(Z|[+-]\d\d:?\d\d)?"
)


def _header(file: RawFile) -> tuple[Grid, int] | None:
    """All rows, and where the header stands: the first row that begins with a word for time."""
    grid = grid_of(file.lines)
    at = next((i for i, row in enumerate(grid.rows[:20])
               if len(row.cells) > 1 and TIME.match(row.cells[0])), None)  # fmt: skip
    return None if at is None else (grid, at)


def sniff(file: RawFile) -> bool:
    """Whether a header begins with time and has channels, with rows below."""
    if not file.text or file.text.lstrip().startswith("<"):
        return False
    result = _header(file)
    return result is not None and len(result[0].rows) > result[1] + 1


def read(result: Import) -> None:
    """Temperatures as covariates, each channel of a length or angle as drift readings."""
    header = _header(result.file)
    assert header is not None
    grid, at = header
    names, rows = grid.rows[at].cells, grid.rows[at + 1 :]
    units = [_unit(name) for name in names]
    if rows and not rows[0].cells[0].strip("-[]() ").replace("s", ""):
        row_units = [_unit(f"x [{cell.strip('[]()')}]") for cell in rows.pop(0).cells]
        units = [row_unit or unit for row_unit, unit in zip(row_units, units, strict=False)]
        result.says.append("one row of units")
    result.drop("lines above the header", at)
    columns = Columns(result, names, rows, grid.separator)
    times = _times(columns)
    values = [columns.numbers(i) for i in range(1, len(names))]
    result.faults.raise_if_any()
    _assemble(result, names[1:], units[1:], times, values, [row.line for row in rows])
    result.says[:0] = [summary(grid, columns.signs)]


def _unit(name: str) -> str | None:
    if re.search(r"degC\b|[\[( _]C[\])]?$", plain_unit(name)):
        return "degC"
    return unit_in(name)


def _assemble(
    result: Import, names: Sequence[str], units: Sequence[str | None],
    times: tuple[str, Sequence[Any]], values: Sequence[Sequence[float | None]],
    lines: Sequence[int],
) -> None:  # fmt: skip
    """Rows of drift readings; channels that are neither temperature nor reading are counted."""
    file, ask, sensors = result.file, result.ask, dict[int, str]()
    for i in (i for i, unit in enumerate(units) if unit == "degC"):
        plain = re.sub(r"[\[(].*|_?degC$", "", plain_unit(names[i]))
        plain = re.sub(r"[^A-Za-z0-9]+", "_", re.sub(r"^T[ _-]+", "", plain)).strip("_")
        sensors[i] = f"T_{plain}_degC"
    probes = [i for i, unit in enumerate(units) if unit in UNITS]
    if not probes and (ask.unit or ask.component in ask.machine_units):
        unitless = [i for i in range(len(names)) if not re.search(r"[\[(]", names[i])]
        probes = [i for i in unitless if i not in sensors]
        if len(probes) > 1:
            reason = f"which channel is the probe: {listed(names[i] for i in probes)}"
            expected = "its unit in its heading, as [um], or a --map profile"
            raise file.error("undecided", what=reason, expected=expected)
    result.facts = {"channels": list(names), "readings": [names[i] for i in probes],
                   "temperatures": [*sensors.values()], "rows": len(lines)}  # fmt: skip
    if not probes:
        expected = "a channel in um, mm, arcsec, ... , or --unit"
        raise file.error("missing-input", what="a channel of a probe", expected=expected)
    if ask.component and len(probes) > 1:
        reason = f"{len(probes)} channels of readings and one component"
        raise file.error("undecided", what=reason, expected="a --map profile")
    # Files may begin anew at 0 min: each is a cycle of its own.
    cycle, count = "/".join(file.source.path.parts[-2:]), len(names) - len(sensors) - len(probes)
    result.drop("channels without a unit of temperature, length or angle", count)
    for i in probes:
        # Without a stated component the channel's name, less its unit.
        plain = re.sub(r"\W+", "_", re.sub(r"[\[(].*", "", names[i])).strip("_")
        unit, component = result.unit_of(units[i]), ask.component or plain
        for n, line in enumerate(lines):
            result.add(line, component=component, error=values[i][n], unit=unit, cycle=cycle,
                      **{times[0]: times[1][n]},
                      **{name: values[j][n] for j, name in sensors.items()})  # fmt: skip
    result.says.append("the file is one cycle: split it by a --map profile with cycles")


def _times(columns: Columns) -> tuple[str, list[Any]]:
    """The column's name in the contract, and its cells: minutes, or ISO 8601 times."""
    name, result = columns.header[0], columns.result
    matches = [_DATE.fullmatch(text) for text in columns.texts[0]]
    dates = [match for match in matches if match]
    if not dates:
        unit = re.search(r"[\[(_ ](s|sec|min|h)\b", name)
        if unit is None:
            facts = {"what": f"the unit of {name!r}", "expected": "time [s], [min] or [h]"}
            raise result.file.error("undecided", **facts)
        return "time_min", [x and x * PER_MINUTE[unit[1]] for x in columns.numbers(0)]
    slashed = [match for match in dates if match[2] == "/" and len(match[1]) < 3]
    day_first = any(int(match[1]) > 12 for match in slashed)
    if slashed and not day_first and not any(int(match[3]) > 12 for match in slashed):
        what, expected = "day or month first in the times", "a day after the 12th, or ISO 8601"
        raise result.file.error("undecided", what=what, expected=expected)
    times = list[str]()
    for row, match in zip(columns.rows, matches, strict=True):
        try:
            if match is None:
                raise ValueError
            a, b, c, hour = (match[n].zfill(2) for n in (1, 3, 4, 5))
            date = f"{c:0>4}-{b}-{a}" if day_first or match[2] != "/" else f"{c:0>4}-{a}-{b}"
            date = f"{a}-{b}-{c}" if len(a) == 4 else date
            time = datetime.fromisoformat(f"{date}T{hour}{match[6]}")
            times.append(time.isoformat() + (match[7] or ""))
        except ValueError:
            result.bad_cell(row.line, name, row.cells[0], "a date and time")
    return "time", times


def read_tdms(result: Import) -> None:
    """Channels of the first group, as long as the shortest; needs nptdms."""
    file = result.file
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise file.error("missing-input", what="nptdms", expected="mtu-cli[tdms]") from None
    try:
        groups = TdmsFile.read(io.BytesIO(file.content)).groups()
    except Exception as fault:
        raise file.error("not-readable", reason=f"damaged TDMS ({type(fault).__name__})") from None
    channels = [item for group in groups[:1] for item in group.channels() if len(item)]
    count = min(map(len, channels), default=0)
    result.drop("groups beyond the first", max(0, len(groups) - 1))
    result.drop("samples beyond the shortest channel", sum(len(item) - count for item in channels))
    step = channels[0].properties.get("wf_increment") if channels else None
    if not step or not all(item.dtype.kind in "iuf" for item in channels):
        raise file.error("missing-input", what="wf_increment of numeric channels")
    names = [item.name for item in channels]
    units = [plain_unit(str(item.properties.get("unit_string", ""))) or _unit(item.name)
             for item in channels]  # fmt: skip
    values = [[float(x) for x in item[:count]] for item in channels]
    times = [n * float(step) / 60.0 for n in range(count)]
    _assemble(result, names, units, ("time_min", times), values, [1] * count)


FORMATS = (
    Format("tdms", "National Instruments TDMS", "drift",
           lambda file: file.content.startswith(b"TDSm"), read_tdms),
    Format("logger", "time and channels", "drift", sniff, read),
)  # fmt: skip
