"""What was measured together: readings in passes and runs, points in visits of parts, with the
best-fit alignment of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mtu_cli.files.headers import LISTED_FAULTS
from mtu_cli.files.readings import Points, Readings
from mtu_cli.files.study import Datum
from mtu_cli.findings import InputError, finding
from mtu_cli.stats.alignment import aligned_errors
from mtu_cli.stats.groups import distinct, group_least, group_means, occurrence
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray

PassKey = tuple[int, int, int]
"""(file, pass, direction)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Passes:
    """`keys` name the G passes; `order` (G,) is their sequence in time, `timed` that it was read
    rather than assumed; `starts` and `ends` (G,) their first and last time in min, nan or infinite
    where not given; `setups` their set-ups, `runs` (G,) the run there and back of each, in time.
    """

    keys: tuple[PassKey, ...]
    order: IntArray
    timed: bool
    starts: FloatArray
    ends: FloatArray
    setups: tuple[str, ...]
    runs: IntArray

    def only(self, index: IntArray) -> Passes:
        """The passes at `index` (m,)."""
        arrays = {name: getattr(self, name)[index] for name in ("order", "starts", "ends", "runs")}
        keys, setups = tuple(self.keys[g] for g in index), tuple(self.setups[g] for g in index)
        return replace(self, keys=keys, setups=setups, **arrays)


def passes_read(readings: Readings, rows: IntArray, of: str | None) -> tuple[IntArray, Passes]:
    """The pass of each of the readings `rows` (n,) of a component along the axis `of`, and the
    passes: one (file, number, direction), forward before reverse. Without a number each reading is
    a pass of its own where there is no axis, else a repeat of pass 0.

    Each file numbers its passes: pass 1 of two days is two passes.
    """
    has, sign = readings.has_pass[rows], readings.direction[rows].astype(np.int64)
    numbers = np.where(has, readings.pass_number[rows], 0)
    if of is None and not has.all():
        numbers = np.arange(1, len(rows) + 1)
    triples = np.column_stack([readings.file_index[rows], numbers, -sign]).astype(np.int64)
    keys, first, group = np.unique(triples, axis=0, return_index=True, return_inverse=True)
    group, G = group.reshape(-1), len(keys)
    keys = keys * np.array([1, 1, -1])
    times = readings.time_min[rows]
    # One reading without a time (nan) leaves its pass without.
    starts, ends = group_least(times, group, G), -group_least(-times, group, G)
    timed = bool(np.isfinite(starts).all()) and _one_clock(keys, starts, ends)
    # Without a clock a pass goes forward first: the order of rows has no effect.
    rank: IntArray = np.arange(G)
    if timed:
        rank[np.argsort(starts, kind="stable")] = np.arange(G)
    labels = readings.covariates.get("setup")
    setups = [""] * G if labels is None else [str(label) for label in labels[rows[first]]]
    return group, Passes(
        keys=tuple((file, number, way) for file, number, way in keys.tolist()),
        order=rank,
        timed=timed,
        starts=starts,
        ends=ends,
        setups=tuple(setups),
        runs=_runs(keys, rank, setups),
    )


def _one_clock(keys: IntArray, starts: FloatArray, ends: FloatArray) -> bool:
    """Whether the files of the passes (G,) share a clock.

    Files whose times overlap each count from their own start; but those of one direction alternate
    with those of the other: of these the passes are compared.
    """
    file = keys[:, 0]
    if np.ptp(file) > 0 and _directions(file, keys[:, 2]).all():
        file = np.arange(len(keys))
    spans = sorted((starts[file == f].min(), ends[file == f].max()) for f in np.unique(file))
    return all(later[0] > earlier[1] for earlier, later in pairwise(spans))


def _directions(code: IntArray, sign: IntArray) -> IntArray:
    """The direction (n,) that all of the same code have; 0 where they run both ways, or in none."""
    _, index = np.unique(code, return_inverse=True)
    count = int(index.max(initial=-1)) + 1
    least, most = group_least(sign, index, count), -group_least(-sign, index, count)
    return np.where(least == most, least, 0.0).astype(np.int64)[index]


def _runs(keys: IntArray, rank: IntArray, setups: list[str]) -> IntArray:
    """The run there and back of each pass (G,), numbered in time.

    A number that runs both ways is a run. Where every number of a file runs one way, one there and
    one back are a run: else a difference of directions would count as one of passes. Files that
    hold one direction each are read as one. The passes of a run are of one set-up.
    """
    numbered, code = np.unique(keys[:, :2], axis=0, return_inverse=True)
    code = code.reshape(-1)
    way = np.zeros(len(numbered), np.int64)
    way[code] = _directions(code, keys[:, 2])
    files = np.where(_directions(numbered[:, 0], way) != 0, -1, numbered[:, 0])
    in_time = np.argsort(group_least(rank, code, len(numbered)), kind="stable")
    run = np.arange(len(numbered))
    for file in np.unique(files):
        order = in_time[files[in_time] == file]
        if way[order].all():
            for there, back in pairs_of_passes(numbered[order, 1], way[order]):
                run[order[back]] = run[order[there]]
    labels = np.unique(np.array(setups, dtype=object), return_inverse=True)[1]
    both = np.column_stack([run[code], labels.reshape(-1)])
    group = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)
    start = group_least(rank, group, len(keys))[group]
    return np.unique(start, return_inverse=True)[1].reshape(-1)


def pairs_of_passes(number: IntArray, way: IntArray) -> list[tuple[int, int]]:
    """Places of the pairs (there, back) in a sequence of passes of one direction each, `way`.

    Numbers pair by the difference from there to back that most pairs have: 0 of two counts, 1 of
    passes in turn, half of all of one count there before all back; then a missing pass leaves its
    partner single. Else the n-th there and the n-th back.
    """
    there, back = np.flatnonzero(way > 0), np.flatnonzero(way < 0)
    steps, counts = np.unique(number[back] - number[there, None], return_counts=True)
    # Fewer than half may be chance.
    likely = np.flatnonzero(2 * counts > min(len(there), len(back)))
    once = all(len(np.unique(number[rows])) == len(rows) for rows in (there, back))
    if not (once and len(likely)):
        return list(zip(there.tolist(), back.tolist(), strict=False))
    half = int(number.max()) + 1
    alike = [(s == 0, n, s == 1, -abs(2 * s - half)) for s, n in zip(steps, counts, strict=True)]
    step = int(steps[max(likely, key=alike.__getitem__)])
    at = {int(number[i]): int(i) for i in back}
    return [(int(i), at[n]) for i in there if (n := int(number[i]) + step) in at]


# Measured points by visits of parts.


def axes_of(points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) along which every point was measured and has a nominal."""
    both = np.isfinite(points.measured).all(axis=0) & np.isfinite(points.nominal).all(axis=0)
    return tuple(np.flatnonzero(both).tolist())


def operations_of(points: Points) -> tuple[tuple[str, ...], IntArray]:
    """Names and codes (n,) of operations; "" where a file does not have them."""
    if not points.operations:
        return ("",), np.broadcast_to(np.int64(0), len(points))
    unnamed = points.operation < 0
    if not unnamed.any():
        return points.operations, points.operation
    return (*points.operations, ""), np.where(unnamed, len(points.operations), points.operation)


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """The points by measurement of each part: `errors` and `nominal` (visits,
    features, 3) mm, nan where a feature was not measured; `part` and `operation` (visits,) are
    codes, `of_point` (n,) the visit of each point. A visit is one repeat of one part in one
    operation: repeats by their number or, without one, in the order of the file, after those with a
    number.
    """

    part: IntArray
    operation: IntArray
    errors: FloatArray
    nominal: FloatArray
    of_point: IntArray


def visits_of(points: Points) -> Visits:
    """Gathers points into visits.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    _, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    run = operation.astype(np.int64) * parts + points.part
    repeat, unnamed = points.repeat.copy(), points.repeat < 0
    if unnamed.any():
        # Counted on from the largest that is given.
        place = (run * features + points.feature)[unnamed]
        repeat[unnamed] = max(int(repeat.max()), -1) + 1 + occurrence(place)
    numbers, code = distinct(repeat)
    runs, visit = distinct(run * len(numbers) + code)
    place = visit * features + points.feature
    if np.bincount(place).max() > 1:
        check_repeats(points)
    # Axis by axis, as the points lie in memory.
    errors = np.full((3, len(runs) * features), np.nan)
    nominal = np.full((3, features), np.nan)
    for axis, (measured, at) in enumerate(zip(points.measured.T, points.nominal.T, strict=True)):
        nominal[axis, points.feature] = at
        if not np.isnan(measured).all():
            errors[axis, place] = measured - at
    run_of = runs // len(numbers)
    return Visits(
        part=run_of % parts,
        operation=run_of // parts,
        of_point=visit,
        errors=np.moveaxis(errors.reshape(3, len(runs), features), 0, 2),
        nominal=nominal.T,
    )


def only_features(points: Points, names: Iterable[str]) -> Points:
    """The points of some features; parts and operations keep their codes."""
    index = {name: code for code, name in enumerate(points.features)}
    codes = [index[name] for name in dict.fromkeys(names) if name in index]
    code = np.full(len(points.features), -1)
    code[codes] = np.arange(len(codes))
    feature = code[points.feature]
    rows = np.flatnonzero(feature >= 0)
    features = tuple(points.features[i] for i in codes)
    return replace(points.where(rows), features=features, feature=feature[rows])


def check_repeats(points: Points) -> None:
    """Raises InputError for a feature that stands twice in one repeat of one part, every such row.

    Repeats without a number are counted on, and none of them stands twice.
    """
    import pandas as pd

    columns = points.operation, points.part, points.feature, points.repeat
    table = pd.DataFrame(dict(enumerate(columns)), copy=False)
    twice = np.flatnonzero(table.duplicated() & (points.repeat >= 0))
    if not len(twice):
        return
    what, expected = "the feature in one repeat of one part", "one row a feature and `repeat`"
    raise InputError(
        finding(
            "appears-twice",
            what=what,
            column="feature",
            value=points.features[points.feature[i]],
            expected=expected,
            **points.place(i),
        )
        for i in twice[:LISTED_FAULTS]
    )


def aligned(points: Points, axes: tuple[int, ...], datum: Datum) -> Points:
    """The points with best-fit alignment removed from each visit."""
    if datum == "none" or not axes:
        return points
    chosen = list(axes)
    errors = points.measured[:, chosen] - points.nominal[:, chosen]
    measured = points.measured.copy()
    measured[:, chosen] = points.nominal[:, chosen] + datum_errors(points, errors, axes, datum)[0]
    return replace(points, measured=measured)


def datum_errors(
    points: Points, errors: FloatArray, axes: tuple[int, ...], datum: Datum
) -> tuple[FloatArray, BoolArray]:
    """Errors (n, A) of the points less each visit's best-fit motion, and those (n,) that it removes
    entirely.
    """
    if datum == "none" or not axes:
        return errors, np.zeros(len(errors), bool)
    visits = visits_of(points)
    at, shape = (visits.of_point, points.feature), (len(visits.part), len(points.features))
    return aligned_errors(errors, points.nominal, at, shape, axes, datum)


@dataclass(frozen=True, kw_only=True)
class Cells:
    """The cells of P `parts` x H `features` that n measurements fall into, each by its codes `part`
    and `column` (n,); their `nominal` places (n, 3) mm. `operation` (H,) are codes of `operations`.
    """

    parts: tuple[str, ...]
    features: tuple[str, ...]
    operations: tuple[str, ...] = ("",)
    operation: IntArray
    part: IntArray
    column: IntArray
    nominal: FloatArray

    @cached_property
    def shape(self) -> tuple[int, int]:
        """(P, H)."""
        return len(self.parts), len(self.features)

    @cached_property
    def cell(self) -> IntArray:
        """The number of the cell (n,) of each measurement, part by part."""
        return self.part.astype(np.int64) * len(self.features) + self.column

    def means(self, values: FloatArray) -> FloatArray:
        """Means (P, H, ...) of values (n, ...), nan where there are none; equal values keep their
        digits.
        """
        means = group_means(values, self.cell, math.prod(self.shape))
        return means.reshape(*self.shape, *values.shape[1:])

    @cached_property
    def repeats(self) -> IntArray:
        """Measurements in every cell, (P, H)."""
        return np.bincount(self.cell, minlength=math.prod(self.shape)).reshape(self.shape)
