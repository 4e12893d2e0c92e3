"""The passes of a component's readings: their order in time, their set-ups and their runs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.runs import one_way_files, runs_of, ways
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.readings import Readings

IntArray = NDArray[np.int64]
PassKey = tuple[int, int, int]
"""(file, pass, direction)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Passes:
    """`keys` name the G passes; `order` (G,) is their sequence in time, `timed` that it was read
    rather than assumed; `starts` and `ends` (G,) their first and last time in min, nan or infinite
    where not given; `setups` their set-ups, `runs` (G,) the run there and back of each, numbered
    in time.
    """

    keys: tuple[PassKey, ...]
    order: IntArray
    timed: bool
    starts: FloatArray
    ends: FloatArray
    setups: tuple[str, ...]
    runs: IntArray

    @property
    def timed_each(self) -> bool:
        """Whether every pass has its times, of whatever clock."""
        return bool(np.isfinite(self.starts).all())

    def only(self, kept: IntArray) -> Passes:
        """The passes `kept` (m,)."""
        return Passes(
            keys=tuple(self.keys[g] for g in kept),
            order=self.order[kept],
            timed=self.timed,
            starts=self.starts[kept],
            ends=self.ends[kept],
            setups=tuple(self.setups[g] for g in kept),
            runs=self.runs[kept],
        )

    def files_in_turn(self, unit: IntArray) -> bool:
        """Whether some units, `unit` (G,) that of each pass, are of other files than others: where
        each has a pass of every file no order of the files changes the mean time of a unit.
        """
        files: dict[int, set[int]] = {}
        for (file, _, _), own in zip(self.keys, unit, strict=True):
            files.setdefault(int(own), set()).add(file)
        return len({frozenset(own) for own in files.values()}) > 1


def passes_of(
    readings: Readings, rows: IntArray, numbers: IntArray, sign: IntArray
) -> tuple[IntArray, Passes]:
    """The pass of each of the readings `rows` (n,), whose pass numbers and directions are `numbers`
    and `sign` (n,), and the passes: one (file, number, direction), forward before reverse.

    Files number their passes on their own: pass 1 of two days is two passes.
    """
    triples = np.column_stack([readings.file_index[rows], numbers, -sign]).astype(np.int64)
    order = np.lexsort(triples.T[::-1])
    ordered = triples[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.empty(len(rows), np.int64)
    group[order] = np.cumsum(new) - 1
    keys = ordered[new] * np.array([1, 1, -1])
    starts, ends = _times(readings.time_min[rows], group, len(keys))
    timed = _one_clock(keys, starts, ends)
    # Without a clock a pass goes forward first: the order of rows is not to matter.
    sequence = np.argsort(starts, kind="stable") if timed else np.arange(len(keys))
    rank = np.empty(len(keys), np.int64)
    rank[sequence] = np.arange(len(keys))
    setups = [""] * len(keys)
    labels = readings.covariates.get("setup")
    if labels is not None:
        _, first = np.unique(group, return_index=True)
        setups = [str(label) for label in labels[rows[first]]]
    return group, Passes(
        keys=tuple((file, number, way) for file, number, way in keys.tolist()),
        order=rank,
        timed=timed,
        starts=starts,
        ends=ends,
        setups=tuple(setups),
        runs=_runs(keys, rank, setups),
    )


def _times(times: FloatArray, group: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    starts, ends = np.full(count, np.inf), np.full(count, -np.inf)
    # One reading without a time (nan) leaves its pass without.
    with np.errstate(invalid="ignore"):
        np.minimum.at(starts, group, times)
        np.maximum.at(ends, group, times)
    return starts, ends


def _one_clock(keys: IntArray, starts: FloatArray, ends: FloatArray) -> bool:
    """Whether every pass (G,) has its times, and the files share a clock.

    Files whose times overlap were each counted from their own start; but those of one direction
    take turns with those of the other: of these the passes are compared.
    """
    if not np.isfinite(starts).all():
        return False
    file = keys[:, 0]
    if one_way_files(file, keys[:, 2]).all():
        file = np.where(np.ptp(file) > 0, np.arange(len(keys)), 0)
    spans = sorted((starts[file == f].min(), ends[file == f].max()) for f in np.unique(file))
    return all(later[0] > earlier[1] for earlier, later in pairwise(spans))


def _runs(keys: IntArray, rank: IntArray, setups: list[str]) -> IntArray:
    """The run there and back of each pass (G,); two passes of a run are of one set-up."""
    numbered, code = np.unique(keys[:, :2], axis=0, return_inverse=True)
    code = code.reshape(-1)
    first = np.full(len(numbered), len(keys))
    np.minimum.at(first, code, rank)
    in_time = np.argsort(first, kind="stable")
    run = runs_of(numbered, in_time, ways(code, keys[:, 2], len(numbered)))[code]
    _, label = np.unique(np.array(setups, dtype=object), return_inverse=True)
    both = np.column_stack([run, label.reshape(-1)])
    own = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)
    start = np.full(len(keys), len(keys))
    np.minimum.at(start, own, rank)
    return np.unique(start[own], return_inverse=True)[1].reshape(-1)
