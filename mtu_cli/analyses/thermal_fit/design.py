"""The drift readings of one component, and the columns that its thermal models choose from:
sensors, or groups of them, with and without lag.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError, error, finding
from mtu_cli.stats.least_squares import FloatArray, IntArray, compress
from mtu_cli.stats.selection import Panel, levels_of_pieces
from mtu_cli.stats.serial import first_order_lag

ALIKE = 0.999
"""Correlation from which on two sensors are one to any fit (Valdes et al.)."""
MOST_LAGS = 7
MOST_ROWS = 1_000_000
"""Readings of a component that are fitted; of more every second, third, ... of a cycle."""
OFFSET_P, OFFSET_SHARE = 0.001, 0.7
"""Level of the test of cycles' offsets, and their least share of the residuals without them: memory
and noise make small offsets, too."""
ROUNDING = 1e-12
"""Share of the readings that is rounding where it is all they differ by."""


class Design:
    """Readings of one component by position, by cycle as these follow each other, and by time, or
    in the order of the file where times are not given; what its models are made of.

    `positions` (mm, ascending; (None,) without an axis), `cycles`; `places` and `runs` are the rows
    of each position, and by the indices of position and cycle. `y` (n,) mm or rad, `still` where
    they do not differ; `T` (n, s) degC, `span` (s, 2) their ranges, `time` (n,) min (nan: not
    given). Of `readings` (their number) every `every`-th is here.

    `groups` are tuples of sensors, `average` (s, g) their means. `Z` (n, 2 + k g) are the rows 1,
    columns, reading: column 1 + c g + j is the rise of group j above the reference, degC, with the
    time constant `time_constants[c]`, min, of which the first is 0; `step` between readings, min.
    `panel` has these rows, and (p - c)/h of the positions p, c their middle and h their half range
    (`scale`, mm; c is 0 without an axis). Where cycles have `offsets` of their own (`by`: setting,
    first readings or test) its columns count from their means in each position and cycle.

    Lagged columns are made where `lagged` is asked for and times are known. `zeroed`: cycle (an
    offset each), never, or auto.
    """

    def __init__(
        self,
        readings: Readings,
        rows: IntArray,
        sensors: tuple[str, ...],
        reference: float,
        *,
        lagged: bool,
        zeroed: str,
    ) -> None:
        import pandas as pd

        columns = [readings.covariates[sensor].astype(float, copy=False) for sensor in sensors]
        self.span = np.array([(T[rows].min(), T[rows].max()) for T in columns])
        self.readings, self.every = len(rows), -(-len(rows) // MOST_ROWS)
        if self.every > 1:
            keys = [readings.position_mm[rows], readings.cycle[rows]]
            count = pd.Series(rows).groupby(keys, dropna=False).cumcount().to_numpy()
            rows = rows[count % self.every == 0]
        rows = self._sort(readings, rows)
        files = np.unique(readings.file_index[rows]).tolist()
        self.name = readings.components[int(readings.code[rows[0]])]
        self.dimension = int(readings.dimension[rows[0]])
        self.file = readings.sources[files[0]].shown if len(files) == 1 else None
        self.sensors, self.reference = sensors, reference
        self.y, self.time = (x[rows].astype(float) for x in (readings.error, readings.time_min))
        self.T = np.column_stack([column[rows] for column in columns])
        scatter = float(np.linalg.norm(about_means(self.y, self.places)))
        self.still = scatter <= ROUNDING * float(np.linalg.norm(self.y))
        # Sensors that never move hold no information, and of readings that do not none has any.
        moving = np.flatnonzero((np.ptp(self.span, axis=1) > 0) & (not self.still)).tolist()
        groups = list[dict[int, float]]()
        centred = about_means(self.T, self.places)
        length = np.linalg.norm(centred, axis=0)
        # A sensor may differ between positions alone.
        centred = centred / np.where(length > 0, length, 1.0)
        for sensor in moving:
            # Those correlated with the first of a group, with their sign.
            r = [float(centred[:, sensor] @ centred[:, next(iter(group))]) for group in groups]
            index = next((i for i, each in enumerate(r) if abs(each) >= ALIKE), None)
            if index is None:
                groups.append({sensor: 1.0})
            else:
                groups[index][sensor] = float(np.sign(r[index]))
        self.groups = tuple(tuple(sensors[s] for s in group) for group in groups)
        self.average = np.zeros((len(sensors), len(groups)))
        for j, group in enumerate(groups):
            self.average[[*group], j] = np.array([*group.values()]) / len(group)
        self.step, self.time_constants = 0.0, np.zeros(1)
        times = [self.time[part] for part in self.runs.values()]
        steps = np.concatenate([np.diff(time) for time in times])
        if lagged and not np.isnan(self.time).any() and (steps > 0).any():
            # Time constants from twice the usual step on, in powers of two.
            self.step = float(np.median(steps[steps > 0]))
            longest = max(float(time[-1] - time[0]) for time in times)
            many = int(np.clip(np.floor(np.log2(longest / (2 * self.step))) + 1, 0, MOST_LAGS))
            self.time_constants = np.append(0.0, 2 * self.step * 2.0 ** np.arange(many))
        rise, n = (self.T - reference) @ self.average, len(self.y)
        lags = [first_order_lag(rise[p], self.time[p], self.time_constants) for p in self.places]
        lagged_rise = np.moveaxis(np.concatenate(lags, axis=1), 0, 1).reshape(n, -1)
        self.Z = np.column_stack([np.ones(n), lagged_rise, self.y])
        pieces = {key: compress(self.Z[part]) for key, part in self.runs.items()}
        places = np.array([position or 0.0 for position in self.positions])
        middle, half = float(places.max() + places.min()) / 2, float(np.ptp(places)) / 2 or 1.0
        self.scale, panel = (middle, half), Panel(pieces, (places - middle) / half, len(groups))
        self.offsets, self.by = zeroed == "cycle", "test" if zeroed == "auto" else "setting"
        several = len(self.cycles) > 1 and len(self.runs) > len(self.positions)
        if zeroed == "auto" and groups and several:
            if not self.y[[part.start for part in self.runs.values()]].any():
                self.offsets, self.by = True, "first readings"
            else:
                # Lags that are left out shift the levels of cycles: that with which offsets explain
                # least decides.
                by_lag = np.arange(1, self.Z.shape[1] - 1).reshape(-1, len(groups)).tolist()
                sets = [by_lag[0], *(by_lag[0] + columns for columns in by_lag[1:])]
                share, p = levels_of_pieces(panel, sets)
                self.offsets = p < OFFSET_P and share > OFFSET_SHARE
        self.offsets &= len(self.cycles) > 1
        self.panel = panel.freed() if self.offsets else panel

    def _sort(self, readings: Readings, rows: IntArray) -> IntArray:
        """The rows by position, cycle and time."""
        import pandas as pd

        positions, place = np.unique(readings.position_mm[rows], return_inverse=True)
        cycle, labels = pd.factorize(readings.cycle[rows])
        time, order = readings.time_min[rows], np.lexsort((cycle, place))
        if not np.isnan(time).any():
            start = np.full(len(labels), np.inf)
            np.minimum.at(start, cycle, time)
            # Cycles follow each other in time, too, whichever the file has first.
            order = np.lexsort((time, cycle, start[cycle], place))
        place, cycle = place[order], cycle[order]
        changed = (np.diff(place, prepend=-1) != 0) | (np.diff(cycle, prepend=-1) != 0)
        edges = [*np.flatnonzero(changed).tolist(), len(rows)]
        self.positions = tuple(None if np.isnan(p) else float(p) for p in positions)
        self.cycles = tuple(readings.cycles[c] if c >= 0 else "" for c in labels.tolist())
        self.runs = {(int(place[i]), int(cycle[i])): slice(i, end) for i, end in pairwise(edges)}
        ends = np.searchsorted(place, np.arange(len(positions) + 1)).tolist()
        self.places = [slice(low, high) for low, high in pairwise(ends)]
        return rows[order]


def about_means(values: FloatArray, parts: Iterable[slice]) -> FloatArray:
    """Values (n, ...) less the means of the parts that they are made of."""
    result = np.empty_like(values)
    for rows in parts:
        # About the first one: equal values leave nothing.
        deviation = values[rows] - values[rows.start]
        result[rows] = deviation - deviation.mean(axis=0)
    return result


def sensors_of(readings: Readings) -> tuple[str, ...]:
    """The sensors: columns T_<sensor>_degC.

    Raises InputError where there is none, or where some of the files have none of them.
    """
    sensors = tuple(sorted(name for name in readings.covariates if is_temperature(name)))
    if not sensors:
        names = ", ".join(readings.covariates) or "none"
        raise error(
            "missing-column",
            column="T_<sensor>_degC",
            file=readings.sources[0].shown,
            expected=f"columns such as T_01_degC (columns beside the readings': {names})",
        )
    expected = "the column in every file, or in none"
    problems = [
        finding("missing-column", column=name, file=readings.sources[i].shown, expected=expected)
        for name in sensors
        for i in np.unique(
            readings.file_index[np.isnan(readings.covariates[name].astype(float, copy=False))]
        ).tolist()
    ]
    if problems:
        raise InputError(problems)
    return sensors
