"""What looks odd in drift readings as they are read: sensors, times, a column's name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice, closest
from mtu_cli.files.csv_table import cell_text
from mtu_cli.files.sensor_faults import in_runs, sensor_notes, times_of
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import Table

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]

OUT_OF_ORDER = "time-out-of-order"
MOST = 0.05
"""Share of a cycle's rows beyond which times that do not ascend are in no order at all."""
FEWEST = 5
"""Rows of a component and position from which on their times show an order."""
CYCLE = "cyc"
"""How the name of a column begins that may be meant to tell cycles apart."""


def drift_notes(tables: Sequence[Table]) -> Iterator[Finding]:
    """All of it of the tables of drift readings, or of blocks of them; of others their times."""
    drifts = [table for table in tables if table.source.role == DRIFT]
    yield from negative_times([table for table in tables if table.source.role != DRIFT])
    yield from sensor_notes(drifts)
    for table in drifts:
        yield from _time_notes(table)
        yield from _cycle_notes(table)


def negative_times(tables: Sequence[Table]) -> Iterator[Finding]:
    """Of few rows whose minutes are below 0, in files whose other minutes ascend from 0 or more,
    by rows or by parts: without their sign they may be in order.
    """
    for table in tables:
        values = table.columns.numbers.get("time_min", np.zeros(0))
        count = int((values < 0).sum())
        if not 0 < count <= max(1.0, MOST * len(values)) or len(values) < FEWEST:
            continue
        if np.isnan(values).any():
            continue
        for order, ascend in _orders(table, values):
            rest = np.flatnonzero(values[order] >= 0)
            if (np.diff(values[order][rest]) < 0).any():
                continue
            # Before the first of the others they are the start of a run that was zeroed later.
            odd = np.flatnonzero(values[order] < 0)
            odd = odd[odd > rest[0]]
            near = [rest[max(0, place - 1) : place + 1] for place in np.searchsorted(rest, odd)]
            pairs = zip(order[odd].tolist(), near, strict=True)
            found = [(row, order[beside].tolist()) for row, beside in pairs]
            if found:
                yield _out_of_order(table, found, ascend)
            break


def _orders(table: Table, values: Floats) -> Iterator[tuple[Rows, str]]:
    """In which rows (n,) may follow each other, with what is said of their times."""
    yield np.arange(len(values)), "in a file whose times ascend"
    column = table.columns.texts.get("part")
    if column is None:
        return
    made = table.columns.numbers.get("sequence")
    if made is None:
        # Of parts with no time from 0 on nobody knows; below 0 they stay at the beginning.
        of_part = np.full(len(column.labels), -np.inf)
        np.maximum.at(of_part, column.codes, values)
        made = of_part[column.codes]
    yield np.lexsort((values, made)), "where the times of parts ascend"


def _cycle_notes(table: Table) -> Iterator[Finding]:
    """Of a column that only its name keeps from telling cycles apart."""
    if "cycle" in table.columns.texts:
        return
    folded = {name.casefold(): name for name in table.covariates}
    near = closest("cycle", [n for n in folded if n.startswith(CYCLE) and "time" not in n])
    if near is not None:
        text = (
            f"{table.source.shown}: no column 'cycle', so that no cycles are told apart: did you "
            f"mean the column {folded[near]!r}? Rename it to 'cycle'"
        )
        yield Notice(code="no-cycles", message=text)


def _time_notes(table: Table) -> Iterator[Finding]:
    """Of single rows whose times lie outside those of their neighbours in the file."""
    minutes = times_of(table)
    if minutes is None:
        return
    order, run = in_runs(table, None)
    values = minutes[order]
    fell = np.flatnonzero((np.diff(values) < 0) & (run[1:] == run[:-1]))
    if not len(fell):
        return
    cycles = table.columns.texts.get("cycle")
    cycle = np.zeros(len(table), np.int64) if cycles is None else cycles.codes[order]
    rows, falls = np.bincount(cycle), np.bincount(cycle[fell], minlength=int(cycle.max()) + 1)
    ordered = falls <= MOST * rows
    starts = np.flatnonzero(np.diff(run, prepend=-1))
    ends = np.append(starts[1:], len(run))
    found = []
    for i in fell[ordered[cycle[fell]]].tolist():
        own = int(np.searchsorted(starts, i, side="right")) - 1
        at = _odd_one(values, i, int(starts[own]), int(ends[own]))
        if at is None:
            ordered[cycle[i]] = False
        else:
            near = [k for k in (at - 1, at + 1) if starts[own] <= k < ends[own]]
            found.append((at, order[near].tolist()))
    found = [(at, near) for at, near in found if ordered[cycle[at]]]
    if found:
        yield _out_of_order(table, [(int(order[at]), near) for at, near in found])


def _odd_one(values: Floats, i: int, start: int, end: int) -> int | None:
    """Which of the rows i and i + 1, between which the times of a run [start, end) fall, is the one
    without which they ascend around it; None where neither is. Of both, the farther off.
    """
    if end - start < FEWEST:
        return None
    fits = []
    for k in (i, i + 1):
        # Python's own numbers: those of numpy warn where a sum is too large for them.
        near = [float(values[j]) for j in (k - 1, k + 1) if start <= j < end]
        around = [values[j] for j in (k - 2, k - 1, k + 1, k + 2) if start <= j < end]
        if around == sorted(around):
            fits.append((-abs(float(values[k]) - sum(near) / len(near)), k))
    return min(fits)[1] if fits else None


def _out_of_order(
    table: Table,
    found: Sequence[tuple[int, list[int]]],
    ascend: str = "in a file whose times ascend",
) -> Finding:
    """The warning of rows and their neighbours, by the first."""
    row, near = min(found)
    column = "time" if "time" in table.columns.times else "time_min"
    beside = " and ".join(f"{_shown(table, k)} (row {table.rows[k]})" for k in near)
    more = len(found) - 1
    others = f"; so do {more} more" if more > 1 else "; so does 1 more" if more else ""
    mistyped = "they are mistyped" if more else "it is mistyped"
    text = (
        f"{table.source.shown}, row {table.rows[row]}, column {column!r}: {_shown(table, row)} "
        f"lies outside the times beside it, {beside}, {ascend}{others}: look whether {mistyped}"
    )
    return Notice(code=OUT_OF_ORDER, message=text)


def _shown(table: Table, index: int) -> str:
    """The time of a row as the file gives it."""
    dated = table.columns.times.get("time")
    if dated is None:
        return cell_text(float(table.columns.numbers["time_min"][index]))
    return str(dated.microseconds[index].astype("datetime64[us]").astype("datetime64[ms]"))
