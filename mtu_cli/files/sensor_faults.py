"""Cells of temperature sensors that hold what a faulty sensor shows, not a temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.fahrenheit import FAHRENHEIT, some_fahrenheit, told_partly
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList, Table

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Bools = NDArray[np.bool_]

STEP_K = 30.0
"""No sensor in a machine's structure jumps by this from one reading to the next, and back."""
NO_ANSWER, NOT_READ = -127.0, 0.0
CODES = {
    NO_ANSWER: (0.0, "-127 degC is what a DS18B20 gives where it does not answer"),
    85.0: (STEP_K, "85 degC exactly is what a DS18B20 gives before it has measured"),
    NOT_READ: (10.0, "0 degC exactly is what a sensor gives that is not read"),
}
"""What sensors give in place of a temperature (Maxim DS18B20, data sheet, table 1; its usual
drivers), by how much it then stands apart from the readings before and after it, and its words. A
run may begin with any of them but 0, which is also the rise over a cold machine at its start."""
SOON_MIN = 60.0
"""A machine's structure does not go to a code and come back within as many minutes each way."""
LONGEST = 3
"""Readings in a row up to which a jump and the way back are a fault of the sensor ..."""
SLOWEST_MIN = 10.0
"""... where each step took no longer: a sensor that is read rarely may warm up in between."""
USUAL = 0.1
"""Share of a run beyond which that is how the sensor behaves: a spindle that is switched on and
off, a sensor that tells no more than 85 degC."""
JUMPS = f"no jump of more than {STEP_K:g} K and back from reading to reading"
JUMPED = f"jumps of more than {STEP_K:g} K and back from reading to reading"


@dataclass(frozen=True, slots=True)
class _Cells:
    """The values (n,) of a sensor in the `order` of their times, their runs, what is the matter
    with those that are no temperatures, and the same of what comes too often for that.
    """

    values: Floats
    order: Ints
    run: Ints
    told: dict[int, str]
    usual: tuple[str, ...]


def check_sensors(table: Table, name: str, problems: ProblemList) -> None:
    """A problem for every cell of the sensor `name` that is an error code of a sensor, or stands
    on a jump and back of more than `STEP_K`; a sensor that warms up to 85 degC does neither.
    """
    cells = _cells(table, name)
    if cells is None:
        return
    order, told = cells.order, cells.told
    for i in sorted(told, key=lambda i: int(order[i])):
        near = _neighbours(cells.values, cells.run, i, told)
        expected = f"a temperature in degC{near}: {told[i]}; leave out such rows, or the column"
        what = "a fault of the sensor, no temperature"
        problems.add(table.problem(int(order[i]), name, what, float(cells.values[i]), expected))


def sensor_notes(tables: Sequence[Table]) -> Iterator[Finding]:
    """Of sensors that look faulty more often, or slower, than from a fault, or without times, and
    of those that are in Fahrenheit from some row on.
    """
    for table in tables:
        for name in filter(is_temperature, table.columns.numbers):
            cells = _cells(table, name)
            if cells is None:
                continue
            for words in cells.usual:
                yield _doubtful(table, name, words)
            odd = some_fahrenheit(cells.values, cells.run)
            if odd is not None:
                first = int(table.rows[cells.order[odd].min()])
                words = told_partly(cells.values, odd, first)
                message = f"{table.source.shown}, column {name!r}: {words}"
                yield Notice(code=FAHRENHEIT, message=message)


def code_notes(table: Table, name: str) -> Iterator[Finding]:
    """The same of one sensor, of error codes alone."""
    cells = _cells(table, name)
    for words in () if cells is None else cells.usual:
        if words != JUMPED:
            yield _doubtful(table, name, words)


def _doubtful(table: Table, name: str, words: str) -> Finding:
    text = (
        f"{table.source.shown}, column {name!r}: {words}; such cells are too many in a cycle for "
        f"a fault, or more than {SOON_MIN:g} min from the readings beside them, or no times are "
        "given: they count as temperatures; leave out the rows, or the column, where they are none"
    )
    return Notice(code="sensor-doubtful", message=text)


def _cells(table: Table, name: str) -> _Cells | None:
    """What is the matter with a sensor; None where a glance tells that nothing is."""
    values = table.columns.numbers[name]
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    apart = {code: limit for code, (limit, _) in CODES.items() if low <= code <= high}
    if NO_ANSWER not in apart and not high - low > min(apart.values(), default=STEP_K):
        return None
    minutes = times_of(table)
    order, run = in_runs(table, minutes)
    values = values[order]
    minutes = None if minutes is None else np.asarray(minutes[order], np.float64)
    told: dict[int, str] = {}
    usual: dict[str, None] = {}
    left = np.ones(len(order), bool)
    for code in apart:
        hit, late = _coded(values, run, minutes, code)
        often = _often(hit, run) if code != NO_ANSWER else np.zeros(len(hit), bool)
        told |= dict.fromkeys(np.flatnonzero(hit & ~often).tolist(), CODES[code][1])
        usual |= dict.fromkeys([CODES[code][1]] if (often | late).any() else [])
        left &= ~(hit | late)
    rest = np.flatnonzero(left)
    hit = _spikes(
        values[rest], run[rest], np.zeros(len(rest)) if minutes is None else minutes[rest]
    )
    often = hit if minutes is None else _often(hit, run[rest])
    told |= dict.fromkeys(rest[hit & ~often].tolist(), JUMPS)
    usual |= dict.fromkeys([JUMPED] if often.any() else [])
    return _Cells(values, order, run, told, tuple(usual))


def _often(hit: Bools, run: Ints) -> Bools:
    """Which of the cells `hit` (n,) are too many in their run for a fault."""
    count, size = np.bincount(run, hit), np.bincount(run)
    found: Bools = hit & (count > np.maximum(1, USUAL * size))[run]
    return found


def in_runs(table: Table, times: Floats | None) -> tuple[Ints, Ints]:
    """Rows in the order of their `times`, or else of the file, within each component, position and
    cycle, and the number of that run in this order, (n,) each.
    """
    n, columns = len(table), table.columns
    keys: list[NDArray[Any]] = [np.arange(n), np.zeros(n) if times is None else times]
    for name in ("cycle", "position_mm", "component"):
        if name in columns.texts:
            keys.append(columns.texts[name].codes)
        elif name in columns.numbers:
            keys.append(np.nan_to_num(columns.numbers[name], nan=np.inf))
    order = np.lexsort(keys)
    changed = np.zeros(n, bool)
    for key in keys[2:]:
        changed[1:] |= key[order][1:] != key[order][:-1]
    return order, np.cumsum(changed)


def times_of(table: Table) -> NDArray[np.float64] | None:
    """Minutes of each row, None where no times are given."""
    if "time" in table.columns.times:
        return table.columns.times["time"].microseconds / 60e6
    return table.columns.numbers.get("time_min")


def _coded(values: Floats, run: Ints, minutes: Floats | None, code: float) -> tuple[Bools, Bools]:
    """Which of the values (n,) are `code` and stand apart from what is before and after them in
    their run: soon enough for a fault (with a limit of 0, all), and not so.
    """
    hit, limit = values == code, CODES[code][0]
    found, late = np.zeros(len(values), bool), np.zeros(len(values), bool)
    if limit == 0.0 or not hit.any():
        return np.asarray(hit), late
    n, fewest = len(values), 2 if code == NOT_READ else 1
    alone = bool(np.abs(values[~hit] - code).min(initial=np.inf) > limit)
    edge = np.flatnonzero(np.diff(hit, prepend=False, append=False) | _starts(run, n + 1))
    for a, b in pairwise(edge.tolist()):
        if not hit[a]:
            continue
        pairs = [(a, a - 1), (b - 1, b)]
        near = [(i, k) for i, k in pairs if 0 <= k < n and run[k] == run[a]]
        apart = all(abs(values[k] - code) > limit for _, k in near)
        # Read often, it cannot have jumped there. Else what stays at a code may be so hot, and
        # what begins or ends there may cool or warm up within the hour, if not by so much.
        far = len(near) > 1 or all(abs(values[k] - code) > 2 * limit for _, k in near)
        limit_min = SOON_MIN if b - a <= LONGEST and far else SLOWEST_MIN
        soon = minutes is None or all(abs(minutes[k] - minutes[i]) <= limit_min for i, k in near)
        if len(near) >= fewest:
            found[a:b], late[a:b] = apart and soon, apart and not soon
        elif not near and b - a == 1:
            # Its run tells nothing of the one reading in it, all others do.
            late[a:b] = alone
    return found, late


def _starts(run: Ints, size: int) -> Bools:
    """Where a run begins, and the ends of all, (size,)."""
    found = np.zeros(size, bool)
    found[1:-1] = run[1:] != run[:-1]
    found[[0, -1]] = True
    return found


def _spikes(values: Floats, run: Ints, minutes: Floats) -> Bools:
    """Which of the values (n,) stand on a jump and the way back."""
    n = len(values)
    found = np.zeros(n, bool)
    steps = np.abs(np.diff(values)) > STEP_K
    for a in (np.flatnonzero(steps & (run[1:] == run[:-1])) + 1).tolist():
        for b in range(a + 1, min(a + LONGEST, n - 1) + 1):
            back = steps[b - 1] and abs(values[b] - values[a - 1]) < STEP_K / 2
            quick = minutes[b] - minutes[a - 1] <= SLOWEST_MIN * (b - a + 1)
            if run[b] == run[a] and back and quick and not found[a - 1]:
                found[a:b] = True
                break
    return found


def _neighbours(values: Floats, run: Ints, i: int, told: dict[int, str]) -> str:
    """What the sensor gave before and after, in words."""
    before, after = i - 1, i + 1
    while before in told:
        before -= 1
    while after in told:
        after += 1
    near = [values[k] for k in (before, after) if 0 <= k < len(values) and run[k] == run[i]]
    return f" near {' and '.join(f'{value:.4g}' for value in near)}" if near else ""
