"""Passes and runs: which there are, and what is shared between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.stats.least_squares import FloatArray, IntArray

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
    starts, ends = _least(group, times, G), -_least(group, -times, G)
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


def _least(code: IntArray, values: FloatArray | IntArray, count: int) -> FloatArray:
    """The least of the `values` (n,) of each of `count` codes, nan where one of them is."""
    result = np.full(count, np.inf)
    with np.errstate(invalid="ignore"):
        np.minimum.at(result, code, values)
    return result


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
    least, most = _least(index, sign, count), -_least(index, -sign, count)
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
    in_time = np.argsort(_least(code, rank, len(numbered)), kind="stable")
    run = np.arange(len(numbered))
    for file in np.unique(files):
        order = in_time[files[in_time] == file]
        if way[order].all():
            for there, back in pairs_of_passes(numbered[order, 1], way[order]):
                run[order[back]] = run[order[there]]
    labels = np.unique(np.array(setups, dtype=object), return_inverse=True)[1]
    both = np.column_stack([run[code], labels.reshape(-1)])
    group = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)
    start = _least(group, rank, len(keys))[group]
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
