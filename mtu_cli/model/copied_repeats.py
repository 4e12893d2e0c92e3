"""Repeats of a part that are copies of each other: all their values agree, to the last digit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mtu_cli.errors import Warned
from mtu_cli.files.points import Points
from mtu_cli.files.row_marks import fingerprints, row_marks
from mtu_cli.findings import Finding
from mtu_cli.model.copied_parts import CHANCE, FEWEST_COPIED, MOST_ALIKE
from mtu_cli.model.resolution import last_digit
from mtu_cli.model.visits import IntArray, numbered, operations_of
from mtu_cli.stats.least_squares import FloatArray

LEAST_U_MM = 5e-5
"""No CMM repeats better than to 0.05 um."""
ALL_AGREE = 3.0
"""Normal readings of standard deviation s, n of one place, lie d s apart in the mean, d =
`_mean_range`: rounded to steps of h >> s they differ in d s/h of all cases. Places that all agree
do so once in twenty (e^-3) where s is ALL_AGREE h over the sum of their d."""
QUIET = 3.0
"""A part may repeat so many times better than the others: it was clamped better, or measured by
night."""
COUNTS = (
    "a copy counts as a measurement without scatter, so that the CMM seems better and the mean "
    "surer than they are"
)


class _Repeats(NamedTuple):
    """`of_point` (n,): the measurement of a part in one operation; of each (m,): its `run` (part
    and operation), and the earlier measurement of the run with equal values, itself if none.
    """

    of_point: IntArray
    run: IntArray
    twin: IntArray


def copied_repeats(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """One warning of repeats with the values of an earlier one of their part in all features.

    Two repeats of other parts tell how often that is chance: a coarse last digit makes equal
    values by itself. Where all agree, what the CMM would have to repeat to does.
    """
    found = _repeats(points, axes)
    if found is None:
        return []
    m = np.arange(len(found.run))
    size = np.bincount(found.of_point, minlength=len(m)) * len(axes)
    copies = np.flatnonzero((found.twin != m) & (size >= FEWEST_COPIED))
    if not len(copies):
        return []
    count = np.bincount(found.run)
    shares = _agreeing(points, axes, found)
    if shares is None:
        return _all_agree(points, axes, found, size)
    pairs = float((count * (count - 1) / 2).sum())
    sure = copies[pairs * shares ** size[copies] < CHANCE]
    return [_warned(points, found, sure)] if len(sure) else []


def _repeats(points: Points, axes: tuple[int, ...]) -> _Repeats | None:
    """None where no feature of a part was measured twice in an operation."""
    _, operation = operations_of(points)
    run = operation.astype(np.int64) * len(points.parts) + points.part
    cell = run * len(points.features) + points.feature
    if np.bincount(cell).max(initial=0) < 2:
        return None
    # Repeats may be numbered by ticks of a clock: with the runs these are no 64 bits.
    numbers, repeat = _coded(numbered(points.repeat, cell))
    span = len(numbers)
    there, of_point = _coded(run * span + repeat)
    columns = [points.feature, *(points.measured[:, axis] for axis in axes)]
    marks = fingerprints(columns, of_point, len(there))
    own = there // span
    _, first, same = np.unique(row_marks([own, *marks.T]), return_index=True, return_inverse=True)
    return _Repeats(of_point, own, first[same.reshape(-1)])


def _coded(key: IntArray) -> tuple[IntArray, IntArray]:
    """The different values of `key` (n,) in order, and which of them each is."""
    most = int(key.max()) + 1
    if most > 4 * len(key):
        there, code = np.unique(key, return_inverse=True)
        return there, code.reshape(-1)
    # By counting: several times quicker than sorting.
    there = np.flatnonzero(np.bincount(key))
    number = np.zeros(most, np.int64)
    number[there] = np.arange(len(there))
    return there, number[key]


def _agreeing(points: Points, axes: tuple[int, ...], found: _Repeats) -> float | None:
    """How often a value of two repeats that are no copies agrees: of all, were they QUIET times
    quieter, or of those that are most alike, whichever is more often. None where all are copies.

    Repeats that follow each other are held against each other, one pair more than there are.
    """
    honest = found.twin == np.arange(len(found.twin))
    rows = np.flatnonzero(honest[found.of_point])
    cell = found.run[found.of_point[rows]] * len(points.features) + points.feature[rows]
    order = np.lexsort((found.of_point[rows], cell))
    rows, cell = rows[order], cell[order]
    pair = np.flatnonzero(cell[1:] == cell[:-1])
    if not len(pair):
        return None
    values = points.measured[rows][:, axes]
    alike = (values[pair] == values[pair + 1]).sum(axis=1)
    # All values of one measurement beside the one before it.
    later = found.of_point[rows[pair + 1]]
    n = np.bincount(later) * len(axes)
    share = np.where(n >= FEWEST_COPIED, np.bincount(later, alike) / np.maximum(n, 1), 0.0)
    p = (float(alike.sum()) + 1) / (float(n.sum()) + 1)
    # Agreement goes with 1/s where it is rare, and its lack with s where that is.
    return max(min(QUIET * p, 1 - (1 - p) / QUIET), float(share.max()))


def _mean_range(count: IntArray) -> FloatArray:
    """The mean range d (n,) of so many (n,) normal readings of standard deviation 1: the integral
    of 1 - P^count - (1 - P)^count (Tippett, Biometrika 17 (1925) 364).
    """
    from scipy.special import ndtr

    step = 0.01
    p = ndtr(np.arange(-8.0, 8.0, step))
    counts, place = np.unique(count, return_inverse=True)
    found = [step * float((1 - p**n - (1 - p) ** n).sum()) for n in counts.tolist()]
    return np.array(found)[place.reshape(-1)]


def _all_agree(
    points: Points, axes: tuple[int, ...], found: _Repeats, size: IntArray
) -> list[Finding]:
    """Of repeats that all agree, each in its `size` (m,) of values: what would be said of the CMM,
    or nothing where a CMM may repeat as well as that.
    """
    step = max(last_digit(points.measured[:, axis]) for axis in axes)
    values = int(size[found.twin != np.arange(len(found.twin))].sum())
    first, alike = np.unique(found.twin, return_counts=True)
    bound = ALL_AGREE * step / float((size[first] * _mean_range(alike)).sum())
    if bound >= LEAST_U_MM:
        return []
    text = (
        f"all repeats have the same values as the one before, to the last digit "
        f"({1e3 * step:.2g} um): with {values} values the CMM would repeat to within "
        f"{1e3 * bound:.1g} um. Were they copied? {COUNTS[0].upper()}{COUNTS[1:]}"
    )
    return [Warned(code="repeats-alike", message=text)]


def _warned(points: Points, found: _Repeats, copies: IntArray) -> Finding:
    """The copies, the first few of them by part and rows."""
    named = []
    for copy in copies[:MOST_ALIKE].tolist():
        first, later = (
            int(np.flatnonzero(found.of_point == i)[0]) for i in (found.twin[copy], copy)
        )
        named.append(
            f"part {points.parts[points.part[later]]!r}, {_place(points, later)} on, as "
            f"{_place(points, first)} on"
        )
    more = f" and {len(copies) - MOST_ALIKE} more" if len(copies) > MOST_ALIKE else ""
    one = len(copies) == 1
    text = (
        f"{'a repeat has' if one else f'{len(copies)} repeats have'} the values of an earlier one "
        f"in all features, to the last digit, where others differ: {'; '.join(named)}{more}. "
        f"{'Was it' if one else 'Were they'} copied? {COUNTS[0].upper()}{COUNTS[1:]}"
    )
    return Warned(code="repeats-alike", message=text)


def _place(points: Points, i: int) -> str:
    return f"{points.sources[points.file_index[i]].shown}, row {points.row[i]}"
