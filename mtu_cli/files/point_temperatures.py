"""Temperatures of measured points that no working sensor gave, or not in degC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice, Problem
from mtu_cli.files.covariates import HOTTEST_DEGC, is_temperature
from mtu_cli.files.fahrenheit import (
    FAHRENHEIT,
    fahrenheit_words,
    in_fahrenheit,
    some_fahrenheit,
    told_partly,
)
from mtu_cli.files.sensor_faults import (
    CODES,
    NO_ANSWER,
    NOT_READ,
    SOON_MIN,
    USUAL,
    check_sensors,
    code_notes,
)
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList, Table
    from mtu_cli.files.points import Points

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]

NAMED_FILES = 3
FEWEST = 5
"""Other readings of the sensor without which a code may be what it read: 0 degC of three rooms."""


@dataclass(frozen=True, slots=True)
class _Coded:
    """Rows (n,) of a sensor that hold a `code` far from all that it reads else, from `low` to
    `high`; not `sure` where they are too many, or at the wrong time, for a fault.
    """

    code: float
    rows: Bools
    low: float
    high: float
    sure: bool


def check_temperatures_of_points(
    tables: Sequence[Table], points: Points, problems: ProblemList
) -> None:
    """A problem for every cell of a sensor that holds what a faulty sensor shows: where the rows
    are in the order of their times, as in drift readings; else, and where a sensor was read once
    a part, by what it shows in all other rows.
    """
    for name, values in _sensors(points).items():
        for table in _judged(tables, points, name):
            check_sensors(table, name, problems)
        for coded in _codes(points, values):
            for i in np.flatnonzero(coded.rows & coded.sure).tolist():
                problems.add(_faulty(points, name, coded, i))


def temperature_notes(tables: Sequence[Table], points: Points) -> Iterator[Finding]:
    """Of sensors that show codes of faults too often, or at the wrong times, to be refused, or
    that seem to be in Fahrenheit.
    """
    for name, values in _sensors(points).items():
        codes = list(_codes(points, values))
        for coded in codes:
            text = (
                f"column {name!r}: {int(coded.rows.sum())} of {len(values)} rows are "
                f"{coded.code:g}, the others {coded.low:.4g} to {coded.high:.4g}: "
                f"{CODES[coded.code][1]}; they count as temperatures: leave them out where they "
                "are none"
            )
            where = _files(points, coded.rows)
            yield Notice(code="sensor-doubtful", message=f"{where}{', ' if where else ''}{text}")
        for table in () if codes else _judged(tables, points, name):
            yield from code_notes(table, name)
    yield from _fahrenheit_notes(points)


def _fahrenheit_notes(points: Points) -> Iterator[Finding]:
    """Of sensors in Fahrenheit in all rows, of each in some."""
    code, sensors = FAHRENHEIT, _sensors(points)
    for name, values in sensors.items():
        odd = some_fahrenheit(values)
        if odd is not None:
            first = int(odd.argmax())
            shown = points.sources[points.file_index[first]].shown
            words = told_partly(values, odd, int(points.row[first]))
            yield Notice(code=code, message=f"{shown}, column {name!r}: {words}")
    extents = {name: _extent(values) for name, values in sensors.items()}
    words = fahrenheit_words(extents) or ""
    if words:
        given = [np.isfinite(sensors[name]) for name in in_fahrenheit(extents)]
        where = _files(points, np.any(given, axis=0))
        yield Notice(code=code, message=f"{where}{': ' if where else ''}{words}")


def _files(points: Points, rows: Bools) -> str:
    """The files of rows (n,), where there are several files."""
    if len(points.sources) == 1:
        return ""
    shown = [points.sources[i].shown for i in np.unique(points.file_index[rows]).tolist()]
    rest = len(shown) - NAMED_FILES
    return ", ".join(shown[:NAMED_FILES]) + (f" and {rest} more" if rest > 0 else "")


def _judged(tables: Sequence[Table], points: Points, name: str) -> Iterator[Table]:
    """Tables of a sensor whose rows are in the order of their times."""
    for table in tables:
        own = table.columns.numbers.get(name)
        if (
            own is not None
            and np.abs(own).max(initial=0.0) <= HOTTEST_DEGC
            and _in_order(table, points)
        ):
            yield table


def _faulty(points: Points, name: str, coded: _Coded, i: int) -> Finding:
    near = f", {coded.low:.4g} to {coded.high:.4g} as in other rows"
    return Problem(
        what="a fault of the sensor, no temperature",
        file=points.sources[points.file_index[i]].shown,
        row=int(points.row[i]),
        column=name,
        value=f"{coded.code:g}",
        expected=f"a temperature in degC{'' if np.isnan(coded.low) else near}: "
        f"{CODES[coded.code][1]}; leave out such rows, or the column",
    )


def _sensors(points: Points) -> dict[str, Floats]:
    """Temperatures (n,) by sensor, nan where a cell is empty."""
    named = {name: column for name, column in points.covariates.items() if is_temperature(name)}
    return {n: c.astype(np.float64, copy=False) for n, c in named.items() if c.dtype != object}


def _in_order(table: Table, points: Points) -> bool:
    """Whether the rows of a table are in the order of their times."""
    source = next(i for i, item in enumerate(points.sources) if item is table.source)
    return bool((np.diff(points.time_min[points.file_index == source]) >= 0.0).all())


def _extent(values: Floats) -> tuple[float, float]:
    """The least and the largest of the values that are none; nan where all are."""
    return (
        float(np.fmin.reduce(values, initial=np.nan)),
        float(np.fmax.reduce(values, initial=np.nan)),
    )


def _codes(points: Points, values: Floats) -> Iterator[_Coded]:
    """What of a sensor's values (n,) are codes that stand apart from all others."""
    present = [code for code in CODES if (values == code).any()]
    if not present:
        return
    others = np.isfinite(values) & ~np.isin(values, present)
    low, high = _extent(values[others])
    for code in present:
        rows, limit = values == code, CODES[code][0]
        if code == NO_ANSWER:
            yield _Coded(code, rows, low, high, sure=True)
        elif others.any() and np.abs(values[others] - code).min() > limit:
            sure = _rare(points, values, rows, others)
            sure = sure and (code != NOT_READ or _between(points, rows, others))
            yield _Coded(code, rows, low, high, sure)


def _rare(points: Points, values: Floats, rows: Bools, others: Bools) -> bool:
    """Whether so few readings are at a code that it is no habit of the sensor; rows of one visit
    with one value are one reading.
    """
    known = np.flatnonzero(rows | others)
    given, visit = values[known], points.part[known].astype(np.int64)
    for code in (points.operation[known], points.repeat[known]):
        visit = visit * (int(code.max()) + 2) + code + 1
    visits, inverse = np.unique(visit, return_inverse=True)
    of_visit = np.empty(len(visits))
    of_visit[inverse] = given
    readings = of_visit if (of_visit[inverse] == given).all() else given
    coded = int((readings == values[rows][0]).sum())
    return coded <= max(1.0, USUAL * len(readings)) and len(readings) - coded >= FEWEST


def _between(points: Points, rows: Bools, others: Bools) -> bool:
    """Whether the sensor gave temperatures before and after each stretch of `rows` (n,), and soon
    where times tell: a rise over a cold machine is 0 at its start.
    """
    known = np.flatnonzero(rows | others)
    times = points.time_min[known]
    timed = bool(np.isfinite(times).all())
    order = np.argsort(times if timed else points.sequence[known], kind="stable")
    hit = rows[known][order]
    if hit[0] or hit[-1]:
        return False
    steps = np.diff(times[order])[np.diff(hit)]
    return not timed or bool((steps <= SOON_MIN).all())
