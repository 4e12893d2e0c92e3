"""Traces of a circular test (ISO 230-4): radial deviations over the angle, from all files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.csv_file import read_tables
from mtu_cli.files.csv_table import CellFaults, Floats, Table
from mtu_cli.files.headers import PASS, Column, TableSpec
from mtu_cli.files.source import Source
from mtu_cli.findings import error, finding
from mtu_cli.units import UM

WAYS = {"ccw": 1, "cw": -1}
PLANES = ("XY", "YZ", "ZX")
"""First and second axis: counter-clockwise turns from the first to the second."""
FEWEST = 24
"""Samples of a trace: fewer do not separate its terms."""
TRACES = TableSpec(
    holds="traces of a circular test",
    option="mtu circular",
    columns={
        "angle_deg": Column(required=True, largest=36_000.0),
        "deviation_um": Column(required=True, largest=1e5),
        "direction": Column("text", texts=tuple(WAYS)),
        "radius_mm": Column(largest=1e5),
        "feed_mm_min": Column(largest=1e7, may_be_empty=True),
        "plane": Column("text", texts=PLANES),
        "pass": PASS,
    },
)
"""One row a sample; the angle counts from the first axis to the second, for cw, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A trace of radial deviations (n,) in mm at angles (n,) in rad, of `sign` +1 (ccw) or -1;
    `feed` in mm/min, nan where unknown.
    """

    file: str
    number: int | None
    direction: str
    feed: float
    angle: Floats
    deviation: Floats

    @property
    def sign(self) -> int:
        """The sense of rotation."""
        return WAYS[self.direction]


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """All traces of one plane (None: not stated) and one nominal radius, mm."""

    traces: tuple[Trace, ...]
    plane: str | None
    radius: float
    sources: tuple[Source, ...]


def read_traces(
    files: Sequence[Path],
    *,
    direction: Sequence[str] = (),
    feed: Sequence[float] = (),
    radius: Sequence[float] = (),
    plane: Sequence[str] = (),
) -> Traces:
    """Reads all files; what no column says the options do, each of all files or of each in turn.

    Raises InputError with all bad cells, or for what is not stated, or not alike in all traces.
    """
    faults = CellFaults()
    table = read_tables([(path, "traces") for path in files], TRACES, faults)
    faults.raise_if_any()
    ways = _filled(table, "direction", "--direction", direction)
    feeds = _filled(table, "feed_mm_min", "--feed", feed).astype(float)
    if (bad := np.flatnonzero(feeds <= 0)).size:
        place = {**table.place(int(bad[0])), "column": "feed_mm_min"}
        value = f"{feeds[bad[0]]:g}"
        raise error("out-of-range", value=value, expected="mm/min above 0, or empty", **place)
    radii = _filled(table, "radius_mm", "--radius", radius)
    planes = _filled(table, "plane", "--plane", plane)
    if not all(x and x > 0 for x in radii):
        place = {"path": "--radius", "expected": "--radius MM above 0, or a column radius_mm"}
        raise error("missing-input", what="the nominal radius", **place)
    for name, column in (("radius_mm", radii), ("plane", planes)):
        if (conflicts := np.flatnonzero(column != column[0])).size:
            value = ", ".join(f"{column[i]}" for i in (0, conflicts[0]))
            place = {**table.place(int(conflicts[0])), "column": name, "value": value}
            raise error("contradicts", other="another trace", expected="one in all traces", **place)
    traces, number = [], table.whole("pass")
    # Rows of one file, pass, direction and feed are a trace.
    keys = zip(table.file_index.tolist(), number.tolist(), ways, np.nan_to_num(feeds), strict=True)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for i, key in enumerate(keys):
        groups.setdefault(key, []).append(i)
    for rows in groups.values():
        first = rows[0]
        place = table.place(first)
        if ways[first] is None:
            del place["row"]
            place["expected"] = "--direction cw or ccw, or a column 'direction'"
            faults.add(finding("missing-input", what="the direction", **place))
        elif len(rows) < FEWEST:
            what = f"a trace of {len(rows)} samples"
            place["expected"] = f"{FEWEST} or more around the circle"
            faults.add(finding("too-little-data", what=what, **place))
        else:
            traces.append(
                Trace(
                    file=str(place["file"]),
                    number=int(number[first]) if number[first] >= 0 else None,
                    direction=ways[first],
                    feed=float(feeds[first]),
                    angle=np.radians(table.number("angle_deg")[rows]),
                    deviation=table.number("deviation_um")[rows] * UM,
                )
            )
    faults.raise_if_any()
    return Traces(traces=tuple(traces), plane=planes[0], radius=radii[0], sources=table.sources)


def _filled(table: Table, name: str, option: str, values: Sequence[Any]) -> NDArray[Any]:
    """A column (n,), with the value of an option where the file has none: one for all files, or one
    for each; None where neither states it. Raises InputError where both do, and differ.
    """
    files = len(table.files)
    if values and len(values) not in (1, files):
        expected = f"one for all files, or {files} with commas"
        raise error("wrong-count", path=option, found=f"{len(values)} values", expected=expected)
    defaults = np.array([values[i % len(values)] if values else None for i in range(files)], object)
    cells = table.number(name).astype(object)
    if name in table.texts:
        labels, codes = table.labelled(name)
        cells = np.array([*labels, None], object)[codes]
    options = defaults[table.file_index]
    has_cell = [x is not None and x == x for x in cells]
    rows = np.flatnonzero(has_cell & (options != None) & (options != cells))  # noqa: E711  # (n,)
    if rows.size:
        place = {**table.place(int(rows[0])), "column": name, "value": f"{cells[rows[0]]}"}
        raise error("contradicts", other=f"{option} {options[rows[0]]}", **place)
    return np.where(table.has(name), cells, options)
