"""Passes and runs: which there are, and what is shared between them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.readings import Readings
from mtu_cli.stats.least_squares import FloatArray

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


Fellows = list[tuple[int, int]]
"""Places (earlier, later) of two passes of a run."""


def ways(code: IntArray, sign: IntArray, count: int) -> IntArray:
    """The direction (m,) of each pass; 0 where it runs both ways, or in none that is told."""
    least, most = np.full(count, 2), np.full(count, -2)
    np.minimum.at(least, code, sign)
    np.maximum.at(most, code, sign)
    return np.where(least == most, least, 0)


def one_way_files(file: IntArray, way: IntArray) -> NDArray[np.bool_]:
    """(m,) whether every pass of the pass's file runs in one and the same direction."""
    _, code = np.unique(file, return_inverse=True)
    whole = ways(code.reshape(-1), way, int(code.max(initial=-1)) + 1)
    found: NDArray[np.bool_] = whole[code.reshape(-1)] != 0
    return found


def runs_of(keys: IntArray, order: IntArray, way: IntArray) -> IntArray:
    """The run (m,) of each pass (file, number) in `keys` (m, 2), in their `order` in time.

    A pass that runs both ways is one. Where every pass of a file runs one way only (`way`, see
    `ways`), one there and one back are a run: what differs between the directions could not be
    told from what differs between passes. Files that hold one direction only are read as one:
    one file a pass, or one a direction.
    """
    first = np.empty(len(keys), np.int64)
    first[order] = np.arange(len(keys))
    files = np.where(one_way_files(keys[:, 0], way), -1, keys[:, 0])
    for file in np.unique(files):
        own = order[files[order] == file]
        if way[own].all():
            for a, b in fellows(keys[own, 1], way[own]):
                first[own[b]] = first[own[a]]
    return np.unique(first, return_inverse=True)[1].reshape(-1)


def fellows(number: IntArray, way: IntArray) -> Fellows:
    """Places of the pairs of one there and one back in a sequence of passes.

    By their `number`, so that a pass that is missing leaves its fellow alone, and nobody else:
    1 there, 2 back, 3 there; or all there before all back, in one count or each in its own, of
    which the second may run down. Else neighbours, or the n-th of each of two blocks, whichever
    finds more.
    """
    if (np.diff(number) > 0).all():
        return _of_one_count(number, way)
    pieces = _pieces(number, way)
    found = _paired(pieces, number, way)
    starts = {int(number[own[0]]) for own in pieces}
    anew = len(starts) == 1 and all(len(own) > 1 and np.diff(way[own]).all() for own in pieces)
    if not anew and len(set(zip(number.tolist(), way.tolist(), strict=True))) == len(way):
        # No number stands twice in a direction, and no day of both begins as the others do: it
        # may be one day that counts in its own way.
        whole = _paired([np.arange(len(number))], number, way)
        found = max(found, whole, key=len)
    return found


def _paired(pieces: list[IntArray], number: IntArray, way: IntArray) -> Fellows:
    found: Fellows = []
    for own in pieces:
        pairs = _alike(number[own], way[own])
        if not _most(pairs, way[own]):
            pairs = max(pairs, _neighbours(way[own]), _blocks(own - own[0], way[own]), key=len)
        found += [(int(own[i]), int(own[j])) for i, j in pairs]
    return found


def _pieces(number: IntArray, way: IntArray) -> list[IntArray]:
    """Places of passes among which fellows are looked for: two blocks of a direction each that
    have most of their numbers in common, or files of one direction each, or days.
    """
    every = np.arange(len(number))
    blocks = np.split(every, np.flatnonzero(np.diff(way)) + 1)
    two = [np.concatenate(pair) for pair in zip(blocks[::2], blocks[1::2], strict=False)]
    if len(blocks) % 2 == 0 and all(_most(_alike(number[o], way[o]), way[o]) for o in two):
        return two
    counts = np.split(every, np.flatnonzero(np.diff(number) <= 0) + 1)
    there = [own for own in counts if (way[own] > 0).all()]
    back = [own for own in counts if (way[own] < 0).all()]
    if len(there) == len(back) == len(counts) / 2:
        # Of one day or several: the n-th there with the n-th back.
        return [np.sort(np.concatenate(pair)) for pair in zip(there, back, strict=True)]
    return _days(number, way)


def _most(pairs: Fellows, way: IntArray) -> bool:
    """Whether more than half of those that might have a fellow have one: no coincidence."""
    return 2 * len(pairs) > min(int(np.sum(way > 0)), int(np.sum(way < 0)))


def _of_one_count(number: IntArray, way: IntArray) -> Fellows:
    """Of numbers that ascend, from 1 or 0; from where they begin if more then find a fellow."""
    counts = [number - min(1, int(number[0])), number - int(number[0])]
    if len(np.unique(way * (1 - 2 * (number % 2)))) == 1:
        return max((_turns(place) for place in counts), key=len)
    blocks = [_blocks(place, way) for place in (*counts, np.arange(len(way)))]
    return max([_neighbours(way), *blocks], key=len)


def _days(number: IntArray, way: IntArray) -> list[IntArray]:
    """Places of the passes of each count of both directions: a new one begins with a number and
    direction that stood before, or with a lower number once both directions are there.
    """
    if (np.diff(number) < 0).all():
        return [np.arange(len(number))]
    seen: set[tuple[int, int]] = set()
    begins, last = [], 0
    for i, key in enumerate(zip(number.tolist(), way.tolist(), strict=True)):
        if key in seen or (key[0] < last and len({sign for _, sign in seen}) == 2):
            begins.append(i)
            seen = set()
        seen.add(key)
        last = key[0]
    return np.split(np.arange(len(number)), begins)


def _alike(number: IntArray, way: IntArray) -> Fellows:
    """Passes of one number, where each direction counts its own."""
    if len(np.unique(np.column_stack([number, way]), axis=0)) < len(number):
        return []
    order = np.argsort(number, kind="stable")
    same = np.flatnonzero(number[order][1:] == number[order][:-1])
    return [(int(order[i]), int(order[i + 1])) for i in same]


def _turns(place: IntArray) -> Fellows:
    """Places 2r and 2r + 1 of a count whose even places all go one way, the odd ones the other."""
    run = place // 2
    return [(int(i), int(i) + 1) for i in np.flatnonzero(run[1:] == run[:-1])]


def _neighbours(way: IntArray) -> Fellows:
    """Neighbours of which the first goes one way, the second the other; the way of the first of
    all, or its opposite where that finds more.
    """
    turns = np.flatnonzero(way[1:] != way[:-1])
    found = [[(int(i), int(i) + 1) for i in turns if way[i] == sign] for sign in (way[0], -way[0])]
    return max(found, key=len)


def _blocks(place: IntArray, way: IntArray) -> Fellows:
    """The n-th of each of two blocks of one direction each, which are equally long if none of
    their places is missing; else in the order that they stand in.
    """
    ends = [*np.flatnonzero(way[1:] != way[:-1]).tolist(), len(way) - 1]
    found: Fellows = []
    begin, start = 0, 0
    for middle, end in zip(ends[::2], ends[1::2], strict=False):
        half = (int(place[end]) - start + 2) // 2
        if place[middle] < start + half <= place[middle + 1]:
            at = {int(place[i]) - start: i for i in range(begin, middle + 1)}
            later = [(int(place[i]) - start - half, i) for i in range(middle + 1, end + 1)]
            found += [(at[n], i) for n, i in later if n in at]
        else:
            found += list(zip(range(begin, middle + 1), range(middle + 1, end + 1), strict=False))
        begin, start = end + 1, int(place[end]) + 1
    return found
