"""Cells of temperature sensors that hold what a faulty sensor shows, not a temperature."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import ProblemList, Table

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]
    Bools = NDArray[np.bool_]

STEP_K = 30.0
"""No sensor in a machine's structure jumps by this from one reading to the next, and back."""
NO_ANSWER = -127.0
CODES = {
    NO_ANSWER: (0.0, "-127 degC is what a DS18B20 gives where it does not answer"),
    85.0: (STEP_K, "85 degC exactly is what a DS18B20 gives before it has measured"),
    0.0: (10.0, "0 degC exactly is what a sensor gives that is not read"),
}
"""What sensors give in place of a temperature (Maxim DS18B20, data sheet, table 1; its usual
drivers), by how much it then stands apart from the readings before and after it, and its words."""
LONGEST = 3
"""Readings in a row up to which a jump and the way back are a fault of the sensor ..."""
SLOWEST_MIN = 10.0
"""... where each step took no longer: a sensor that is read rarely may warm up in between."""


def check_sensors(table: Table, name: str, problems: ProblemList) -> None:
    """A problem for every cell of the sensor `name` that is an error code of a sensor, or stands
    on a jump and back of more than `STEP_K`; a sensor that warms up to 85 degC does neither.
    """
    values = table.columns.numbers[name]
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    apart = {code: limit for code, (limit, _) in CODES.items() if low <= code <= high}
    if NO_ANSWER not in apart and not high - low > min(apart.values(), default=STEP_K):
        return
    order, run = _in_time(table)
    ordered, minutes = values[order], _minutes(table, order)
    told: dict[int, str] = {}
    for code, limit in apart.items():
        for i in np.flatnonzero(_coded(ordered, run, code, limit)).tolist():
            told[i] = CODES[code][1]
    rest = np.setdiff1d(np.arange(len(order)), list(told))
    for i in np.flatnonzero(_spikes(ordered[rest], run[rest], minutes[rest])).tolist():
        told[int(rest[i])] = f"no jump of more than {STEP_K:g} K and back from reading to reading"
    for i in sorted(told, key=lambda i: int(order[i])):
        near = _neighbours(ordered, run, i, told)
        expected = f"a temperature in degC{near}: {told[i]}; leave out such rows, or the column"
        what = "a fault of the sensor, no temperature"
        problems.add(table.problem(int(order[i]), name, what, float(ordered[i]), expected))


def _in_time(table: Table) -> tuple[Ints, Ints]:
    """Rows in the order of their times within each component, position and cycle, and the number
    of that run in this order, (n,) each.
    """
    n, columns = len(table), table.columns
    keys: list[NDArray[Any]] = [np.arange(n), _times(table)]
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


def _times(table: Table) -> NDArray[np.float64]:
    """Minutes of each row, 0 where no times are given."""
    if "time" in table.columns.times:
        return table.columns.times["time"].microseconds / 60e6
    return table.columns.numbers.get("time_min", np.zeros(len(table)))


def _minutes(table: Table, order: Ints) -> Floats:
    return np.asarray(_times(table)[order], np.float64)


def _coded(values: Floats, run: Ints, code: float, limit: float) -> Bools:
    """Which of the values (n,) are `code` and stand more than `limit` apart from what is before
    and after them in their run; with a limit of 0, all.
    """
    hit = values == code
    if limit == 0.0 or not hit.any():
        return np.asarray(hit)
    n = len(values)
    edge = np.flatnonzero(np.diff(hit, prepend=False, append=False) | _starts(run, n + 1))
    found = np.zeros(n, bool)
    for a, b in pairwise(edge.tolist()):
        if not hit[a]:
            continue
        near = [values[i] for i in (a - 1, b) if 0 <= i < n and run[i] == run[a]]
        found[a:b] = bool(near) and all(abs(value - code) > limit for value in near)
    return found


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
