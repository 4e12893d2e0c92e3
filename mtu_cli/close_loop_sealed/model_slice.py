"""Readings and measured points as cells of passes or parts by columns: what only the loop needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.passes import IntArray, Passes, passes_read
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class Cells:
    """The cells of `parts` x `columns` that n measurements fall into; `cell` (n,) is
    part * columns + column.

    `order` (n,) sorts the measurements by cell, `starts` and `count` (m,) are the runs of the m
    cells that hold any, `there` (m,) their numbers.
    """

    parts: int
    columns: int
    cell: IntArray
    order: IntArray
    starts: IntArray
    count: IntArray
    there: IntArray

    @cached_property
    def first(self) -> IntArray:
        """The first measurement of each of the m cells."""
        return self.order[self.starts]

    @cached_property
    def index(self) -> IntArray:
        """The place (n,) of each measurement's cell among the m."""
        place = np.zeros(self.parts * self.columns, np.int64)
        place[self.there] = np.arange(len(self.there))
        return place[self.cell]

    @property
    def part(self) -> IntArray:
        """The part of each measurement."""
        return self.cell // self.columns

    @property
    def column(self) -> IntArray:
        """The column of each measurement."""
        return self.cell % self.columns

    def means(self, values: FloatArray) -> FloatArray:
        """Means (m, ...) of values (n, ...); equal values keep their digits."""
        ordered = values[self.order]
        origin = ordered[self.starts]
        if len(self.starts) == len(ordered):
            return origin
        away = ordered - np.repeat(origin, self.count, axis=0)
        weight = self.count.reshape(-1, *(1,) * (values.ndim - 1))
        found: FloatArray = origin + np.add.reduceat(away, self.starts, axis=0) / weight
        return found

    def squares(self, values: FloatArray) -> FloatArray:
        """Sums (...) over all cells of the squares of values (n, ...) about their cell's mean."""
        left = values - self.means(values)[self.index]
        found: FloatArray = (left**2).sum(axis=0)
        return found

    def table(self, means: FloatArray, fill: float = np.nan) -> FloatArray:
        """Values (m, ...) of the cells as (parts, columns, ...), `fill` where there is none."""
        found = np.full((self.parts * self.columns, *means.shape[1:]), fill, means.dtype)
        found[self.there] = means
        return found.reshape(self.parts, self.columns, *means.shape[1:])

    @cached_property
    def repeats(self) -> IntArray:
        """Measurements in every cell, (parts, columns)."""
        return np.bincount(self.cell, minlength=self.parts * self.columns).reshape(
            self.parts, self.columns
        )


def cells_of(part: IntArray, column: IntArray, parts: int, columns: int) -> Cells:
    """Gathers measurements by their codes `part` and `column` (n,)."""
    cell = part.astype(np.int64) * columns + column
    order = np.argsort(cell, kind="stable")
    ordered = cell[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    return Cells(
        parts=parts,
        columns=columns,
        cell=cell,
        order=order,
        starts=starts,
        count=np.diff(np.r_[starts, len(cell)]),
        there=ordered[starts],
    )


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
    group, passes = passes_read(readings, rows, of)
    target, labels = _targets(readings, rows, of, name)
    sign = np.zeros(len(rows), int) if of is None else readings.direction[rows].astype(int)
    # Forward first, as the passes of a fit are.
    columns, column = np.unique(target * 3 + (1 - sign), return_inverse=True)
    signs = 1 - columns % 3
    several = len(np.unique(signs)) > 1
    names = _row_names(readings, passes)
    # Runs, in their order, that two numbers of passes are of.
    numbered = {(int(run), key[:2]) for run, key in zip(passes.runs, passes.keys, strict=True)}
    of_two = [a for (a, _), (b, _) in pairwise(sorted(numbered)) if a == b]
    return ReadingLayout(
        passes=names,
        pairs=tuple(names[run] for run in of_two),
        columns=tuple(
            f"{labels[k // 3]} {SIGNS[int(sign)]}".rstrip() if several else labels[k // 3]
            for k, sign in zip(columns.tolist(), signs, strict=True)
        ),
        direction=signs,
        cells=cells_of(passes.runs[group], column.reshape(-1), len(names), len(columns)),
    )


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
    for digits in (6, 9, 12, 17):
        found = [f"{value:.{digits}g}" for value in means]
        if len(set(found)) == len(found):
            break
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitScatter:
    """`variance` (A,), mm^2, of one visit by axis, the mean over the features: what s_repeat of
    the components makes of it; `dof` are the fewest that any of these is known with.
    """

    variance: FloatArray
    dof: float


def visit_scatter(model: MachineModel, at: Prediction, own: Sequence[int]) -> VisitScatter:
    """Of the features of a prediction `at`, along `own` of the model's axes."""
    variance = at.variance().repeatability.reshape(-1, len(at.axes))[:, list(own)]
    dof = [t.estimate.repeat_dof for t in model.terms if t.estimate.s_repeat > 0]
    return VisitScatter(variance=np.mean(variance, axis=0), dof=float(min(dof, default=np.inf)))
