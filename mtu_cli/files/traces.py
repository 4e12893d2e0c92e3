"""Traces of a circular test (ISO 230-4): radial deviations over the angle, from all files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.files.csv_file import read_tables
from mtu_cli.files.csv_table import CellFaults, Floats, Table, Texts
from mtu_cli.files.headers import Column, TableSpec
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
        "direction": Column("text", known=tuple(WAYS)),
        "radius_mm": Column(largest=1e5),
        "feed_mm_min": Column(largest=1e7, may_be_empty=True),
        "plane": Column("text", known=PLANES),
        "pass": Column("count"),
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
    radius: float | None = None,
    plane: str | None = None,
) -> Traces:
    """Reads all files; what no column says `direction` and `feed` do, of all files or of each in
    turn, and `radius` and `plane`.

    Raises InputError with all bad cells, or for what is not stated, or not alike in all traces.
    """
    faults = CellFaults()
    table = read_tables([(path, "traces") for path in files], TRACES, faults)
    faults.raise_if_any()
    _spread(table, "direction", "--direction", direction)
    _spread(table, "feed_mm_min", "--feed", feed)
    _spread(table, "radius_mm", "--radius", () if radius is None else (radius,))
    _spread(table, "plane", "--plane", () if plane is None else (plane,))
    for i in np.flatnonzero(table.number("feed_mm_min") <= 0)[:1].tolist():
        place = {**table.place(i), "column": "feed_mm_min"}
        value = f"{table.number('feed_mm_min')[i]:g}"
        raise error("out-of-range", value=value, expected="mm/min above 0, or empty", **place)
    radii = table.number("radius_mm")
    if len(np.unique(radii[np.isfinite(radii)])) > 1:
        row = int(np.flatnonzero(radii != radii[0])[0])
        place = {**table.place(row), "column": "radius_mm", "value": f"{radii[row]:g}"}
        raise error("contradicts", other="another trace", expected="one in all traces", **place)
    if not (radii > 0).all():
        place = {"path": "--radius", "expected": "--radius MM above 0, or a column radius_mm"}
        raise error("missing-input", what="the nominal radius", **place)
    labels, codes = table.labelled("plane")
    names = [labels[int(each)] if each >= 0 else "" for each in np.unique(codes)]
    if len(names) > 1:
        expected = "the traces of one plane in a call"
        place = {"column": "plane", "value": ", ".join(names)}
        raise error("contradicts", other="another trace", expected=expected, **place)
    return Traces(
        traces=tuple(_traces(table)),
        plane=names[0] or None,
        radius=float(radii[0]),
        sources=table.sources,
    )


def _spread(table: Table, name: str, option: str, values: Sequence[Any]) -> None:
    """Gives files without a column the value of an option: one for all, or one for each."""
    files = len(table.files)
    if not values:
        return
    if len(values) not in (1, files):
        expected = f"one for all files, or {files} with commas"
        raise error("wrong-count", path=option, found=f"{len(values)} values", expected=expected)
    without = ~table.has(name)
    each = [values[i % len(values)] for i in range(files)]
    if name in ("direction", "plane"):
        known = table.texts.get(name, Texts(np.full(len(table), -1), ()))
        labels = [*known.labels, *each]
        codes = np.where(without, len(known.labels) + table.file_index, known.codes)
        first = {label: labels.index(label) for label in labels}
        merged = np.array([first[label] for label in labels] + [-1])[codes]
        table.texts[name] = Texts(merged, tuple(labels))
    else:
        given = np.array(each, np.float64)[table.file_index]
        table.numbers[name] = np.where(without, given, table.number(name))


def _traces(table: Table) -> list[Trace]:
    """Rows of one file, pass, direction and feed are a trace."""
    labels, way = table.labelled("direction")
    feed, number = table.number("feed_mm_min"), table.whole("pass")
    result, faults = [], CellFaults()
    keys = np.column_stack([table.file_index, number, way, np.nan_to_num(feed)])
    group = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    for each in dict.fromkeys(group.tolist()):
        rows = np.flatnonzero(group == each)
        first = int(rows[0])
        place = table.place(first)
        if way[first] < 0:
            expected = "--direction cw or ccw, or a column 'direction'"
            del place["row"]
            faults.add(finding("missing-input", what="the direction", expected=expected, **place))
        elif len(rows) < FEWEST:
            what = f"a trace of {len(rows)} samples"
            expected = f"{FEWEST} or more around the circle"
            faults.add(finding("too-little-data", what=what, expected=expected, **place))
        else:
            result.append(
                Trace(
                    file=str(place["file"]),
                    number=int(number[first]) if number[first] >= 0 else None,
                    direction=labels[way[first]],
                    feed=float(feed[first]),
                    angle=np.radians(table.number("angle_deg")[rows]),
                    deviation=table.number("deviation_um")[rows] * UM,
                )
            )
    faults.raise_if_any()
    return result


def words(text: str | None, read: Callable[[str], Any]) -> list[Any]:
    """The values of an option with commas."""
    return [read(each.strip()) for each in text.split(",")] if text else []
