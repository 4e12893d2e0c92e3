"""Readings of one component as passes and targets: the rows and columns of their table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.model.passes import Passes, passes_of
from mtu_cli.model.residual_cells import Cells, IntArray, cells_of
from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-4
"""Positions within this share of the travel are one target, recorded as it was reached."""
SIGNS = {1: "+", -1: "-", 0: ""}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingLayout:
    """`passes` in order of time, `columns` named by target and direction, whose sign is
    `direction` (H,). `pairs` are those of the passes that are two, one there and one back.
    """

    passes: tuple[str, ...]
    pairs: tuple[str, ...]
    columns: tuple[str, ...]
    direction: IntArray
    cells: Cells


def reading_layout(readings: Readings, rows: IntArray, of: str | None, name: str) -> ReadingLayout:
    """The readings `rows` (n,) of the component `name`, a function of the axis `of`.

    A pass is one number of one file, in one direction where it is not a run there and back.
    Without an axis every reading without a number is a pass of its own; with one they are
    repeats of pass 0.
    """
    sign = np.zeros(len(rows), np.int64) if of is None else readings.direction[rows].astype(int)
    has = readings.has_pass[rows]
    numbers = np.where(has, readings.pass_number[rows], 0)
    if of is None and not has.all():
        numbers = np.arange(1, len(rows) + 1)
    group, passes = passes_of(readings, rows, numbers, sign)
    target, labels = _targets(readings, rows, of, name)
    # Forward first, as the passes of a fit are.
    columns, column = np.unique(target * 3 + (1 - sign), return_inverse=True)
    signs = 1 - columns % 3
    several = len(np.unique(signs)) > 1
    names = _row_names(readings, passes)
    return ReadingLayout(
        passes=names,
        pairs=tuple(names[run] for run in _of_two(passes)),
        columns=tuple(
            f"{labels[k // 3]} {SIGNS[int(sign)]}".rstrip() if several else labels[k // 3]
            for k, sign in zip(columns.tolist(), signs, strict=True)
        ),
        direction=signs,
        cells=cells_of(passes.runs[group], column.reshape(-1), len(names), len(columns)),
    )


def _of_two(passes: Passes) -> list[int]:
    """Runs, in their order, that two numbers of passes are of."""
    numbered = {(int(run), key[:2]) for run, key in zip(passes.runs, passes.keys, strict=True)}
    runs = [run for run, _ in sorted(numbered)]
    return [a for a, b in pairwise(runs) if a == b]


def _row_names(readings: Readings, passes: Passes) -> tuple[str, ...]:
    """The passes of each run by their numbers, in their order; with their file where two files
    have the same, and their direction where that alone tells two runs apart.
    """
    numbered = list(dict.fromkeys(key[:2] for key in passes.keys))
    twice = len({number for _, number in numbered}) < len(numbered)
    shown = {
        key: f"{readings.sources[key[0]].shown} {key[1]}" if twice else str(key[1])
        for key in numbered
    }
    found: list[dict[str, None]] = [{} for _ in range(int(passes.runs.max(initial=-1)) + 1)]
    ways: list[int] = [0] * len(found)
    for g in np.argsort(passes.order).tolist():
        run, key = passes.runs[g], passes.keys[g]
        found[run][shown[key[:2]]] = None
        ways[run] = key[2]
    names = ["/".join(own) for own in found]
    if len(set(names)) < len(names):
        names = [f"{name} {SIGNS[way]}".rstrip() for name, way in zip(names, ways, strict=True)]
    return tuple(names)


def _targets(
    readings: Readings, rows: IntArray, of: str | None, name: str
) -> tuple[IntArray, list[str]]:
    """The target of each reading, ascending, and the targets' names."""
    if of is None:
        return np.zeros(len(rows), np.int64), [name]
    position = readings.position_mm[rows]
    distinct, code = np.unique(position, return_inverse=True)
    group = _groups(distinct)
    target = group[code.reshape(-1)]
    count = np.bincount(target)
    means = np.bincount(target, position) / count
    labels = _labels(means)
    return target, labels


def _groups(distinct: FloatArray) -> IntArray:
    """The target of each distinct position; each its own where targets would run together."""
    alone = np.arange(len(distinct))
    near = SAME * float(np.ptp(distinct)) if len(distinct) else 0.0
    group = np.cumsum(np.r_[0, np.diff(distinct) > near])
    first = np.searchsorted(group, np.arange(group[-1] + 1))
    last = np.r_[first[1:], len(distinct)] - 1
    return group if (distinct[last] - distinct[first] <= 3 * near).all() else alone


def _labels(means: FloatArray) -> list[str]:
    """Positions with as many digits as tell them apart."""
    for digits in (6, 9, 12):
        found = [f"{value:.{digits}g}" for value in means]
        if len(set(found)) == len(found):
            return found
    return [repr(float(value)) for value in means]
